"""COCO instances (JSON): polygons and run lengths to masks."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.annotations.image_names import original_name, uploaded_name
from swardmap.io.annotations.masks import (
    BACKGROUND,
    Mask,
    Masks,
    add_reader,
    blank_mask,
    by_gravity,
    fill_polygon,
    guessed,
    ids_by_name,
    runs_to_flat,
)
from swardmap.io.door import reading, through_door
from swardmap.io.files import read_bytes
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelSet, Role


@dataclass(frozen=True, slots=True)
class Shape:
    """One annotation: its class, and how its place is given."""

    category: str
    segmentation: Any
    box: Any


@through_door("annotations of COCO")
def read_coco(
    file: str | Path,
    target: LabelSet = GRASS_OBSTACLE_PERSON,
    classes: Mapping[str, str] | None = None,
    guess: bool = False,
) -> Masks:
    """Read instances_*.json: polygons, run lengths plain or as a string, boxes where that is all.

    Where annotations overlap, an obstacle beats grass and a person beats both; COCO has no order.
    An obstacle or person of which there is only a box fills the box; grass with only a box is refused.
    Names of images are those before Roboflow or Label Studio renamed them.

    Args:
        file: the JSON.
        target: the set to express masks in.
        classes: name there -> name in `target`, or "void".
        guess: take plain words for what they mean.

    Raises:
        InputError: if it is damaged, or has a class that means nothing.
    """
    file = Path(file)
    with reading(file, "COCO instances"):
        tree = json.loads(read_bytes(file))
        names = {entry["id"]: str(entry["name"]) for entry in tree["categories"]}
        images = {i["id"]: (image_name(i, tree), int(i["height"]), int(i["width"])) for i in tree["images"]}
        of_image: dict[Any, list[Shape]] = {i: [] for i in images}
        for a in tree["annotations"]:
            shape = Shape(names[a["category_id"]], a.get("segmentation"), a.get("bbox"))
            of_image[a["image_id"]].append(shape)
    used = [shape.category for shapes in of_image.values() for shape in shapes]
    ids = ids_by_name([BACKGROUND, *used], target, classes, str(file), guess)
    boxes = sum(not _has_outline(shape) for shapes in of_image.values() for shape in shapes)
    notes = [f"{boxes} annotations have only a box: all of it was filled"] if boxes else []
    readers: dict[str, Callable[[], Mask]] = {}
    for key, (name, height, width) in images.items():
        where = f"{file}: image {name}"
        drawn = [(ids[shape.category], shape) for shape in of_image[key]]
        read = partial(_painted, height, width, drawn, target, ids[BACKGROUND], where)
        add_reader(readers, name, read, str(file))
    return Masks(target, readers, guessed(used, target, classes) if guess else None, notes)


def image_name(image: Mapping[str, Any], tree: Mapping[str, Any]) -> str:
    """Name of an image as it was before a tool renamed it, with its suffix."""
    name = str(image["file_name"])
    extra = image.get("extra")
    if isinstance(extra, dict) and isinstance(extra.get("name"), str):  # Roboflow
        return original_name(extra["name"])
    about = tree.get("info")
    if isinstance(about, dict) and about.get("contributor") == "Label Studio":
        return uploaded_name(name)
    return original_name(name)


def decode_rle(counts: Any, height: int, width: int, where: str) -> NDArray[np.bool_]:
    """COCO run lengths, plain or as a string, as (H, W) bool: column by column, background first.

    >>> decode_rle([5, 2, 2, 2, 5], 4, 4, "").astype(int).tolist()
    [[0, 0, 0, 0], [0, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 0]]
    """
    if isinstance(counts, str):
        counts = _unpacked(counts, where)
    if not isinstance(counts, list) or not all(type(c) is int and abs(c) < 2**62 for c in counts):
        raise InputError(f"{where}: expected run lengths to be whole numbers")
    return runs_to_flat(counts, height * width, where).reshape(width, height).T


def _unpacked(text: str, where: str) -> list[int]:
    """Run lengths in COCO's string: 5 bits a character; from the fourth on, less the last but one."""
    runs: list[int] = []
    value, shift = 0, 0
    for character in text:
        code = ord(character) - 48
        if not 0 <= code < 64 or shift > 60:
            raise InputError(f"{where}: damaged run lengths")
        value |= (code & 31) << shift
        shift += 5
        if not code & 32:
            if code & 16:
                value -= 1 << shift
            runs.append(value + (runs[-2] if len(runs) > 2 else 0))
            value, shift = 0, 0
    return runs


def _has_outline(shape: Shape) -> bool:
    """Whether an annotation has more than a box: run lengths, or a polygon of three corners."""
    if isinstance(shape.segmentation, list):
        return any(isinstance(p, list) and len(p) >= 6 for p in shape.segmentation)
    return shape.segmentation is not None


def _painted(
    height: int,
    width: int,
    shapes: list[tuple[int, Shape]],
    target: LabelSet,
    background: int,
    where: str,
) -> Mask:
    mask = blank_mask(height, width, background, where)
    free = {c.id for c in target.classes if c.role is Role.FREE}
    for i in by_gravity([value for value, _ in shapes], target):
        value, shape = shapes[i]
        if not _has_outline(shape):
            if value in free:
                raise InputError(
                    f"{where}: '{shape.category}' has only a box, in which not all may be {shape.category}: "
                    "draw its outline"
                )
            fill_polygon(mask, _box(shape.box, shape.category, where), value, where)
        elif isinstance(shape.segmentation, dict):
            if shape.segmentation.get("size") != [height, width]:
                raise InputError(f"{where}: expected run lengths of size {[height, width]}")
            mask[decode_rle(shape.segmentation.get("counts"), height, width, where)] = value
        elif isinstance(shape.segmentation, list):
            for polygon in shape.segmentation:
                if not (isinstance(polygon, list) and len(polygon) == 4):  # a line has no area
                    fill_polygon(mask, _corners(polygon, where), value, where)
        else:
            kind = type(shape.segmentation).__name__
            raise InputError(f"{where}: expected polygons or run lengths, got {kind}")
    return mask


def _box(box: Any, category: str, where: str) -> NDArray[np.float64]:
    if not isinstance(box, list) or len(box) != 4:
        raise InputError(f"{where}: '{category}' has neither an outline nor a box")
    with reading(where, f"a box of '{category}'"):
        x, y, width, height = (float(v) for v in box)
    return np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)])


def _corners(polygon: Any, where: str) -> NDArray[np.float64]:
    with reading(where, "a polygon"):
        corners = np.asarray(polygon, np.float64).reshape(-1, 2)
    if len(corners) < 3 or not np.isfinite(corners).all():
        raise InputError(f"{where}: expected polygons of at least three finite corners")
    return corners
