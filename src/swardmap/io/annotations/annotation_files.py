"""Masks and clouds as annotation tools write them: CVAT, CamVid, COCO, Label Studio, Roboflow, rviz.

Each reader gives masks by image name, in the classes of one label set, and reads a mask when it is asked
for. A class that the label set does not know is refused until the caller says what it is: it might be
an obstacle. What nobody annotated is void.
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from swardmap.errors import InputError, shortened
from swardmap.io.annotations.coco import read_coco
from swardmap.io.annotations.cvat_xml import read_cvat_xml
from swardmap.io.annotations.label_studio import read_label_studio
from swardmap.io.annotations.mask_folder import (
    CLASSES_FILE,
    ROBOFLOW_CLASSES,
    read_mask_folder,
    read_roboflow_masks,
)
from swardmap.io.annotations.masks import (
    BACKGROUND,
    Mask,
    Masks,
    add_reader,
    colors_to_ids,
    guessed,
    ids_by_name,
    read_mask_image,
)
from swardmap.io.clouds.cloud_files import label_points, read_points
from swardmap.io.door import through_door
from swardmap.io.files import inside, read_bytes
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelSet
from swardmap.types import LabeledCloud

__all__ = [
    "read_annotated_cloud",
    "read_camvid",
    "read_coco",
    "read_cvat_masks",
    "read_cvat_xml",
    "read_label_studio",
    "read_mask_folder",
    "read_masks",
    "read_roboflow_masks",
]

Color = tuple[int, int, int]
Classes = Mapping[str, str] | None
MAX_TEXT_BYTES = 50_000_000


@through_door("masks")
def read_masks(
    path: str | Path,
    target: LabelSet = GRASS_OBSTACLE_PERSON,
    classes: Classes = None,
    guess: bool = False,
) -> Masks:
    """Read the masks of any tool known here, told apart by the files there are.

    Args:
        path: a folder with classes.yaml (ours), labelmap.txt (CVAT "Segmentation mask 1.1"), label_colors.txt
            (CamVid), annotations.xml (CVAT) or _annotations.coco.json or _classes.csv (Roboflow, also in its
            folders train, valid, test), a .json (COCO, Label Studio) or an .xml (CVAT 1.1).
        target: the set to express masks in.
        classes: name there -> name in `target`, or "void".
        guess: take plain words, such as lawn, for what they mean, and tell it in `Masks.guessed`.

    Raises:
        InputError: if it is none of these, damaged, or has a class that means nothing.
    """
    path = Path(path)
    for name, read in FOLDERS.items():
        if (path / name).is_file():
            return read(path, target, classes, guess)
    parts = [path / split for split in SPLITS if any((path / split / name).is_file() for name in FOLDERS)]
    if parts:
        return _joined([read_masks(part, target, classes, guess) for part in parts], str(path))
    if path.suffix.lower() == ".json":
        read_json = read_label_studio if _is_list(path) else read_coco
        return read_json(path, target, classes, guess)
    if path.suffix.lower() == ".xml":
        return read_cvat_xml(path, target, classes, guess)
    raise InputError(
        f"{path}: expected a folder with {', '.join(FOLDERS)}, a .json (COCO, Label Studio) or a CVAT .xml; "
        "an archive must be unpacked first"
    )


def is_annotated(folder: Path) -> bool:
    """Whether a folder is an export of one of the tools."""
    return any((folder / part / name).is_file() for part in ("", *SPLITS) for name in FOLDERS)


def _is_list(file: Path) -> bool:
    """Whether a JSON file holds a list, as Label Studio's does, and not an object, as COCO's."""
    return read_bytes(file).lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"["


def _joined(parts: list[Masks], where: str) -> Masks:
    """The masks of the parts of a data set as one."""
    readers: dict[str, Callable[[], Mask]] = {}
    for part in parts:
        for name in part:
            add_reader(readers, f"{name}.png", partial(part.__getitem__, name), where)
    told = {name: meaning for part in parts for name, meaning in part.guessed.items()}
    return Masks(parts[0].label_set, readers, told, [note for part in parts for note in part.notes])


@through_door("masks of CVAT")
def read_cvat_masks(
    folder: str | Path,
    target: LabelSet = GRASS_OBSTACLE_PERSON,
    classes: Classes = None,
    guess: bool = False,
) -> Masks:
    """Read CVAT's "Segmentation mask 1.1": labelmap.txt and SegmentationClass/NAME.png.

    The images hold colours, or, with one channel, the line numbers of labelmap.txt with the background
    (colour 0 0 0) first. See `read_masks` for arguments and errors.
    """
    folder = Path(folder)
    colors = _parse_labelmap(folder / "labelmap.txt")
    ids = ids_by_name(colors, target, classes, str(folder / "labelmap.txt"), guess)
    images = folder / "SegmentationClass"
    if not images.is_dir():
        raise InputError(f"{images}: expected the folder of the masks beside labelmap.txt")
    files = sorted(images.rglob("*.png"))
    read = partial(_indexed_mask, colors=colors, ids=ids)
    readers = {str(f.relative_to(images).with_suffix("")): partial(read, f) for f in files}
    return Masks(target, readers, guessed(colors, target, classes) if guess else None)


@through_door("masks of CamVid")
def read_camvid(
    folder: str | Path,
    target: LabelSet = GRASS_OBSTACLE_PERSON,
    classes: Classes = None,
    guess: bool = False,
) -> Masks:
    """Read CamVid as CVAT writes it: label_colors.txt (`r g b name`) and SUBSETannot/NAME.png.

    The pairs are those of SUBSET.txt (`/SUBSET/NAME.png /SUBSETannot/NAME.png`). See `read_masks`.
    """
    folder = Path(folder)
    colors = _parse_label_colors(folder / "label_colors.txt")
    ids = ids_by_name(colors, target, classes, str(folder / "label_colors.txt"), guess)
    readers: dict[str, Callable[[], Mask]] = {}
    for subset in sorted(folder.glob("*.txt")):
        if subset.name == "label_colors.txt":
            continue
        for line in _lines(subset):
            image, mask = _pair(line, subset)
            read = partial(_indexed_mask, inside(folder, mask.lstrip("/")), colors=colors, ids=ids)
            add_reader(readers, image, read, str(subset))
    return Masks(target, readers, guessed(colors, target, classes) if guess else None)


FOLDERS: Mapping[str, Callable[[Path, LabelSet, Classes, bool], Masks]] = {
    CLASSES_FILE: read_mask_folder,
    "labelmap.txt": read_cvat_masks,
    "label_colors.txt": read_camvid,
    "_annotations.coco.json": lambda folder, *how: read_coco(folder / "_annotations.coco.json", *how),
    ROBOFLOW_CLASSES: read_roboflow_masks,
    "annotations.xml": lambda folder, *how: read_cvat_xml(folder / "annotations.xml", *how),
}
"""File that shows of a folder which tool wrote it -> what reads it."""

SPLITS = ("train", "valid", "test")
"""Folders of an export of Roboflow."""


@through_door("an annotated cloud")
def read_annotated_cloud(
    cloud: str | Path,
    names: str | Path,
    target: LabelSet = GRASS_OBSTACLE_PERSON,
    classes: Classes = None,
    frame_id: str | None = None,
) -> LabeledCloud:
    """Read what rviz_cloud_annotation saved: a PCD with labels, 0 = none, and the text of their names.

    Args:
        cloud: the annotated cloud.
        names: text file with lines `id: name`.
        target: the set to express labels in.
        classes: name there -> name in `target`, or "void".
        frame_id: frame of the points.

    Raises:
        InputError: if a file is damaged, or a label means nothing.
    """
    named = {0: BACKGROUND}
    for line in _lines(Path(names)):
        number, colon, name = line.partition(":")
        if not colon or not number.strip().isascii() or not number.strip().isdigit():
            raise InputError(f"{names}: expected lines 'id: name', got '{line[:80]}'")
        named[int(number)] = name.strip()
    points = read_points(cloud)
    if points.ids is None:
        raise InputError(f"{cloud}: the cloud has no labels; expected a field 'label'")
    used = {i: named[i] for i in np.unique(points.ids).tolist() if i in named}
    ids = ids_by_name(used.values(), target, classes, str(names))
    own = {c.id: c.name for c in target.classes}
    table = {i: own[ids[name]] for i, name in used.items() if ids[name] in own}
    return label_points(points, target, table, frame_id)


def _indexed_mask(file: Path, colors: Mapping[str, Color | None], ids: Mapping[str, int]) -> Mask:
    image = read_mask_image(file)
    if image.ndim == 3:
        by_color = {color: ids[name] for name, color in colors.items() if color is not None}
        return colors_to_ids(image, by_color, str(file))
    table = np.array([ids[name] for name in colors], np.uint8)
    if image.max() >= len(table):
        raise InputError(f"{file}: index {image.max()} is beyond the {len(table)} classes")
    mask: Mask = table[image]
    return mask


def _parse_labelmap(file: Path) -> dict[str, Color | None]:
    """Lines `name:r,g,b:parts:actions`; the background comes first."""
    colors: dict[str, Color | None] = {}
    for line in _lines(file):
        name, *rest = line.split(":")
        if not name or name in colors:
            raise InputError(f"{file}: expected each class once, as name:r,g,b::, got '{line[:80]}'")
        colors[name] = _color(rest[0].split(","), file) if rest and rest[0] else None
    return _background_first(colors)


def _parse_label_colors(file: Path) -> dict[str, Color | None]:
    """Lines `r g b name`; the background comes first."""
    colors: dict[str, Color | None] = {}
    for line in _lines(file):
        words = line.split(maxsplit=3)
        name = words[-1] if len(words) in (1, 4) else ""
        if not name or name in colors:
            raise InputError(f"{file}: expected each class once, as 'r g b name', got '{line[:80]}'")
        colors[name] = _color(words[:3], file) if len(words) == 4 else None
    return _background_first(colors)


def _background_first(colors: dict[str, Color | None]) -> dict[str, Color | None]:
    black = next((name for name, color in colors.items() if color == (0, 0, 0)), BACKGROUND)
    first = {black: colors.get(black, (0, 0, 0))}
    return first | {name: color for name, color in colors.items() if name != black}


def _color(words: list[str], file: Path) -> Color:
    plain = [word.strip() for word in words]
    if len(plain) != 3 or not all(w.isascii() and w.isdigit() and len(w) < 9 and int(w) < 256 for w in plain):
        raise InputError(
            f"{file}: expected a colour of three numbers in 0..255, got {shortened(' '.join(plain))}"
        )
    return int(plain[0]), int(plain[1]), int(plain[2])


def _pair(line: str, file: Path) -> tuple[str, str]:
    words = [w for w in line.split('"') if w.strip()] if '"' in line else line.split()
    if len(words) != 2:
        raise InputError(f"{file}: expected an image and its mask on each line, got '{line[:80]}'")
    return words[0], words[1]


def _lines(file: Path) -> list[str]:
    try:
        text = read_bytes(file, MAX_TEXT_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: expected UTF-8 text: {error}") from error
    stripped = (line.strip() for line in text.splitlines())
    return [line for line in stripped if line and not line.startswith("#")]
