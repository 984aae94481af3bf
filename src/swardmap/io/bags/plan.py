"""What a recording holds, and how its frames are made: decided once, when it is opened."""

from dataclasses import dataclass

import numpy as np

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.bags import realsense_recording
from swardmap.io.bags.poses import PosePlan, camera_tf, latest_between, optical_between, plan_poses
from swardmap.io.bags.reader import Bag
from swardmap.io.bags.recorded_labels import LabelTopic, find_labels
from swardmap.io.bags.ros_camera import Calibration, calibration_from_camera_info
from swardmap.io.bags.tf_topics import TfTopics
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
        float_unit_m: metres per unit of float depth, if it is set.
        T_color_depth: where depth is seen from; None if it is in the pixels of the colour image already.
        poses: where poses come from; None if there are none.
        images: of colour or of depth, whichever are fewer.
        labels: true classes of the colour images, or None.
        notes: what was taken for granted.
    """

    color: ImageTopic
    depth: ImageTopic
    color_camera: Calibration
    depth_camera: Calibration
    depth_unit_m: float
    float_unit_m: float | None
    T_color_depth: Pose | None
    poses: PosePlan | None
    images: int
    labels: LabelTopic | None = None
    notes: tuple[str, ...] = ()


def make_plan(bag: Bag, config: SourceConfig) -> BagPlan:
    """Choose topics, read cameras, and find where colour and depth are to each other and in the map.

    Raises:
        InputError: if one of them is missing or ambiguous.
    """
    notes = list(bag.notes)
    color, depth = choose_topics(bag, config, notes)
    color_camera = _calibration(bag, color)
    tf = camera_tf(bag, config, color.name, notes)
    depth_camera, T_color_depth = _depth_view(bag, config, color, depth, color_camera, tf, notes)
    camera_frame = (config.camera_frame or color.frame_id).strip("/")
    return BagPlan(
        color=color,
        depth=depth,
        color_camera=color_camera,
        depth_camera=depth_camera,
        depth_unit_m=config.depth_unit_m or realsense_recording.depth_unit_m(bag, depth.name) or 0.001,
        float_unit_m=config.depth_unit_m,
        T_color_depth=T_color_depth,
        poses=plan_poses(bag, config, camera_frame, tf, notes),
        images=min(bag.topics[color.name].count, bag.topics[depth.name].count),
        labels=find_labels(bag),
        notes=tuple(notes),
    )


def _calibration(bag: Bag, topic: ImageTopic) -> Calibration:
    """Of the first CameraInfo of a topic that is filled in."""
    error: InputError | None = None
    for message in bag.beginning(topic.info) if topic.info else ():
        try:
            return calibration_from_camera_info(message, topic.rectified, topic.info or "")
        except InputError as found:
            error = error or found
    raise error or InputError(
        f"{bag.path}: no CameraInfo beside {topic.name}. Record it, or name its topic with "
        "--set source.color_info_topic=... or source.depth_info_topic=..."
    )


def _depth_view(
    bag: Bag,
    config: SourceConfig,
    color: ImageTopic,
    depth: ImageTopic,
    color_camera: Calibration,
    tf: TfTopics,
    notes: list[str],
) -> tuple[Calibration, Pose | None]:
    """The camera of the depth image, and where it is seen from; None in the pixels of the colour image.

    Raises:
        InputError: if that is not recorded, or what is recorded contradicts itself.
    """
    sdk_bag = realsense_recording.is_sdk_bag(bag, depth.name)
    same_frame = depth.frame_id == color.frame_id and not sdk_bag
    if depth.info is None and (same_frame or config.depth_aligned):
        return color_camera, None
    camera = _calibration(bag, depth)
    T = _color_from_depth(bag, config, color, depth, tf, sdk_bag)
    if not np.array_equal(T.matrix, np.eye(4)):
        return camera, T
    ours, theirs = color_camera.intrinsics, camera.intrinsics
    if _same_pixels(ours, theirs):
        return camera, None
    same_size = (ours.width, ours.height) == (theirs.width, theirs.height)
    if not same_size or not same_frame or config.depth_aligned is False:
        return camera, T
    if depth.aligned or config.depth_aligned:
        notes.append(
            f"{depth.info} says fx {theirs.fx:g}, {color.info} {ours.fx:g}: depth that is aligned has the "
            "camera of the colour image"
        )
        return color_camera, None
    raise InputError(
        f"{bag.path}: depth has the frame and the size of the colour image, but another camera "
        f"(fx {theirs.fx:g}, colour {ours.fx:g}). Say whether it is in the pixels of the colour image with "
        "--set source.depth_aligned=true or false."
    )


def _color_from_depth(
    bag: Bag, config: SourceConfig, color: ImageTopic, depth: ImageTopic, tf: TfTopics, sdk_bag: bool
) -> Pose:
    """T_color_depth of the two optical frames; the identity is never assumed across frames.

    Raises:
        InputError: if it is not recorded, or the name of the topic says other than tf.
    """
    same = Pose.identity("color", "depth")
    if config.T_color_depth is not None:
        return Pose.from_quaternion("color", "depth", config.T_color_depth[:3], config.T_color_depth[3:])
    if config.depth_aligned:
        return same
    if sdk_bag:
        return realsense_recording.color_from_depth(bag, color.name, depth.name)
    if depth.frame_id == color.frame_id:
        return same
    where = (
        f"{bag.path}: depth {depth.name} is seen from '{depth.frame_id}' and colour from '{color.frame_id}'"
    )
    T = latest_between(bag, color.frame_id, depth.frame_id, tf)
    if T is None:
        raise InputError(
            f"{where}, and no tf says how they stand to each other. Record /tf_static, or the aligned depth "
            "topic (realsense-ros: align_depth.enable:=true; else depth_image_proc register); else set "
            "source.depth_aligned=true if it is aligned, or source.T_color_depth=[x, y, z, qx, qy, qz, qw]."
        )
    T = optical_between(T) if config.camera_axes == "body" else T
    if depth.aligned and config.depth_aligned is None and not np.allclose(T.matrix, np.eye(4), atol=1e-6):
        raise InputError(
            f"{where}, which tf puts elsewhere, but its name says it is aligned. Say whether it is in the "
            "pixels of the colour image with --set source.depth_aligned=true or false."
        )
    return T


def _same_pixels(a: Intrinsics, b: Intrinsics) -> bool:
    first, second = ((c.width, c.height, c.fx, c.fy, c.cx, c.cy) for c in (a, b))
    return bool(np.allclose(first, second, rtol=0, atol=SAME_PIXEL))
