"""Where the camera was, from the tf or the odometry of a recording: decided when it is opened."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import R_BODY_OPTICAL, Pose
from swardmap.io.bags.reader import Bag
from swardmap.io.bags.tf import TransformBuffer
from swardmap.io.bags.tf_messages import add_message, static_buffer, transforms_of
from swardmap.io.bags.tf_topics import TfTopics, choose_tf

ODOMETRY = "nav_msgs/msg/Odometry"
MAP_FRAMES = ("map", "odom")

LOOK_AHEAD_NS = 10_000_000_000
"""How much of a recording is searched for the map frame where none is named; all of it if none turns up."""

LOOKS_UP = 0.5
"""Sine of an elevation that no mower's camera looks up to: its frame has the axes of a body."""


@dataclass(frozen=True, slots=True)
class PosePlan:
    """Which topics give the pose of the camera, and between which frames.

    Attributes:
        map_frame, camera_frame: of T_map_camera.
        topics: that move: tf or one odometry.
        static: messages of /tf_static.
        origin: `tf` or `odometry`.
        axes: of the camera's frame: `optical`, `body` (x forward), or `auto`: optical, unless it looks up.
        placeholders: frames whose static transform does not hold, since tf moves them elsewhere.
    """

    map_frame: str
    camera_frame: str
    topics: frozenset[str]
    static: tuple[Any, ...]
    origin: str = "tf"
    axes: str = "auto"
    placeholders: frozenset[str] = frozenset()

    def new_buffer(self) -> TransformBuffer:
        """A buffer with what never moves."""
        return static_buffer(self.static, self.placeholders)

    def optical(self, T_map_camera: Pose) -> Pose:
        """The pose of the optical frame (z forward).

        Raises:
            InputError: if the camera's frame looks up, as one with the axes of a body does.
        """
        return optical_by_axes(T_map_camera, self.axes, self.camera_frame)


def optical_by_axes(T_map_camera: Pose, axes: str, camera_frame: str) -> Pose:
    """The pose of the optical frame (z forward) of a camera whose own frame has these axes.

    Args:
        T_map_camera: of the frame that the images are said to be of.
        axes: `optical`, `body` (x forward), or `auto`: optical, unless it looks up.
        camera_frame: for the message.

    Raises:
        InputError: if the frame looks up, as one with the axes of a body does, and nobody said its axes.
    """
    if axes == "body":
        return optical_of_body(T_map_camera)
    if axes == "auto" and T_map_camera.matrix[2, 2] > LOOKS_UP:
        raise InputError(
            f"the camera's frame '{camera_frame}' looks up: is it a body frame (x forward) in place "
            "of an optical one (z forward, REP-103)? Name the optical frame with --set "
            "source.camera_frame=..., or, if tf has none, say --set source.camera_axes=body (optical: it "
            "does look up)"
        )
    return T_map_camera


def optical_between(T_body_body: Pose) -> Pose:
    """A pose between frames with the axes of a body, between the optical frames of the same cameras."""
    turn: Any = np.eye(4)
    turn[:3, :3] = R_BODY_OPTICAL
    return Pose(T_body_body.parent, T_body_body.child, turn.T @ T_body_body.matrix @ turn)


def optical_of_body(T_parent_body: Pose) -> Pose:
    """The pose of a camera's optical frame, from its frame with the axes of a body (REP-103)."""
    matrix = T_parent_body.matrix.copy()
    matrix[:3, :3] = matrix[:3, :3] @ R_BODY_OPTICAL
    return Pose(T_parent_body.parent, T_parent_body.child, matrix)


