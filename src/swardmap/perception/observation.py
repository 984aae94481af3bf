"""What one frame says of the cells it sees: the only thing that maps take in."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.perception.geometric_obstacles import GeometricMarks
from swardmap.perception.ground_surface import Ground, GroundPlane
from swardmap.perception.passes import Counted, Placed


@dataclass(frozen=True, slots=True)
class PixelCounts:
    """What became of the pixels of a frame; every pixel is in exactly one of the rows but the first.

    Attributes:
        pixels: of the depth image.
        no_reading: 0, NaN or infinite depth.
        out_of_range: nearer or farther than the limits.
        inconsistent: removed by the 3x3 consistency filter.
        void: the mask says nothing, or is not sure.
        out_of_height: below or above the limits.
        outside_grid: fell beside the grid.
        merged: joined with others in a voxel, or removed as outliers after that (plain backend only).
        used: counted in a cell.
    """

    pixels: int
    no_reading: int
    out_of_range: int
    inconsistent: int
    void: int
    out_of_height: int
    outside_grid: int
    merged: int
    used: int

    def __add__(self, other: "PixelCounts") -> "PixelCounts":
        return PixelCounts(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What one frame says of the cells of a grid.

    Attributes:
        spec: the grid, on the lattice of the map.
        classes: (height, width) uint8 MapClass, the standalone map of this frame.
        points: (height, width, 4) uint32 points by MapClass that it was made of; at UNKNOWN those that may
            not clear, for they are in doubt or no ground is known.
        viewpoint_m: (x, y, z) of the camera in the grid's frame.
        stamp_ns: time of the frame.
        counts: what became of its pixels.
        semantic: (height, width) uint8 MapClass from the network's classes alone.
        ground: of this view, or carried over from an earlier one; None = not known, so nothing is free.
        geometry: what depth marks; None = switched off.
        height_row: (4,) float32 a, b, c, d: height a x + b y + c z + d of a point of the camera above the
            plane of the ground, or above the map's z = 0 where no ground is known.
    """

    spec: GridSpec
    classes: NDArray[np.uint8]
    points: NDArray[np.uint32]
    viewpoint_m: tuple[float, float, float]
    stamp_ns: int
    counts: PixelCounts
    semantic: NDArray[np.uint8]
    ground: Ground | None = None
    geometry: GeometricMarks | None = None
    height_row: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        if self.classes.shape != self.spec.shape or self.points.shape != (*self.spec.shape, 4):
            raise InvalidValueError(
                f"observation: expected arrays of {self.spec.shape} cells, "
                f"got classes {self.classes.shape} and points {self.points.shape}"
            )

    @property
    def grid(self) -> OccupancyGrid:
        """The standalone map of this frame."""
        return OccupancyGrid(self.spec, self.classes, self.stamp_ns)

    @property
    def ground_slope(self) -> tuple[float, float] | None:
        """(dz/dx, dz/dy) of the ground that this view itself has shown, in the map; None = none."""
        return None if self.ground is None else self.ground.shown_slope

    @property
    def semantic_grid(self) -> OccupancyGrid:
        """The same from the network's classes alone."""
        return OccupancyGrid(self.spec, self.semantic, self.stamp_ns)

    @property
    def by_geometry(self) -> NDArray[np.bool_] | None:
        """(height, width) bool, cells that geometry alone marks; None if it is switched off."""
        return None if self.geometry is None else self.geometry.marks & (self.semantic < 2)

    @property
    def ground_m(self) -> NDArray[np.float32]:
        """(height, width) float32 height of the ground in the grid's frame; NaN where it is not known."""
        if self.ground is None:
            return np.full(self.spec.shape, np.nan, np.float32)
        return self.ground.height_m(self.spec)

    @property
    def camera_height_m(self) -> float | None:
        """Of the camera above the ground's plane; None if no ground is known."""
        if self.ground is None:
            return None
        return self.viewpoint_m[2] - GroundPlane.of(self.ground, self.spec, self.viewpoint_m).at_m[2]


