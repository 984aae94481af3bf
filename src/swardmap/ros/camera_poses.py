"""Poses of the cameras of a node: from odometry or tf, and mounts where tf does not say where they sit."""

from collections.abc import Collection
from typing import Any

from swardmap.errors import ConfigError
from swardmap.geometry import Pose
from swardmap.io.bags.poses import optical_between, optical_by_axes
from swardmap.io.bags.tf_edge import ALWAYS_NS
from swardmap.pipeline import configured_mount
from swardmap.rig.rig import Rig
from swardmap.ros.inputs import CameraPair
from swardmap.ros.parameters import Parameters
from swardmap.ros.poses import LivePoses

BASE_FRAME = "base_link"
"""What a configured mount is measured in, where there is no rig that names it."""

TF_TOPICS = ("/tf", "/tf_static")


class CameraPoses:
    """What is known of poses; asked at the stamps of images.

    Args:
        parameters: of the node.
        rig: names base frame and mounts; None = the mount of the configuration.
        cameras: names.

    Raises:
        ConfigError: if parameters contradict each other.
    """

    def __init__(self, parameters: Parameters, rig: Rig | None, cameras: Collection[str]) -> None:
        config, source = parameters.config, parameters.node.pose_source
        topic, mount = config.source.odometry_topic, configured_mount(config.mount)
        if source == "none" and rig is not None:
            raise ConfigError("pose_source none: a rig needs poses, or its cameras cannot share a map")
        if source == "none" and mount is None:
            raise ConfigError("pose_source none: set mount.height_m and mount.pitch_deg")
        if source == "odometry" and topic is None:
            raise ConfigError("pose_source odometry: set source.odometry_topic")
        self.posed = source != "none"
        self.from_odometry = source == "odometry" or (source == "auto" and topic is not None)
        self.mounts = {name: mount if rig is None else rig.T_base_camera(name) for name in cameras}
        self.live, self._axes = LivePoses(config.source), config.source.camera_axes
        self._topic = str(topic)
        self._base_frame = BASE_FRAME if rig is None else rig.base_frame

    def add_tf(self, message: Any, static: bool) -> None:
        """Take a message of /tf or /tf_static."""
        if static:
            self.live.add_tf_static(message)
        else:
            self.live.add_tf(message)

    def of_pair(self, pair: CameraPair, overdue: bool) -> Pose | None:
        """T_map_camera at the image stamp; None if it is not known, or not yet.

        Args:
            pair: images of one camera.
            overdue: nothing more will be waited for: by tf the camera may be put where its mount says.

        Raises:
            InputError: if the camera's frame looks up, as one with the axes of a body does.
        """
        if not self.posed:
            return None
        pose = self._of_frame(pair, overdue)
        return None if pose is None else optical_by_axes(pose, self._axes, pair.color_frame)

    def _of_frame(self, pair: CameraPair, overdue: bool) -> Pose | None:
        pose = self.live.lookup(pair.color_frame, pair.stamp_ns)
        mount = self.mounts[pair.camera]
        if pose is not None or mount is None or self.live.knows(pair.color_frame):
            return pose
        base = self._base_frame if self.live.knows(self._base_frame) or not self.from_odometry else None
        base = base or self.live.base_frame
        if base is None or not (self.from_odometry or overdue):
            return None
        added = self.live.add_mount(base, pair.color_frame, mount)
        return self.live.lookup(pair.color_frame, pair.stamp_ns) if added else None

    def view_of(self, pair: CameraPair) -> Pose | None:
        """T_color_depth of a pair; None if tf does not tell.

        By what both images say of themselves, as for a recording: that the pose is asked for another frame
        does not put the two cameras apart.
        """
        view = self.live.between(*pair.header_frames)
        return view if view is None or self._axes != "body" else optical_between(view)

    def newest_ns(self, frames: Collection[str], now_ns: int) -> int | None:
        """Stamp of the newest pose of the frame that is worst off; None if there is none of any."""
        stamps = [stamp for frame in frames if (stamp := self.live.newest_ns(frame)) is not None]
        return None if not stamps else now_ns if min(stamps) == ALWAYS_NS else min(stamps)

    def facts(self, frames: Collection[str]) -> dict[str, Any] | None:
        """How the poses of cameras are found, by the names of summary.json; None where there are none.

        Args:
            frames: optical frames of the cameras.
        """
        if not self.posed:
            return None
        origin, topics = ("odometry", [self._topic]) if self.from_odometry else ("tf", TF_TOPICS)
        each = [self.live.facts(frame, origin, topics) for frame in frames]
        told: dict[str, Any] = {"from": origin, "topics": list(topics), "frames": "", "largest_gap_ms": {}}
        for one in each:  # of one tree: what two ways share is the same in both
            told = {**one, "largest_gap_ms": told["largest_gap_ms"] | one["largest_gap_ms"]}
        return told | {"frames": "; ".join(str(one["frames"]) for one in each)}

    def newest_robot(self) -> tuple[int, Pose] | None:
        """The newest pose of the robot's base, by odometry or tf, and its stamp; None if it is not known."""
        base = self._base_frame if self.live.knows(self._base_frame) else self.live.base_frame
        newest = None if base is None else self.live.newest_ns(base)
        if base is None or newest is None:
            return None
        pose = self.live.lookup(base, newest)
        return None if pose is None else (newest, pose)

    def newest_base(self) -> tuple[int, Pose] | None:
        """The newest pose of the robot's base by tf, and its stamp."""
        newest = self.live.newest_ns(self._base_frame)
        pose = None if newest is None else self.live.lookup(self._base_frame, newest)
        return None if newest is None or pose is None else (newest, pose)