def plan_poses(
    bag: Bag, config: SourceConfig, camera_frame: str, tf: TfTopics, notes: list[str]
) -> PosePlan | None:
    """Decide where poses come from: the odometry named, else tf, else the only odometry.

    Args:
        bag: the recording.
        config: `poses`, `odometry_topic`, `map_frame`, `camera_axes`.
        camera_frame: optical frame of the colour image.
        tf: topics of the tf that the camera is in.
        notes: gets what was taken for granted.

    Returns:
        None if the recording has no poses.

    Raises:
        InputError: if a topic or frame named is not there, the camera is not in the tree, or tf has poses
            under a name that could be that of anything.
    """
    if config.poses == "none":
        return None
    buffer = static_buffer(tf.static)
    if config.odometry_topic is not None:
        return _plan_odometry(bag, config, camera_frame, tf, buffer, config.odometry_topic)
    map_frame = _find_map_frame(bag, config, tf, buffer, camera_frame)
    if map_frame is not None:
        if map_frame != MAP_FRAMES[0] and not config.map_frame:
            notes.append(f"tf places the camera in no frame 'map': the map is in '{map_frame}'")
        placeholders = _placeholders(bag, tf, map_frame, camera_frame, notes)
        axes = config.camera_axes
        return PosePlan(map_frame, camera_frame, tf.moving, tf.static, "tf", axes, placeholders)
    odometries = [t.name for t in bag.topics.values() if t.type == ODOMETRY and t.count]
    if len(odometries) == 1 and _odometry_frames(bag, odometries[0], buffer, camera_frame)[2]:
        return _plan_odometry(bag, config, camera_frame, tf, buffer, odometries[0])
    notes.append(_why_without(buffer, camera_frame, odometries))
    return None


def latest_between(bag: Bag, parent: str, child: str, tf: TfTopics) -> Pose | None:
    """T_parent_child of two frames that do not move against each other, from /tf_static or /tf."""
    buffer = static_buffer(tf.static)
    if not buffer.connected(parent, child):
        for message in _beginning(bag, tf.moving):
            add_message(buffer, message)
            if buffer.connected(parent, child):
                break
    newest = buffer.newest_ns(parent, child)
    return None if newest is None else buffer.lookup(parent, child, newest, 2**62)


def camera_tf(bag: Bag, config: SourceConfig, color_topic: str, notes: list[str]) -> TfTopics:
    """The tf that the camera is in, with its static messages."""
    moving, static, others = choose_tf(bag, config.tf_topic, color_topic)
    if others:
        chosen = ", ".join(sorted(moving)) or "none"
        notes.append(f"tf of {', '.join(others)} is left out; the camera's is {chosen} (source.tf_topic)")
    return TfTopics(moving, tuple(bag.decode(name, data) for name, _, data in bag.messages(static)))


def _plan_odometry(
    bag: Bag, config: SourceConfig, camera_frame: str, tf: TfTopics, buffer: TransformBuffer, topic: str
) -> PosePlan:
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
    map_frame = config.map_frame or odom
    return PosePlan(map_frame, camera_frame, frozenset({topic}), tf.static, "odometry", config.camera_axes)


def _odometry_frames(
    bag: Bag, topic: str, buffer: TransformBuffer, camera_frame: str
) -> tuple[str, str, bool]:
    """Frames of an odometry, and whether the camera sits on the one that moves."""
    data = bag.first(topic)
    message = bag.decode(topic, data or b"")
    odom, base = message.header.frame_id.strip("/"), message.child_frame_id.strip("/")
    return odom, base, base == camera_frame or buffer.connected(base, camera_frame)


