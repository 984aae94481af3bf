"""Recordings that hold more than they say: one error, and neither memory nor disk for it."""

import struct
from collections import namedtuple
from pathlib import Path

import pytest
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode

from swardmap.errors import InputError
from swardmap.io.bags import bounded_chunks, storage
from swardmap.io.bags.reader import open_bag
from swardmap.io.unpacking import zstd
from tests import bags
from tests.io.bags.test_recorded_files import packed_bag, storage_file
from tests.io.memory import memory_below

LARGE = 2**27
LZ4_MAGIC = b"\x04\x22\x4d\x18"


def mcap_of(path: Path, message: bytes, compression: CompressionType) -> Path:
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression, chunk_size=2**28)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/words", "cdr", schema)
        writer.add_message(channel, 1, message, 1)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def read(path: Path) -> int:
    """Bytes in the topic /words."""
    with open_bag(path) as bag:
        return sum(len(data) for _, _, data in bag.messages(["/words"]))


def lying(content: bytes) -> bytes:
    """The chunk said to hold 5000 bytes, in its record and in the index; no checksum of the summary."""
    sizes = (struct.pack("<Q", n) for n in range(LARGE, LARGE + 400))
    size = next(word for word in sizes if content.count(word) >= 2)
    at = content.find(size)
    while at >= 0:
        if content[at - 6 : at - 2] != LZ4_MAGIC:  # whose own head has a checksum
            content = content[:at] + struct.pack("<Q", 5000) + content[at + 8 :]
        at = content.find(size, at + 1)
    return content[:-12] + bytes(4) + content[-8:]


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_chunk_that_says_it_is_small(tmp_path: Path, compression: CompressionType) -> None:
    path = mcap_of(tmp_path / "a.mcap", bytes(LARGE), compression)
    assert read(path) == LARGE
    path.write_bytes(lying(path.read_bytes()))
    with pytest.raises(InputError, match="unpacks to more than the 5000 bytes"), memory_below(LARGE // 8):
        read(path)


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_chunks_of_ros_1_have_a_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: str
) -> None:
    path, store = tmp_path / "a.bag", bags.typestore("ros1")
    writer = Writer1(path)
    writer.set_compression(Writer1.CompressionFormat[compression])
    with writer:
        words = writer.add_connection("/words", "std_msgs/msg/String", typestore=store)
        writer.write(words, 1, bytes(LARGE))
    assert read(path) == LARGE
    monkeypatch.setattr(bounded_chunks, "MAX_UNPACKED_BYTES", 2**20)
    with pytest.raises(InputError, match="unpacks to more than the 1048576 bytes"), memory_below(LARGE // 8):
        read(path)


def test_messages_that_are_packed_have_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    packed = zstd().compress(bytes(LARGE))
    assert storage.unpacked_message(packed) == bytes(LARGE)
    monkeypatch.setattr(storage, "MAX_MESSAGE_BYTES", 2**20)
    with pytest.raises(ValueError, match="unpacks to more than the 1048576 bytes"), memory_below(LARGE // 8):
        storage.unpacked_message(packed)


def test_a_packed_file_does_not_fill_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = storage_file(packed_bag(tmp_path, "mcap", CompressionMode.FILE))
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda folder: usage(10**6, 9 * 10**5, 10**5))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    with pytest.raises(InputError, match=r"unpacks to more than 90000 bytes.*TMPDIR"), open_bag(file):
        pass
    assert not list(tmp_path.glob("swardmap-*"))
