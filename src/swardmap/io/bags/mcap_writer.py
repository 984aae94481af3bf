"""Frames to an MCAP file that `ros2 bag`, Foxglove and our own reader take.

`record_messages` says what is in it. The writer is the format's own: chunks of 1 MB in zstd, so that memory
does not grow with the length, with a checksum of each, of what lies between them, and of the summary at the
end. A file has its name only when it is whole.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swardmap import __version__
from swardmap.errors import InputError, OutputError
from swardmap.geometry import Intrinsics
from swardmap.io import FrameSource
from swardmap.io.bags.record_messages import Message, RecordOptions, frame_messages, latched_messages
from swardmap.io.bags.ros_fields import rosbags_message
from swardmap.io.door import frames_of
from swardmap.io.staging import staged_folder, sweep
from swardmap.types import Frame

CHUNK_BYTES = 2**20

LATCHED = """- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false"""
"""What `ros2 bag play` needs to know to give a late listener what was sent once: transient local."""


def record(
    source: FrameSource,
    path: str | Path,
    options: RecordOptions | None = None,
    overwrite: bool = False,
    on_frame: Callable[[Frame], None] | None = None,
) -> int:
    """Write every frame of a source to an MCAP file; returns how many.

    Raises:
        InputError: if there is no frame, or they do not go into one recording.
        OutputError: as `mcap_writer`.
    """
    with mcap_writer(path, options, overwrite) as writer:
        for frame in frames_of(source, source.name):
            writer.write(frame)
            if on_frame is not None:
                on_frame(frame)
        if not writer.frames:
            left_out = ", ".join(f"{n} x {reason}" for reason, n in source.skipped.items())
            raise InputError(f"{source.name} gave no frame to record (left out: {left_out or 'nothing'})")
    return writer.frames


@contextmanager
def mcap_writer(
    path: str | Path, options: RecordOptions | None = None, overwrite: bool = False
) -> Iterator["McapWriter"]:
    """Open a file that appears under its name, whole, when the block ends without an error.

    Args:
        path: ends in .mcap; missing parent folders are made.
        options: how images are stored.
        overwrite: replace a file of that name.

    Raises:
        OutputError: if the name is taken or no .mcap, or it cannot be written (a full disk, ...); an
            earlier file stays as it was.
    """
    from mcap.writer import CompressionType, Writer

    path = Path(path)
    sweep(path)
    _refuse(path, overwrite)
    with ExitStack() as stack:
        with _one_error(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            staging = stack.enter_context(staged_folder(path)) / path.name
            file = stack.enter_context(staging.open("xb"))
        bag = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
        with _one_error(path):
            bag.start(profile="ros2", library=f"swardmap {__version__}")
        writer = McapWriter(path, bag, options or RecordOptions())
        yield writer
        with _one_error(path):
            writer.finish()
            file.flush()
            os.fsync(file.fileno())
            _publish(staging, path)


class McapWriter:
    """Writes frames into an open bag; use `mcap_writer`.

    Attributes:
        frames: written so far.
    """

    def __init__(self, path: Path, bag: Any, options: RecordOptions) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._path, self._bag, self._options = path, bag, options
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, _Channel] = {}
        self._first: Frame | None = None
        self._last_ns = -1
        self.frames = 0

    def write(self, frame: Frame) -> None:
        """Add one frame.

        Raises:
            InputError: if it does not go with those before it: another camera, an earlier time, another
                scene; or its depth cannot be stored as asked for.
        """
        self._check(frame, self._first or frame)
        self._last_ns = frame.stamp_ns
        if self._first is None:
            self._first = frame
            for message in latched_messages(frame, self._options):
                self._put(message, frame.stamp_ns, latched=True)
        for message in frame_messages(frame, self._options):
            self._put(message, frame.stamp_ns)
        self.frames += 1

    def finish(self) -> None:
        """Write what is still held, the metadata of a ROS 2 bag, and the summary."""
        text = bag_metadata(self._path.name, self._channels.values())
        self._bag.add_metadata("rosbag2", {"serialized_metadata": text})
        self._bag.finish()

    def _put(self, message: Message, stamp_ns: int, latched: bool = False) -> None:
        topic, kind, fields = message
        data = bytes(self._store.serialize_cdr(rosbags_message(self._store, kind, fields), kind))
        with _one_error(self._path):
            channel = self._channels.get(topic) or self._channel(topic, kind, LATCHED if latched else "")
            channel.count(stamp_ns)
            self._bag.add_message(channel.number, stamp_ns, data, stamp_ns)

    def _channel(self, topic: str, kind: str, qos: str) -> "_Channel":
        if kind not in self._schemas:
            definition, _ = self._store.generate_msgdef(kind, ros_version=2)
            self._schemas[kind] = self._bag.register_schema(kind, "ros2msg", definition.encode())
        metadata = {"offered_qos_profiles": qos}
        number = self._bag.register_channel(topic, "cdr", self._schemas[kind], metadata)
        digest = self._store.hash_rihs01(kind)
        self._channels[topic] = _Channel(number, topic, kind, digest, qos)
        return self._channels[topic]

    def _check(self, frame: Frame, first: Frame) -> None:
        who = f"frame {frame.name or frame.stamp_ns}"
        if not self._last_ns < frame.stamp_ns < 2**31 * 10**9:  # what a ROS header can hold
            raise InputError(
                f"{who}: expected a time in nanoseconds after {self._last_ns}, that of the frame before, and "
                f"below 2^31 seconds, got {frame.stamp_ns}"
            )
        if frame.intrinsics != first.intrinsics:
            raise InputError(
                f"{who}: expected the camera of the first frame, {_short(first.intrinsics)}, got "
                f"{_short(frame.intrinsics)}: one recording is of one camera"
            )
        if (frame.depth.dtype, frame.depth_unit_m) != (first.depth.dtype, first.depth_unit_m):
            raise InputError(
                f"{who}: expected {first.depth.dtype} depth in units of {first.depth_unit_m:g} m as in the "
                f"first frame, got {frame.depth.dtype} of {frame.depth_unit_m:g} m"
            )
        if frame.T_map_camera is None:
            return
        if frame.tags.get("scene") != first.tags.get("scene"):
            raise InputError(
                f"{who} is of scene '{frame.tags.get('scene')}', the recording of scene "
                f"'{first.tags.get('scene')}': each scene has a world of its own; record them one by one"
            )
        if "/tf_static" in self._channels:
            raise InputError(f"{who} has a pose, the first has none and a mount: unset mount.height_m")


@dataclass(slots=True)
class _Channel:
    """A topic of the file, and what was written of it."""

    number: int
    topic: str
    kind: str
    digest: str
    qos: str
    messages: int = 0
    first_ns: int = 2**63 - 1
    last_ns: int = 0

    def count(self, stamp_ns: int) -> None:
        self.messages += 1
        self.first_ns, self.last_ns = min(self.first_ns, stamp_ns), max(self.last_ns, stamp_ns)


def bag_metadata(name: str, channels: Iterable[_Channel]) -> str:
    """What metadata.yaml of a ROS 2 bag says (version 8, read from Iron on), for a bag of one file."""
    import yaml

    channels = list(channels)
    start_ns = min((c.first_ns for c in channels), default=0)
    facts: dict[str, Any] = {
        "starting_time": {"nanoseconds_since_epoch": start_ns},
        "duration": {"nanoseconds": max((c.last_ns for c in channels), default=start_ns) - start_ns},
        "message_count": sum(c.messages for c in channels),
    }
    topics = [
        {
            "topic_metadata": {
                "name": c.topic,
                "type": c.kind,
                "serialization_format": "cdr",
                "offered_qos_profiles": c.qos,
                "type_description_hash": c.digest,
            },
            "message_count": c.messages,
        }
        for c in channels
    ]
    whole = {
        "version": 8,
        "storage_identifier": "mcap",
        "relative_file_paths": [name],
        **facts,
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "files": [{"path": name, **facts}],
        "custom_data": None,
        "ros_distro": "swardmap",
    }
    return str(yaml.safe_dump(whole, sort_keys=False))


def _short(camera: Intrinsics) -> str:
    return f"{camera.width}x{camera.height} with focal length {camera.fx:g}"


def _refuse(path: Path, overwrite: bool) -> None:
    if path.suffix != ".mcap":
        raise OutputError(f"expected a name that ends in .mcap, got {path}")
    if path.is_dir():
        raise OutputError(f"expected a file to write, but {path} is a folder")
    if path.exists() and not overwrite:
        raise OutputError(f"{path} exists: choose another name, or pass --overwrite")


def _publish(written: Path, path: Path) -> None:
    """What is on the disk gets its name."""
    written.replace(path)
    with suppress(OSError):
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


@contextmanager
def _one_error(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error
