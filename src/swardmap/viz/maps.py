"""Maps from above: which pixel shows which place, cells and points as colours, scale and camera."""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.geometry import Intrinsics, Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import GRASS, OTHER, PERSON, MapClass
from swardmap.mapping.costmap import INSCRIBED, LETHAL, NO_INFORMATION
from swardmap.types import LabeledCloud
from swardmap.viz.drawing import INK, PAPER, Color, Picture, blend, write

UNKNOWN_COLOR: Color = (228, 228, 223)
MARGIN_COLOR: Color = (214, 66, 60)
GEOMETRY_COLOR: Color = (126, 72, 168)
COLOR_OF_CLASS = np.array([UNKNOWN_COLOR, GRASS.color, OTHER.color, PERSON.color], np.uint8)
SWATCHES = [
    ("unknown", UNKNOWN_COLOR),
    ("grass", GRASS.color),
    ("obstacle", OTHER.color),
    ("person", PERSON.color),
]


@dataclass(frozen=True, slots=True)
class View:
    """A window on the map: x to the right, y up.

    Attributes:
        left_m, top_m: place of the outer corner of the upper left pixel.
        px_per_m: scale.
        width, height: in pixels.
    """

    left_m: float
    top_m: float
    px_per_m: float
    width: int
    height: int

    @classmethod
    def of(cls, bounds_m: tuple[float, float, float, float], width: int, height: int) -> "View":
        """The largest scale at which (x_min, x_max, y_min, y_max) fits, centred."""
        x_min, x_max, y_min, y_max = bounds_m
        px_per_m = min(width / max(x_max - x_min, 1e-9), height / max(y_max - y_min, 1e-9))
        return cls(
            (x_min + x_max) / 2 - width / 2 / px_per_m,
            (y_min + y_max) / 2 + height / 2 / px_per_m,
            px_per_m,
            width,
            height,
        )

    def pixel_of(self, xy_m: ArrayLike) -> NDArray[np.int64]:
        """Pixel (column, row) of places (..., 2); may lie outside."""
        xy = np.asarray(xy_m, np.float64)
        across = (xy[..., 0] - self.left_m) * self.px_per_m
        down = (self.top_m - xy[..., 1]) * self.px_per_m
        return np.floor(np.stack([across, down], axis=-1)).astype(np.int64)

    def cells(self, spec: GridSpec) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Cell column of each pixel column and cell row of each pixel row; -1 outside the grid."""
        x = self.left_m + (np.arange(self.width) + 0.5) / self.px_per_m
        y = self.top_m - (np.arange(self.height) + 0.5) / self.px_per_m
        ix = np.floor((x - spec.origin_m[0]) / spec.resolution_m).astype(np.int64)
        iy = np.floor((y - spec.origin_m[1]) / spec.resolution_m).astype(np.int64)
        return np.where((ix < spec.width) & (ix >= 0), ix, -1), np.where(
            (iy < spec.height) & (iy >= 0), iy, -1
        )


def bounds_of(grid: OccupancyGrid, *more_xy_m: ArrayLike) -> tuple[float, float, float, float]:
    """(x_min, x_max, y_min, y_max) of what is known, and of further places, with a little air around."""
    rows, columns = (np.flatnonzero(grid.classes.any(axis=axis)) for axis in (1, 0))
    corners = [np.asarray(xy, np.float64) for xy in more_xy_m]
    if len(rows):
        r = grid.spec.resolution_m
        low = np.array([columns[0], rows[0]]) * r + grid.spec.origin_m
        high = np.array([columns[-1] + 1, rows[-1] + 1]) * r + grid.spec.origin_m
        corners += [low, high]
    if not len(rows) and not corners:
        return grid.spec.extent_m
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    air = max(0.04 * float((high - low).max()), 2 * grid.spec.resolution_m)
    return float(low[0] - air), float(high[0] + air), float(low[1] - air), float(high[1] + air)


def draw_classes(grid: OccupancyGrid, view: View) -> Picture:
    """The cells of a map; where a pixel holds many, the gravest class shows: no obstacle gets lost."""
    colors: Picture = COLOR_OF_CLASS[_sampled(grid.classes, grid.spec, view, MapClass.UNKNOWN)]
    return colors


def draw_cells(picture: Picture, cells: NDArray[np.bool_], spec: GridSpec, view: View, color: Color) -> None:
    """Paint some cells of a map in one colour; a pixel that holds any of them is painted."""
    picture[_sampled(cells.astype(np.uint8), spec, view, 0) > 0] = color


def draw_costs(costs: NDArray[np.uint8], spec: GridSpec, view: View) -> Picture:
    """The cells of a costmap; where a pixel holds many, the highest known cost shows."""
    known = np.where(
        costs == NO_INFORMATION, 0, costs.astype(np.uint16) + 1
    )  # unknown lowest: max keeps lethal
    colors: Picture = cost_colors()[_sampled(known, spec, view, 0)]
    return colors


def tint_costs(picture: Picture, grid: OccupancyGrid, costs: NDArray[np.uint8], view: View) -> Picture:
    """Lay costs over the drawn cells that hold no obstacle: the margin strongly, what falls off faintly."""
    share = np.where(costs >= LETHAL, 0.58, np.where(costs == INSCRIBED, 0.32, costs / 252 * 0.18))
    share[(costs == NO_INFORMATION) | grid.is_obstacle] = 0
    levels = _sampled((share * 250).astype(np.uint8), grid.spec, view, 0)
    hazard = _sampled(grid.is_obstacle.astype(np.uint8), grid.spec, view, 0) > 0
    opacity = np.where(hazard, 0, levels / np.float32(250)).astype(np.float32)
    return blend(picture, np.full_like(picture, MARGIN_COLOR), opacity)


def draw_points(picture: Picture, cloud: LabeledCloud, view: View, size: int = 2) -> None:
    """The points of a cloud in their class colours, the gravest class on top."""
    pixels = view.pixel_of(cloud.xyz[:, :2])
    seen = ((pixels >= 0) & (pixels < (view.width, view.height))).all(axis=1)
    flat, labels = pixels[seen, 1] * view.width + pixels[seen, 0], cloud.labels[seen]
    map_class = cloud.label_set.map_class_table
    order = sorted(set(np.unique(labels).tolist()), key=lambda label: (map_class[label], label))
    ranks = np.zeros(view.width * view.height, np.uint8)
    for rank, label in enumerate(order, start=1):
        ranks[flat[labels == label]] = rank
    grown = cv2.dilate(ranks.reshape(view.height, view.width), np.ones((size, size), np.uint8))
    colors = cloud.label_set.color_table[np.array([0, *order])]
    picture[grown > 0] = colors[grown[grown > 0]]


def draw_camera(picture: Picture, view: View, T_map_camera: Pose, intrinsics: Intrinsics | None) -> None:
    """A dot where the camera is, and the sector it sees."""
    at = view.pixel_of(T_map_camera.position_m[:2])
    if not ((at > -view.width) & (at < 2 * view.width)).all():
        return
    forward = T_map_camera.matrix[:2, 2]
    if intrinsics is not None and np.linalg.norm(forward) > 1e-3:
        heading = np.arctan2(forward[1], forward[0])
        half = np.arctan(intrinsics.width / 2 / intrinsics.fx)
        for edge in (heading - half, heading + half):
            end = at + np.round(46 * np.array([np.cos(edge), -np.sin(edge)])).astype(int)
            cv2.line(picture, _point(at), _point(end), INK, 1, cv2.LINE_AA)
    cv2.circle(picture, _point(at), 6, INK, cv2.FILLED, cv2.LINE_AA)
    cv2.circle(picture, _point(at), 6, PAPER, 1, cv2.LINE_AA)


def draw_scale(picture: Picture, view: View) -> None:
    """A bar of a round length in metres, lower left."""
    length_m = round_length(view.width / 4 / view.px_per_m)
    length = max(1, round(length_m * view.px_per_m))
    words = f"{length_m:g} m" if length_m >= 0.01 else f"{length_m * 1000:g} mm"
    x, y = 14, view.height - 16
    plate = picture[y - 26 : y + 8, x - 6 : x + max(length, 44) + 7]
    plate[:] = blend(plate, np.full_like(plate, PAPER), 0.82)
    cv2.line(picture, (x, y), (x + length, y), INK, 2)
    for end in (x, x + length):
        cv2.line(picture, (end, y - 4), (end, y + 3), INK, 2)
    write(picture, words, x + 2, y - 9, 14)


def round_length(limit: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `limit`.

    >>> [round_length(v) for v in (0.09, 1.0, 4.9, 70)]
    [0.05, 1.0, 2.0, 50.0]
    """
    power = 10.0 ** np.floor(np.log10(limit))
    return float(max(step for step in (power, 2 * power, 5 * power) if step <= limit * (1 + 1e-9)))


