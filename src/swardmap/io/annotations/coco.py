"""COCO instances (JSON): polygons and run lengths to masks."""

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.annotations.masks import (
    BACKGROUND,
    Mask,
    Masks,
    add_reader,
    blank_mask,
    by_gravity,
    fill_polygon,
    ids_by_name,
    runs_to_flat,
)
from swardmap.io.door import through_door
from swardmap.io.files import read_bytes
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelSet


@through_door("annotations of COCO")
def read_coco(
    file: str | Path, target: LabelSet = GRASS_OBSTACLE_PERSON, classes: Mapping[str, str] | None = None
) -> Masks:
    """Read instances_*.json: polygons, and run lengths plain or as a string.

    Where annotations overlap, an obstacle beats grass and a person beats both; COCO has no order.

    Args:
        file: the JSON.
        target: the set to express masks in.
        classes: name there -> name in `target`, or "void".

    Raises:
        InputError: if it is damaged, or has a class that means nothing.
    """
    file = Path(file)
    try:
        tree = json.loads(read_bytes(file))
        names = {entry["id"]: str(entry["name"]) for entry in tree["categories"]}
        images = {i["id"]: (str(i["file_name"]), int(i["height"]), int(i["width"])) for i in tree["images"]}
        of_image: dict[Any, list[Any]] = {i: [] for i in images}
        for annotation in tree["annotations"]:
            of_image[annotation["image_id"]].append(
                (names[annotation["category_id"]], annotation["segmentation"])
            )
    except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
        raise InputError(f"{file}: expected COCO instances; missing or damaged: {error}") from error
    used = [category for shapes in of_image.values() for category, _ in shapes]
    ids = ids_by_name([BACKGROUND, *used], target, classes, str(file))
    readers: dict[str, Callable[[], Mask]] = {}
    for key, (name, height, width) in images.items():
        where = f"{file}: image {name}"
        shapes = [(ids[category], segmentation) for category, segmentation in of_image[key]]
        read = partial(_painted, height, width, shapes, target, ids[BACKGROUND], where)
        add_reader(readers, name, read, str(file))
    return Masks(target, readers)


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


def _painted(
    height: int,
    width: int,
    shapes: list[tuple[int, Any]],
    target: LabelSet,
    background: int,
    where: str,
) -> Mask:
    mask = blank_mask(height, width, background, where)
    for i in by_gravity([value for value, _ in shapes], target):
        value, segmentation = shapes[i]
        if isinstance(segmentation, dict):
            if segmentation.get("size") != [height, width]:
                raise InputError(f"{where}: expected run lengths of size {[height, width]}")
            mask[decode_rle(segmentation.get("counts"), height, width, where)] = value
        elif isinstance(segmentation, list):
            for polygon in segmentation:
                fill_polygon(mask, _corners(polygon, where), value)
        else:
            raise InputError(f"{where}: expected polygons or run lengths, got {type(segmentation).__name__}")
    return mask


def _corners(polygon: Any, where: str) -> NDArray[np.float64]:
    try:
        corners = np.asarray(polygon, np.float64).reshape(-1, 2)
    except (ValueError, TypeError) as error:
        raise InputError(f"{where}: damaged polygon: {error}") from error
    if len(corners) < 3 or not np.isfinite(corners).all():
        raise InputError(f"{where}: expected polygons of at least three finite corners")
    return corners
