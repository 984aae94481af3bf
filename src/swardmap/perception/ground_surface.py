"""The ground of one frame: a robust plane, and how far the ground of each block of cells is off it.

A large slope goes into the plane, a gentle bend into the offsets, an obstacle into neither.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import GeometryConfig
from swardmap.grid import GridSpec
from swardmap.kernels.constants import (
    DENT_M,
    FEWEST_CELLS,
    LANES,
    LOW_SHARE,
    LOWEST_PART_M,
    PER_METRE,
    STEP_CELLS,
)

LOWEST_CAMERA_M = 0.03  # a plane that is not so far below the camera is not what the robot stands on
NEAR_PLANE_M = (0.6, 0.4, 0.25, 0.2, 0.15, 0.15)  # how near to the plane counts, round by round

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Sums = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The ground of one frame, in the frame `grid`.

    Attributes:
        plane: (3,) float64 a, b, c of z = a x + b y + c.
        offset_m: (cells,) float32 how far the ground lies over the plane; NaN where not seen.
        floor_m: (cells,) float32 the same, lower beside a step down: what a rise is measured from.
        carried: it is that of an earlier view.
    """

    plane: Float64
    offset_m: Float32
    floor_m: Float32
    carried: bool = False

    @property
    def shown_slope(self) -> tuple[float, float] | None:
        """(dz/dx, dz/dy) that this view itself has shown; None if it is that of an earlier one."""
        a, b, _ = self.plane.tolist()
        return None if self.carried else (a, b)

    def height_m(self, spec: GridSpec) -> Float32:
        """(height, width) float32 height of the ground in the middle of each cell; NaN = not seen."""
        a, b, c = self.plane
        y, x = (((np.arange(n) + 0.5) * spec.resolution_m).astype(np.float32) for n in spec.shape)
        plane_m = np.float32(a) * x + (np.float32(b) * y + np.float32(c))[:, None]
        return self.offset_m.reshape(spec.shape) + plane_m


@dataclass(frozen=True, slots=True)
class GroundPlane:
    """The plane of the ground that a view has shown, to serve those that show none.

    Attributes:
        slope: (dz/dx, dz/dy) in the map frame.
        at_m: (x, y, z) of the plane under the camera that saw it.
        frame_id: of the map.
    """

    slope: tuple[float, float]
    at_m: tuple[float, float, float]
    frame_id: str = "map"

    @classmethod
    def of(cls, ground: Ground, spec: GridSpec, viewpoint_m: tuple[float, float, float]) -> "GroundPlane":
        """The plane of a frame's ground, in the map frame."""
        a, b, c = ground.plane.tolist()
        (x, y, _), (ox, oy) = viewpoint_m, spec.origin_m
        return cls((a, b), (x, y, a * (x - ox) + b * (y - oy) + c), spec.frame_id)

    def in_grid(self, spec: GridSpec) -> Float64:
        """(3,) a, b, c of z = a x + b y + c in the frame `grid` of a grid in the same map."""
        (a, b), (x, y, z), (ox, oy) = self.slope, self.at_m, spec.origin_m
        return np.array([a, b, z + a * (ox - x) + b * (oy - y)])


Fit = Callable[[Sums, GridSpec, GeometryConfig], Ground | None]


def find_ground(
    sums: Sums,
    spec: GridSpec,
    config: GeometryConfig,
    viewpoint_m: tuple[float, float, float],
    earlier: GroundPlane | None = None,
    fit: Fit | None = None,
) -> Ground | None:
    """The ground of a view; where it shows none, that of an earlier view nearby; None if neither is known.

    Args:
        sums: as `fit_ground` takes it.
        spec: the grid.
        config: how steep ground may be, and how far an earlier view serves.
        viewpoint_m: (x, y, z) of the camera in the map frame: ground lies below it.
        earlier: the last ground that was seen.
        fit: `fit_ground`, or its compiled twin.
    """
    ground = (fit or fit_ground)(sums, spec, config)
    if ground is not None and _is_below(GroundPlane.of(ground, spec, viewpoint_m), viewpoint_m):
        return ground
    if earlier is None or earlier.frame_id != spec.frame_id or config.carry_m <= 0:
        return None
    x, y, _ = viewpoint_m
    if np.hypot(x - earlier.at_m[0], y - earlier.at_m[1]) > config.carry_m:
        return None
    level = np.zeros(len(sums), np.float32)
    carried = Ground(earlier.in_grid(spec), level, level, carried=True)
    return carried if _is_below(GroundPlane.of(carried, spec, viewpoint_m), viewpoint_m) else None


