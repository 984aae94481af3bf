"""Recordings of ROS 1 and ROS 2 as streams of messages, without ROS.

The message definitions that a bag carries are never used: every type read here is a standard one, its
definition is checked by digest, and unknown or broken definitions of other topics do no harm.
"""

import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swardmap.errors import InputError, SwardmapError

TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

_HINTS = {
    "not indexed": "Run `rosbag reindex` on it.",
    "end magic": "The recording was cut off: `mcap recover` writes a whole file from it.",
    "profile is not ros2": "Only MCAP files with ROS 2 messages (profile ros2, CDR) can be read.",
    "serialization format": "Only CDR messages can be read.",
}


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a recording."""

    name: str
    type: str
    count: int


class Bag:
    """An open recording; use `open_bag`.

    Attributes:
        path: the file or folder.
        topics: by name.
    """

    def __init__(self, path: Path, reader: Any, store: Any, is_ros2: bool) -> None:
        self.path = path
        self._reader, self._store, self._is_ros2 = reader, store, is_ros2
        self._connections: dict[str, list[Any]] = {}
        for connection in reader.connections:
            self._connections.setdefault(connection.topic, []).append(connection)
        self.topics = {
            name: Topic(name, _full_type(found[0].msgtype), sum(c.msgcount for c in found))
            for name, found in sorted(self._connections.items())
        }
        self._checked: set[str] = set()

    def messages(self, names: Iterable[str]) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, time of recording in ns, and bytes of the messages, in order of that time.

        Raises:
            InputError: if the recording is damaged.
        """
        chosen = [c for name in names for c in self._connections.get(name, [])]
        if not chosen:
            return
        stream = self._reader.messages(chosen)
        while True:
            with _one_error(self.path):
                found = next(stream, None)
            if found is None:
                return
            connection, time_ns, data = found
            yield connection.topic, time_ns, data

    def first(self, name: str) -> bytes | None:
        """Bytes of the first message of a topic."""
        return next((data for _, _, data in self.messages([name])), None)

    def decode(self, name: str, data: bytes) -> Any:
        """The message, with the fields of its ROS definition as attributes.

        Raises:
            InputError: if the bytes are not such a message, or its definition is not the standard one.
        """
        kind = self.topics[name].type
        self._check_definition(name, kind)
        with _one_error(self.path, f"message of {name}"):
            if self._is_ros2:
                return self._store.deserialize_cdr(data, kind)
            if kind == "sensor_msgs/msg/Image":
                data = data[: -len(appended_bytes(data)) or None]
            return self._store.deserialize_ros1(data, kind)

    def appended(self, name: str, data: bytes) -> bytes:
        """What librealsense wrote behind an Image of ROS 1: four bytes, else none."""
        is_image = not self._is_ros2 and self.topics[name].type == "sensor_msgs/msg/Image"
        return appended_bytes(data) if is_image else b""

    def header_stamp_ns(self, data: bytes, recorded_ns: int) -> int:
        """Time in the header of a message that starts with one; that of recording if the header has none.

        Raises:
            InputError: if the message is shorter than a header.
        """
        with _one_error(self.path, "message header"):
            if self._is_ros2:
                order = "<" if data[1] & 1 else ">"
                seconds, nanoseconds = struct.unpack_from(f"{order}iI", data, 4)
            else:
                seconds, nanoseconds = struct.unpack_from("<II", data, 4)
        return (int(seconds) * 1_000_000_000 + int(nanoseconds)) or recorded_ns

    def _check_definition(self, name: str, kind: str) -> None:
        if name in self._checked:
            return
        if kind not in self._store.fielddefs:
            raise InputError(f"{self.path}: topic {name} has type '{kind}', which is no standard message")
        right = self._store.hash_rihs01(kind) if self._is_ros2 else self._store.generate_msgdef(kind)[1]
        for connection in self._connections[name]:
            coding = getattr(connection.ext, "serialization_format", "cdr")
            if coding != "cdr":
                raise InputError(f"{self.path}: topic {name} is stored as '{coding}'; only CDR can be read")
            if connection.digest not in ("", "*", right):
                raise InputError(
                    f"{self.path}: topic {name} has a definition of '{kind}' that is not the standard one "
                    f"(digest {connection.digest}, expected {right}); convert the recording first"
                )
        self._checked.add(name)


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a .bag, .db3 or .mcap file, or the folder of a ROS 2 bag.

    Raises:
        InputError: if it is none, is damaged, or may not be read.
    """
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    is_ros2 = path.suffix != ".bag" or path.is_dir()
    with _one_error(path):
        for file in path.glob("*.db3") if path.is_dir() else [path]:
            _check_length(file)
        reader: Any = Reader2(path) if is_ros2 else Reader1(path)
        reader.open()
    try:
        store = get_typestore(Stores.ROS2_JAZZY if is_ros2 else Stores.ROS1_NOETIC)
        if not is_ros2:
            for name in TF_TYPES:
                store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
        with _one_error(path):
            bag = Bag(path, reader, store, is_ros2)
        yield bag
    finally:
        with _one_error(path):
            reader.close()


def appended_bytes(data: bytes) -> bytes:
    """The four bytes that librealsense appends to an Image of ROS 1 (its depth unit), else none.

    The fields before say how long the message is; anything but exactly four bytes more is left to the
    decoder, which refuses it.
    """
    try:
        at = 12  # sequence number and time
        at += 4 + struct.unpack_from("<I", data, at)[0]  # frame id
        at += 8  # height and width
        at += 4 + struct.unpack_from("<I", data, at)[0]  # encoding
        at += 5  # byte order and step
        at += 4 + struct.unpack_from("<I", data, at)[0]  # pixels
    except struct.error:
        return b""
    return bytes(data[at:]) if len(data) - at == 4 else b""


def _check_length(path: Path) -> None:
    """SQLite notices that a file was cut off only when it comes to a page that is not there."""
    if path.suffix != ".db3":
        return
    with path.open("rb") as file:
        head = file.read(100)
    if len(head) < 100:
        raise InputError(f"{path}: expected an SQLite database, got {len(head)} bytes. Is it whole?")
    (page_bytes,), (pages,) = struct.unpack(">H", head[16:18]), struct.unpack(">I", head[28:32])
    expected = pages * (65536 if page_bytes == 1 else page_bytes)
    number_is_valid = (
        head.startswith(b"SQLite") and head[24:28] == head[92:96]
    )  # the count of changes it was written with
    if number_is_valid and path.stat().st_size < expected:
        raise InputError(
            f"{path}: the recording was cut off: it has {path.stat().st_size} of {expected} bytes. Copy it "
            "again, or recover what is left with `sqlite3 FILE .recover`."
        )


def _full_type(name: str) -> str:
    """Some writers leave out the middle of `sensor_msgs/msg/Image`."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


@contextmanager
def _one_error(path: Path, what: str = "recording") -> Iterator[None]:
    """Whatever a reader raises on a damaged file becomes one clear error."""
    try:
        yield
    except (SwardmapError, GeneratorExit):
        raise
    except PermissionError as error:
        raise InputError(f"no permission to read {path}: {error}") from error
    except Exception as error:  # readers of binary files raise anything on wrong bytes
        text = " ".join(str(error).split())[:200] or type(error).__name__
        hint = next((hint for words, hint in _HINTS.items() if words in text.lower()), "Is it whole?")
        raise InputError(f"{path}: the {what} cannot be read: {text}. {hint}") from error
