"""Where the camera was, from the tf or the odometry of a recording."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.io.bags.reader import TF_TYPES, Bag
from swardmap.io.bags.ros_messages import stamp_ns, vectors
from swardmap.io.bags.tf import TransformBuffer

ODOMETRY = "nav_msgs/msg/Odometry"
MAP_FRAMES = ("map", "odom")

LOOK_AHEAD_NS = 10_000_000_000
"""How much of a recording is searched for the map frame where none is named."""


@dataclass(frozen=True, slots=True)
class PosePlan:
    """Which topics give the pose of the camera, and between which frames.

    Attributes:
        map_frame, camera_frame: of T_map_camera.
        topics: that move: tf or one odometry.
        static: messages of /tf_static.
    """

    map_frame: str
    camera_frame: str
    topics: frozenset[str]
    static: tuple[Any, ...]

    def new_buffer(self) -> TransformBuffer:
        """A buffer with what never moves."""
        buffer = TransformBuffer()
        for message in self.static:
            _add_static(buffer, message)
        return buffer


def add_message(buffer: TransformBuffer, message: Any) -> None:
    """Add a TFMessage or an Odometry."""
    if hasattr(message, "transforms"):
        for item in message.transforms:
            place, turn = vectors(item.transform.translation, item.transform.rotation)
            buffer.add(item.header.frame_id, item.child_frame_id, stamp_ns(item.header.stamp), place, turn)
        return
    place, turn = vectors(message.pose.pose.position, message.pose.pose.orientation)
    stamp = stamp_ns(message.header.stamp)
    buffer.add(message.header.frame_id, message.child_frame_id, stamp, place, turn)


def static_messages(bag: Bag) -> tuple[Any, ...]:
    """All messages of /tf_static; they are few."""
    names = [t.name for t in bag.topics.values() if t.type in TF_TYPES and t.name.endswith("tf_static")]
    return tuple(bag.decode(name, data) for name, _, data in bag.messages(names))


def plan_poses(bag: Bag, config: SourceConfig, camera_frame: str, static: tuple[Any, ...]) -> PosePlan | None:
    """Decide where poses come from: the odometry named, else tf, else the only odometry.

    Args:
        bag: the recording.
        config: `odometry_topic`, `map_frame`.
        camera_frame: optical frame of the colour image.
        static: messages of /tf_static.

    Returns:
        None if the recording has no poses.

    Raises:
        InputError: if a topic or frame named is not there, or the camera is not in the tree.
    """
    buffer = PosePlan("", "", frozenset(), static).new_buffer()
    if config.odometry_topic is not None:
        return _plan_odometry(bag, config, camera_frame, static, buffer)
    topics = frozenset(
        t.name for t in bag.topics.values() if t.type in TF_TYPES and not t.name.endswith("tf_static")
    )
    map_frame = _find_map_frame(bag, config, topics, buffer, camera_frame)
    if map_frame is not None:
        if camera_frame not in buffer.frames:
            raise InputError(
                f"{bag.path}: tf has '{map_frame}' but not '{camera_frame}', the frame of the colour images; "
                f"frames: {', '.join(sorted(buffer.frames))}. Name the camera's optical frame with "
                "--set source.camera_frame=..., or record /tf_static."
            )
        return PosePlan(map_frame, camera_frame, topics, static)
    odometries = [t.name for t in bag.topics.values() if t.type == ODOMETRY and t.count]
    if len(odometries) == 1 and _odometry_frames(bag, odometries[0], buffer, camera_frame)[2]:
        return _plan_odometry(bag, config, camera_frame, static, buffer, odometries[0])
    return None


def latest_between(bag: Bag, parent: str, child: str, static: tuple[Any, ...]) -> Pose | None:
    """T_parent_child of two frames that do not move against each other, from /tf_static or /tf."""
    buffer = PosePlan("", "", frozenset(), static).new_buffer()
    if not buffer.connected(parent, child):
        names = [t.name for t in bag.topics.values() if t.type in TF_TYPES]
        for message in _beginning(bag, names):
            add_message(buffer, message)
            if buffer.connected(parent, child):
                break
    newest = buffer.newest_ns(parent, child)
    return None if newest is None else buffer.lookup(parent, child, newest, 2**62)


def _plan_odometry(
    bag: Bag,
    config: SourceConfig,
    camera_frame: str,
    static: tuple[Any, ...],
    buffer: TransformBuffer,
    only: str | None = None,
) -> PosePlan:
    topic = only or config.odometry_topic or ""
    if topic not in bag.topics or bag.topics[topic].type != ODOMETRY or not bag.topics[topic].count:
        listed = ", ".join(t.name for t in bag.topics.values() if t.type == ODOMETRY) or "none"
        raise InputError(f"{bag.path}: no odometry in topic '{topic}'; topics with odometry: {listed}")
    odom, base, connected = _odometry_frames(bag, topic, buffer, camera_frame)
    if not connected:
        raise InputError(
            f"{bag.path}: {topic} moves '{base}', but where the camera '{camera_frame}' sits on it is not in "
            f"/tf_static. Record /tf_static, or, if this is the odometry of the camera itself, use "
            f"--set source.camera_frame={base}."
        )
    return PosePlan(config.map_frame or odom, camera_frame, frozenset({topic}), static)


def _odometry_frames(
    bag: Bag, topic: str, buffer: TransformBuffer, camera_frame: str
) -> tuple[str, str, bool]:
    """Frames of an odometry, and whether the camera sits on the one that moves."""
    data = bag.first(topic)
    message = bag.decode(topic, data or b"")
    odom, base = message.header.frame_id.strip("/"), message.child_frame_id.strip("/")
    return odom, base, base == camera_frame or buffer.connected(base, camera_frame)


def _find_map_frame(
    bag: Bag, config: SourceConfig, topics: frozenset[str], buffer: TransformBuffer, camera_frame: str
) -> str | None:
    """The frame named, else map, else odom; adds what it reads on the way to the buffer."""
    wanted = (config.map_frame.strip("/"),) if config.map_frame else MAP_FRAMES
    for message in _beginning(bag, topics, None if config.map_frame else LOOK_AHEAD_NS):
        if {wanted[0], camera_frame} <= buffer.frames:
            break
        add_message(buffer, message)
    found = next((name for name in wanted if name in buffer.frames), None)
    if config.map_frame and found is None:
        listed = ", ".join(sorted(buffer.frames)) or "none"
        raise InputError(f"{bag.path}: no frame '{config.map_frame}' in tf; frames: {listed}")
    return found


def _beginning(bag: Bag, names: Any, length_ns: int | None = LOOK_AHEAD_NS) -> Iterator[Any]:
    start: int | None = None
    for name, time_ns, data in bag.messages(names):
        start = time_ns if start is None else start
        if length_ns is not None and time_ns - start > length_ns:
            return
        yield bag.decode(name, data)


def _add_static(buffer: TransformBuffer, message: Any) -> None:
    for item in message.transforms:
        place, turn = vectors(item.transform.translation, item.transform.rotation)
        buffer.add_static(item.header.frame_id, item.child_frame_id, place, turn)
