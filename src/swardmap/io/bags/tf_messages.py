"""Messages of tf and odometry as transforms, and a buffer of those that never move."""

from dataclasses import dataclass
from typing import Any

from swardmap.io.bags.ros_messages import stamp_ns, vectors
from swardmap.io.bags.tf import TransformBuffer


@dataclass(frozen=True, slots=True)
class Transform:
    """Where a frame was in its parent, as a message has it; unchecked."""

    parent: str
    child: str
    stamp_ns: int
    translation_m: tuple[float, ...]
    quaternion_xyzw: tuple[float, ...]


def transforms_of(message: Any) -> list[Transform]:
    """What a TFMessage or an Odometry says."""
    if hasattr(message, "transforms"):
        return [
            Transform(
                item.header.frame_id,
                item.child_frame_id,
                stamp_ns(item.header.stamp),
                *vectors(item.transform.translation, item.transform.rotation),
            )
            for item in message.transforms
        ]
    pose, header = message.pose.pose, message.header
    place = vectors(pose.position, pose.orientation)
    return [Transform(header.frame_id, message.child_frame_id, stamp_ns(header.stamp), *place)]


def add_message(buffer: TransformBuffer, message: Any) -> None:
    """Add a TFMessage or an Odometry, transform by transform; what is none is counted in the buffer."""
    for t in transforms_of(message):
        buffer.add(t.parent, t.child, t.stamp_ns, t.translation_m, t.quaternion_xyzw)


def static_buffer(static: tuple[Any, ...], but: frozenset[str] = frozenset()) -> TransformBuffer:
    """A buffer with messages of /tf_static, but for some frames."""
    buffer = TransformBuffer()
    for message in static:
        for t in transforms_of(message):
            if t.child.strip("/") in but:
                continue
            buffer.add_static(t.parent, t.child, t.translation_m, t.quaternion_xyzw)
    return buffer
