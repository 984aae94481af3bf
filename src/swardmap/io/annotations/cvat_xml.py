"""CVAT's own XML (for images 1.1): polygons, boxes and run lengths to masks."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from xml.etree import ElementTree as ET

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
    guessed,
    ids_by_name,
    runs_to_flat,
)
from swardmap.io.door import reading, through_door
from swardmap.io.files import read_bytes
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelSet

AREAS = ("polygon", "box", "ellipse", "mask")
ELLIPSE_CORNERS = 256
NO_AREAS = ("tag",)
"""Says something of the whole image, and marks no place in it."""


@through_door("annotations of CVAT")
def read_cvat_xml(
    file: str | Path,
    target: LabelSet = GRASS_OBSTACLE_PERSON,
    classes: Mapping[str, str] | None = None,
    guess: bool = False,
) -> Masks:
    """Read "CVAT for images 1.1": polygons, boxes, ellipses and masks, painted in the order of z_order.

    On one level an obstacle beats grass and a person beats both: CVAT says nothing of the order there.

    Args:
        file: annotations.xml.
        target: the set to express masks in.
        classes: name there -> name in `target`, or "void".
        guess: take plain words for what they mean.

    Raises:
        InputError: if it is damaged, has a document type (entities), shapes without an area (polylines,
            points, skeletons), tracks of a video, or a class that means nothing.
    """
    file = Path(file)
    root = _parsed(read_bytes(file), file)
    if root.tag != "annotations" or root.find("track") is not None:
        raise InputError(
            f"{file}: expected CVAT for images 1.1 (<annotations> with <image>), not a video's tracks"
        )
    images, labels = [], [BACKGROUND]
    for image in root.iter("image"):
        name = image.get("name", "")
        where = f"{file}: image {name}"
        shapes = [s for s in image if s.tag not in NO_AREAS]
        strange = sorted({s.tag for s in shapes} - set(AREAS))
        if not name or strange:
            raise InputError(
                f"{where}: expected a name and {', '.join(AREAS)} only, got {', '.join(strange)}"
            )
        labels += [s.get("label", "") for s in shapes]
        images.append((name, image, shapes, where))
    ids = ids_by_name(labels, target, classes, str(file), guess)
    readers: dict[str, Callable[[], Mask]] = {}
    for name, image, shapes, where in images:
        add_reader(readers, name, partial(_painted, image, shapes, where, ids, target), str(file))
    return Masks(target, readers, guessed(labels, target, classes) if guess else None)


class _NoDoctype(ET.TreeBuilder):
    """Refuses a document type: it may define entities that grow without end or read files."""

    def doctype(self, *_: str | None) -> None:
        """Called for <!DOCTYPE>."""
        raise ValueError("a document type is not expected in annotations")


def _parsed(content: bytes, file: Path) -> ET.Element:
    parser = ET.XMLParser(target=_NoDoctype())  # noqa: S314 - without a document type no entities
    with reading(file, "XML"):
        parser.feed(content)
        root = parser.close()
    assert isinstance(root, ET.Element)  # noqa: S101 - narrows the type: TreeBuilder's result
    return root


def _painted(
    image: ET.Element, shapes: list[ET.Element], where: str, ids: Mapping[str, int], target: LabelSet
) -> Mask:
    height, width = _whole(image, "height", where), _whole(image, "width", where)
    mask = blank_mask(height, width, ids[BACKGROUND], where)
    graver_last = by_gravity([ids[s.get("label", "")] for s in shapes], target)
    for shape in sorted((shapes[i] for i in graver_last), key=lambda s: _whole(s, "z_order", where, 0)):
        value = ids[shape.get("label", "")]
        if shape.tag == "mask":
            _paint_runs(mask, shape, value, where)
        else:
            fill_polygon(mask, _corners(shape, where), value, where)
    return mask


def _paint_runs(mask: Mask, shape: ET.Element, value: int, where: str) -> None:
    """Run lengths row by row inside the shape's box, background first."""
    left, top = _whole(shape, "left", where), _whole(shape, "top", where)
    width, height = _whole(shape, "width", where), _whole(shape, "height", where)
    if left < 0 or top < 0 or left + width > mask.shape[1] or top + height > mask.shape[0]:
        raise InputError(f"{where}: a mask reaches out of the image")
    try:
        runs = [int(word) for word in shape.get("rle", "").split(",")]
    except ValueError as error:
        raise InputError(f"{where}: damaged run lengths: {error}") from error
    if any(abs(run) > mask.size for run in runs):
        raise InputError(f"{where}: damaged run lengths: longer than the image")
    inside = runs_to_flat(runs, width * height, where).reshape(height, width)
    mask[top : top + height, left : left + width][inside] = value


def _corners(shape: ET.Element, where: str) -> NDArray[np.float64]:
    with reading(where, f"a {shape.tag}"):
        if shape.tag == "box":
            x0, y0, x1, y1 = (float(shape.get(key, "")) for key in ("xtl", "ytl", "xbr", "ybr"))
            corners = _turned(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]), shape)
        elif shape.tag == "ellipse":
            cx, cy, rx, ry = (float(shape.get(key, "")) for key in ("cx", "cy", "rx", "ry"))
            angles = np.linspace(0, 2 * np.pi, ELLIPSE_CORNERS, endpoint=False)
            corners = _turned(np.stack([cx + rx * np.cos(angles), cy + ry * np.sin(angles)], axis=-1), shape)
        else:
            words = shape.get("points", "").split(";")
            corners = np.array([[float(v) for v in word.split(",")] for word in words]).reshape(-1, 2)
    if len(corners) < 3 or not np.isfinite(corners).all():
        raise InputError(f"{where}: expected polygons of at least three finite corners")
    return corners


def _turned(corners: NDArray[np.float64], shape: ET.Element) -> NDArray[np.float64]:
    """Corners turned about their middle by `rotation` degrees, clockwise in the image."""
    angle, middle = np.deg2rad(float(shape.get("rotation", "0"))), corners.mean(axis=0)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return corners if angle == 0 else np.asarray((corners - middle) @ turn + middle)


def _whole(element: ET.Element, key: str, where: str, default: int | None = None) -> int:
    text = element.get(key)
    if text is None and default is not None:
        return default
    try:
        number = int(text or "")
    except ValueError as error:
        raise InputError(f"{where}: expected {key} to be a whole number, got {text!r}") from error
    if abs(number) > 2**31:
        raise InputError(f"{where}: {key} is out of range: {number}")
    return number
