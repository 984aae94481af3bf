"""Images and masks to learn from: reading, mixing, and what a mask's pixel may mean.

A pixel need not be known exactly. Its *code* names a set of classes: one class (labelled), one class by
a teacher's word, some classes (a data set that knows persons but not grass), or any (void).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.errors import ConfigError, InputError
from swardmap.labels import GRASS_OBSTACLE_PERSON, VOID_ID, LabelSet, Role
from swardmap.train.augment import Image, Strength, paste, relight, warp
from swardmap.train.recipe import DataConfig, NetworkConfig, Recipe
from swardmap.types import Frame

PSEUDO_CODE = 100
PARTIAL_CODE = 200
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")
LARGEST_EDGE = 640  # of images kept in memory


@dataclass(frozen=True, eq=False)
class Codes:
    """What each code means.

    Attributes:
        sets: (256, C) bool, classes a pixel with that code may have; all of them for void.
        weights: (256,) float32, of such a pixel in the loss.
    """

    sets: NDArray[np.bool_]
    weights: NDArray[np.float32]


@dataclass(eq=False)
class Photo:
    """One image with its codes, kept in memory.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        codes: (H, W) uint8.
        fine: (H, W) uint8 ids of the finer classes, 255 = void.
        stem: name.
    """

    image: Image
    codes: Image
    fine: Image
    stem: str


@dataclass(eq=False)
class PhotoSet:
    """The photos of one DataConfig and how often each is drawn; `person` is the code of a person, if any."""

    config: DataConfig
    photos: list[Photo]
    person: int | None
    chances: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        boost = np.ones(len(self.photos))
        for index, photo in enumerate(self.photos):
            if self.person is not None and (photo.codes == self.person).mean() > 0.002:
                boost[index] = self.config.person_boost
        self.chances = boost / boost.sum()


def make_codes(recipe: Recipe) -> Codes:
    """The code table of a recipe: class index, 100 + class index (teacher), 200 + data set (partial)."""
    ids, names = recipe.network.trained_ids, recipe.network.label_set
    sets = np.ones((256, len(ids)), np.bool_)
    weights = np.zeros(256, np.float32)
    schedule = recipe.schedule
    for index, class_id in enumerate(ids):
        role = next(c.role for c in names.classes if c.id == class_id)
        weight = schedule.person_weight if role is Role.PERSON else 1.0
        for code, factor in ((index, 1.0), (PSEUDO_CODE + index, schedule.pseudo_weight)):
            sets[code] = np.arange(len(ids)) == index
            weights[code] = weight * factor
    for number, config in enumerate(recipe.data):
        if config.void_means:
            allowed = {names[name.strip()].id for name in config.void_means.split(",")}
            sets[PARTIAL_CODE + number] = [i in allowed for i in ids]
            weights[PARTIAL_CODE + number] = schedule.partial_weight
    return Codes(sets, weights)


def person_code(network: NetworkConfig) -> int | None:
    """Code of a labelled person; None for a network that does not tell persons apart."""
    roles = {c.id: c.role for c in network.label_set.classes}
    indices = [i for i, class_id in enumerate(network.trained_ids) if roles[class_id] is Role.PERSON]
    return indices[0] if indices else None


def load_photos(recipe: Recipe, root: Path, validation: bool) -> list[PhotoSet]:
    """Read every image and mask of the recipe's training or validation sets into memory.

    Raises:
        InputError: for a folder, list, image or mask that is missing or damaged.
    """
    loaded = []
    for number, config in enumerate(recipe.data):
        if config.validation != validation or (config.weight == 0 and not validation):
            continue
        if config.kind == "recording":
            photos = [_of_frame(frame, config, number, recipe.network) for frame in _frames(config, root)]
        else:
            photos = [_load(path, config, number, recipe.network, root) for path in image_paths(config, root)]
        if not photos:
            raise InputError(f"data set {config.name}: no images in {root / config.folder}")
        loaded.append(PhotoSet(config, photos, person_code(recipe.network)))
    return loaded


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
    stems = listing.read_text(encoding="utf-8").split()
    lost = [s for s in stems if s not in found]
    if lost:
        raise InputError(f"data set {config.name}: {listing} names {lost[0]}, which is not in {folder}")
    return _held_out([found[s] for s in stems], config)


def _held_out(paths: list[Path], config: DataConfig) -> list[Path]:
    n = config.hold_out
    if n:
        paths = [p for i, p in enumerate(paths) if (i % n == n // 2) == config.validation]
    return paths[:: config.every]


def draw_batch(sets: Sequence[PhotoSet], recipe: Recipe, indices: Sequence[int], step: int) -> list[Photo]:
    """The views of one step. A view depends on the seed, the step and its index alone.

    So a run that was killed goes on exactly as it would have, and any number of processes share a batch.
    """
    return [_draw(sets, recipe, np.random.default_rng((recipe.schedule.seed, step, i))) for i in indices]


def _draw(sets: Sequence[PhotoSet], recipe: Recipe, rng: np.random.Generator) -> Photo:
    crop = recipe.schedule.crop
    size = (crop, crop) if crop else (recipe.network.width, recipe.network.height)
    strength = Strength()
    photo = _pick(sets, rng)
    view = _view(photo, size, strength, rng)
    person = person_code(recipe.network)
    if person is not None and rng.random() < recipe.schedule.paste_person:
        donor = _view(_pick_person(sets, person, rng), size, strength, rng)
        image, codes = paste(view.image, view.codes, donor.image, donor.codes, person)
        fine = np.where(codes == view.codes, view.fine, VOID_ID).astype(np.uint8)
        view = Photo(image, codes, fine, view.stem)
    return Photo(relight(view.image, strength, rng), view.codes, view.fine, view.stem)


def _view(photo: Photo, size: tuple[int, int], strength: Strength, rng: np.random.Generator) -> Photo:
    masks = np.dstack([photo.codes, photo.fine])
    image, masks = warp(photo.image, masks, size, strength, rng)
    codes, fine = (np.ascontiguousarray(masks[..., i]) for i in range(2))
    return Photo(image, codes, fine, photo.stem)


def _pick(sets: Sequence[PhotoSet], rng: np.random.Generator) -> Photo:
    weights = np.array([s.config.weight for s in sets])
    chosen = sets[int(rng.choice(len(sets), p=weights / weights.sum()))]
    return chosen.photos[int(rng.choice(len(chosen.photos), p=chosen.chances))]


def _pick_person(sets: Sequence[PhotoSet], person: int, rng: np.random.Generator) -> Photo:
    """A photo with a clear person, or any photo if there is none."""
    for _ in range(30):
        photo = _pick(sets, rng)
        if 0.02 < (photo.codes == person).mean() < 0.5:
            return photo
    return photo


def _load(path: Path, config: DataConfig, number: int, network: NetworkConfig, root: Path) -> Photo:
    image = _read(path, cv2.IMREAD_COLOR)
    shape = image.shape[:2]
    base = root / config.folder
    mask = np.full(shape, VOID_ID, np.uint8)
    if config.labels is not None:
        mask = _read(base / config.labels / f"{path.stem}{config.label_suffix}", cv2.IMREAD_GRAYSCALE, shape)
    codes = _class_indices(config, network)[mask]
    pseudo_path = root / (config.pseudo or "") / f"{path.stem}.png"
    if config.pseudo is not None and pseudo_path.is_file():
        pseudo = _read(pseudo_path, cv2.IMREAD_GRAYSCALE)
        pseudo = np.asarray(cv2.resize(pseudo, shape[::-1], interpolation=cv2.INTER_NEAREST), np.uint8)
        said = _index_table(GRASS_OBSTACLE_PERSON, network)[pseudo]
        codes = np.where((codes == VOID_ID) & (said != VOID_ID), said + np.uint8(PSEUDO_CODE), codes)
    fine = np.full(shape, VOID_ID, np.uint8)
    if config.fine is not None and network.auxiliary_classes:
        fine = _read(base / config.fine / f"{path.stem}{config.label_suffix}", cv2.IMREAD_GRAYSCALE, shape)
        fine = np.where(fine == 0, np.uint8(VOID_ID), fine)
    rgb = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
    return _shrunk(Photo(rgb, _partial(codes, config, number), fine, path.stem), config.validation)


def _frames(config: DataConfig, root: Path) -> Iterator[Frame]:
    from swardmap.io import open_source

    for index, frame in enumerate(open_source(root / config.folder)):
        if config.hold_out and (index % config.hold_out == config.hold_out // 2) != config.validation:
            continue
        if index % config.every == 0:
            yield frame


def _of_frame(frame: Frame, config: DataConfig, number: int, network: NetworkConfig) -> Photo:
    if frame.labels is None or frame.label_set is None:
        raise InputError(f"data set {config.name}: frame {frame.name} has no true labels")
    codes = _index_table(frame.label_set, network)[frame.labels]
    fine = np.full(codes.shape, VOID_ID, np.uint8)
    return _shrunk(Photo(frame.rgb, _partial(codes, config, number), fine, frame.name), config.validation)


def _partial(codes: Image, config: DataConfig, number: int) -> Image:
    if not config.void_means:
        return codes
    return np.where(codes == VOID_ID, np.uint8(PARTIAL_CODE + number), codes)


def _class_indices(config: DataConfig, network: NetworkConfig) -> NDArray[np.uint8]:
    """(256,) uint8: id in the data set's masks -> index of the class, 255 = void."""
    if not config.ids:
        return _index_table(GRASS_OBSTACLE_PERSON, network)
    table = np.full(256, VOID_ID, np.uint8)
    named = _index_table(GRASS_OBSTACLE_PERSON, network)
    for entry in config.ids.split(","):
        number, _, name = entry.partition("=")
        if not number.strip().isdigit() or not int(number) <= VOID_ID:
            raise ConfigError(f"data set {config.name}: expected ids as 0=other,1=grass, got '{entry}'")
        table[int(number)] = named[GRASS_OBSTACLE_PERSON[name.strip()].id]
    return table


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
    return Photo(cv2.resize(photo.image, size, interpolation=cv2.INTER_AREA), masks[0], masks[1], photo.stem)


def _read(path: Path, mode: int, shape: tuple[int, ...] | None = None) -> Image:
    image = cv2.imread(str(path), mode) if path.is_file() else None
    if image is None:
        raise InputError(f"cannot read the image {path}: missing or damaged")
    if shape is not None and image.shape[:2] != shape:
        raise InputError(
            f"{path}: expected a mask of {shape[1]} x {shape[0]} as its image, got {image.shape}"
        )
    return np.asarray(image, np.uint8)
