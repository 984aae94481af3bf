"""The passes over the pixels in plain NumPy: what a reader learns from, and the oracle of the compiled ones.

The only backend with voxels and outlier removal (the paper's PCL chain).
"""

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig, Config
from swardmap.geometry import Pose, deproject, transform_points
from swardmap.grid import GridSpec, classify_cells, count_points
from swardmap.kernels.constants import (
    DROPPED,
    HIGHEST,
    NOT_CONSISTENT,
    NOT_IN_RANGE,
    OUTSIDE,
    PER_METRE,
    VOID,
)
from swardmap.labels import LabelClass, LabelSet, MapClass, Role
from swardmap.perception.backend import Judged
from swardmap.perception.cloud import (
    consistent_depth,
    crop_range,
    neighbours_needed,
    remove_radius_outliers,
    remove_statistical_outliers,
    voxel_downsample,
)
from swardmap.perception.geometric_obstacles import geometric_marks, with_marks
from swardmap.perception.ground_surface import Ground, Sums, fit_ground
from swardmap.perception.observation import clear_together, may_clear, without_doubt
from swardmap.perception.passes import (
    Counted,
    Placed,
    count_limits,
    height_row,
    mask_codes,
)
from swardmap.types import Frame, LabeledCloud, Segmentation, nearest_indices

__all__ = ["count", "fit_ground", "judge", "place", "sum_heights"]

CODES = LabelSet(
    (
        LabelClass(0, "unsure", Role.VOID, (0, 0, 0)),
        LabelClass(1, "grass", Role.FREE, (0, 0, 0)),
        LabelClass(2, "obstacle", Role.OBSTACLE, (0, 0, 0)),
        LabelClass(3, "person", Role.PERSON, (0, 0, 0)),
    )
)
"""The codes of the mask as classes of a cloud: they are what is counted."""


def place(frame: Frame, T_grid_camera: Pose, spec: GridSpec, config: Config) -> Placed:
    """Cell of every pixel that passes range and consistency, and heights of every cell."""
    cloud, depth_m = config.cloud, frame.depth_m
    in_range = crop_range(depth_m, cloud.min_range_m, cloud.max_range_m)
    kept = consistent_depth(
        in_range, neighbours_needed(frame, cloud), cloud.consistency_relative, cloud.consistency_m
    )
    xyz = transform_points(deproject(in_range, frame.intrinsics), T_grid_camera)
    per_metre = np.float32(1.0 / spec.resolution_m)
    x, y = xyz[..., 0] * per_metre, xyz[..., 1] * per_metre
    inside = (x >= 0) & (y >= 0) & (x < np.float32(spec.width)) & (y < np.float32(spec.height))
    dropped = np.isnan(kept)
    cells = np.full(depth_m.shape, OUTSIDE, np.int32)
    cells[dropped] = NOT_CONSISTENT
    cells[np.isnan(in_range)] = NOT_IN_RANGE
    not_in_range, not_consistent, outside = (
        int((cells == why).sum()) for why in (NOT_IN_RANGE, NOT_CONSISTENT, OUTSIDE)
    )
    flat = y[inside].astype(np.int32) * spec.width + x[inside].astype(np.int32)
    cells[inside] = np.where(dropped[inside], DROPPED - flat, flat)
    used = cells >= 0
    sums = sum_heights(cells[used], xyz[used][:, 2], spec)
    return Placed(
        cells, sums, int(np.isnan(depth_m).sum()), not_in_range, not_consistent, outside - int(used.sum())
    )


def sum_heights(cells: NDArray[np.int32], z_m: NDArray[np.float32], spec: GridSpec) -> Sums:
    """Sum of heights in 0.1 mm, points, and lowest height of every cell.

    Args:
        cells: (N,) flat index of the cell of each point.
        z_m: (N,) their heights.
        spec: the grid.
    """
    sums = np.zeros((spec.width * spec.height, 3), np.int64)
    sums[:, 2] = HIGHEST
    tenths = np.floor(z_m * PER_METRE).astype(np.int32)
    np.add.at(sums[:, 0], cells, tenths)
    np.minimum.at(sums[:, 2], cells, tenths)
    sums[:, 1] = np.bincount(cells, minlength=len(sums))
    return sums


