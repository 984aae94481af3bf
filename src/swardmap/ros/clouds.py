"""The point clouds of frames and of the map, as fields of sensor_msgs/PointCloud2; ROS is not needed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig
from swardmap.geometry import Pose, deproject
from swardmap.grid import OccupancyGrid
from swardmap.io.bags.ros_fields import POINT, Fields, packed_cloud_fields, point_cloud_fields
from swardmap.labels import VOID_ID, LabelSet, MapClass
from swardmap.perception.cloud import consistent_depth, crop_range, neighbours_needed
from swardmap.pipeline import StepResult
from swardmap.ros.near_frame import near_frame
from swardmap.types import Frame, Segmentation, nearest_indices

CLEARS_BELOW_M = 0.15
"""Lawn higher than this above the ground of the view clears nothing in an obstacle layer."""

ABOVE_GROUND_M = 0.1
"""Where the obstacle cloud puts what depth alone has marked: within the heights of any obstacle layer."""


@dataclass(frozen=True, slots=True, eq=False)
class FramePoints:
    """The points of a frame, pixel by pixel; what the clouds of a frame are made of.

    Attributes:
        xyz: (H * W, 3) float32 in the optical frame, NaN = no reading.
        labels: (H * W,) uint8 ids of `label_set`.
        kept: (H * W,) bool, in range, consistent with its neighbours, within the map's height limits.
        size: (H, W).
        label_set: what the ids mean.
    """

    xyz: NDArray[np.float32]
    labels: NDArray[np.uint8]
    kept: NDArray[np.bool_]
    size: tuple[int, int]
    label_set: LabelSet


def height_row(step: StepResult) -> NDArray[np.float32]:
    """(4,) float32 a, b, c, d: a x + b y + c z + d is the height of a point of the camera.

    Above the ground of this view, as the map takes it; where none is known above the map's z = 0, which
    limits nothing (`limits_in_view`).
    """
    row = step.observation.height_row
    return step.T_map_camera.matrix[2].astype(np.float32) if row is None else row


def frame_points(
    frame: Frame, segmentation: Segmentation, height_row: NDArray[np.float32], config: CloudConfig
) -> FramePoints:
    """Points of a frame as the map takes them.

    Args:
        frame: aligned images.
        segmentation: its mask.
        height_row: see the function of that name.
        config: limits.
    """
    depth_m = crop_range(frame.depth_m, config.min_range_m, config.max_range_m)
    depth_m = consistent_depth(
        depth_m, neighbours_needed(frame, config), config.consistency_relative, config.consistency_m
    )
    xyz = deproject(depth_m, frame.intrinsics).reshape(-1, 3)
    labels = segmentation.resized_to(*depth_m.shape).labels.reshape(-1)
    a, b, c, d = height_row
    height = a * xyz[:, 0] + b * xyz[:, 1] + c * xyz[:, 2] + d
    with np.errstate(invalid="ignore"):
        kept = (height >= np.float32(config.min_height_m)) & (height <= np.float32(config.max_height_m))
    return FramePoints(xyz, labels, kept, frame.depth.shape, segmentation.label_set)


def organised_cloud_fields(points: FramePoints, stamp_ns: int, frame_id: str) -> Fields:
    """sensor_msgs/PointCloud2, x y z label, one point a pixel; NaN and label 255 where there is none.

    Args:
        points: of the frame.
        stamp_ns: of the colour image.
        frame_id: its optical frame: Nav2's layers take the sensor's place from the cloud's frame, so it is
            not that of the map.
    """
    kept = points.kept
    xyz = np.where(kept[:, None], points.xyz, np.float32(np.nan))
    labels = np.where(kept, points.labels, np.uint8(VOID_ID))
    fields = point_cloud_fields(xyz, labels, stamp_ns, frame_id)
    height, width = points.size
    return fields | {"height": height, "width": width, "row_step": width * fields["point_step"]}


def cloud_fields(
    frame: Frame,
    segmentation: Segmentation,
    height_row: NDArray[np.float32],
    config: CloudConfig,
    stamped: tuple[int, str],
    lowest: MapClass = MapClass.UNKNOWN,
    others_m: NDArray[np.float32] | None = None,
    stride: int = 1,
) -> Fields:
    """sensor_msgs/PointCloud2, x y z label, of the points of `frame_points` that are kept, compiled.

    Args:
        frame: aligned images.
        segmentation: its mask.
        height_row: see the function of that name.
        config: limits.
        stamped: stamp of the colour image and its optical frame.
        lowest: points of a lower map class are left out; OBSTACLE: the obstacle cloud.
        others_m: (N, 3) points in the optical frame of obstacles that the network did not name; they get the
            id of its first obstacle class.
        stride: only every n-th row and column.
    """
    heights_m = config.min_height_m, config.max_height_m
    points = _points(frame, segmentation, height_row, config, heights_m, lowest, stride)
    if others_m is not None and len(others_m):
        named = np.flatnonzero(segmentation.label_set.map_class_table == MapClass.OBSTACLE)
        more = np.zeros(len(others_m), POINT)
        more["xyz"], more["label"] = others_m, named[0] if len(named) else VOID_ID
        points = np.concatenate([points, more])
    return packed_cloud_fields(points, *stamped)


def ground_fields(step: StepResult, config: CloudConfig, stamped: tuple[int, str], stride: int = 1) -> Fields:
    """sensor_msgs/PointCloud2, x y z label, of lawn near the ground: what an obstacle layer may clear by.

    Points that the network calls free, in cells that this view clears in the map, not higher than
    `CLEARS_BELOW_M`: rays to higher ones pass over what is low. Nav2 knows no doubt, and heights above the
    map's z = 0 alone, so both are judged here. Where no ground is known there is no point.

    Args:
        step: of the frame.
        config: limits.
        stamped: stamp of the colour image and its optical frame.
        stride: only every n-th row and column.
    """
    seen, mask = step.observation, step.segmentation
    if seen.ground is None:
        return packed_cloud_fields(np.zeros(0, POINT), *stamped)
    heights_m = config.min_height_m, min(CLEARS_BELOW_M, config.max_height_m)
    T_grid_camera = seen.spec.T_grid_map @ step.T_map_camera
    cleared = Cells(T_grid_camera, seen.spec.resolution_m, seen.classes == MapClass.GRASS)
    points = _points(step.frame, mask, height_row(step), config, heights_m, MapClass.GRASS, stride, cleared)
    lawn = mask.label_set.map_class_table[points["label"]] == MapClass.GRASS
    return packed_cloud_fields(points[lawn], *stamped)


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Some cells of a grid that a camera looks at.

    Attributes:
        T_grid_camera: pose of the camera in the grid.
        resolution_m: edge of a cell.
        chosen: (height, width) bool.
    """

    T_grid_camera: Pose
    resolution_m: float
    chosen: NDArray[np.bool_]


