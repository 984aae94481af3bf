"""The two equal roads from an aligned frame and its mask to a grid: staged and fused.

A property test holds them cell for cell and count for count equal (tests/perception/test_frame_grid.py).
"""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig
from swardmap.errors import ConfigError
from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid, Sighting, classify_cells, count_points
from swardmap.labels import MapClass
from swardmap.perception.cloud import (
    consistent_depth,
    crop_range,
    label_cloud,
    remove_radius_outliers,
    remove_statistical_outliers,
    voxel_downsample,
)
from swardmap.types import Frame, LabeledCloud, Segmentation, nearest_indices


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
        merged: joined with others in a voxel, or removed as outliers after that (staged road only).
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
        theirs = asdict(other)
        return PixelCounts(**{name: n + theirs[name] for name, n in asdict(self).items()})


def filtered_cloud(frame: Frame, segmentation: Segmentation, config: CloudConfig) -> LabeledCloud:
    """The labelled cloud of a frame after range crop and consistency filter, in the camera frame."""
    depth_m = crop_range(frame.depth_m, config.min_range_m, config.max_range_m)
    depth_m = consistent_depth(
        depth_m, config.consistent_neighbours, config.consistency_relative, config.consistency_m
    )
    return label_cloud(frame, segmentation, depth_m)


def staged_grid(
    frame: Frame,
    segmentation: Segmentation,
    T_map_camera: Pose,
    spec: GridSpec,
    config: CloudConfig,
    min_points: int,
    min_grass_points: int | None = None,
    above_lawn: NDArray[np.float32] | None = None,
) -> tuple[OccupancyGrid, PixelCounts]:
    """One frame's grid, stage by stage in NumPy: the oracle, and the only road with voxels and outliers.

    Args:
        frame: aligned images.
        segmentation: mask of any size.
        T_map_camera: pose of the camera in the grid's frame.
        spec: the grid.
        config: ranges and filters.
        min_points: of obstacle and person that mark a cell (`classify_cells`).
        min_grass_points: of grass that clear one; None = min_points.
        above_lawn: (4,) a, b, c, d: height a x + b y + c z + d of a point of the camera above the lawn, where
            that is known; what is within the height limits by it or by the grid's z is used.

    Returns:
        The standalone grid of this frame, and what became of its pixels.
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
    sighting = Sighting(counts, _viewpoint_m(T_map_camera))
    grid = OccupancyGrid(spec, classify_cells(counts, min_points, min_grass_points), frame.stamp_ns, sighting)
    readings, ranged = int(np.isfinite(depth_m).sum()), int(np.isfinite(in_range).sum())
    return grid, PixelCounts(
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


def fused_grid(
    frame: Frame,
    segmentation: Segmentation,
    T_map_camera: Pose,
    spec: GridSpec,
    config: CloudConfig,
    min_points: int,
    min_grass_points: int | None = None,
    above_lawn: NDArray[np.float32] | None = None,
) -> tuple[OccupancyGrid, PixelCounts]:
    """The same as `staged_grid` in one compiled pass over the pixels, without voxels and outliers.

    Raises:
        ConfigError: if the configuration asks for a voxel grid or outlier removal.
    """
    from swardmap.kernels import grid as kernel

    if config.voxel_m > 0 or config.outliers != "none":
        raise ConfigError(
            "cloud: a voxel grid or outlier removal was asked for, which the fused road leaves out; "
            "set road to 'staged', or rely on the consistency filter"
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
    classes = np.empty(spec.width * spec.height, np.uint8)
    kernel.classify(counts, np.uint32(min_points), np.uint32(min_grass_points or min_points), classes)
    points = counts[: -kernel.REASONS].reshape(*spec.shape, 4)
    sighting = Sighting(points, _viewpoint_m(T_map_camera))
    grid = OccupancyGrid(spec, classes.reshape(spec.shape), frame.stamp_ns, sighting)
    return grid, _pixel_counts(counts[-kernel.REASONS :].tolist(), depth.size, int(readings))


def within_height(
    cloud: LabeledCloud,
    T_parent_camera: Pose,
    config: CloudConfig,
    above_lawn: NDArray[np.float32] | None = None,
) -> LabeledCloud:
    """The points whose z or whose height above the lawn is within the limits, in the parent's frame.

    Args:
        cloud: of the camera.
        T_parent_camera: its pose, z of the parent up.
        config: the limits.
        above_lawn: see `staged_grid`.
    """
    lowest, highest = np.float32(config.min_height_m), np.float32(config.max_height_m)
    moved = cloud.transformed(T_parent_camera)
    heights = [moved.xyz[:, 2]]
    if above_lawn is not None:
        (a, b, c, d), (x, y, z) = above_lawn, cloud.xyz.T
        heights.append(a * x + b * y + c * z + d)  # in the kernel's order of operations
    return moved[np.logical_or.reduce([(h >= lowest) & (h <= highest) for h in heights])]


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
    renamed = Pose(T_map_camera.parent, "camera", T_map_camera.matrix)
    return spec.T_grid_map @ renamed


def _viewpoint_m(T_map_camera: Pose) -> tuple[float, float, float]:
    x, y, z = T_map_camera.position_m.tolist()
    return x, y, z
