"""Photos to learn from: images with masks, annotation files or recordings, in codes (see data.py)."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.errors import ConfigError, InputError
from swardmap.io.annotations.annotation_files import read_masks
from swardmap.io.images import read_mask
from swardmap.labels import GRASS_OBSTACLE_PERSON, VOID_ID, LabelSet, Role
from swardmap.train.augment import Image
from swardmap.train.recipe import DataConfig, NetworkConfig
from swardmap.types import Frame

FREE_CODE = 50
PSEUDO_CODE = 100
OBSTACLE_CODE = 150
PARTIAL_CODE = 200
SMALL_CODE = 250
SMALL_SHARE = 0.01
"""Of the image: an obstacle that covers less is small, such as a tool on the lawn."""
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")
LARGEST_EDGE = 640  # of images kept in memory


@dataclass(eq=False)
class Photo:
    """One image with its codes, kept in memory.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        codes: (H, W) uint8.
        fine: (H, W) uint8 ids of the finer classes, 255 = void.
        stem: name.
        light: illumination, of a garden's frame.
    """

    image: Image
    codes: Image
    fine: Image
    stem: str
    light: str = ""


def read_photos(config: DataConfig, number: int, network: NetworkConfig, root: Path) -> list[Photo]:
    """Every photo of a data set with its codes.

    Args:
        config: the data set.
        number: its place in the recipe, for the codes of pixels that are known in part.
        network: whose classes the codes are of.
        root: data root.

    Raises:
        InputError: for a folder, list, image, mask or annotation file that is missing or damaged.
    """
    if config.kind == "recording":
        return [_of_frame(frame, config, number, network) for frame in _frames(config, root)]
    paths = image_paths(config, root)
    if config.annotations is None:
        return [_load(path, config, number, network, root, None) for path in paths]
    annotated = _annotated(config, network, root)
    return [_load(p, config, number, network, root, annotated) for p in paths if p.stem in annotated]


def image_paths(config: DataConfig, root: Path) -> list[Path]:
    """Images of a data set, sorted.

    Raises:
        InputError: for a missing folder, or a list that names what is not there.
    """
    folder = root / config.folder / config.images
    if not folder.is_dir():
        raise InputError(f"data set {config.name}: no such folder: {folder}")
    found = {p.stem: p for p in sorted(folder.iterdir()) if p.suffix.lower() in IMAGE_SUFFIXES}
    if config.list is None:
        return _held_out(list(found.values()), config)
    listing = root / config.folder / config.list
    if not listing.is_file():
        raise InputError(f"data set {config.name}: no such list: {listing}")
    stems = [line.strip() for line in listing.read_text(encoding="utf-8").splitlines() if line.strip()]
    lost = [s for s in stems if s not in found]
    if lost:
        raise InputError(f"data set {config.name}: {listing} names {lost[0]}, which is not in {folder}")
    return _held_out([found[s] for s in stems], config)


def _held_out(paths: list[Path], config: DataConfig) -> list[Path]:
    n = config.hold_out
    if n:
        paths = [p for i, p in enumerate(paths) if (i % n == n // 2) == config.validation]
    return paths[:: config.every]


def _annotated(config: DataConfig, network: NetworkConfig, root: Path) -> dict[str, Callable[[], Image]]:
    """Masks of an annotation file by the stem of their image; each is painted when it is called for."""
    file = root / config.folder / str(config.annotations)
    classes = dict(_pairs(config.classes, config, "person=person,*=void"))
    masks = read_masks(file, network.data_label_set, classes)
    by_stem: dict[str, Callable[[], Image]] = {}
    for name in masks:
        if Path(name).name in by_stem:
            raise InputError(f"data set {config.name}: {file} has two images named {Path(name).name}")
        by_stem[Path(name).name] = partial(masks.__getitem__, name)
    return by_stem


def _load(
    path: Path,
    config: DataConfig,
    number: int,
    network: NetworkConfig,
    root: Path,
    annotated: Mapping[str, Callable[[], Image]] | None,
) -> Photo:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR) if path.is_file() else None
    if image is None:
        raise InputError(f"cannot read the image {path}: missing or damaged")
    shape = image.shape[:2]
    base = root / config.folder
    mask = np.full(shape, VOID_ID, np.uint8)
    if annotated is not None:
        mask = _checked(annotated[path.stem](), shape, f"{config.annotations}: {path.stem}")
    elif config.labels is not None:
        mask = _mask(base / config.labels / f"{path.stem}{config.label_suffix}", shape)
    codes = _class_indices(config, network)[mask]
    pseudo_path = root / (config.pseudo or "") / f"{path.stem}.png"
    if config.pseudo is not None and pseudo_path.is_file():
        pseudo = read_mask(pseudo_path)
        pseudo = np.asarray(cv2.resize(pseudo, shape[::-1], interpolation=cv2.INTER_NEAREST), np.uint8)
        said = _index_table(GRASS_OBSTACLE_PERSON, network)[pseudo]
        codes = np.where((codes == VOID_ID) & (said != VOID_ID), said + np.uint8(PSEUDO_CODE), codes)
    fine = np.full(shape, VOID_ID, np.uint8)
    if config.fine is not None and network.auxiliary_classes:
        fine = _mask(base / config.fine / f"{path.stem}{config.label_suffix}", shape)
        fine = np.where(fine == 0, np.uint8(VOID_ID), fine)
    rgb = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
    return _shrunk(Photo(rgb, _of_set(codes, config, number, network), fine, path.stem), config.validation)


def _frames(config: DataConfig, root: Path) -> Iterator[Frame]:
    """Frames of a recording; where they say of which scene, whole scenes are held out, else single frames."""
    from swardmap.io import open_source

    scenes: dict[str, int] = {}
    for index, frame in enumerate(open_source(root / config.folder)):
        scene = frame.tags.get("scene")
        number = index if scene is None else scenes.setdefault(scene, len(scenes))
        n = config.hold_out
        if n and (number % n == n // 2) != config.validation:
            continue
        if index % config.every == 0:
            yield frame


def _of_frame(frame: Frame, config: DataConfig, number: int, network: NetworkConfig) -> Photo:
    if frame.labels is None or frame.label_set is None:
        raise InputError(f"data set {config.name}: frame {frame.name} has no true labels")
    codes = _index_table(frame.label_set, network)[frame.labels]
    fine = np.full(codes.shape, VOID_ID, np.uint8)
    light = frame.tags.get("illumination", "")
    if config.small_things and not config.validation:
        codes = np.where(small_obstacles(codes, network), np.uint8(SMALL_CODE), codes)
    photo = Photo(frame.rgb, _of_set(codes, config, number, network), fine, frame.name, light)
    return _shrunk(photo, config.validation)


def small_obstacles(codes: Image, network: NetworkConfig) -> NDArray[np.bool_]:
    """(H, W): obstacles that touch no other one and cover less than `SMALL_SHARE` of the image."""
    obstacle = np.asarray(codes == role_code(network, Role.OBSTACLE), np.uint8)
    _, piece, stats, _ = cv2.connectedComponentsWithStats(obstacle, connectivity=8)
    small = stats[:, cv2.CC_STAT_AREA] < SMALL_SHARE * codes.size
    small[0] = False  # what is no obstacle
    return np.asarray(small[piece], np.bool_)


def _of_set(codes: Image, config: DataConfig, number: int, network: NetworkConfig) -> Image:
    """Codes of the data set's own, where its void is known in part or some of its classes weigh otherwise."""
    if config.void_means:
        codes = np.where(codes == VOID_ID, np.uint8(PARTIAL_CODE + number), codes)
    own = (
        (config.obstacle_weight, Role.OBSTACLE, OBSTACLE_CODE),
        (config.free_weight, Role.FREE, FREE_CODE),
    )
    for weight, role, code in own:
        if weight != 1 and not config.validation:
            codes = np.where(codes == role_code(network, role), np.uint8(code + number), codes)
    return codes


