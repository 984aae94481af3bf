"""What stands above the local ground, and holes in it, from depth alone: evidence beside the network's.

The ground of one frame is a plane, found robustly, and how far the ground of each half a metre is off
it. A large slope goes into the plane, a gentle bend into the offsets, an obstacle into neither.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swardmap.cloud import consistent_depth, crop_range
from swardmap.config import CloudConfig, Config, GeometryConfig
from swardmap.errors import InvalidValueError
from swardmap.geometry import Pose, deproject, transform_points
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.types import Frame

PER_METRE = np.float32(10000)  # heights are summed as whole tenths of millimetres (kernels.ground)
HIGHEST = 2**31 - 1  # lowest height of a cell without points
LOW_SHARE = 0.3  # of the cells of a block are taken to be ground, where an obstacle covers the rest
LOWEST_PART_M = 0.05  # of a cell's points above its lowest is ground, where the rest is a trunk or a roof
STEP_CELLS = 2  # a step is looked for this many cells around
DENT_M = 0.05  # a block this much below those around it is a hole, not the ground
FEWEST_CELLS = 12  # less ground than that is no ground
PLANE_ROUNDS, NEAR_PLANE_M = 6, (0.6, 0.4, 0.25, 0.2, 0.15, 0.15)

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Sums = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class GroundEvidence:
    """What depth alone says about the cells of one frame.

    Attributes:
        grid: OBSTACLE where something stands or a hole gapes, UNKNOWN elsewhere; never GRASS, since
            flat is not the same as grass.
        holes: (height, width) bool, the obstacle cells with points below the ground.
        ground_m: (height, width) float32 height of the ground in the grid's frame; NaN where not seen.
    """

    grid: OccupancyGrid
    holes: NDArray[np.bool_]
    ground_m: Float32


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The ground of one frame, in the frame `grid`.

    Attributes:
        plane: (3,) float64 a, b, c of z = a x + b y + c.
        offset_m: (cells,) float32 how far the ground lies over the plane; NaN where not seen.
        floor_m: (cells,) float32 the same, lower beside a step down: what a rise is measured from.
    """

    plane: Float64
    offset_m: Float32
    floor_m: Float32


def fuse(semantic: OccupancyGrid, evidence: GroundEvidence) -> OccupancyGrid:
    """Both kinds of evidence in one grid: a mark of either is a mark; only grass seen as such is free.

    Raises:
        InvalidValueError: if the two grids are not one and the same lattice.
    """
    if semantic.spec != evidence.grid.spec:
        raise InvalidValueError(f"fuse: expected one grid, got {semantic.spec} and {evidence.grid.spec}")
    return replace(semantic, classes=np.maximum(semantic.classes, evidence.grid.classes))


def observe_ground(
    frame: Frame,
    T_map_camera: Pose,
    spec: GridSpec,
    cloud: CloudConfig,
    config: GeometryConfig,
    min_points: int,
    compiled: bool = True,
) -> GroundEvidence:
    """Mark what rises above the ground around it, and what lies below it.

    Takes every reading in range that passes the consistency filter, whatever its class.

    Args:
        frame: its depth is used, nothing else.
        T_map_camera: pose of the camera in the grid's frame, z up.
        spec: the grid.
        cloud: range, consistency filter, and `max_height_m`, here above the local ground.
        config: thresholds and noise.
        min_points: points above (below) that make a cell an obstacle (a hole).
        compiled: the fast twin of the two passes over the pixels; the result is the same.
    """
    T_grid_camera = spec.T_grid_map @ Pose(T_map_camera.parent, "camera", T_map_camera.matrix)
    cells, sums = (_fast_sums if compiled else _plain_sums)(frame, T_grid_camera, spec, cloud)
    ground = fit_ground(sums, spec, config, min_points)
    if ground is None:
        nothing = replace(OccupancyGrid.unknown(spec), stamp_ns=frame.stamp_ns)
        return GroundEvidence(nothing, np.zeros(spec.shape, bool), np.full(spec.shape, np.nan, np.float32))
    a, b, c = ground.plane
    R, t = T_grid_camera.matrix[:3, :3], T_grid_camera.position_m
    normal = np.array([-a, -b, 1.0])  # height above the plane = normal . p - c
    up = np.array([*(normal @ R), normal @ t - c]).astype(np.float32)
    limits = np.array(
        [config.min_height_m, cloud.max_height_m, config.hole_depth_m,
         config.noise_sigmas * config.noise_m_at_1m], np.float32,
    )  # fmt: skip
    counts = (_fast_counts if compiled else _plain_counts)(frame, up, limits, cells, ground)
    above, below = (counts[:, i].reshape(spec.shape) >= min_points for i in (0, 1))
    classes = np.where(above | below, MapClass.OBSTACLE, MapClass.UNKNOWN).astype(np.uint8)
    y, x = (((np.arange(n) + 0.5) * spec.resolution_m).astype(np.float32) for n in spec.shape)
    plane_m = np.float32(a) * x + (np.float32(b) * y + np.float32(c))[:, None]
    height_m = ground.offset_m.reshape(spec.shape) + plane_m
    grid = OccupancyGrid(spec, classes, frame.stamp_ns)
    return GroundEvidence(grid, below, height_m)


