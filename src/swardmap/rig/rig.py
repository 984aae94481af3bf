"""The cameras of a robot: where they sit, which way they look, and which of them are processed.

The paper's mower (Sec. 3.1) has a pair of cameras for each direction of travel and runs only the pair that
faces it. A rig file says the same of any robot; docs/rig.md describes it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.config import MountConfig
from swardmap.config.bounded_yaml import parse_yaml
from swardmap.config.settings import Checked, build, setting
from swardmap.errors import ConfigError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose, mount_pose

MAX_FILE_BYTES = 1_000_000


class Direction(StrEnum):
    """Of travel, and of the cameras that face it."""

    FORWARD = "forward"
    BACKWARD = "backward"


@dataclass(frozen=True)
class RigIntrinsics(Checked):
    """Pinhole camera in pixels, where the camera itself does not tell."""

    fx: float = setting(0.0, "focal length in pixels", minimum=1e-3)
    fy: float = setting(0.0, "focal length in pixels", minimum=1e-3)
    cx: float = setting(0.0, "principal point in pixels")
    cy: float = setting(0.0, "principal point in pixels")


@dataclass(frozen=True)
class RigCamera(Checked):
    """One camera: what it is called, where its images come from, where it sits and looks."""

    name: str = setting("", "unique in the rig")
    direction: str = setting("forward", "of travel in which it is processed", choices=("forward", "backward"))
    mount: MountConfig = field(default_factory=MountConfig)
    serial: str | None = setting(None, "serial number of a RealSense camera")
    color_topic: str | None = setting(None, "ROS: colour images")
    depth_topic: str | None = setting(None, "ROS: depth images, aligned to colour or not")
    color_info_topic: str | None = setting(None, "ROS: CameraInfo of the colour images")
    depth_info_topic: str | None = setting(None, "ROS: CameraInfo of the depth images")
    width: int | None = setting(None, "of the images in pixels", minimum=1)
    height: int | None = setting(None, "of the images in pixels", minimum=1)
    rate_hz: float | None = setting(None, "frames a second that are asked for", minimum=0.1, maximum=1000)
    camera_matrix: RigIntrinsics | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        who = f"camera '{self.name}'"
        if not self.name:
            raise ConfigError("rig: expected a name for each camera, got an empty one")
        if self.mount.height_m is None or self.mount.pitch_deg is None:
            raise ConfigError(
                f"{who}: expected mount.height_m and mount.pitch_deg; measure them on the robot"
            )
        if (self.width is None) != (self.height is None):
            raise ConfigError(f"{who}: expected width and height together, got only one of them")
        if self.camera_matrix is not None and self.width is None:
            raise ConfigError(f"{who}: expected width and height beside camera_matrix")
        ahead = np.cos(np.deg2rad(self.mount.yaw_deg))
        if (ahead > 1e-9 and self.direction == "backward") or (ahead < -1e-9 and self.direction == "forward"):
            raise ConfigError(
                f"{who}: its direction is {self.direction}, but mount.yaw_deg {self.mount.yaw_deg:g} looks "
                "the other way; a camera that looks straight back has yaw_deg 180"
            )

    @property
    def intrinsics(self) -> Intrinsics | None:
        """Pinhole camera of the images, if the rig file gives it."""
        k = self.camera_matrix
        if k is None or self.width is None or self.height is None:
            return None
        return Intrinsics(self.width, self.height, k.fx, k.fy, k.cx, k.cy)

    def T_base_camera(self, base_frame: str = "base") -> Pose:
        """Pose of the optical frame on the robot; its child is named as the camera."""
        m = self.mount
        if m.height_m is None or m.pitch_deg is None:  # refused when built
            raise InvalidValueError(f"camera '{self.name}': the mount is not known")
        return mount_pose(
            m.height_m, m.pitch_deg, m.roll_deg, m.yaw_deg, (m.x_m, m.y_m), base_frame, self.name
        )


@dataclass(frozen=True)
class SelectorConfig(Checked):
    """When the direction of travel counts as changed."""

    min_speed_mps: float = setting(
        0.08, "slower is standing still, which keeps the last direction", minimum=1e-3, maximum=10
    )
    hold_s: float = setting(0.2, "so long the other direction must last before it is taken", minimum=0)
    window_s: float = setting(
        0.4,
        "poses: speed is the way driven in this time; RTK is noisy from one pose to the next",
        minimum=0.01,
    )
    max_speed_mps: float = setting(
        5.0, "poses: a faster step is a jump of the pose, not a drive", minimum=0.1
    )
    initial: str = setting("forward", "until the robot has moved", choices=("forward", "backward"))


@dataclass(frozen=True)
class Rig:
    """All cameras of a robot.

    Attributes:
        cameras: at least one; names, serials and topics are unique.
        base_frame: the robot's frame, which mounts are measured in: on the ground, under the axle.
        selector: when the direction of travel counts as changed.
    """

    cameras: tuple[RigCamera, ...]
    base_frame: str = "base"
    selector: SelectorConfig = field(default_factory=SelectorConfig)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        if not self.cameras:
            raise ConfigError("rig: expected at least one camera, got none")
        for what in ("name", "serial", "color_topic", "depth_topic"):
            values = [v for c in self.cameras if (v := getattr(c, what)) is not None]
            twice = sorted({v for v in values if values.count(v) > 1})
            if twice:
                raise ConfigError(f"rig: expected each {what} once, got twice: {', '.join(twice)}")

    def __getitem__(self, name: str) -> RigCamera:
        for camera in self.cameras:
            if camera.name == name:
                return camera
        raise InvalidValueError(f"no camera '{name}' in the rig; it has: {', '.join(self.names)}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names in the order of the file."""
        return tuple(camera.name for camera in self.cameras)

    def facing(self, direction: Direction) -> tuple[RigCamera, ...]:
        """Cameras that look in a direction of travel; empty if the robot has none there."""
        return tuple(camera for camera in self.cameras if camera.direction == direction)

    def T_base_camera(self, name: str) -> Pose:
        """Mount of a camera: base_frame <- its name."""
        return self[name].T_base_camera(self.base_frame)