def role_code(network: NetworkConfig, role: Role) -> int | None:
    """Code of a labelled pixel of the first class in that role; None for a network without one."""
    roles = {c.id: c.role for c in network.label_set.classes}
    return next((i for i, class_id in enumerate(network.trained_ids) if roles[class_id] is role), None)


def _class_indices(config: DataConfig, network: NetworkConfig) -> NDArray[np.uint8]:
    """(256,) uint8: id in the data set's masks -> index of the class, 255 = void."""
    names = network.data_label_set
    named = _index_table(names, network)
    if not config.ids:
        return named
    table = np.full(256, VOID_ID, np.uint8)
    for number, name in _pairs(config.ids, config, "0=other,1=grass"):
        if not number.isdigit() or not int(number) <= VOID_ID:
            raise ConfigError(
                f"data set {config.name}: expected ids as 0=other,1=grass, got '{number}={name}'"
            )
        table[int(number)] = named[names[name].id]
    return table


def _pairs(text: str, config: DataConfig, example: str) -> Iterator[tuple[str, str]]:
    """The pairs of `a=b,c=d`."""
    for entry in filter(None, (part.strip() for part in text.split(","))):
        key, sign, value = (part.strip() for part in entry.partition("="))
        if not (key and sign and value):
            raise ConfigError(f"data set {config.name}: expected pairs as {example}, got '{entry}'")
        yield key, value


def _index_table(source: LabelSet, network: NetworkConfig) -> NDArray[np.uint8]:
    """(256,) uint8: id of `source` -> index of the network's class, 255 = void."""
    index = np.full(256, VOID_ID, np.uint8)
    index[list(network.trained_ids)] = np.arange(len(network.trained_ids))
    return index[source.remap_table(network.label_set)]


def _shrunk(photo: Photo, keep: bool) -> Photo:
    height, width = photo.codes.shape
    factor = LARGEST_EDGE / max(height, width)
    if factor >= 1 or keep:
        return photo
    size = (round(width * factor), round(height * factor))
    masks = [cv2.resize(m, size, interpolation=cv2.INTER_NEAREST) for m in (photo.codes, photo.fine)]
    image = np.asarray(cv2.resize(photo.image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return replace(photo, image=image, codes=masks[0], fine=masks[1])


def _mask(path: Path, shape: tuple[int, ...]) -> Image:
    return _checked(read_mask(path), shape, str(path))


def _checked(mask: Image, shape: tuple[int, ...], where: str) -> Image:
    if mask.shape[:2] != shape:
        raise InputError(
            f"{where}: expected a mask of {shape[1]} x {shape[0]} as its image, got {mask.shape}"
        )
    return mask
