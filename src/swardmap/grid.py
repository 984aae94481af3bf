"""The occupancy grid (Sec. 3.5): where a point falls (Eq. 2), and what a cell becomes.

Row-major [iy, ix]; the origin is the outer corner of cell (0, 0); the centre of a cell is at +0.5.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.errors import InvalidValueError
from swardmap.geometry import Pose
from swardmap.labels import MapClass
from swardmap.types import LabeledCloud

MAX_CELLS = 400_000_000
"""Refuse larger grids: a unit error (mm for m) otherwise ends in an unhelpful MemoryError."""

NAV_VALUE_OF_CLASS = np.array([-1, 0, 100, 100], np.int8)
"""nav_msgs/OccupancyGrid value of each MapClass."""


@dataclass(frozen=True, slots=True)
class GridSpec:
    """Where a grid lies and how fine it is.

    Attributes:
        resolution_m: edge of a cell, the paper's r.
        width, height: cells along x and along y.
        origin_m: (x, y) of the outer corner of cell (0, 0) in `frame_id`; Eq. 2's offsets are
            -origin_m / resolution_m.
        frame_id: frame the grid lies in, z up.
    """

    resolution_m: float
    width: int
    height: int
    origin_m: tuple[float, float] = (0.0, 0.0)
    frame_id: str = "map"

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin_m", (float(self.origin_m[0]), float(self.origin_m[1])))
        if not (math.isfinite(self.resolution_m) and self.resolution_m > 0):
            raise InvalidValueError(
                f"grid: expected a positive resolution in metres, got {self.resolution_m}"
            )
        if self.width <= 0 or self.height <= 0 or self.width * self.height > MAX_CELLS:
            raise InvalidValueError(
                f"grid: expected between 1 and {MAX_CELLS} cells, got {self.width} x {self.height}; "
                "check the resolution, and the poses for a jump or a wrong unit"
            )
        if not all(map(math.isfinite, self.origin_m)):
            raise InvalidValueError(f"grid: expected a finite origin, got {self.origin_m}")

    @classmethod
    def covering(
        cls,
        resolution_m: float,
        lower_m: tuple[float, float],
        upper_m: tuple[float, float],
        frame_id: str = "map",
    ) -> "GridSpec":
        """Smallest grid on the lattice of whole cells from (0, 0) that covers a rectangle."""
        r = resolution_m
        if not (r > 0 and all(map(math.isfinite, (r, *lower_m, *upper_m)))):
            raise InvalidValueError(
                f"grid: expected a positive resolution and finite corners, got {r}, {lower_m}, {upper_m}"
            )
        ix, iy = (math.floor(low / r) for low in lower_m)
        nx = max(1, math.ceil(upper_m[0] / r) - ix)
        ny = max(1, math.ceil(upper_m[1] / r) - iy)
        corner = round(ix * r, 9), round(iy * r, 9)  # -11.7, not -11.700000000000001
        return cls(r, nx, ny, corner, frame_id)

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), the shape of the arrays."""
        return self.height, self.width

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """(x_min, x_max, y_min, y_max) of the outer border."""
        x, y = self.origin_m
        r = self.resolution_m
        return x, x + self.width * r, y, y + self.height * r

    @property
    def T_grid_map(self) -> Pose:
        """Pose that puts the origin at the outer corner of cell (0, 0): grid <- frame_id."""
        matrix = np.eye(4)
        matrix[:2, 3] = -self.origin_m[0], -self.origin_m[1]
        return Pose("grid", self.frame_id, matrix)

    def cell_of(self, xy_m: ArrayLike) -> NDArray[np.int64]:
        """Cell of each point: Eq. 2, floor(x / r + offset). May lie outside: see `contains`.

        Args:
            xy_m: (..., 2) metres in `frame_id`, finite.

        Returns:
            (..., 2) int64 (ix, iy).

        >>> GridSpec(0.1, 20, 20, origin_m=(-1.0, -1.0)).cell_of([0.25, -0.95]).tolist()
        [12, 0]
        """
        offset = np.asarray(xy_m, np.float64) - np.asarray(self.origin_m)
        cells: NDArray[np.int64] = np.floor(offset / self.resolution_m).astype(np.int64)
        return cells

    def center_of(self, cell: ArrayLike) -> NDArray[np.float64]:
        """Centres of cells (..., 2) given as (ix, iy), in metres."""
        centers: NDArray[np.float64] = (np.asarray(cell, np.float64) + 0.5) * self.resolution_m + np.asarray(
            self.origin_m
        )
        return centers

    def contains(self, cell: ArrayLike) -> NDArray[np.bool_]:
        """Whether cells (..., 2) given as (ix, iy) lie in the grid."""
        ix, iy = np.moveaxis(np.asarray(cell), -1, 0)
        return np.asarray((ix >= 0) & (iy >= 0) & (ix < self.width) & (iy < self.height))

    def part_within(self, other: "GridSpec") -> "GridSpec":
        """The part of this grid, on its own lattice, that covers where `other` overlaps it.

        Where they do not overlap it is one cell at the rim, since a grid has at least one.
        """
        x0, x1, y0, y1 = other.extent_m
        size = np.array([self.width, self.height])
        first = np.clip(self.cell_of([x0, y0]), 0, size - 1)
        last = np.clip(self.cell_of([x1, y1]), first, size - 1)
        origin = np.asarray(self.origin_m) + first * self.resolution_m
        width, height = (last - first + 1).tolist()
        return replace(self, width=width, height=height, origin_m=(origin[0], origin[1]))

    def offset_in(self, outer: "GridSpec") -> tuple[int, int]:
        """(ix, iy) of this grid's cell (0, 0) in a grid on the same lattice.

        Raises:
            InvalidValueError: if frames or resolutions differ, or the lattices do not coincide.
        """
        if self.frame_id != outer.frame_id or self.resolution_m != outer.resolution_m:
            raise InvalidValueError(
                f"grids do not fit: {self.resolution_m} m in '{self.frame_id}' and "
                f"{outer.resolution_m} m in '{outer.frame_id}'"
            )
        (x, y), (x0, y0) = self.origin_m, outer.origin_m
        steps = (x - x0) / self.resolution_m, (y - y0) / self.resolution_m
        ix, iy = map(round, steps)
        if any(
            abs(step - cell) > 1e-3 + 1e-5 * abs(cell) for step, cell in zip(steps, (ix, iy), strict=True)
        ):
            raise InvalidValueError(
                f"grids do not fit: origins {self.origin_m} and {outer.origin_m} are not whole cells apart"
            )
        return ix, iy


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyGrid:
    """What is known of each cell.

    Attributes:
        spec: where the grid lies.
        classes: (height, width) uint8 MapClass: unknown, grass, obstacle, person.
        stamp_ns: time of the last measurement in it.
    """

    spec: GridSpec
    classes: NDArray[np.uint8]
    stamp_ns: int = 0

    def __post_init__(self) -> None:
        if self.classes.shape != self.spec.shape or self.classes.dtype != np.uint8:
            raise InvalidValueError(
                f"occupancy grid: expected uint8 of shape {self.spec.shape}, "
                f"got {self.classes.dtype} of shape {self.classes.shape}"
            )

    @classmethod
    def unknown(cls, spec: GridSpec) -> "OccupancyGrid":
        """A grid of which nothing is known."""
        return cls(spec, np.full(spec.shape, MapClass.UNKNOWN, np.uint8))

    @property
    def nav_values(self) -> NDArray[np.int8]:
        """(height, width) int8 as in nav_msgs/OccupancyGrid: -1 unknown, 0 free, 100 occupied."""
        return NAV_VALUE_OF_CLASS.take(self.classes)

    @property
    def is_obstacle(self) -> NDArray[np.bool_]:
        """(height, width) bool: obstacle or person, as Tables 6, 8 and 9 count it."""
        return self.classes >= MapClass.OBSTACLE

    def count(self, map_class: MapClass) -> int:
        """Number of cells of a class."""
        return int(np.count_nonzero(self.classes == map_class))