def _find_map_frame(
    bag: Bag, config: SourceConfig, tf: TfTopics, buffer: TransformBuffer, camera_frame: str
) -> str | None:
    """The frame named, else map, else odom, that the camera hangs on; adds what it reads to the buffer.

    Raises:
        InputError: if tf moves the camera, but in no frame of these names, or not in the one named.
    """
    wanted = (config.map_frame.strip("/"),) if config.map_frame else MAP_FRAMES
    start: int | None = None
    for name, time_ns, data in bag.messages(tf.moving):
        start = time_ns if start is None else start
        late = time_ns - start > LOOK_AHEAD_NS
        if _connected(buffer, wanted[:1] if not late else wanted, camera_frame):
            break
        add_message(buffer, bag.decode(name, data))
    found = _connected(buffer, wanted, camera_frame)
    if found is None and (known := [name for name in wanted if name in buffer.frames]):
        _refuse_unconnected(bag, buffer, known[0], camera_frame)
    if found is None and config.map_frame:
        raise InputError(f"{bag.path}: no frame '{config.map_frame}' in tf; frames: {_listed(buffer)}")
    if found is None and camera_frame in buffer.frames:
        root, moved = buffer.root_of(camera_frame)
        if moved:
            raise InputError(
                f"{bag.path}: tf moves the camera, but in no frame named map or odom; frames: "
                f"{_listed(buffer)}. Name the fixed one, such as --set source.map_frame={root}, or map each "
                "frame on its own with --set source.poses=none."
            )
    return found


def _placeholders(
    bag: Bag, tf: TfTopics, map_frame: str, camera_frame: str, notes: list[str]
) -> frozenset[str]:
    """Frames near the map that came as static and, within the first seconds, as moving and elsewhere."""
    buffer = static_buffer(tf.static)
    fixed = {map_frame, *MAP_FRAMES}
    if not any(e.parent in fixed or e.child in fixed for m in tf.static for e in transforms_of(m)):
        return frozenset()
    for message in _beginning(bag, tf.moving):
        add_message(buffer, message)
    found = buffer.conflicts(map_frame, camera_frame)
    for parent, child in found:
        notes.append(f"tf gives {parent} <- {child} as static and as moving: the moving one is used")
    return frozenset(child for _, child in found)


def _connected(buffer: TransformBuffer, names: tuple[str, ...], camera_frame: str) -> str | None:
    if camera_frame not in buffer.frames:
        return None
    heard = (name for name in names if name in buffer.frames)
    return next((name for name in heard if buffer.connected(name, camera_frame)), None)


def _refuse_unconnected(bag: Bag, buffer: TransformBuffer, map_frame: str, camera_frame: str) -> None:
    wrong = f" Left out: {next(iter(buffer.faults))}." if buffer.faults else ""
    if camera_frame not in buffer.frames:
        raise InputError(
            f"{bag.path}: tf has '{map_frame}' but not '{camera_frame}', the frame of the colour images; "
            f"frames: {_listed(buffer)}. Name the camera's optical frame with "
            f"--set source.camera_frame=..., or record /tf_static.{wrong}"
        )
    raise InputError(
        f"{bag.path}: tf has no way from '{map_frame}' to '{camera_frame}', the frame of the colour images, "
        f"which hangs on '{buffer.root_of(camera_frame)[0]}'; frames: {_listed(buffer)}. Record /tf_static, "
        f"or name another fixed frame with --set source.map_frame=....{wrong}"
    )


def _why_without(buffer: TransformBuffer, camera_frame: str, odometries: list[str]) -> str:
    if len(odometries) > 1:
        why = f"name one of the odometries {', '.join(odometries)} with source.odometry_topic"
    elif odometries:
        why = f"nothing says where '{camera_frame}' sits on what {odometries[0]} moves"
    elif buffer.frames:
        why = f"no tf moves the camera '{camera_frame}'; frames: {_listed(buffer)}"
    else:
        why = "neither tf nor odometry is recorded"
    return f"no poses, each frame is mapped on its own: {why}"


def _listed(buffer: TransformBuffer) -> str:
    return ", ".join(sorted(buffer.frames)) or "none"


def _beginning(bag: Bag, names: Any) -> Iterator[Any]:
    start: int | None = None
    for name, time_ns, data in bag.messages(names):
        start = time_ns if start is None else start
        if time_ns - start > LOOK_AHEAD_NS:
            return
        yield bag.decode(name, data)
