"""Arrays to ROS messages, as nested dicts of fields; `rosbags_message` makes messages of them.

A dict has exactly the fields of the ROS 2 message; ROS itself is not needed.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.geometry import Intrinsics, Pose
from swardmap.grid import GridSpec

Fields = dict[str, Any]

_ENCODINGS = {("uint8", 3): "rgb8", ("uint8", 1): "mono8", ("uint16", 1): "16UC1", ("float32", 1): "32FC1"}

_FLOAT32, _UINT32 = 7, 6
"""Codes of sensor_msgs/PointField."""

POINT = np.dtype([("xyz", "<f4", (3,)), ("label", "<u4")])
"""A point of the clouds."""

_NESTED, _REPEATED = 2, (3, 4)
"""How a typestore of `rosbags` marks messages in messages, arrays and sequences."""


def time_fields(stamp_ns: int) -> Fields:
    """builtin_interfaces/Time."""
    return {"sec": stamp_ns // 1_000_000_000, "nanosec": stamp_ns % 1_000_000_000}


def header_fields(stamp_ns: int, frame_id: str) -> Fields:
    """std_msgs/Header."""
    return {"stamp": time_fields(stamp_ns), "frame_id": frame_id}


def image_fields(image: NDArray[Any], stamp_ns: int, frame_id: str) -> Fields:
    """sensor_msgs/Image of (H, W, 3) uint8 RGB, or (H, W) uint8, uint16 or float32."""
    channels = image.shape[2] if image.ndim == 3 else 1
    encoding = _ENCODINGS.get((image.dtype.name, channels))
    if image.ndim not in (2, 3) or encoding is None:
        raise InvalidValueError(
            f"image message: expected uint8 RGB, or uint8, uint16, float32 of one channel; got {image.dtype} "
            f"of shape {image.shape}"
        )
    little = np.ascontiguousarray(image, image.dtype.newbyteorder("<"))
    return {
        "header": header_fields(stamp_ns, frame_id),
        "height": image.shape[0],
        "width": image.shape[1],
        "encoding": encoding,
        "is_bigendian": 0,
        "step": image.shape[1] * channels * image.itemsize,
        "data": little.reshape(-1).view(np.uint8),
    }


def compressed_image_fields(
    image: NDArray[Any], stamp_ns: int, frame_id: str, form: str = "jpeg", quality: int = 95
) -> Fields:
    """sensor_msgs/CompressedImage: RGB as jpeg or png; (H, W) uint16 as compressedDepth.

    Args:
        image: (H, W, 3) uint8 RGB, or (H, W) uint16 depth in millimetres.
        stamp_ns: time of the image.
        frame_id: its optical frame.
        form: `jpeg` or `png`, for colour.
        quality: of JPEG.
    """
    import cv2

    header = header_fields(stamp_ns, frame_id)
    if image.dtype == np.uint16:
        data = cv2.imencode(".png", image)[1].reshape(-1)
        head = np.zeros(12, np.uint8)  # no quantisation
        return {
            "header": header,
            "format": "16UC1; compressedDepth png",
            "data": np.concatenate([head, data]),
        }
    options = [cv2.IMWRITE_JPEG_QUALITY, quality] if form == "jpeg" else []
    data = cv2.imencode(f".{form}", np.ascontiguousarray(image[..., ::-1]), options)[1].reshape(-1)
    return {"header": header, "format": f"rgb8; {form} compressed bgr8", "data": np.asarray(data, np.uint8)}


def camera_info_fields(
    intrinsics: Intrinsics, stamp_ns: int, frame_id: str, distortion: Sequence[float] = (0.0,) * 5
) -> Fields:
    """sensor_msgs/CameraInfo of a camera; `distortion` in the order of plumb_bob or rational_polynomial."""
    K = intrinsics.matrix
    return {
        "header": header_fields(stamp_ns, frame_id),
        "height": intrinsics.height,
        "width": intrinsics.width,
        "distortion_model": "plumb_bob" if len(distortion) <= 5 else "rational_polynomial",
        "d": np.array(distortion, np.float64),
        "k": K.reshape(-1),
        "r": np.eye(3).reshape(-1),
        "p": np.hstack([K, np.zeros((3, 1))]).reshape(-1),
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }


def transform_fields(T_parent_child: Pose, stamp_ns: int) -> Fields:
    """geometry_msgs/TransformStamped."""
    position, orientation = _vectors(T_parent_child)
    return {
        "header": header_fields(stamp_ns, T_parent_child.parent),
        "child_frame_id": T_parent_child.child,
        "transform": {"translation": position, "rotation": orientation},
    }


def tf_fields(poses: Sequence[Pose], stamp_ns: int) -> Fields:
    """tf2_msgs/TFMessage."""
    return {"transforms": [transform_fields(pose, stamp_ns) for pose in poses]}


def odometry_fields(T_odom_base: Pose, stamp_ns: int) -> Fields:
    """nav_msgs/Odometry with the pose only: covariances and velocities are zero."""
    position, orientation = _vectors(T_odom_base)
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    return {
        "header": header_fields(stamp_ns, T_odom_base.parent),
        "child_frame_id": T_odom_base.child,
        "pose": {"pose": {"position": position, "orientation": orientation}, "covariance": np.zeros(36)},
        "twist": {"twist": {"linear": dict(zero), "angular": dict(zero)}, "covariance": np.zeros(36)},
    }


def occupancy_grid_fields(data: NDArray[np.int8], spec: GridSpec, stamp_ns: int, frame_id: str) -> Fields:
    """nav_msgs/OccupancyGrid: (rows, columns) int8, row 0 at the origin; -1 unknown, 0 free, 100 occupied."""
    stamp = time_fields(stamp_ns)
    x, y = spec.origin_m
    return {
        "header": {"stamp": stamp, "frame_id": frame_id},
        "info": {
            "map_load_time": dict(stamp),
            "resolution": spec.resolution_m,
            "width": data.shape[1],
            "height": data.shape[0],
            "origin": {
                "position": {"x": x, "y": y, "z": 0.0},
                "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            },
        },
        "data": np.ascontiguousarray(data, np.int8).reshape(-1),
    }


def point_cloud_fields(
    xyz: NDArray[np.float32], labels: NDArray[np.uint8], stamp_ns: int, frame_id: str
) -> Fields:
    """sensor_msgs/PointCloud2 of x, y, z float32 and label uint32, as `packed_cloud_fields`."""
    points = np.zeros(len(xyz), POINT)
    points["xyz"], points["label"] = xyz, labels
    return packed_cloud_fields(points, stamp_ns, frame_id)


def packed_cloud_fields(points: NDArray[np.void], stamp_ns: int, frame_id: str) -> Fields:
    """sensor_msgs/PointCloud2 of (N,) points of the layout `POINT`: half the bytes of PCL's PointXYZL."""
    names = (("x", 0, _FLOAT32), ("y", 4, _FLOAT32), ("z", 8, _FLOAT32), ("label", 12, _UINT32))
    return {
        "header": header_fields(stamp_ns, frame_id),
        "height": 1,
        "width": len(points),
        "fields": [{"name": n, "offset": o, "datatype": t, "count": 1} for n, o, t in names],
        "is_bigendian": False,
        "point_step": POINT.itemsize,
        "row_step": POINT.itemsize * len(points),
        "data": points.view(np.uint8).reshape(-1),
        "is_dense": bool(np.isfinite(points["xyz"]).all()),
    }


def rosbags_message(store: Any, name: str, fields: Mapping[str, Any]) -> Any:
    """A message of a `rosbags` typestore, of ROS 1 or ROS 2.

    Args:
        store: as `rosbags.typesys.get_typestore` gives it.
        name: such as `sensor_msgs/msg/Image`.
        fields: as the functions of this module give them. ROS 1's upper-case names are found, and its
            `seq` becomes 0.
    """
    known = {key.lower(): value for key, value in fields.items()}
    values = {}
    for field, (kind, inner) in store.fielddefs[name][1]:
        value = known.get(field.lower(), 0)
        if kind == _NESTED:
            value = rosbags_message(store, inner, value)
        elif kind in _REPEATED and inner[0][0] == _NESTED:
            value = [rosbags_message(store, inner[0][1], item) for item in value]
        values[field] = value
    return store.types[name](**values)


def _vectors(pose: Pose) -> tuple[Fields, Fields]:
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(pose.matrix[:3, :3]).as_quat()
    position = dict(zip("xyz", map(float, pose.position_m), strict=True))
    return position, dict(zip("xyzw", map(float, turn), strict=True))
