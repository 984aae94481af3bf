"""A map and its costs as layers for a page: one small transparent PNG each, one pixel a cell."""

from base64 import b64encode
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.mapping.costmap import INSCRIBED, LETHAL, NO_INFORMATION, Costmap
from swardmap.viz.drawing import Color
from swardmap.viz.maps import COLOR_OF_CLASS, MARGIN_COLOR, block_max

MAX_SIDE = 3000
"""Pixels; cells of larger maps are joined, and the gravest of each block shows."""

MOST_BYTES = 6_000_000
"""Of all layers of a map together."""

INSCRIBED_COLOR: Color = (196, 84, 110)
COST_COLOR: Color = (226, 132, 60)


@dataclass(frozen=True, slots=True)
class Layer:
    """One switchable layer.

    Attributes:
        name: for programs.
        title: for people.
        color: as CSS takes it.
        url: of the picture, as a data URL.
        shown: whether it is switched on at first.
    """

    name: str
    title: str
    color: str
    url: str
    shown: bool = True


def map_layers(grid: OccupancyGrid, costmap: Costmap | None, step: int = 1) -> list[Layer]:
    """What there is of grass, obstacles, persons and costs, from below to above; empty ones are left out.

    Args:
        grid: the map.
        costmap: its costs, of the same cells, or None.
        step: cells along each side of a pixel.
    """
    classes = block_max(grid.classes, step)
    found = [
        (MapClass.GRASS, "grass"),
        (MapClass.OBSTACLE, "obstacle"),
        (MapClass.PERSON, "person"),
    ]
    opaque = {title: (classes == int(c), COLOR_OF_CLASS[int(c)], 255, True) for c, title in found}
    parts = {"grass": opaque.pop("grass")} | _cost_parts(grid, costmap, step) | opaque
    return [
        Layer(title.split(" ")[0].strip(",:"), title, _css(color), _png(cells, color, opacity), shown)
        for title, (cells, color, opacity, shown) in parts.items()
        if np.any(cells)
    ]


_Part = tuple[NDArray[np.bool_], NDArray[np.uint8], NDArray[np.uint8] | int, bool]


def _cost_parts(grid: OccupancyGrid, costmap: Costmap | None, step: int) -> dict[str, _Part]:
    if costmap is None:
        return {}
    # unknown lowest, and obstacles left to their own layer, so that the highest cost of a block shows
    costs = np.where((costmap.costs == NO_INFORMATION) | grid.is_obstacle, np.uint8(0), costmap.costs)
    costs = block_max(costs, step)
    falling = (costs > 0) & (costs < INSCRIBED)
    # what is nearly free must still be seen: faint, and stronger towards the obstacle
    opacity = (40 + costs.astype(np.uint16) * 150 // 252).astype(np.uint8)
    return {
        "cost, falling off": (falling, np.array(COST_COLOR, np.uint8), opacity, True),
        "inscribed: no place for the robot's centre": (
            costs == INSCRIBED, np.array(INSCRIBED_COLOR, np.uint8), 150, True,
        ),
        "margin and keep-out": (costs == LETHAL, np.array(MARGIN_COLOR, np.uint8), 190, True),
    }  # fmt: skip


def bounded_layers(grid: OccupancyGrid, costmap: Costmap | None) -> tuple[list[Layer], int]:
    """The layers as fine as MAX_SIDE and MOST_BYTES allow, and the cells along each side of a pixel."""
    step = cells_per_pixel(grid.spec)
    layers = map_layers(grid, costmap, step)
    while sum(len(layer.url) for layer in layers) > MOST_BYTES and step < max(grid.spec.shape):
        step *= 2
        layers = map_layers(grid, costmap, step)
    return layers, step


def cells_per_pixel(spec: GridSpec) -> int:
    """How many cells are joined along each side so that a layer stays small enough to show."""
    return -(-max(spec.shape) // MAX_SIDE)


def image_url(image: NDArray[np.uint8], suffix: str, quality: int = 80) -> str:
    """An RGB or RGBA picture as a data URL, .png or .jpg."""
    swapped = image[..., [2, 1, 0, 3][: image.shape[2]]]
    settings = [cv2.IMWRITE_JPEG_QUALITY, quality] if suffix == ".jpg" else []
    _, encoded = cv2.imencode(suffix, np.ascontiguousarray(swapped), settings)
    kind = {".png": "png", ".jpg": "jpeg"}[suffix]
    return f"data:image/{kind};base64,{b64encode(encoded.tobytes()).decode()}"


def _png(cells: NDArray[np.bool_], color: NDArray[np.uint8], opacity: NDArray[np.uint8] | int) -> str:
    """Row 0 of the map is its lowest y, row 0 of a picture its highest."""
    pixels = np.zeros((*cells.shape, 4), np.uint8)
    pixels[..., :3] = color
    pixels[..., 3] = np.where(cells, opacity, 0)
    return image_url(pixels[::-1], ".png")


def _css(color: NDArray[np.uint8]) -> str:
    return "#" + "".join(f"{int(c):02x}" for c in color)