def with_geometry(
    frame: Frame, semantic: OccupancyGrid, T_map_camera: Pose, config: Config
) -> tuple[OccupancyGrid, GroundEvidence | None]:
    """The frame's grid from all the evidence that is switched on, and what geometry alone says.

    Args:
        frame: its depth is used.
        semantic: its grid from the network's classes.
        T_map_camera: pose of the camera in the grid's frame.
        config: `geometry` says what is switched on, `road` which twin computes it.
    """
    if not config.geometry.enabled:
        return semantic, None
    evidence = observe_ground(
        frame, T_map_camera, semantic.spec, config.cloud, config.geometry, config.grid.min_points,
        compiled=config.road == "fused",
    )  # fmt: skip
    return (fuse(semantic, evidence) if config.geometry.semantics else evidence.grid), evidence


def fit_ground(sums: Sums, spec: GridSpec, config: GeometryConfig, min_points: int) -> Ground | None:
    """The ground under the cells that were seen, or None if too few were.

    Args:
        sums: (cells, 3) int64 sum of heights in 0.1 mm, points, and lowest height of each cell.
        spec: the grid.
        config: size of the blocks, and how far the ground may bend from one to the next.
        min_points: points that a cell needs.
    """
    seen = np.flatnonzero(sums[:, 1] >= min_points)
    if len(seen) < FEWEST_CELLS:
        return None
    mean_m = sums[seen, 0] / (sums[seen, 1] * float(PER_METRE))
    height_m = np.minimum(mean_m, sums[seen, 2] / float(PER_METRE) + LOWEST_PART_M)
    iy, ix = np.divmod(seen, spec.width)
    x, y = (ix + 0.5) * spec.resolution_m, (iy + 0.5) * spec.resolution_m
    side = max(1, round(config.ground_block_m / spec.resolution_m))
    shape = (spec.height - 1) // side + 1, (spec.width - 1) // side + 1
    block = (iy // side) * shape[1] + ix // side

    chosen = _low_of_each(block, height_m)
    plane = _robust_plane(x[chosen], y[chosen], height_m[chosen])
    plane = _robust_plane(x, y, height_m, plane)
    slope = float(np.hypot(plane[0], plane[1]))
    limit = float(np.tan(np.deg2rad(config.max_slope_deg)))
    if slope > limit:  # a wall fills the view: the map's horizon is the better guess
        plane = np.array([0.0, 0.0, 0.0])
    sloping = plane[0] * x + plane[1] * y + plane[2]
    over = height_m - sloping

    chosen = _low_of_each(block, over)
    lows = np.full(shape, np.nan)
    lows.ravel()[block[chosen]] = over[chosen]
    bend = float(np.tan(np.deg2rad(config.max_bend_deg)))
    offsets = _envelope(_without_dents(lows), bend * side * spec.resolution_m)
    offsets[np.isnan(lows)] = np.nan
    own = _interpolated(offsets, (iy + 0.5) / side - 0.5, (ix + 0.5) / side - 0.5)
    allowance = bend * STEP_CELLS * spec.resolution_m
    around = _lowest_around(seen, mean_m - sloping, spec)[seen] + allowance
    offset_m, floor_m = (np.full(len(sums), np.nan, np.float32) for _ in range(2))
    offset_m[seen], floor_m[seen] = own, np.minimum(own, around)
    return Ground(plane, offset_m, floor_m)


def _low_of_each(block: NDArray[np.int64], height_m: Float64) -> NDArray[np.intp]:
    """Index of the cell at the low quantile of each block's heights."""
    level = np.clip((height_m + 1000.0) * 10000.0, 0, 2**31 - 1).astype(np.int64)
    order = np.argsort(block * 2**31 + level)
    starts = np.flatnonzero(np.diff(block[order], prepend=-1))
    sizes = np.diff(starts, append=len(order))
    return order[starts + (LOW_SHARE * (sizes - 1)).astype(np.intp)]


def _robust_plane(x: Float64, y: Float64, z: Float64, start: Float64 | None = None) -> Float64:
    """Plane through most points: reweighted least squares, what is far from it counts less and less."""
    if start is None:
        start = np.array([0.0, 0.0, float(np.quantile(z, LOW_SHARE))])
        scales: tuple[float, ...] = (1.5, *NEAR_PLANE_M)
    else:
        scales = NEAR_PLANE_M[-2:]
    mid = (float(x.mean()), float(y.mean()))
    dx, dy = x - mid[0], y - mid[1]
    plane: Float64 = start + np.array([0, 0, start[0] * mid[0] + start[1] * mid[1]])
    for scale in scales:
        off = z - (plane[0] * dx + plane[1] * dy + plane[2])
        w = np.square(np.clip(1.0 - np.square(off / (3 * scale)), 0, None))  # Tukey's biweight
        wx, wy, wo = w * dx, w * dy, w * off
        xx, xy, yy = (wx * dx).sum(), (wx * dy).sum(), (wy * dy).sum()  # no BLAS: one order of summing
        normal = np.array([[xx, xy, wx.sum()], [xy, yy, wy.sum()], [wx.sum(), wy.sum(), w.sum()]])
        right = np.array([(wo * dx).sum(), (wo * dy).sum(), wo.sum()])
        step = np.linalg.solve(normal + 1e-6 * len(x) * np.eye(3), right)
        plane = plane + step
    plane[2] -= plane[0] * mid[0] + plane[1] * mid[1]
    return plane


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
    steps = [(i, j, rise_m * float(np.hypot(i, j))) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
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


def _depth_limits(cloud: CloudConfig) -> Float32:
    return np.array(
        [cloud.min_range_m, cloud.max_range_m, cloud.consistency_relative, cloud.consistency_m], np.float32
    )


def _fast_sums(
    frame: Frame, T_grid_camera: Pose, spec: GridSpec, cloud: CloudConfig
) -> tuple[NDArray[np.int32], Sums]:
    from swardmap.kernels import ground as kernel

    cells = np.empty(frame.depth.shape, np.int32)
    sums = np.empty((spec.width * spec.height, 3), np.int64)
    ray_x, ray_y = frame.intrinsics.ray_tables()
    kernel.sum_heights(
        frame.depth, np.float32(frame.depth_unit_m), ray_x, ray_y,
        T_grid_camera.matrix[:3].astype(np.float32), _depth_limits(cloud), cloud.consistent_neighbours,
        spec.width, spec.height, np.float32(1.0 / spec.resolution_m), cells, sums,
    )  # fmt: skip
    return cells, sums


def _plain_sums(
    frame: Frame, T_grid_camera: Pose, spec: GridSpec, cloud: CloudConfig
) -> tuple[NDArray[np.int32], Sums]:
    depth_m = crop_range(frame.depth_m, cloud.min_range_m, cloud.max_range_m)
    depth_m = consistent_depth(
        depth_m, cloud.consistent_neighbours, cloud.consistency_relative, cloud.consistency_m
    )
    xyz = transform_points(deproject(depth_m, frame.intrinsics), T_grid_camera)
    per_metre = np.float32(1.0 / spec.resolution_m)
    x, y = xyz[..., 0] * per_metre, xyz[..., 1] * per_metre
    inside = (x >= 0) & (y >= 0) & (x < np.float32(spec.width)) & (y < np.float32(spec.height))
    cells = np.full(depth_m.shape, -1, np.int32)
    cells[inside] = y[inside].astype(np.int32) * spec.width + x[inside].astype(np.int32)
    sums = np.zeros((spec.width * spec.height, 3), np.int64)
    sums[:, 2] = HIGHEST
    tenths = np.floor(xyz[inside][:, 2] * PER_METRE).astype(np.int32)
    np.add.at(sums[:, 0], cells[inside], tenths)
    np.minimum.at(sums[:, 2], cells[inside], tenths)
    sums[:, 1] = np.bincount(cells[inside], minlength=len(sums))
    return cells, sums


def _fast_counts(
    frame: Frame, up: Float32, limits: Float32, cells: NDArray[np.int32], ground: Ground
) -> NDArray[np.uint32]:
    from swardmap.kernels import ground as kernel

    counts = np.empty(2 * len(ground.offset_m) + 1, np.uint32)
    kernel.count_off_ground(
        frame.depth, np.float32(frame.depth_unit_m), *frame.intrinsics.ray_tables(), up, limits, cells,
        ground.floor_m, ground.offset_m, counts,
    )  # fmt: skip
    return counts[:-1].reshape(-1, 2)


def _plain_counts(
    frame: Frame, up: Float32, limits: Float32, cells: NDArray[np.int32], ground: Ground
) -> NDArray[np.uint32]:
    lowest, highest, hole, noise = limits
    used = cells >= 0
    ray_x, ray_y = frame.intrinsics.ray_tables()
    z, cell = frame.depth_m[used], cells[used]
    q = (up[0] * ray_x[None, :] + (up[1] * ray_y + up[2])[:, None])[used]
    over = z * q + up[3]
    doubt = noise * (z * z) * q
    rise, fall = over - ground.floor_m[cell], ground.offset_m[cell] - over
    doubt = doubt * doubt
    above = (rise > 0) & (rise * rise > lowest * lowest + doubt) & (rise <= highest)
    below = ~above & (fall > 0) & (fall * fall > hole * hole + doubt)
    n = len(ground.offset_m)
    counts = [np.bincount(cell[chosen], minlength=n) for chosen in (above, below)]
    return np.stack(counts, axis=1).astype(np.uint32)