def count(
    frame: Frame,
    segmentation: Segmentation,
    placed: Placed,
    T_grid_camera: Pose,
    ground: Ground | None,
    spec: GridSpec,
    config: Config,
) -> Counted:
    """What the pixels say of each cell, at their heights above the ground."""
    lowest, highest, rise_m, doubt_rise_m, hole_m, noise, doubted = count_limits(config, ground)
    rows, columns = (nearest_indices(n, m) for n, m in zip(frame.depth.shape, segmentation.labels.shape,
                                                           strict=True))  # fmt: skip
    used = placed.cells >= 0
    codes = mask_codes(segmentation, config)[rows[:, None], columns][used]
    hazard = segmentation.hazard_255[rows[:, None], columns][used]
    cell, z = placed.cells[used], frame.depth_m[used]
    up = height_row(T_grid_camera, ground)
    ray_x, ray_y = frame.intrinsics.ray_tables()
    q = (up[0] * ray_x[None, :] + (up[1] * ray_y + up[2])[:, None])[used]
    over = z * q + up[3]

    offset, floor = _surface(ground, spec)
    height = over - offset[cell]
    in_height = (height >= lowest) & (height <= highest)
    named = codes != VOID
    known = named & in_height
    per_cell = spec.width * spec.height
    flat = cell[known].astype(np.int64) * 4 + codes[known]
    points = np.bincount(flat, minlength=4 * per_cell).astype(np.uint32).reshape(*spec.shape, 4)
    seen = points.sum(axis=2, dtype=np.uint32)
    doubt = np.bincount(cell[known], hazard[known], per_cell).astype(np.uint32).reshape(spec.shape)
    merged = 0
    if config.cloud.voxel_m > 0 or config.cloud.outliers != "none":
        xyz = transform_points(deproject(frame.depth_m, frame.intrinsics), T_grid_camera)[used][known]
        points, merged = _thinned_points(xyz, codes[known], spec, config.cloud)

    above = below = raised = dropped = np.zeros(spec.shape, np.uint32)
    if ground is not None:
        noise_m = noise * (z * z) * q
        rise, fall, noise_m2 = over - floor[cell], -height, noise_m * noise_m
        stands = (rise > 0) & (rise <= highest)
        is_above = stands & (rise * rise > rise_m * rise_m + noise_m2)
        is_below = ~is_above & (fall > 0) & (fall * fall > hole_m * hole_m + noise_m2)
        is_raised = (
            stands & named & (hazard > doubted) & (rise * rise > doubt_rise_m * doubt_rise_m + noise_m2)
        )
        above, below, raised = (
            np.bincount(cell[chosen], minlength=per_cell).astype(np.uint32).reshape(spec.shape)
            for chosen in (is_above, is_below, is_raised)
        )
        dropped = _dropped_above(frame, placed, up, ground, spec, config)
    return Counted(
        points, seen, doubt, above, below, raised, dropped, up,
        void=int((~named).sum()), out_of_height=int((named & ~in_height).sum()), merged=merged,
    )  # fmt: skip


def _dropped_above(
    frame: Frame, placed: Placed, up: NDArray[np.float32], ground: Ground, spec: GridSpec, config: Config
) -> NDArray[np.uint32]:
    """Readings that the filter dropped and that stand above the ground, by cell."""
    _, highest, rise_m, _, _, noise, _ = count_limits(config, ground)
    ray_x, ray_y = frame.intrinsics.ray_tables()
    is_dropped = placed.cells <= DROPPED
    cell, z = DROPPED - placed.cells[is_dropped], frame.depth_m[is_dropped]
    q = (up[0] * ray_x[None, :] + (up[1] * ray_y + up[2])[:, None])[is_dropped]
    rise, noise_m = (z * q + up[3]) - ground.floor_m[cell], noise * (z * z) * q
    stands = (rise > 0) & (rise <= highest) & (rise * rise > rise_m * rise_m + noise_m * noise_m)
    counts = np.bincount(cell[stands], minlength=spec.width * spec.height)
    return counts.astype(np.uint32).reshape(spec.shape)


def _surface(ground: Ground | None, spec: GridSpec) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    if ground is None:
        level = np.zeros(spec.width * spec.height, np.float32)
        return level, level
    return ground.offset_m, ground.floor_m


def _thinned_points(
    xyz: NDArray[np.float32],
    codes: NDArray[np.uint8],
    spec: GridSpec,
    config: CloudConfig,
) -> tuple[NDArray[np.uint32], int]:
    """Points by class after the paper's PCL chain: voxel grid, then outlier removal."""
    cloud = LabeledCloud(xyz, codes, "grid", CODES)
    if config.voxel_m > 0:
        cloud = voxel_downsample(cloud, config.voxel_m)
    if config.outliers == "statistical":
        cloud = remove_statistical_outliers(cloud, config.outlier_neighbours, config.outlier_sigmas)
    elif config.outliers == "radius":
        cloud = remove_radius_outliers(cloud, config.outlier_radius_m, config.outlier_neighbours)
    points, outside = count_points(cloud, spec)
    return points, len(xyz) - len(cloud) + outside


def judge(counted: Counted, ground: Ground | None, config: Config) -> Judged:
    """What may be cleared, what stands above the ground, and what each cell is by both."""
    rules, geometry = config.grid, config.geometry
    clear = may_clear(counted, ground, rules.clear_below, geometry.enabled)
    marks = geometric_marks(counted, geometry) if geometry.enabled else None
    semantic = classify_cells(counted.points, rules.min_points, rules.min_grass_points, clear)
    points, classes = without_doubt(counted.points, clear, rules.min_points), semantic
    if marks is not None:
        points, classes = with_marks(points, classes, marks.marks, geometry.semantics)
    if rules.clear_together:
        classes, points = clear_together(classes, points, rules.min_grass_points)
        semantic = np.maximum(semantic, (classes == MapClass.GRASS).astype(np.uint8))
    return Judged(classes, points, semantic, marks)