def count_points(cloud: LabeledCloud, spec: GridSpec) -> tuple[NDArray[np.uint32], int]:
    """Count the points of each map class in each cell (the projection half of Eq. 2).

    Args:
        cloud: points in the frame `grid`, that is, transformed by `spec.T_grid_map`.
        spec: the grid.

    Returns:
        (height, width, 4) uint32 points by MapClass (void points at UNKNOWN), and the number of
        points outside the grid.
    """
    if cloud.frame_id != "grid":
        raise InvalidValueError(
            f"expected a cloud in the frame 'grid', got '{cloud.frame_id}': "
            "transform it by spec.T_grid_map @ T_map_cloud"
        )
    per_metre = np.float32(1.0 / spec.resolution_m)
    x, y = cloud.xyz[:, 0] * per_metre, cloud.xyz[:, 1] * per_metre
    inside = (x >= 0) & (y >= 0) & (x < np.float32(spec.width)) & (y < np.float32(spec.height))
    ix, iy = x[inside].astype(np.int64), y[inside].astype(np.int64)  # floor: not negative
    classes = cloud.label_set.map_class_table[cloud.labels[inside]]
    flat = (iy * spec.width + ix) * 4 + classes
    counts = np.bincount(flat, minlength=spec.width * spec.height * 4)
    outside = int(len(cloud) - np.count_nonzero(inside))
    return counts.astype(np.uint32).reshape(*spec.shape, 4), outside


