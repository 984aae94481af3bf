"""A robot with cameras in the analytic garden, as the messages that ROS would bring; ROS is not needed."""

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from swardmap.geometry import Intrinsics, Pose
from swardmap.io.bags.ros_fields import (
    Fields,
    camera_info_fields,
    image_fields,
    odometry_fields,
    rosbags_message,
    tf_fields,
)
from swardmap.rig.rig import Rig, rig_from_dict
from swardmap.synth.analytic import StereoNoise, garden_scene, render, with_sensor_noise
from swardmap.types import Frame
from tests.bags import IMAGE, INFO, ODOMETRY, TF, Event

STORE = get_typestore(Stores.ROS2_JAZZY)
SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 100_000_000
MS = 1_000_000
BASE = "base_link"

MOUNT = {"height_m": 0.9, "pitch_deg": 25.0}
REAR = {**MOUNT, "x_m": -0.5}
RIG: dict[str, Any] = {
    "base_frame": BASE,
    "direction": {"hold_s": 0.2, "window_s": 0.4},
    "cameras": {
        "front_left": {"mount": {**MOUNT, "x_m": 0.5, "y_m": 0.2, "yaw_deg": 20}},
        "front_right": {"mount": {**MOUNT, "x_m": 0.5, "y_m": -0.2, "yaw_deg": -20}},
        "rear_left": {"direction": "backward", "mount": {**REAR, "y_m": 0.2, "yaw_deg": 160}},
        "rear_right": {"direction": "backward", "mount": {**REAR, "y_m": -0.2, "yaw_deg": -160}},
    },
}
"""The paper's mower: two cameras for each direction of travel."""

ONE: dict[str, Any] = {"base_frame": BASE, "cameras": {"camera": {"mount": MOUNT}}}


def rig_of(tree: dict[str, Any]) -> Rig:
    return rig_from_dict(tree)


def base_at(x_m: float) -> Pose:
    matrix = np.eye(4)
    matrix[0, 3] = x_m
    return Pose("map", BASE, matrix)


@cache
def _view(name: str, mount: bytes, x_m: float, seed: int) -> Frame:
    T = base_at(x_m) @ Pose(BASE, optical(name), np.frombuffer(mount).reshape(4, 4))
    frame = render(garden_scene(0), SMALL, T)
    return with_sensor_noise(frame, np.random.default_rng(seed), StereoNoise())


def view(rig: Rig, name: str, x_m: float, seed: int = 0) -> Frame:
    """What a camera sees with the robot at x, with the noise of stereo depth."""
    return _view(name, rig.T_base_camera(name).matrix.tobytes(), x_m, seed)


def optical(name: str) -> str:
    return f"{name}_optical_frame"


def message(name: str, fields: Fields) -> Any:
    """As rosbags gives it; the node reads messages by attribute, so that those of rclpy do alike."""
    return rosbags_message(STORE, name, fields)


def camera_fields(frame: Frame, name: str, stamp_ns: int) -> dict[str, tuple[str, Fields]]:
    """Topic below the camera's name -> message type and fields."""
    info = camera_info_fields(frame.intrinsics, stamp_ns, optical(name))
    return {
        "color/camera_info": (INFO, info),
        "depth/camera_info": (INFO, info),
        "color/image_raw": (IMAGE, image_fields(frame.rgb, stamp_ns, optical(name))),
        "depth/image_raw": (IMAGE, image_fields(frame.depth, stamp_ns, optical(name))),
    }


def drive_events(rig: Rig, xs_m: Sequence[float], period_ns: int = PERIOD_NS) -> Iterator[Event]:
    """A drive along x with all cameras of a rig; the robot's pose is an odometry."""
    for i, x_m in enumerate(xs_m):
        stamp_ns = START_NS + i * period_ns
        yield stamp_ns, "/odom", ODOMETRY, odometry_fields(base_at(x_m), stamp_ns)
        for name in rig.names:
            for topic, (kind, fields) in camera_fields(view(rig, name, x_m, i), name, stamp_ns).items():
                yield stamp_ns, f"/{name}/{topic}", kind, fields


def odometry(x_m: float, stamp_ns: int) -> Any:
    return message(ODOMETRY, odometry_fields(base_at(x_m), stamp_ns))


def transforms(poses: Sequence[Pose], stamp_ns: int) -> Any:
    return message(TF, tf_fields(poses, stamp_ns))