def _is_below(plane: GroundPlane, viewpoint_m: tuple[float, float, float]) -> bool:
    return viewpoint_m[2] - plane.at_m[2] > LOWEST_CAMERA_M


def fit_ground(sums: Sums, spec: GridSpec, config: GeometryConfig) -> Ground | None:
    """The ground under the cells that were seen, or None if too few were.

    Args:
        sums: (cells, 3) int64 sum of heights in 0.1 mm, points, and lowest height of each cell.
        spec: the grid.
        config: size of the blocks, and how far the ground may bend from one to the next.
    """
    seen = np.flatnonzero(sums[:, 1])
    if len(seen) < FEWEST_CELLS:
        return None
    mean_m = sums[seen, 0] / (sums[seen, 1] * float(PER_METRE))
    height_m = np.minimum(mean_m, sums[seen, 2] / float(PER_METRE) + LOWEST_PART_M)
    iy, ix = np.divmod(seen, spec.width)
    x, y = (ix + 0.5) * spec.resolution_m, (iy + 0.5) * spec.resolution_m
    side = block_cells(spec, config)
    shape = (spec.height - 1) // side + 1, (spec.width - 1) // side + 1
    block = (iy // side) * shape[1] + ix // side

    chosen = _low_of_each(block, height_m)
    mid_x, mid_y = 0.5 * spec.width * spec.resolution_m, 0.5 * spec.height * spec.resolution_m
    dx, dy = x - mid_x, y - mid_y
    level = np.array([0.0, 0.0, np.sort(height_m[chosen])[int(LOW_SHARE * (len(chosen) - 1))]])
    plane = _robust_plane(dx[chosen], dy[chosen], height_m[chosen], level, NEAR_PLANE_M)
    plane = _robust_plane(dx, dy, height_m, plane, NEAR_PLANE_M[-2:])
    plane[2] -= plane[0] * mid_x + plane[1] * mid_y
    if plane[0] * plane[0] + plane[1] * plane[1] > steepest(config) * steepest(
        config
    ):  # a wall fills the view
        return None
    sloping = plane[0] * x + plane[1] * y + plane[2]
    over = height_m - sloping

    chosen = _low_of_each(block, over)
    lows = np.full(shape, np.nan)
    lows.ravel()[block[chosen]] = over[chosen]
    bend = largest_bend(config)
    offsets = _envelope(_without_dents(lows), bend * side * spec.resolution_m)
    offsets[np.isnan(lows)] = np.nan
    own = _interpolated(offsets, (iy + 0.5) / side - 0.5, (ix + 0.5) / side - 0.5)
    allowance = bend * STEP_CELLS * spec.resolution_m
    around = _lowest_around(seen, mean_m - sloping, spec)[seen] + allowance
    offset_m, floor_m = (np.full(len(sums), np.nan, np.float32) for _ in range(2))
    offset_m[seen], floor_m[seen] = own, np.minimum(own, around)
    return Ground(plane, offset_m, floor_m)


def ground_settings(config: GeometryConfig) -> tuple[float, float, float]:
    """All of a configuration that the ground of a view depends on."""
    return config.ground_block_m, config.max_slope_deg, config.max_bend_deg


def block_cells(spec: GridSpec, config: GeometryConfig) -> int:
    """Side of a block in cells."""
    return max(1, round(config.ground_block_m / spec.resolution_m))


def steepest(config: GeometryConfig) -> float:
    """Tangent of the steepest slope that is ground."""
    return float(np.tan(np.deg2rad(config.max_slope_deg)))


def largest_bend(config: GeometryConfig) -> float:
    """Tangent of how much steeper the ground may get from one block to the next."""
    return float(np.tan(np.deg2rad(config.max_bend_deg)))


def _low_of_each(block: NDArray[np.int64], height_m: Float64) -> NDArray[np.intp]:
    """Index of the cell at the low quantile of each block's heights, the first among equals."""
    level = np.clip((height_m + 1000.0) * 10000.0, 0, 2**31 - 1).astype(np.int64)
    order = np.argsort(block * 2**31 + level, kind="stable")
    starts = np.flatnonzero(np.diff(block[order], prepend=-1))
    sizes = np.diff(starts, append=len(order))
    return order[starts + (LOW_SHARE * (sizes - 1)).astype(np.intp)]


def _robust_plane(dx: Float64, dy: Float64, z: Float64, start: Float64, near_m: tuple[float, ...]) -> Float64:
    """Plane through most points: reweighted least squares, what is far from it counts less and less."""
    plane: Float64 = start.copy()
    for near in near_m:
        off = z - (plane[0] * dx + plane[1] * dy + plane[2])
        w = np.square(np.maximum(1.0 - np.square(off * (1.0 / (3.0 * near))), 0.0))  # Tukey's biweight
        wx, wy, wo = w * dx, w * dy, w * off
        sums = [_sum(v) for v in (wx * dx, wx * dy, wy * dy, wx, wy, w, wo * dx, wo * dy, wo)]
        plane += _step(sums, 1e-6 * len(z))
    return plane


def _sum(values: Float64) -> float:
    """Sum in as many lanes as the compiled twin has: the same to the last digit."""
    lanes = np.zeros((len(values) + LANES - 1) // LANES * LANES)
    lanes[: len(values)] = values
    return float(np.cumsum(np.cumsum(lanes.reshape(-1, LANES), axis=0)[-1])[-1])


def _step(sums: list[float], ridge: float) -> Float64:
    """(3,) solution of the normal equations, by elimination; a ridge holds what the points leave open."""
    xx, xy, yy, wx, wy, w, right1, right2, right3 = sums
    xx, yy, w = xx + ridge, yy + ridge, w + ridge
    l1, l2 = xy / xx, wx / xx
    yy2, wy2 = yy - l1 * xy, wy - l1 * wx
    l3 = wy2 / yy2
    right2 -= l1 * right1
    up = (right3 - l2 * right1 - l3 * right2) / (w - l2 * wx - l3 * wy2)
    along = (right2 - wy2 * up) / yy2
    return np.array([(right1 - xy * along - wx * up) / xx, along, up])


def _without_dents(lows: Float64) -> Float64:
    """Blocks that lie below the median of those around them are lifted to it: a hole is no ground."""
    padded = np.pad(lows, 2, constant_values=np.nan)
    h, w = lows.shape
    views = np.stack([padded[i : i + h, j : j + w] for i in range(5) for j in range(5)])
    order = np.sort(views, axis=0)  # NaN last
    known = 25 - np.isnan(views).sum(axis=0)
    middle = np.take_along_axis(order, np.maximum(known - 1, 0)[None] // 2, axis=0)[0]
    return np.where(known >= 4, np.fmax(lows, np.where(np.isnan(lows), np.nan, middle - DENT_M)), lows)


def _envelope(lows: Float64, rise_m: float) -> Float64:
    """The highest surface below all blocks that rises by at most `rise_m` from block to block."""
    h, w = lows.shape
    padded = np.full((h + 2, w + 2), np.inf)
    inner = padded[1:-1, 1:-1]
    inner[:] = np.where(np.isnan(lows), np.inf, lows)
    steps = [(i, j, rise_m * float(np.sqrt(i * i + j * j))) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    for _ in range(h + w):
        before = inner.copy()
        for i, j, rise in steps:
            np.minimum(inner, padded[1 + i : 1 + i + h, 1 + j : 1 + j + w] + rise, out=inner)
        if np.array_equal(before, inner):
            break
    return inner.copy()


def _interpolated(offsets: Float64, row: Float64, column: Float64) -> Float64:
    """Bilinear between the middles of blocks, those not seen left out."""
    total, weight = np.zeros(len(row)), np.zeros(len(row))
    i0, j0 = np.floor(row).astype(np.intp), np.floor(column).astype(np.intp)
    fi, fj = row - i0, column - j0
    h, w = offsets.shape
    values, known = np.nan_to_num(offsets).ravel(), np.isfinite(offsets).ravel()
    for di, wi in ((0, 1 - fi), (1, fi)):
        for dj, wj in ((0, 1 - fj), (1, fj)):
            at = np.clip(i0 + di, 0, h - 1) * w + np.clip(j0 + dj, 0, w - 1)
            share = wi * wj * known[at]
            total += share * values[at]
            weight += share
    return total / weight  # the block of a cell that was seen was seen: never 0


def _lowest_around(seen: NDArray[np.intp], over: Float64, spec: GridSpec) -> Float64:
    """(cells,) lowest mean height over the plane within a few cells."""
    n = STEP_CELLS
    table = np.full((spec.height + 2 * n, spec.width + 2 * n), np.inf)
    iy, ix = np.divmod(seen, spec.width)
    table[iy + n, ix + n] = over
    rows = table[: spec.height].copy()
    for i in range(1, 2 * n + 1):
        np.minimum(rows, table[i : i + spec.height], out=rows)
    lowest = rows[:, : spec.width].copy()
    for j in range(1, 2 * n + 1):
        np.minimum(lowest, rows[:, j : j + spec.width], out=lowest)
    return lowest.ravel()