def classify_cells(
    counts: NDArray[np.uint32],
    min_points: int,
    min_grass_points: int | None = None,
    clear: NDArray[np.bool_] | None = None,
) -> NDArray[np.uint8]:
    """Class of each cell from its point counts: grass clears, then obstacle and person mark.

    A cell needs `min_grass_points` points of grass to be cleared, and `min_points` of obstacle and
    person together to be marked; it is then a person's where persons reach `min_points` or are no
    fewer than the rest. An obstacle beats grass; what is not seen often enough stays unknown.

    Args:
        counts: (height, width, 4) points by MapClass.
        min_points: k of obstacles, at least 1.
        min_grass_points: k of grass; None = min_points.
        clear: (height, width) bool, cells that may be cleared at all; None = every cell.

    Returns:
        (height, width) uint8 MapClass.
    """
    grass, obstacle, person = (counts[..., c] for c in (1, 2, 3))
    classes = np.full(counts.shape[:2], MapClass.UNKNOWN, np.uint8)
    free = grass >= (min_grass_points or min_points)
    classes[free if clear is None else free & clear] = MapClass.GRASS
    marked = obstacle + person >= min_points
    classes[marked] = MapClass.OBSTACLE
    classes[marked & ((person >= min_points) | (person >= obstacle))] = MapClass.PERSON
    return classes


def update_grid(grid: OccupancyGrid, seen: OccupancyGrid) -> OccupancyGrid:
    """Sec. 3.5: clear the cells that were seen as grass, then mark obstacles and persons.

    Cells that `seen` does not know keep what they were; cells outside `grid` are left out.

    Args:
        grid: the map so far.
        seen: one frame's grid on the same lattice.

    Returns:
        The new map; `grid` is not changed.
    """
    classes = grid.classes.copy()
    here, there = overlap(seen.spec, grid.spec)
    window, news = classes[there], seen.classes[here]
    window[news == MapClass.GRASS] = MapClass.GRASS
    hazard = news >= MapClass.OBSTACLE
    np.maximum(window, news, out=window, where=hazard)  # a person stays one until grass is seen
    return replace(grid, classes=classes, stamp_ns=max(grid.stamp_ns, seen.stamp_ns))


def overlap(inner: GridSpec, outer: GridSpec) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Slices of the cells two grids share: into `inner`'s arrays, and into `outer`'s."""
    return shared_cells(inner.offset_in(outer), inner.shape, outer.shape)


def shared_cells(
    offset: tuple[int, int], inner: tuple[int, int], outer: tuple[int, int]
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The same of arrays (height, width) whose cell (0, 0) is cell (ix, iy) of the other."""
    (inner_x, outer_x), (inner_y, outer_y) = (
        _shared(*axis) for axis in zip(offset, inner[::-1], outer[::-1], strict=True)
    )
    return (inner_y, inner_x), (outer_y, outer_x)


def _shared(offset: int, n_inner: int, n_outer: int) -> tuple[slice, slice]:
    start = max(0, offset)
    stop = max(start, min(n_outer, offset + n_inner))
    return slice(start - offset, stop - offset), slice(start, stop)