def may_clear(
    counted: Counted, ground: Ground | None, clear_below: float, level: bool = True
) -> NDArray[np.bool_]:
    """(height, width) bool: cells whose points are hardly ever in doubt, on ground that is known.

    Args:
        counted: points of a frame by cell.
        ground: of the view.
        clear_below: largest mean P(obstacle or person).
        level: one point that stands above the ground, or lies below it, is enough not to clear: fewer than a
            geometric mark takes, and what is called grass half a metre up is no lawn. So is one above it that
            the filter removed: a wire is seldom consistent, and marks nothing, but is no lawn either.
    """
    if ground is None:
        return np.zeros(counted.seen.shape, np.bool_)
    sure = np.asarray(counted.doubt <= (255 * clear_below) * counted.seen.astype(np.float64))
    return sure & ((counted.above | counted.below | counted.dropped) == 0) if level else sure


def without_doubt(
    points: NDArray[np.uint32], clear: NDArray[np.bool_], min_points: int
) -> NDArray[np.uint32]:
    """Points in which grass that may not clear counts as unsure.

    Beside an obstacle it stays grass: there it clears nothing, and says how much of the cell is obstacle.

    Args:
        points: (height, width, 4) uint32 points by MapClass.
        clear: (height, width) bool of `may_clear`.
        min_points: points of obstacle and person that mark a cell.
    """
    doubted = ~clear & (points[..., 2] + points[..., 3] < min_points)
    told = points.copy()
    told[doubted, MapClass.UNKNOWN] += told[doubted, MapClass.GRASS]
    told[doubted, MapClass.GRASS] = 0
    return told


def clear_together(
    classes: NDArray[np.uint8], points: NDArray[np.uint32], min_grass_points: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint32]]:
    """Clear cells whose points of grass are too few, but enough with those of their neighbours.

    Far away a cell holds one or two pixels: its lawn would stay unknown for want of points. The cell has a
    point of grass itself, the 3 x 3 cells about it hold enough and none that is in doubt, and
    none of the 7 x 7 is marked: next to an obstacle a cell needs points of its own.

    Args:
        classes: (height, width) uint8 MapClass of all evidence.
        points: (height, width, 4) uint32 as of `Observation.points`.
        min_grass_points: points that clear a cell.

    Returns:
        Both anew; a cell that is cleared so has as many points of grass as clear it.
    """
    grass, doubted = points[..., MapClass.GRASS], points[..., MapClass.UNKNOWN]
    few = (classes == MapClass.UNKNOWN) & (grass > 0) & (grass < min_grass_points)
    enough = _neighbours(grass, np.add) >= min_grass_points
    sure = _neighbours(doubted, np.maximum) == 0
    near = classes
    for _ in range(3):
        near = _neighbours(near, np.maximum)
    cleared = few & enough & sure & (near < MapClass.OBSTACLE)
    classes, points = classes.copy(), points.copy()
    classes[cleared] = MapClass.GRASS
    points[cleared, MapClass.GRASS] = min_grass_points
    return classes, points


def _neighbours(values: NDArray[Any], join: np.ufunc) -> NDArray[Any]:
    """Each cell joined with the eight about it; nothing lies beyond the rim."""
    padded = np.pad(values, 1)
    rows = join(join(padded[:-2], padded[1:-1]), padded[2:])
    return np.asarray(join(join(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:]))


def pixel_counts(placed: Placed, counted: Counted) -> PixelCounts:
    """What became of the pixels, every pixel once."""
    in_no_cell = placed.not_in_range + placed.not_consistent + placed.outside
    return PixelCounts(
        pixels=placed.cells.size,
        no_reading=placed.no_reading,
        out_of_range=placed.not_in_range - placed.no_reading,
        inconsistent=placed.not_consistent,
        void=counted.void,
        out_of_height=counted.out_of_height,
        outside_grid=placed.outside,
        merged=counted.merged,
        used=placed.cells.size - in_no_cell - counted.void - counted.out_of_height - counted.merged,
    )
