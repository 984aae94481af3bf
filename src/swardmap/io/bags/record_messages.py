"""Frames as ROS 2 messages of a recording: topics as realsense-ros names them, units as in REP-118.

/camera/camera/color/image_raw                     sensor_msgs/Image rgb8; or .../compressed, PNG or JPEG
/camera/camera/color/camera_info                   sensor_msgs/CameraInfo
/camera/camera/aligned_depth_to_color/image_raw    16UC1 in millimetres or 32FC1 in metres; or
                                                   .../compressedDepth, PNG of 16UC1
/camera/camera/aligned_depth_to_color/camera_info
/camera/camera/labels/image_raw                    mono8 true classes, if the source has them; their
/camera/camera/labels/classes                      names and roles, std_msgs/String in JSON
/tf                                                map <- camera, for frames with a pose
/tf_static                                         base <- camera, if a mount is given and poses are not
"""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError, OutputError
from swardmap.geometry import Pose
from swardmap.io.bags.ros_fields import (
    Fields,
    camera_info_fields,
    compressed_image_fields,
    image_fields,
    tf_fields,
)
from swardmap.types import Frame

CAMERA_FRAME = "camera_color_optical_frame"
COLOR, DEPTH = "/camera/camera/color", "/camera/camera/aligned_depth_to_color"
LABELS = "/camera/camera/labels"
MAP_FRAMES = ("map", "odom")
"""Names of a fixed frame that are kept; any other is called `map`, as readers look for it."""

COLOR_FORMS, DEPTH_FORMS = ("raw", "png", "jpeg"), ("raw", "png")
MILLIMETRE = 0.001

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO, TF, STRING = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"

Message = tuple[str, str, Fields]
"""Topic, type and fields."""


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """How images are stored.

    Attributes:
        color: `raw` and `png` without loss, `jpeg` small; raw is the fastest.
        depth: `raw`, or `png` for depth in 16-bit millimetres; both without loss.
        T_base_camera: mount, for frames without a pose.
    """

    color: str = "raw"
    depth: str = "raw"
    T_base_camera: Pose | None = None

    def __post_init__(self) -> None:
        for what, value, known in (("color", self.color, COLOR_FORMS), ("depth", self.depth, DEPTH_FORMS)):
            if value not in known:
                raise OutputError(f"{what} images: expected one of {', '.join(known)}, got '{value}'")


def frame_messages(frame: Frame, options: RecordOptions) -> Iterator[Message]:
    """The messages of one frame, all of its time.

    Raises:
        InputError: if its depth cannot be stored as asked for.
    """
    stamp_ns = frame.stamp_ns
    if frame.T_map_camera is not None:
        yield "/tf", TF, tf_fields([_named(frame.T_map_camera)], stamp_ns)
    yield _color(frame, options.color)
    yield _depth(frame, options.depth)
    for place in (COLOR, DEPTH):
        info = camera_info_fields(frame.intrinsics, stamp_ns, CAMERA_FRAME)
        yield f"{place}/camera_info", CAMERA_INFO, info
    if frame.labels is not None:
        yield f"{LABELS}/image_raw", IMAGE, image_fields(frame.labels, stamp_ns, CAMERA_FRAME)


def latched_messages(first: Frame, options: RecordOptions) -> Iterator[Message]:
    """What does not change, to be sent once before the first frame."""
    mount = options.T_base_camera
    if mount is not None and first.T_map_camera is None:
        mount = Pose(mount.parent, CAMERA_FRAME, mount.matrix)
        yield "/tf_static", TF, tf_fields([mount], first.stamp_ns)
    if first.label_set is not None:
        classes = [asdict(label) for label in first.label_set.classes]
        yield f"{LABELS}/classes", STRING, {"data": json.dumps(classes)}


def depth_to_store(frame: Frame) -> NDArray[np.uint16] | NDArray[np.float32]:
    """Depth as REP-118 has it: uint16 millimetres if it is that, else float32 metres without rounding."""
    if frame.depth.dtype == np.uint16 and frame.depth_unit_m != MILLIMETRE:
        return frame.depth_m
    return frame.depth


def _color(frame: Frame, form: str) -> Message:
    if form == "raw":
        return f"{COLOR}/image_raw", IMAGE, image_fields(frame.rgb, frame.stamp_ns, CAMERA_FRAME)
    fields = compressed_image_fields(frame.rgb, frame.stamp_ns, CAMERA_FRAME, form)
    return f"{COLOR}/image_raw/compressed", COMPRESSED, fields


def _depth(frame: Frame, form: str) -> Message:
    depth = depth_to_store(frame)
    if form == "raw":
        return f"{DEPTH}/image_raw", IMAGE, image_fields(depth, frame.stamp_ns, CAMERA_FRAME)
    if depth.dtype != np.uint16:
        raise InputError(
            f"depth of frame {frame.name or frame.stamp_ns} is not in 16-bit millimetres, and a PNG would "
            "round it: store depth raw"
        )
    fields = compressed_image_fields(depth, frame.stamp_ns, CAMERA_FRAME)
    return f"{DEPTH}/image_raw/compressedDepth", COMPRESSED, fields


def _named(T_map_camera: Pose) -> Pose:
    parent = T_map_camera.parent if T_map_camera.parent in MAP_FRAMES else MAP_FRAMES[0]
    return Pose(parent, CAMERA_FRAME, T_map_camera.matrix)
