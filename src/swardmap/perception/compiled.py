"""The passes over the pixels, compiled: the default at run time (twin: `plain`)."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig, Config, GeometryConfig
from swardmap.errors import ConfigError
from swardmap.geometry import Pose
from swardmap.grid import GridSpec
from swardmap.kernels.constants import OBSTACLE, PERSON
from swardmap.labels import LabelSet
from swardmap.perception.backend import Judged
from swardmap.perception.cloud import neighbours_needed
from swardmap.perception.geometric_obstacles import ALWAYS_ENOUGH, GeometricMarks
from swardmap.perception.ground_surface import (
    NEAR_PLANE_M,
    Ground,
    Sums,
    block_cells,
    largest_bend,
    steepest,
)
from swardmap.perception.passes import (
    Counted,
    Placed,
    code_table,
    count_limits,
    depth_limits,
    height_row,
    mask_codes,
)
from swardmap.types import Frame, Segmentation, nearest_indices


def consistent_pixels(depth_m: NDArray[np.float32], config: CloudConfig) -> NDArray[np.bool_]:
    """Readings that the 3x3 consistency filter leaves (twin: `cloud.consistent_depth`).

    Args:
        depth_m: (H, W) float32 metres, NaN = no reading.
        config: neighbours needed, and what agrees.

    Returns:
        (H, W) bool.
    """
    from swardmap.kernels import depth as kernel

    if config.consistent_neighbours == 0:
        return np.isfinite(depth_m)
    keep = np.empty(depth_m.shape, np.bool_)
    kernel.consistent(
        np.ascontiguousarray(depth_m), np.float32(config.consistency_relative),
        np.float32(config.consistency_m), config.consistent_neighbours, keep,
    )  # fmt: skip
    return keep


def place(frame: Frame, T_grid_camera: Pose, spec: GridSpec, config: Config) -> Placed:
    """Cell of every pixel that passes range and consistency, and heights of every cell.

    Raises:
        ConfigError: if the configuration asks for a voxel grid or outlier removal.
    """
    from swardmap.kernels import place as kernel

    if config.cloud.voxel_m > 0 or config.cloud.outliers != "none":
        raise ConfigError(
            "cloud: a voxel grid or outlier removal was asked for, which the compiled backend leaves out; "
            "set backend to 'plain', or rely on the consistency filter"
        )
    cells = np.empty(frame.depth.shape, np.int32)
    sums = np.empty((spec.width * spec.height + 3, 3), np.int64)
    ray_x, ray_y = frame.intrinsics.ray_tables()
    readings = kernel.place(
        frame.depth, np.float32(frame.depth_unit_m), ray_x, ray_y,
        T_grid_camera.matrix[:3].astype(np.float32), depth_limits(config),
        neighbours_needed(frame, config.cloud), spec.width, spec.height,
        np.float32(1.0 / spec.resolution_m), cells, sums,
    )  # fmt: skip
    reasons = sums[-3:, 1].tolist()
    return Placed(cells, sums[:-3], frame.depth.size - int(readings), *reasons)


def fit_ground(sums: Sums, spec: GridSpec, config: GeometryConfig) -> Ground | None:
    """The ground under the cells that were seen (twin: `ground_surface.fit_ground`)."""
    from swardmap.kernels import ground as kernel

    plane = np.empty(3)
    offset_m, floor_m = np.empty(len(sums), np.float32), np.empty(len(sums), np.float32)
    found = kernel.fit(
        sums, spec.width, spec.height, spec.resolution_m, block_cells(spec, config), steepest(config),
        largest_bend(config), np.array(NEAR_PLANE_M), plane, offset_m, floor_m,
    )  # fmt: skip
    return Ground(plane, offset_m, floor_m) if found else None


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
    from swardmap.kernels import count as kernel

    n = spec.width * spec.height
    ray_x, ray_y = frame.intrinsics.ray_tables()
    if ground is None:  # no limits of height, and no marks by depth
        offset_m = floor_m = np.zeros(n, np.float32)
    else:
        offset_m, floor_m = ground.offset_m, ground.floor_m
    up = height_row(T_grid_camera, ground)
    points, per_cell = np.empty(4 * n + 6, np.uint32), np.empty((6, n), np.uint32)
    rows, columns = map(_sources, frame.depth.shape, segmentation.labels.shape)
    mask, table, hazard = _mask(segmentation, config)
    kernel.count(
        frame.depth, np.float32(frame.depth_unit_m), ray_x, ray_y, placed.cells, placed.sums,
        mask, table, mask if hazard is None else hazard, hazard is not None, rows, columns,
        up, count_limits(config, ground), ground is not None,
        offset_m, floor_m, points, per_cell,
    )  # fmt: skip
    void, out_of_height = points[-2:].tolist()
    seen, doubt, above, below, raised, dropped = per_cell.reshape(6, *spec.shape)
    by_class = points[:-6].reshape(*spec.shape, 4)
    return Counted(by_class, seen, doubt, above, below, raised, dropped, up, void, out_of_height)


def _mask(
    segmentation: Segmentation, config: Config
) -> tuple[NDArray[np.uint8], NDArray[np.int32], NDArray[np.uint8] | None]:
    """(h, w) ids, (256,) what each counts as + 256 * its hazard, and (h, w) hazards of the pixels, if any.

    Without doubts about grass the ids say all: no array of the mask's size is made.
    """
    if segmentation.may_be_unsure(config.segmenter.min_confidence, config.watchdog.unfamiliar):
        return (
            mask_codes(segmentation, config),
            np.arange(256, dtype=np.int32),
            segmentation.hazard_255,
        )
    own = segmentation.hazard is not None or segmentation.confidence is not None
    return segmentation.labels, _table(segmentation.label_set), segmentation.hazard_255 if own else None


@lru_cache(maxsize=16)
def _table(label_set: LabelSet) -> NDArray[np.int32]:
    codes = code_table(label_set).astype(np.int32)
    table: NDArray[np.int32] = codes + 256 * np.where(
        (codes == OBSTACLE) | (codes == PERSON), np.int32(255), np.int32(0)
    )
    return table


@lru_cache(maxsize=64)
def _sources(size_out: int, size_in: int) -> NDArray[np.uint64]:
    """`nearest_indices`, unsigned: a kernel need not look at the sign."""
    return nearest_indices(size_out, size_in).astype(np.uint64)


def judge(counted: Counted, ground: Ground | None, config: Config) -> Judged:
    """What may be cleared, what stands above the ground, and what each cell is by both."""
    from swardmap.kernels import cells as kernel

    rules, geometry, shape = config.grid, config.geometry, counted.seen.shape
    points = np.empty((*shape, 4), np.uint32)
    semantic, classes = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
    marks = np.empty((3, *shape), np.bool_)
    kernel.judge(
        counted.points.reshape(-1), counted.seen.reshape(-1), counted.doubt.reshape(-1),
        counted.above.reshape(-1), counted.below.reshape(-1), counted.raised.reshape(-1),
        counted.dropped.reshape(-1),
        ground is not None, 255 * rules.clear_below, np.uint32(rules.min_points),
        np.uint32(rules.min_grass_points or rules.min_points), geometry.enabled,
        np.uint32(geometry.min_points), np.uint32(ALWAYS_ENOUGH), geometry.semantics,
        points.reshape(-1), semantic.reshape(-1), classes.reshape(-1), marks.reshape(3, -1),
    )  # fmt: skip
    if rules.clear_together:
        kernel.clear_together(classes, semantic, points, np.uint32(rules.min_grass_points))
    return Judged(classes, points, semantic, GeometricMarks(*marks) if geometry.enabled else None)
