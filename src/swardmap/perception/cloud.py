"""From an aligned depth image and a mask to a labelled cloud (Sec. 3.4), staged and readable.

This is the oracle of the fused kernel: the same arithmetic in the same order, in plain NumPy.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig
from swardmap.errors import InvalidValueError
from swardmap.geometry import Pose, deproject
from swardmap.kernels.constants import FAR_AWAY
from swardmap.types import Frame, LabeledCloud, Segmentation

EVERYWHERE_M = 1e6
NEIGHBOURS = tuple((dv, du) for dv in (-1, 0, 1) for du in (-1, 0, 1) if (dv, du) != (0, 0))


def label_cloud(
    frame: Frame,
    segmentation: Segmentation,
    depth_m: NDArray[np.float32] | None = None,
    frame_id: str = "camera",
) -> LabeledCloud:
    """Eq. 1: one XYZL point for every pixel that has a reading, in the camera's optical frame.

    Args:
        frame: aligned images and intrinsics.
        segmentation: mask of the colour image at any size; up-sampled to the depth image.
        depth_m: filtered depth (H, W) float32 with NaN for "no reading"; None takes the frame's.
        frame_id: name of the optical frame.

    Returns:
        The cloud, in row-major order of the pixels; void points are kept, with their void label.
    """
    depth_m = frame.depth_m if depth_m is None else depth_m
    xyz = deproject(depth_m, frame.intrinsics)
    seen = np.isfinite(depth_m)
    labels = segmentation.resized_to(*depth_m.shape).labels
    return LabeledCloud(xyz[seen], labels[seen], frame_id, segmentation.label_set, frame.stamp_ns)


def neighbours_needed(frame: Frame, config: CloudConfig) -> int:
    """Neighbours that must agree; 0 where the source has filtered depth as it came, before it was aligned.

    After depth was rendered into a finer image, flying pixels agree with their own copies.
    """
    return 0 if frame.depth_filtered else config.consistent_neighbours


def crop_range(depth_m: NDArray[np.float32], min_m: float, max_m: float) -> NDArray[np.float32]:
    """Depth with everything outside [min_m, max_m] set to NaN."""
    keep = (depth_m >= np.float32(min_m)) & (depth_m <= np.float32(max_m))
    return np.where(keep, depth_m, np.float32(np.nan))


def consistent_depth(
    depth_m: NDArray[np.float32], neighbours: int, relative: float, absolute_m: float
) -> NDArray[np.float32]:
    """Depth without flying pixels: a reading stays if enough of its 8 neighbours agree with it.

    A neighbour agrees if it differs by at most `relative * depth + absolute_m`. Pixels beyond the
    border and pixels without a reading agree with nobody. A flying pixel between an obstacle and
    the lawn behind it has few such neighbours; outlier removal in 3-D after a voxel grid misses them.

    Args:
        depth_m: (H, W) float32, NaN = no reading.
        neighbours: how many of 8 must agree; 0 switches the filter off.
        relative: share of the depth.
        absolute_m: metres on top.

    Returns:
        (H, W) float32, NaN where the reading was removed.
    """
    if neighbours == 0:
        return depth_m
    height, width = depth_m.shape
    padded = np.pad(np.where(np.isnan(depth_m), FAR_AWAY, depth_m), 1, constant_values=FAR_AWAY)
    center = padded[1:-1, 1:-1]
    tolerance = center * np.float32(relative) + np.float32(absolute_m)
    agreeing = np.zeros(depth_m.shape, np.uint8)
    for dv, du in NEIGHBOURS:
        neighbour = padded[1 + dv : 1 + dv + height, 1 + du : 1 + du + width]
        agreeing += np.abs(center - neighbour) <= tolerance
    return np.where(agreeing >= neighbours, depth_m, np.float32(np.nan))


def filtered_cloud(frame: Frame, segmentation: Segmentation, config: CloudConfig) -> LabeledCloud:
    """The labelled cloud of a frame after range crop and consistency filter, in the camera frame."""
    depth_m = crop_range(frame.depth_m, config.min_range_m, config.max_range_m)
    depth_m = consistent_depth(
        depth_m, neighbours_needed(frame, config), config.consistency_relative, config.consistency_m
    )
    return label_cloud(frame, segmentation, depth_m)


def limits_in_view(config: CloudConfig, grounded: bool) -> CloudConfig:
    """The limits that hold in a view; of height none where no ground is known, for z of a map tells none."""
    return config if grounded else replace(config, min_height_m=-EVERYWHERE_M, max_height_m=EVERYWHERE_M)


def within_height(
    cloud: LabeledCloud, T_parent_camera: Pose, config: CloudConfig, height_row: NDArray[np.float32] | None
) -> LabeledCloud:
    """The points whose height above the ground's plane is within the limits, in the parent's frame.

    Args:
        cloud: of the camera.
        T_parent_camera: its pose, z of the parent up.
        config: the limits.
        height_row: of `Observation`; None = heights are z of the parent.
    """
    if height_row is None:
        height_row = T_parent_camera.matrix[2].astype(np.float32)
    (a, b, c, d), (x, y, z) = height_row, cloud.xyz.T
    height = a * x + b * y + c * z + d
    within = (height >= np.float32(config.min_height_m)) & (height <= np.float32(config.max_height_m))
    return cloud[within].transformed(T_parent_camera)


def crop_height(cloud: LabeledCloud, min_m: float, max_m: float) -> LabeledCloud:
    """Points whose z lies in [min_m, max_m]; the cloud must be in a frame whose z is up."""
    z = cloud.xyz[:, 2]
    return cloud[(z >= np.float32(min_m)) & (z <= np.float32(max_m))]


def voxel_downsample(cloud: LabeledCloud, voxel_m: float) -> LabeledCloud:
    """One point a voxel: centroid of its points, most frequent label, ties to the smallest id (PCL).

    Args:
        cloud: any cloud.
        voxel_m: edge of the cubic voxels, whose lattice is anchored at the frame's origin.

    Returns:
        The smaller cloud, ordered by voxel: z slowest, x fastest, as PCL orders it.
    """
    if not (np.isfinite(voxel_m) and voxel_m > 0):
        raise InvalidValueError(f"voxel grid: expected a positive edge in metres, got {voxel_m}")
    if len(cloud) == 0:
        return cloud
    cells = np.floor(cloud.xyz * np.float32(1.0 / voxel_m)).astype(np.int64)
    lowest, spans = cells.min(axis=0), np.ptp(cells, axis=0) + 1
    if float(np.prod(spans.astype(np.float64))) > 2**62:
        raise InvalidValueError(f"voxel grid: {voxel_m} m is too fine for a cloud of {spans * voxel_m} m")
    x, y, z = (cells - lowest).T
    keys = (z * spans[1] + y) * spans[0] + x
    _, voxel_of, counts = np.unique(keys, return_inverse=True, return_counts=True)
    sums = [np.bincount(voxel_of, cloud.xyz[:, axis].astype(np.float64)) for axis in range(3)]
    centroids = np.stack(sums, axis=1) / counts[:, None]
    votes = np.bincount(voxel_of * 256 + cloud.labels, minlength=256 * len(counts))
    labels = votes.reshape(-1, 256).argmax(axis=1)  # the first of equals: the smallest id
    return replace(cloud, xyz=centroids.astype(np.float32), labels=labels.astype(np.uint8))


def remove_statistical_outliers(cloud: LabeledCloud, neighbours: int, sigmas: float) -> LabeledCloud:
    """PCL's StatisticalOutlierRemoval: drop points far from their neighbours.

    A point stays if its mean distance to its `neighbours` nearest others is at most the mean of
    that quantity over the cloud plus `sigmas` standard deviations.

    Args:
        cloud: any cloud; one with fewer than two points is returned as it is.
        neighbours: k, the point itself not counted.
        sigmas: how many standard deviations.
    """
    if len(cloud) < 2:
        return cloud
    from scipy.spatial import cKDTree

    k = min(neighbours, len(cloud) - 1)
    points = cloud.xyz.astype(np.float64)
    distances, _ = cKDTree(points).query(points, k=k + 1)
    mean_distances = distances[:, 1:].mean(axis=1)
    limit = mean_distances.mean() + sigmas * mean_distances.std(ddof=1)
    return cloud[mean_distances <= limit]


def remove_radius_outliers(cloud: LabeledCloud, radius_m: float, neighbours: int) -> LabeledCloud:
    """PCL's RadiusOutlierRemoval: drop points with fewer than `neighbours` others within `radius_m`."""
    if len(cloud) == 0:
        return cloud
    from scipy.spatial import cKDTree

    tree = cKDTree(cloud.xyz.astype(np.float64))
    around = tree.query_ball_point(tree.data, radius_m, return_length=True)
    return cloud[np.asarray(around) > neighbours]  # the point itself is among them