def read_rig(path: str | Path) -> Rig:
    """Read a rig file (YAML; docs/rig.md).

    Raises:
        ConfigError: if it cannot be read, an unknown key or wrong value is in it, or it contradicts itself.
    """
    try:
        data = Path(path).read_bytes()
        if len(data) > MAX_FILE_BYTES:
            raise ValueError(f"expected at most {MAX_FILE_BYTES} bytes, got {len(data)}")
        tree = parse_yaml(data, f"cannot read the rig {path}")
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read the rig {path}: {' '.join(str(error).split())}") from error
    try:
        return rig_from_dict(tree)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def rig_from_dict(tree: Any) -> Rig:
    """A rig from the content of its file: `cameras` by name, `base_frame`, `direction`.

    Raises:
        ConfigError: for an unknown key, a wrong type, a value out of range, or a contradiction.
    """
    if not isinstance(tree, Mapping) or not isinstance(tree.get("cameras"), Mapping):
        raise ConfigError("rig: expected a section 'cameras' with one section for each camera")
    unknown = sorted(str(key) for key in tree if key not in ("cameras", "base_frame", "direction"))
    if unknown:
        raise ConfigError(f"rig: unknown keys {', '.join(unknown)}; known: base_frame, cameras, direction")
    base_frame = tree.get("base_frame", "base")
    if not isinstance(base_frame, str) or not base_frame:
        raise ConfigError(f"rig: expected base_frame to be a name, got {base_frame!r}")
    cameras = tuple(_camera(str(name), section) for name, section in tree["cameras"].items())
    return Rig(cameras, base_frame, build(SelectorConfig, tree.get("direction") or {}, "direction."))


def _camera(name: str, section: Any) -> RigCamera:
    path = f"cameras.{name}."
    if not isinstance(section, Mapping):
        raise ConfigError(f"section '{path}': expected keys and values, got {section!r}")
    values = dict(section)
    matrix = values.pop("camera_matrix", None)
    if matrix is not None:
        matrix = build(RigIntrinsics, matrix, f"{path}camera_matrix.")
    if isinstance(values.get("serial"), int):  # digits without quotes
        raise ConfigError(f"{path}serial: put the number in quotes, or leading zeros are lost")
    camera = build(RigCamera, values | {"name": name, "camera_matrix": matrix}, path)
    assert isinstance(camera, RigCamera)  # noqa: S101 - narrows the type
    return camera
