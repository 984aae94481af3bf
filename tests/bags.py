"""Writes small recordings as ROS does: bags of ROS 1, and of ROS 2 in SQLite and MCAP."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from swardmap.io.bags.ros_fields import Fields, rosbags_message

Kind = Literal["ros1", "sqlite3", "mcap"]
KINDS: tuple[Kind, ...] = ("ros1", "sqlite3", "mcap")

Event = tuple[int, str, str, Fields | bytes]
"""Time of recording in ns, topic, message type, fields (or a message in bytes)."""

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
INFO, TF, ODOMETRY = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage", "nav_msgs/msg/Odometry"


def typestore(kind: Kind) -> Any:
    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_JAZZY)
    if kind == "ros1":
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store


def write_bag(
    folder: Path, kind: Kind, events: Iterable[Event], definitions: dict[str, str] | None = None
) -> Path:
    """Write events in the order given.

    Args:
        folder: existing folder to write into.
        kind: of bag.
        events: what happened.
        definitions: further message types, name -> definition.

    Returns:
        The .bag file, or the folder of a ROS 2 bag.
    """
    store = typestore(kind)
    for name, text in (definitions or {}).items():
        store.register(get_types_from_msg(text, name))
    path = folder / ("bag.bag" if kind == "ros1" else f"bag_{kind}")
    if kind == "ros1":
        writer: Any = Writer1(path)
    else:
        plugin = StoragePlugin.SQLITE3 if kind == "sqlite3" else StoragePlugin.MCAP
        writer = Writer2(path, version=8, storage_plugin=plugin)
    connections: dict[str, Any] = {}
    with writer:
        for stamp_ns, topic, name, fields in events:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            data = fields if isinstance(fields, bytes) else serialized(store, kind, name, fields)
            writer.write(connections[topic], stamp_ns, data)
    return path


def serialized(store: Any, kind: Kind, name: str, fields: Fields) -> bytes:
    message = rosbags_message(store, name, fields)
    serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
    return bytes(serialize(message, name))


def bare_file(bag: Path) -> Path:
    """The storage file of a ROS 2 bag, without its metadata.yaml."""
    return next(p for p in bag.iterdir() if p.suffix in (".db3", ".mcap"))
