"""What stands above the local ground, and holes in it, from depth alone: evidence beside the network's.

The passes over the pixels are here twice, in NumPy and compiled; the ground itself is `ground_fit`'s.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig, GeometryConfig
from swardmap.geometry import Pose, deproject, transform_points
from swardmap.grid import GridSpec
from swardmap.labels import MapClass
from swardmap.perception.cloud import consistent_depth, crop_range
from swardmap.perception.ground_surface import HIGHEST, PER_METRE, Float32, Ground, Sums, fit_ground
from swardmap.types import Frame


@dataclass(frozen=True, slots=True, eq=False)
class GroundEvidence:
    """What depth alone says about the cells of one frame; it never says that a cell is free.

    Attributes:
        marks: (height, width) bool, where something stands or a hole gapes.
        holes: (height, width) bool, the marks with points below the ground.
        ground_m: (height, width) float32 height of the ground in the grid's frame; NaN where not seen.
        above_lawn: (4,) float32 a, b, c, d: height a x + b y + c z + d of a point of the camera above the
            plane of the lawn; None = no ground was seen.
    """

    marks: NDArray[np.bool_]
    holes: NDArray[np.bool_]
    ground_m: Float32
    above_lawn: Float32 | None = None


ALWAYS_ENOUGH = 1_000_000
"""Points that mark a cell whatever `grid.min_points` is: the geometric rule has counted already."""


def with_marks(points: NDArray[np.uint32], marks: NDArray[np.bool_]) -> NDArray[np.uint32]:
    """Points in which those on a geometric mark speak for an obstacle: no map must take them for grass."""
    points = points.copy()
    hazard = points[marks, MapClass.OBSTACLE] + points[marks, MapClass.GRASS]
    points[marks, MapClass.OBSTACLE] = np.maximum(hazard, ALWAYS_ENOUGH)
    points[marks, MapClass.GRASS] = 0
    return points


def marks_alone(marks: NDArray[np.bool_]) -> NDArray[np.uint32]:
    """Points of a frame whose classes are not asked: obstacles on the marks, nothing elsewhere."""
    points = np.zeros((*marks.shape, 4), np.uint32)
    points[marks, MapClass.OBSTACLE] = ALWAYS_ENOUGH
    return points


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
    T_grid_camera = spec.T_grid_map @ T_map_camera.of_child("camera")
    cells, sums = (_fast_sums if compiled else _plain_sums)(frame, T_grid_camera, spec, cloud)
    ground = fit_ground(sums, spec, config, min_points)
    if ground is None:
        nothing = np.zeros(spec.shape, bool)
        return GroundEvidence(nothing, nothing, np.full(spec.shape, np.nan, np.float32))
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
    y, x = (((np.arange(n) + 0.5) * spec.resolution_m).astype(np.float32) for n in spec.shape)
    plane_m = np.float32(a) * x + (np.float32(b) * y + np.float32(c))[:, None]
    height_m = ground.offset_m.reshape(spec.shape) + plane_m
    return GroundEvidence(above | below, below, height_m, up)


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
