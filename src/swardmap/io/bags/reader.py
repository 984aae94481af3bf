"""Recordings of ROS 1 and ROS 2 as streams of messages, without ROS.

The message definitions that a bag carries are never used: every type read here is a standard one, its
definition is checked by digest, and unknown or broken definitions of other topics do no harm.
"""

import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from swardmap.errors import InputError, SwardmapError
from swardmap.io.bags.bounded_chunks import bound_chunks
from swardmap.io.bags.mcap_profile import empty_profile_is_ros2
from swardmap.io.bags.storage import check_file, message_count, storage_files, unpacked, unpacked_message

TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

_HINTS = {
    "not indexed": "Run `rosbag reindex` on it.",
    "end magic": "The recording was cut off: `mcap recover` writes a whole file from it.",
    "profile is not ros2": "Only MCAP files with ROS 2 messages (profile ros2, CDR) can be read.",
    "serialization format": "Only CDR messages can be read.",
    "protobuf": "Only MCAP files with ROS 2 messages (CDR) can be read.",
    "jsonschema": "Only MCAP files with ROS 2 messages (CDR) can be read.",
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
        notes: what is odd about its files.
        again: opens it once more, to be read beside this one; closed with it.
    """

    def __init__(
        self, path: Path, readers: Sequence[Any], store: Any, is_ros2: bool, again: Callable[[], "Bag"]
    ) -> None:
        self.path, self.again = path, again
        self.notes: list[str] = []
        self._readers, self._store, self._is_ros2 = readers, store, is_ros2
        self._connections: dict[str, list[Any]] = {}
        for connection in (c for reader in readers for c in reader.connections):
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
        wanted = set(names)
        for reader in self._readers:
            chosen = [c for c in reader.connections if c.topic in wanted]
            if not chosen:
                continue
            stream = reader.messages(chosen)
            while True:
                with _one_error(self.path):
                    found = next(stream, None)
                    if found is None:
                        break
                    connection, time_ns, data = found
                    data = unpacked_message(data) if self._is_ros2 else data
                yield connection.topic, time_ns, data

    def first(self, name: str) -> bytes | None:
        """Bytes of the first message of a topic."""
        return next((data for _, _, data in self.messages([name])), None)

    def beginning(self, name: str, count: int = 5) -> Iterator[Any]:
        """The first messages of a topic: drivers send an empty one before the sensor runs."""
        for _, _, data in islice(self.messages([name]), count):
            yield self.decode(name, data)

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

    def header_stamp_ns(self, data: bytes) -> int:
        """Time in the header of a message that starts with one; 0 if it was never set.

        Raises:
            InputError: if the message is shorter than a header.
        """
        with _one_error(self.path, "message header"):
            if self._is_ros2:
                order = "<" if data[1] & 1 else ">"
                seconds, nanoseconds = struct.unpack_from(f"{order}iI", data, 4)
            else:
                seconds, nanoseconds = struct.unpack_from("<II", data, 4)
        return int(seconds) * 1_000_000_000 + int(nanoseconds)

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
    """Open a .bag, .db3 or .mcap file, also packed (.zstd), or the folder of a ROS 2 bag.

    Raises:
        InputError: if it is none, is damaged, or may not be read.
    """
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    bound_chunks()
    is_ros2 = path.suffix != ".bag" or path.is_dir()
    store = get_typestore(Stores.ROS2_JAZZY if is_ros2 else Stores.ROS1_NOETIC)
    if not is_ros2:
        for name in TF_TYPES:
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
    with ExitStack() as stack:
        with _one_error(path):
            files = stack.enter_context(unpacked(storage_files(path)))

        def opened() -> Bag:
            readers: list[Any] = []
            with _one_error(path):
                for file in files:
                    check_file(file)
                    readers.append(Reader2(file) if is_ros2 else Reader1(file))
                    with empty_profile_is_ros2():
                        readers[-1].open()
                    stack.callback(readers[-1].close)
                return Bag(path, readers, store, is_ros2, opened)

        bag = opened()
        if is_ros2 and (said := message_count(path)) is not None:
            _compare_counts(bag, said)
        yield bag


def _compare_counts(bag: Bag, said: int) -> None:
    found = sum(topic.count for topic in bag.topics.values())
    if found < said:
        bag.notes.append(f"metadata.yaml names {said} messages, the files hold {found}: some are lost")


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
