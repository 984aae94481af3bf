"""What a recording holds, and how its frames are made: decided once, when it is opened."""

from dataclasses import dataclass

import numpy as np

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.bags import realsense_recording
from swardmap.io.bags.poses import PosePlan, latest_between, plan_poses, static_messages
from swardmap.io.bags.reader import Bag
from swardmap.io.bags.ros_camera import Calibration, calibration_from_camera_info
from swardmap.io.bags.topics import ImageTopic, choose_topics

SAME_PIXEL = 1e-3
"""Cameras whose numbers differ by less are the same."""


@dataclass(frozen=True, slots=True)
class BagPlan:
    """What was found in a recording when it was opened.

    Attributes:
        color, depth: topics of the images.
        color_camera, depth_camera: their cameras.
        depth_unit_m: metres per unit of 16-bit depth.
        T_color_depth: where depth is seen from; None if it is in the pixels of the colour image already.
        poses: where poses come from; None if there are none.
        images: of colour or of depth, whichever are fewer.
    """

    color: ImageTopic
    depth: ImageTopic
    color_camera: Calibration
    depth_camera: Calibration
    depth_unit_m: float
    T_color_depth: Pose | None
    poses: PosePlan | None
    images: int


def make_plan(bag: Bag, config: SourceConfig) -> BagPlan:
    """Choose topics, read cameras, and find where colour and depth are to each other and in the map.

    Raises:
        InputError: if one of them is missing or ambiguous.
    """
    color, depth = choose_topics(bag, config)
    color_camera = _calibration(bag, color)
    is_same_view = depth.frame_id == color.frame_id and not realsense_recording.is_sdk_bag(bag, depth.name)
    depth_camera = color_camera if depth.info is None and is_same_view else _calibration(bag, depth)
    static = static_messages(bag)
    unit_m = config.depth_unit_m or realsense_recording.depth_unit_m(bag, depth.name) or 0.001
    camera_frame = (config.camera_frame or color.frame_id).strip("/")
    T_color_depth = _color_from_depth(bag, color, depth, static)
    coincide = np.array_equal(T_color_depth.matrix, np.eye(4))
    aligned = coincide and _same_pixels(color_camera.intrinsics, depth_camera.intrinsics)
    return BagPlan(
        color=color,
        depth=depth,
        color_camera=color_camera,
        depth_camera=depth_camera,
        depth_unit_m=unit_m,
        T_color_depth=None if aligned else T_color_depth,
        poses=plan_poses(bag, config, camera_frame, static),
        images=min(bag.topics[color.name].count, bag.topics[depth.name].count),
    )


def _calibration(bag: Bag, topic: ImageTopic) -> Calibration:
    if topic.info is None or (data := bag.first(topic.info)) is None:
        raise InputError(
            f"{bag.path}: no CameraInfo beside {topic.name}. Record it, or name its topic with "
            "--set source.color_info_topic=... or source.depth_info_topic=..."
        )
    return calibration_from_camera_info(bag.decode(topic.info, data), topic.rectified, topic.info)


def _color_from_depth(bag: Bag, color: ImageTopic, depth: ImageTopic, static: tuple[object, ...]) -> Pose:
    """T_color_depth of the two cameras.

    Raises:
        InputError: if it is not recorded.
    """
    if realsense_recording.is_sdk_bag(bag, depth.name):
        return realsense_recording.color_from_depth(bag, color.name, depth.name)
    if depth.frame_id == color.frame_id:
        return Pose.identity("color", "depth")
    T = latest_between(bag, color.frame_id, depth.frame_id, static)
    if T is None and not depth.aligned:
        raise InputError(
            f"{bag.path}: depth is seen from '{depth.frame_id}' and colour from '{color.frame_id}', and no "
            "tf says how they stand to each other. Record /tf_static, or the aligned depth topic "
            "(realsense-ros: align_depth.enable:=true; else depth_image_proc register)."
        )
    return Pose.identity("color", "depth") if T is None else T


def _same_pixels(a: Intrinsics, b: Intrinsics) -> bool:
    first, second = ((c.width, c.height, c.fx, c.fy, c.cx, c.cy) for c in (a, b))
    return bool(np.allclose(first, second, rtol=0, atol=SAME_PIXEL))
