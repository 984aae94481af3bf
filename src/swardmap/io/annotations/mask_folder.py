"""A folder of masks: NAME.png with class ids, and classes.yaml that says what they mean."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.errors import InputError
from swardmap.io.annotations.image_names import original_name
from swardmap.io.annotations.masks import BACKGROUND, Mask, Masks, add_reader, guessed, ids_by_name
from swardmap.io.door import parse_yaml, reading, through_door
from swardmap.io.files import inside, read_bytes, write_bytes, write_text
from swardmap.io.folders import new_output_folder
from swardmap.io.images import read_mask
from swardmap.labels import GRASS_OBSTACLE_PERSON, VOID_ID, LabelClass, LabelSet, Role

CLASSES_FILE = "classes.yaml"
ROBOFLOW_CLASSES = "_classes.csv"
MASK_ENDING = "_mask"


def write_masks(masks: Masks, folder: str | Path, overwrite: bool = False) -> dict[str, int]:
    """Write masks as 8-bit PNG of class ids, one read at a time, and their classes.

    Args:
        masks: what to write.
        folder: must not exist, or be empty, or be one of ours with `overwrite`.
        overwrite: replace a folder that swardmap made.

    Returns:
        Number of pixels of each class, in all masks.

    Raises:
        InputError: if a mask cannot be read; OutputError: if the folder cannot be written.
    """
    import cv2

    counts = np.zeros(256, np.int64)
    with new_output_folder(folder, overwrite, "masks") as out:
        for name, mask in masks.items():
            encoded = cv2.imencode(".png", mask)[1].tobytes()
            write_bytes(inside(out, f"{name}.png"), encoded, durable=False)
            counts += np.bincount(mask.ravel(), minlength=256)
        write_text(out / CLASSES_FILE, classes_text(masks.label_set))
    return {c.name: int(counts[c.id]) for c in masks.label_set.classes}


def classes_text(label_set: LabelSet) -> str:
    """A label set as YAML: one class an entry, with id, name, role and colour."""
    import yaml

    entries = [
        {"id": c.id, "name": c.name, "role": c.role.value, "color": list(c.color)} for c in label_set.classes
    ]
    return yaml.safe_dump({"classes": entries}, sort_keys=False, default_flow_style=None)


@through_door("a folder of masks")
def read_mask_folder(
    folder: str | Path,
    target: LabelSet = GRASS_OBSTACLE_PERSON,
    classes: Mapping[str, str] | None = None,
    guess: bool = False,
) -> Masks:
    """Read what `write_masks` writes: NAME.png with ids, and classes.yaml.

    A class that `target` has by name or, without a word in `classes`, by its role stands for that.

    Raises:
        InputError: if it is damaged, or has a class that means nothing.
    """
    folder = Path(folder)
    own = read_classes(folder / CLASSES_FILE)
    said = dict(classes or {})
    unsaid = {c.name for c in own.classes if c.name not in target.names and c.name not in said}
    by_role = own.remap_table(target)
    names = {c.name: c.id for c in own.classes if c.name not in unsaid}
    table = np.full(256, VOID_ID, np.uint8)
    for name, value in ids_by_name(names, target, said, str(folder / CLASSES_FILE), guess).items():
        table[names[name]] = value
    for c in own.classes:
        if c.name in unsaid:
            table[c.id] = target[said["*"]].id if said.get("*", "void") != "void" else by_role[c.id]
    return Masks(target, _png_readers(folder, folder.rglob("*.png"), table))


@through_door("classes")
def read_classes(file: Path) -> LabelSet:
    """A label set from YAML as `classes_text` writes it.

    Raises:
        InputError: if it is none.
    """
    with reading(file, "classes with id, name, role and color"):
        entries = parse_yaml(read_bytes(file, 2**20), file)["classes"]
        return LabelSet(tuple(map(_class, entries)))


def _class(entry: Mapping[str, Any]) -> LabelClass:
    r, g, b = map(int, entry["color"])
    return LabelClass(int(entry["id"]), str(entry["name"]), Role(entry["role"]), (r, g, b))


@through_door("masks of Roboflow")
def read_roboflow_masks(
    folder: str | Path,
    target: LabelSet = GRASS_OBSTACLE_PERSON,
    classes: Mapping[str, str] | None = None,
    guess: bool = False,
) -> Masks:
    """Read Roboflow's "Semantic Segmentation Masks": NAME_mask.png with ids, and _classes.csv.

    Raises:
        InputError: if it is damaged, or has a class that means nothing.
    """
    folder = Path(folder)
    file = folder / ROBOFLOW_CLASSES
    names: dict[str, int] = {}
    for line in read_bytes(file, 2**20).decode("utf-8", "replace").splitlines()[1:]:
        number, comma, name = (word.strip() for word in line.partition(","))
        if line.strip():
            if not (comma and name and number.isascii() and number.isdigit() and int(number) < 256):
                raise InputError(f"{file}: expected lines 'pixel value, class', got '{line[:80]}'")
            names[name] = int(number)
    table = np.full(256, VOID_ID, np.uint8)
    for name, value in ids_by_name([*names, BACKGROUND], target, classes, str(file), guess).items():
        if name in names:
            table[names[name]] = value
    readers = _png_readers(folder, folder.glob(f"*{MASK_ENDING}.png"), table)
    return Masks(target, readers, guessed(names, target, classes) if guess else None)


def _png_readers(folder: Path, files: Iterable[Path], table: Mask) -> dict[str, Callable[[], Mask]]:
    readers: dict[str, Callable[[], Mask]] = {}
    for file in sorted(files):
        name = original_name(file.relative_to(folder).with_suffix("").as_posix().removesuffix(MASK_ENDING))
        add_reader(readers, f"{name}.png", partial(_translated, file, table), str(folder))
    return readers


def _translated(file: Path, table: Mask) -> Mask:
    translated: Mask = table[read_mask(file)]
    return translated
