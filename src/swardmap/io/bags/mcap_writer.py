"""Frames to an MCAP file that `ros2 bag`, Foxglove and our own reader take.

`record_messages` says what is in it. The writer is that of `rosbags`: chunks of 1 MB in zstd, so that memory
does not grow with the length. A file has its name only when it is whole.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from swardmap.errors import InputError, OutputError
from swardmap.geometry import Intrinsics
from swardmap.io import FrameSource
from swardmap.io.bags.record_messages import Message, RecordOptions, frame_messages, latched_messages
from swardmap.io.bags.ros_fields import rosbags_message
from swardmap.io.door import frames_of
from swardmap.io.staging import staged_folder, sweep
from swardmap.types import Frame


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
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    path = Path(path)
    sweep(path)
    _refuse(path, overwrite)
    with ExitStack() as stack:
        with _one_error(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            staging = stack.enter_context(staged_folder(path))
            # metadata of version 8 is read by ROS 2 from Iron on
            bag = Writer(staging / path.stem, version=8, storage_plugin=StoragePlugin.MCAP)
            bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            bag.open()
        try:
            yield McapWriter(path, bag, options or RecordOptions())
            with _one_error(path):
                bag.close()
                _publish(staging / path.stem / f"{path.stem}.mcap", path)
        except BaseException:
            with suppress(Exception):
                bag.abort()
            raise


class McapWriter:
    """Writes frames into an open bag; use `mcap_writer`.

    Attributes:
        frames: written so far.
    """

    def __init__(self, path: Path, bag: Any, options: RecordOptions) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._path, self._bag, self._options = path, bag, options
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Any] = {}
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

    def _put(self, message: Message, stamp_ns: int, latched: bool = False) -> None:
        topic, kind, fields = message
        data = self._store.serialize_cdr(rosbags_message(self._store, kind, fields), kind)
        with _one_error(self._path):
            if topic not in self._connections:
                self._connections[topic] = self._bag.add_connection(
                    topic, kind, typestore=self._store, offered_qos_profiles=[_latched()] if latched else []
                )
            self._bag.write(self._connections[topic], stamp_ns, data)

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
        if "/tf_static" in self._connections:
            raise InputError(f"{who} has a pose, the first has none and a mount: unset mount.height_m")


def _latched() -> Any:
    """What `ros2 bag play` needs to know to give a late listener what was sent once."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    never = QosTime(9223372036, 854775807)
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        never,
        never,
        QosLiveliness.AUTOMATIC,
        never,
        False,
    )


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
    """On the disk first, then under its name."""
    with written.open("rb") as file:
        os.fsync(file.fileno())
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