EVERYWHERE = Cells(Pose("grid", "camera", np.eye(4)), 1.0, np.zeros((0, 0), np.bool_))
"""No cell is asked for: points count wherever they fall."""


def _points(
    frame: Frame,
    segmentation: Segmentation,
    height_row: NDArray[np.float32],
    config: CloudConfig,
    heights_m: tuple[float, float],
    lowest: MapClass,
    stride: int,
    cells: Cells = EVERYWHERE,
) -> NDArray[np.void]:
    """(N,) of POINT: pixels of at least a class, in range, between two heights, in some cells."""
    from swardmap.kernels.clouds import collect_points

    depth, mask = frame.depth, segmentation.labels
    table = segmentation.label_set.map_class_table
    limits = np.array(
        [
            config.min_range_m,
            config.max_range_m,
            *heights_m,
            config.consistency_relative,
            config.consistency_m,
        ],
        np.float32,
    )
    packed = np.zeros(depth.size, POINT)
    count = collect_points(
        depth, np.float32(frame.depth_unit_m), mask,
        nearest_indices(depth.shape[0], mask.shape[0]), nearest_indices(depth.shape[1], mask.shape[1]),
        table.astype(np.int32), *frame.intrinsics.ray_tables(), height_row,
        limits, neighbours_needed(frame, config), int(lowest), stride,
        cells.T_grid_camera.matrix[:2].astype(np.float32), np.float32(1.0 / cells.resolution_m), cells.chosen,
        packed["xyz"], packed["label"],
    )  # fmt: skip
    return packed[:count]


def marked_by_depth_m(step: StepResult) -> NDArray[np.float32]:
    """(N, 3) float32 in the optical frame: cells that depth alone marks, a little over the ground."""
    seen, by_depth = step.observation, step.observation.by_geometry
    if by_depth is None or not by_depth.any():
        return np.zeros((0, 3), np.float32)
    rows, columns = np.nonzero(by_depth)
    xy = seen.spec.center_of(np.stack([columns, rows], axis=-1))
    ground = np.nan_to_num(seen.ground_m[rows, columns])
    xyz = np.concatenate([xy, ground[:, None] + ABOVE_GROUND_M], axis=-1)
    return step.T_map_camera.inverse().apply(xyz).astype(np.float32)


def obstacle_cells_fields(
    grid: OccupancyGrid, around_m: tuple[float, float], range_m: float, z_m: float = 0.0
) -> Fields:
    """The map's obstacles as points, for who takes clouds but no grids: Nav2's collision monitor.

    Unlike the clouds of frames they are those of all cameras, and hold what a camera has seen before and
    cannot see now. They are in the map frame or, far from its origin, in the `near_frame` of the robot.

    Args:
        grid: the map.
        around_m: (x, y) of the robot.
        range_m: cells farther than this are left out.
        z_m: height of the ground at the robot in the map frame: who takes them drops what lies far above or
            below the robot.

    Returns:
        sensor_msgs/PointCloud2 of cell centres, exact to a millimetre, at that height, label 2 obstacle,
        3 person; with the map's stamp.
    """
    rows, columns = np.nonzero(grid.is_obstacle)
    xy = grid.spec.center_of(np.stack([columns, rows], axis=-1))
    near = np.hypot(*(xy - np.asarray(around_m)).T) <= range_m
    T_map_near = near_frame(grid.spec.frame_id, around_m)
    origin_m, frame_id = (
        ((0.0, 0.0), grid.spec.frame_id)
        if T_map_near is None
        else (T_map_near.position_m[:2], T_map_near.child)
    )
    xyz = np.zeros((int(near.sum()), 3), np.float32)
    xyz[:, :2], xyz[:, 2] = xy[near] - origin_m, z_m  # in doubles: float32 has no millimetres far away
    labels = grid.classes[rows[near], columns[near]]
    return point_cloud_fields(xyz, labels, grid.stamp_ns, frame_id)