def cost_colors() -> Picture:
    """(256, 3): colour of unknown, then of the costs 0..254."""
    level = np.linspace(0, 1, 252)[:, None]
    pale, strong = np.array([250, 238, 205]), np.array([226, 132, 60])
    colors = np.empty((256, 3))
    colors[0], colors[1] = UNKNOWN_COLOR, (246, 248, 243)
    colors[2:254] = pale + (strong - pale) * level
    colors[254], colors[255] = (196, 84, 110), (92, 30, 56)
    return colors.astype(np.uint8)


def _sampled(cells: NDArray[Any], spec: GridSpec, view: View, outside: int) -> NDArray[Any]:
    """Value of the cell under each pixel; the highest where cells are smaller than pixels."""
    block = int(np.ceil(1 / (view.px_per_m * spec.resolution_m) - 1e-9))
    if block > 1:
        cells = block_max(cells, block)
        spec = replace(
            spec, resolution_m=spec.resolution_m * block, width=cells.shape[1], height=cells.shape[0]
        )
    columns, rows = view.cells(spec)
    values = cells[np.ix_(rows, columns)]
    values[rows < 0] = outside
    values[:, columns < 0] = outside
    return values


def block_max(cells: NDArray[Any], block: int) -> NDArray[Any]:
    """The highest value of each block of `block` x `block` cells; the last may be smaller."""
    if block == 1:
        return cells
    starts = (np.arange(0, cells.shape[0], block), np.arange(0, cells.shape[1], block))
    return np.maximum.reduceat(np.maximum.reduceat(cells, starts[0], axis=0), starts[1], axis=1)


def _point(pixel: NDArray[np.int64]) -> tuple[int, int]:
    return int(pixel[0]), int(pixel[1])
