"""Label Studio's own JSON: a list of tasks, each an image with polygons, boxes, ellipses or brush strokes.

Places are in percent of the image. Brush strokes are run lengths of its own kind (`label-studio-converter`,
brush.py): words of bits, of the four channels of an RGBA image.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.annotations.image_names import uploaded_name
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
)
from swardmap.io.door import reading, through_door
from swardmap.io.files import read_bytes
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelSet

KINDS = ("polygonlabels", "rectanglelabels", "ellipselabels", "brushlabels")
ELLIPSE_CORNERS = 256


@dataclass(frozen=True, slots=True)
class Region:
    """One annotated place of an image."""

    label: str
    kind: str
    value: Mapping[str, Any]
    size: tuple[int, int]


@through_door("an export of Label Studio")
def read_label_studio(
    file: str | Path,
    target: LabelSet = GRASS_OBSTACLE_PERSON,
    classes: Mapping[str, str] | None = None,
    guess: bool = False,
) -> Masks:
    """Read the export "JSON" of Label Studio; of several annotations of an image the first that is done.

    Where annotations overlap, an obstacle beats grass and a person beats both.

    Args:
        file: the JSON.
        target: the set to express masks in.
        classes: name there -> name in `target`, or "void".
        guess: take plain words for what they mean.

    Raises:
        InputError: if it is damaged, is the "JSON-MIN" export, has shapes without an area, or a class that
            means nothing.
    """
    file = Path(file)
    with reading(file, "Label Studio's export JSON"):
        images = {_image(task): list(_regions(task, file)) for task in json.loads(read_bytes(file))}
    used = [region.label for regions in images.values() for region in regions]
    ids = ids_by_name([BACKGROUND, *used], target, classes, str(file), guess)
    readers: dict[str, Callable[[], Mask]] = {}
    for name, regions in images.items():
        if regions:  # of an image without annotations nobody knows the size
            read = partial(_painted, regions, ids, target, f"{file}: image {name}")
            add_reader(readers, name, read, str(file))
    return Masks(target, readers, guessed(used, target, classes) if guess else None)


def _image(task: Mapping[str, Any]) -> str:
    data = task["data"]
    texts = [value for value in data.values() if isinstance(value, str)]
    return uploaded_name(str(data.get("image") or texts[0]))


def _regions(task: Mapping[str, Any], file: Path) -> Iterator[Region]:
    done = [a for a in task["annotations"] if not a.get("was_cancelled")]
    for result in done[0]["result"] if done else ():
        kind = str(result["type"])
        if kind not in KINDS:
            if kind in ("choices", "rating", "textarea"):  # of the image as a whole
                continue
            raise InputError(f"{file}: expected {', '.join(KINDS)}, got {kind}: draw it as a polygon")
        labels = result["value"].get(kind) or [""]
        size = int(result["original_height"]), int(result["original_width"])
        yield Region(str(labels[0]), kind, result["value"], size)


def _painted(regions: list[Region], ids: Mapping[str, int], target: LabelSet, where: str) -> Mask:
    height, width = regions[0].size
    if any(region.size != (height, width) for region in regions):
        raise InputError(f"{where}: expected one size of the image, got several")
    mask = blank_mask(height, width, ids[BACKGROUND], where)
    for i in by_gravity([ids[region.label] for region in regions], target):
        region, value = regions[i], ids[regions[i].label]
        with reading(where, f"whole {region.kind}"):
            if region.kind == "brushlabels":
                mask[decode_brush(region.value["rle"], height, width)] = value
            else:
                fill_polygon(mask, _corners(region) * [width / 100, height / 100], value, where)
    return mask


def _corners(region: Region) -> NDArray[np.float64]:
    """(N, 2) corners in percent of the image."""
    value = region.value
    if region.kind == "polygonlabels":
        return np.asarray(value["points"], np.float64).reshape(-1, 2)
    x, y = float(value["x"]), float(value["y"])
    if region.kind == "ellipselabels":
        angles = np.linspace(0, 2 * np.pi, ELLIPSE_CORNERS, endpoint=False)
        across, down = float(value["radiusX"]), float(value["radiusY"])
        corners, pivot = np.stack([x + across * np.cos(angles), y + down * np.sin(angles)], axis=-1), (x, y)
    else:
        across, down = float(value["width"]), float(value["height"])
        corners = np.array([(x, y), (x + across, y), (x + across, y + down), (x, y + down)])
        pivot = x, y  # it turns about its upper left corner
    angle = np.deg2rad(float(value.get("rotation", 0)))
    if angle == 0:
        return corners
    aspect = np.array([region.size[1], region.size[0]]) / 100  # turned in pixels, not in percent
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned: NDArray[np.float64] = ((corners - pivot) * aspect @ turn) / aspect + pivot
    return turned


def decode_brush(rle: list[int], height: int, width: int) -> NDArray[np.bool_]:
    """Brush strokes as (H, W) bool: what is not wholly transparent.

    Raises:
        ValueError: if the bits are no run lengths of an image of this size.
    """
    bits = np.unpackbits(np.asarray(rle, np.uint8))
    at = 0

    def read(count: int) -> int:
        nonlocal at
        if at + count > len(bits):
            raise ValueError("the run lengths end too early")
        at += count
        return int("".join(map(str, bits[at - count : at].tolist())), 2)

    total, word = read(32), read(5) + 1
    sizes = [read(4) + 1 for _ in range(4)]
    if total != height * width * 4:
        raise ValueError(f"expected run lengths of {height * width * 4} values, got {total}")
    values = np.zeros(total, np.uint8)
    done = 0
    while done < total:
        same, count = read(1), read(sizes[read(2)]) + 1
        end = min(done + count, total)
        if same:
            values[done:end] = read(word) & 255
        else:
            values[done:end] = [read(word) & 255 for _ in range(done, end)]
        done = end
    return np.asarray(values.reshape(height, width, 4)[..., 3] > 0)
