"""Points of each map class in each cell (Eq. 1 and 2), by two equal backends: plain NumPy and compiled.

A property test holds them cell for cell and count for count equal (tests/perception/test_counting.py).
"""

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig
from swardmap.errors import ConfigError
from swardmap.geometry import Pose
from swardmap.grid import GridSpec, count_points
from swardmap.labels import MapClass
from swardmap.perception.cloud import (
    consistent_depth,
    crop_range,
    label_cloud,
    remove_radius_outliers,
    remove_statistical_outliers,
    voxel_downsample,
    within_height,
)
from swardmap.perception.observation import PixelCounts
from swardmap.types import Frame, LabeledCloud, Segmentation, nearest_indices


def count_plain(
    frame: Frame,
    segmentation: Segmentation,
    T_map_camera: Pose,
    spec: GridSpec,
    config: CloudConfig,
    above_lawn: NDArray[np.float32] | None = None,
) -> tuple[NDArray[np.uint32], PixelCounts]:
    """Stage by stage in NumPy: the oracle, and the only backend with voxels and outliers.

    Args:
        frame: aligned images.
        segmentation: mask of any size.
        T_map_camera: pose of the camera in the grid's frame.
        spec: the grid.
        config: ranges and filters.
        above_lawn: (4,) a, b, c, d: height a x + b y + c z + d of a point of the camera above the lawn, where
            that is known; what is within the height limits by it or by the grid's z is used.

    Returns:
        (height, width, 4) uint32 points by MapClass, and what became of the pixels.
    """
    depth_m = frame.depth_m
    in_range = crop_range(depth_m, config.min_range_m, config.max_range_m)
    consistent = consistent_depth(
        in_range, config.consistent_neighbours, config.consistency_relative, config.consistency_m
    )
    cloud = label_cloud(frame, segmentation, consistent)
    known = cloud[cloud.label_set.map_class_table[cloud.labels] != MapClass.UNKNOWN]
    in_height = within_height(known, _T_grid_camera(spec, T_map_camera), config, above_lawn)
    thinned = _thinned(in_height, config)
    counts, outside = count_points(thinned, spec)
    readings, ranged = int(np.isfinite(depth_m).sum()), int(np.isfinite(in_range).sum())
    return counts, PixelCounts(
        pixels=depth_m.size,
        no_reading=depth_m.size - readings,
        out_of_range=readings - ranged,
        inconsistent=ranged - len(cloud),
        void=len(cloud) - len(known),
        out_of_height=len(known) - len(in_height),
        merged=len(in_height) - len(thinned),
        outside_grid=outside,
        used=len(thinned) - outside,
    )


def count_compiled(
    frame: Frame,
    segmentation: Segmentation,
    T_map_camera: Pose,
    spec: GridSpec,
    config: CloudConfig,
    above_lawn: NDArray[np.float32] | None = None,
) -> tuple[NDArray[np.uint32], PixelCounts]:
    """The same as `count_plain` in one compiled pass over the pixels, without voxels and outliers.

    Raises:
        ConfigError: if the configuration asks for a voxel grid or outlier removal.
    """
    from swardmap.kernels import grid as kernel

    if config.voxel_m > 0 or config.outliers != "none":
        raise ConfigError(
            "cloud: a voxel grid or outlier removal was asked for, which the compiled backend leaves out; "
            "set backend to 'plain', or rely on the consistency filter"
        )
    depth, mask = frame.depth, segmentation.labels
    ray_x, ray_y = frame.intrinsics.ray_tables()
    T = _T_grid_camera(spec, T_map_camera).matrix.astype(np.float32)
    T[3] = T[2] if above_lawn is None else above_lawn
    limits = np.array(
        [config.min_range_m, config.max_range_m, config.min_height_m, config.max_height_m,
         config.consistency_relative, config.consistency_m], np.float32,
    )  # fmt: skip
    counts = np.empty(spec.width * spec.height * 4 + kernel.REASONS, np.uint32)
    readings = kernel.count_pixels(
        depth, np.float32(frame.depth_unit_m), mask,
        nearest_indices(depth.shape[0], mask.shape[0]), nearest_indices(depth.shape[1], mask.shape[1]),
        segmentation.label_set.map_class_table.astype(np.int32), ray_x, ray_y, T, limits,
        config.consistent_neighbours, spec.width, spec.height, np.float32(1.0 / spec.resolution_m), counts,
    )  # fmt: skip
    points = counts[: -kernel.REASONS].reshape(*spec.shape, 4)
    return points, _pixel_counts(counts[-kernel.REASONS :].tolist(), depth.size, int(readings))


def _pixel_counts(reasons: list[int], pixels: int, readings: int) -> PixelCounts:
    from swardmap.kernels import grid as kernel

    return PixelCounts(
        pixels=pixels,
        no_reading=pixels - readings,
        out_of_range=reasons[kernel.NOT_IN_RANGE] - (pixels - readings),
        inconsistent=reasons[kernel.NOT_CONSISTENT],
        void=reasons[kernel.VOID],
        out_of_height=reasons[kernel.NOT_IN_HEIGHT],
        merged=0,
        outside_grid=reasons[kernel.OUTSIDE],
        used=pixels - sum(reasons),
    )


def _thinned(cloud: LabeledCloud, config: CloudConfig) -> LabeledCloud:
    """The paper's PCL chain: voxel grid, then outlier removal."""
    if config.voxel_m > 0:
        cloud = voxel_downsample(cloud, config.voxel_m)
    if config.outliers == "statistical":
        return remove_statistical_outliers(cloud, config.outlier_neighbours, config.outlier_sigmas)
    if config.outliers == "radius":
        return remove_radius_outliers(cloud, config.outlier_radius_m, config.outlier_neighbours)
    return cloud


def _T_grid_camera(spec: GridSpec, T_map_camera: Pose) -> Pose:
    """In float64 up to here: float32 begins at the grid's corner, so UTM-sized origins lose nothing."""
    return spec.T_grid_map @ T_map_camera.of_child("camera")
