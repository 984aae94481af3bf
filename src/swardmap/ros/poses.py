"""Where the cameras were when their images were taken, from /tf and /tf_static or odometry as they come."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.io.bags.pose_facts import pose_facts
from swardmap.io.bags.ros_messages import vectors
from swardmap.io.bags.tf import TransformBuffer
from swardmap.io.bags.tf_edge import ALWAYS_NS
from swardmap.io.bags.tf_messages import Transform, transforms_of

MAP_FRAME = "map"
"""The frame of the map where nobody says another. A recording may fall back on odom, since all of its tree is
known; here the part of the tree above odom may yet come, and a map does not change its frame."""

MEMORY_NS = 10_000_000_000
"""A transform that is older by more than this than the newest of its own two frames is forgotten, or not
taken, as in tf2."""

ANEW = 5
"""So many in a row that are too old begin their edge anew: they are of another clock, or one before them was
stamped ahead of its time. tf2 would wait until its buffer is cleared."""


class LivePoses:
    """The transforms so far, and lookups at the stamps of images; never the latest in place of the right one.

    Args:
        config: `map_frame`, `pose_tolerance_ms`.
    """

    def __init__(self, config: SourceConfig) -> None:
        self._errors: Counter[str] = Counter()
        self._buffer = TransformBuffer()
        self._map_frame = config.map_frame.strip("/") if config.map_frame else None
        self._base_frame: str | None = None
        self._tolerance_ns = round(config.pose_tolerance_ms * 1e6)
        self._too_old: Counter[tuple[str, str]] = Counter()

    @property
    def map_frame(self) -> str:
        """The frame of the map."""
        return self._map_frame or MAP_FRAME

    @property
    def refused(self) -> dict[str, int]:
        """What is wrong with transforms that were left out, and how often; each is judged by itself."""
        return dict(self._errors + self._buffer.faults)

    @property
    def base_frame(self) -> str | None:
        """The frame that the odometry moves; None without odometry."""
        return self._base_frame

    def add_odometry(self, message: Any) -> None:
        """Take a nav_msgs/Odometry."""
        self._base_frame = message.child_frame_id.strip("/")
        self._map_frame = self._map_frame or message.header.frame_id.strip("/")
        self._add(message)

    def add_tf(self, message: Any) -> None:
        """Take a message of /tf."""
        self._add(message)

    def add_tf_static(self, message: Any) -> None:
        """Take a message of /tf_static."""
        for item in message.transforms:
            place, turn = vectors(item.transform.translation, item.transform.rotation)
            self._buffer.add_static(item.header.frame_id, item.child_frame_id, place, turn)

    def add_mount(self, base_frame: str, optical_frame: str, T_base_camera: Pose) -> bool:
        """Take where a camera sits from the rig or the configuration, if tf does not say.

        Returns:
            Whether it was needed.
        """
        try:
            if optical_frame in self._buffer.frames and self._buffer.connected(base_frame, optical_frame):
                return False
        except InputError as error:
            self._refuse(error)
            return False
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_matrix(T_base_camera.matrix[:3, :3]).as_quat()
        place = T_base_camera.position_m.tolist()
        return self._buffer.add_static(base_frame, optical_frame, place, turn.tolist())

    def forget_moving(self) -> None:
        """Take that there is a new clock: where frames were by the old one says nothing; mounts stay."""
        self._buffer.forget_moving()
        self._too_old.clear()

    def knows(self, frame: str) -> bool:
        """Whether a frame was heard of."""
        return frame.strip("/") in self._buffer.frames

    def lookup(self, frame: str, at_ns: int) -> Pose | None:
        """T_map_frame at a time; None if it is not known (yet)."""
        try:
            return self._buffer.lookup(self.map_frame, frame, at_ns, self._tolerance_ns)
        except InputError as error:
            self._refuse(error)
            return None

    def missing(self, frame: str) -> str:
        """Why there is no pose of a frame, for a person."""
        try:
            self._buffer.connected(self.map_frame, frame)
        except InputError as error:
            return str(error)
        heard = ", ".join(sorted(self._buffer.frames)) or "none"
        return (
            f"no pose of '{frame}' in '{self.map_frame}' at the time of the image; frames heard of: {heard} "
            "(source.map_frame names the map's)"
        )

    def facts(self, frame: str, origin: str, topics: Sequence[str]) -> dict[str, Any]:
        """How the poses of a frame are found, or why they cannot be; see `pose_facts`."""
        try:
            return pose_facts(self._buffer, (self.map_frame, frame), origin, topics, self._tolerance_ns)
        except InputError as error:
            return {"from": origin, "topics": list(topics), "frames": str(error), "largest_gap_ms": {}}

    def newest_ns(self, frame: str) -> int | None:
        """Newest time at which a lookup of a frame can succeed; None if never, ALWAYS_NS if nothing moves."""
        return self._newest_between(self.map_frame, frame)

    def between(self, parent: str, child: str) -> Pose | None:
        """T_parent_child of two frames of one camera, which do not move against each other; or None."""
        if parent == child:
            return Pose.identity(parent, child)
        newest = self._newest_between(parent, child)
        return None if newest is None else self._buffer.lookup(parent, child, newest, ALWAYS_NS)

    def _newest_between(self, parent: str, child: str) -> int | None:
        try:
            return self._buffer.newest_ns(parent, child)
        except InputError as error:  # two parents: a timer asks too, and what leaves it ends the node
            self._refuse(error)
            return None

    def _add(self, message: Any) -> None:
        """Take transforms, each judged by those of the same two frames: others say nothing of its time."""
        for t in transforms_of(message):
            if self._is_of_now(t):
                self._buffer.add(t.parent, t.child, t.stamp_ns, t.translation_m, t.quaternion_xyzw)
        self._buffer.forget_older(MEMORY_NS)

    def _is_of_now(self, t: Transform) -> bool:
        edge = t.parent.strip("/"), t.child.strip("/")
        newest_ns = self._buffer.newest_of(*edge)
        if newest_ns is None or t.stamp_ns >= newest_ns - MEMORY_NS:
            self._too_old[edge] = 0
            return True
        self._too_old[edge] += 1
        if self._too_old[edge] >= ANEW:
            self._buffer.forget_edge(*edge)
            self._too_old[edge] = 0
            return True
        old_s = MEMORY_NS // 10**9
        self._errors[f"transform {edge[0]} <- {edge[1]} is older than the newest by more than {old_s} s"] += 1
        return False

    def _refuse(self, error: InputError) -> None:
        self._errors[str(error)] += 1
