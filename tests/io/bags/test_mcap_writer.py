"""Recordings in MCAP: our own reader gives back every frame, and the format's own library reads the file."""

import errno
import json
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

from swardmap.config import SourceConfig
from swardmap.errors import InputError, OutputError
from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.io import FrameSource, open_source
from swardmap.io.bags.mcap_writer import mcap_writer, record
from swardmap.io.bags.record_messages import CAMERA_FRAME, COLOR, DEPTH, LABELS, RecordOptions
from swardmap.io.bags.rosbag import REASON_POSE
from swardmap.io.sources.limited import LimitedSource
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.types import Frame
from tests.io.contract import check_source

SMALL = Intrinsics(64, 48, 46.25, 46.5, 31.3, 23.7)
START_NS = 1_700_000_000_123_456_789


def frames(count: int = 4, **changes: Any) -> list[Frame]:
    """Noise, so that nothing but the same bytes is equal; poses of a lane; labels."""
    garden = AnalyticSource(garden_scene(0), tuple(lane_poses(count, step_m=0.4)), SMALL)
    rng = np.random.default_rng(1)
    return [
        replace(
            frame,
            **{
                "stamp_ns": START_NS + 33_333_333 * i,
                "rgb": rng.integers(0, 255, (48, 64, 3), dtype=np.uint8),
                "depth": rng.integers(0, 65535, (48, 64)).astype(np.uint16),
                "depth_unit_m": 0.001,
                **changes,
            },
        )
        for i, frame in enumerate(garden)
    ]


class Source:
    """A list of frames as a source."""

    name, label_set, skipped = "list", None, {"a reason": 2}

    def __init__(self, items: list[Frame]) -> None:
        self._items, self.frame_count = items, len(items)

    def __iter__(self) -> Iterator[Frame]:
        return iter(self._items)


def recorded(folder: Path, items: list[Frame], options: RecordOptions | None = None) -> Path:
    path = folder / "drive.mcap"
    assert record(Source(items), path, options) == len(items)
    return path


def read(path: Path, **config: Any) -> list[Frame]:
    return check_source(lambda: open_source(path, SourceConfig(**config)))


@pytest.mark.parametrize("color", ["png", "raw"])
@pytest.mark.parametrize("depth", ["png", "raw"])
def test_what_is_written_is_read_back(tmp_path: Path, color: str, depth: str) -> None:
    given = frames()
    found = read(recorded(tmp_path, given, RecordOptions(color, depth)))
    assert len(found) == len(given)
    for one, two in zip(found, given, strict=True):
        assert (one.stamp_ns, one.intrinsics, one.depth_unit_m) == (
            two.stamp_ns,
            two.intrinsics,
            two.depth_unit_m,
        )
        np.testing.assert_array_equal(one.rgb, two.rgb)
        np.testing.assert_array_equal(one.depth, two.depth)
        assert one.T_map_camera is not None
        assert two.T_map_camera is not None
        assert one.T_map_camera.parent == "map"
        np.testing.assert_allclose(one.T_map_camera.matrix, two.T_map_camera.matrix, atol=1e-12)


def test_jpeg_is_near_and_smaller(tmp_path: Path) -> None:
    smooth = np.broadcast_to(np.arange(64, dtype=np.uint8)[None, :, None] * 3, (48, 64, 3)).copy()
    given = frames(rgb=smooth)
    path = recorded(tmp_path, given, RecordOptions("jpeg"))
    for one in read(path):
        assert np.abs(one.rgb.astype(int) - smooth).max() <= 6


def test_another_unit_is_stored_in_metres_without_rounding(tmp_path: Path) -> None:
    given = frames(depth_unit_m=0.0001)
    for one, two in zip(read(recorded(tmp_path, given)), given, strict=True):
        assert one.depth.dtype == np.float32
        np.testing.assert_array_equal(one.depth_m, two.depth_m)
    with pytest.raises(InputError, match="a PNG would round it"):
        record(Source(given), tmp_path / "other.mcap", RecordOptions(depth="png"))
    assert [p.name for p in tmp_path.iterdir()] == ["drive.mcap"]


def test_float_depth_is_kept(tmp_path: Path) -> None:
    metres = np.linspace(0.1, 9, 48 * 64, dtype=np.float32).reshape(48, 64)
    metres[0, :3] = [np.nan, 0, np.inf]
    for one in read(recorded(tmp_path, frames(depth=metres))):
        np.testing.assert_array_equal(one.depth, metres)


def test_frames_without_a_pose(tmp_path: Path) -> None:
    mount = RecordOptions(T_base_camera=mount_pose(0.9, 20.0))
    found = read(recorded(tmp_path, frames(T_map_camera=None), mount))
    assert len(found) == 4
    assert all(frame.T_map_camera is None for frame in found)


def test_a_frame_without_a_pose_among_others_is_told(tmp_path: Path) -> None:
    given = frames()
    given[-1] = replace(given[-1], T_map_camera=None)
    source = open_source(recorded(tmp_path, given))
    assert len(list(source)) == 3
    assert source.skipped == {REASON_POSE: 1}


def test_another_name_of_the_map_is_read_as_map(tmp_path: Path) -> None:
    given = [
        replace(f, T_map_camera=Pose("world", "camera", f.T_map_camera.matrix))
        for f in frames()
        if f.T_map_camera is not None
    ]
    assert [f.T_map_camera.parent for f in read(recorded(tmp_path, given)) if f.T_map_camera] == ["map"] * 4


def test_the_formats_own_library_reads_it(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap.stream_reader import StreamReader

    path, store = recorded(tmp_path, frames(80), RecordOptions("png")), get_typestore(Stores.ROS2_JAZZY)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)  # of chunks and of the summary
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        kinds = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
        messages = list(reader.iter_messages())
    assert kinds == {
        "/tf": "tf2_msgs/msg/TFMessage",
        f"{COLOR}/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
        f"{COLOR}/camera_info": "sensor_msgs/msg/CameraInfo",
        f"{DEPTH}/image_raw": "sensor_msgs/msg/Image",
        f"{DEPTH}/camera_info": "sensor_msgs/msg/CameraInfo",
        f"{LABELS}/image_raw": "sensor_msgs/msg/Image",
        f"{LABELS}/classes": "std_msgs/msg/String",
    }
    assert summary.statistics.message_count == len(messages) == 80 * 6 + 1
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 1  # it is written as it comes
    assert {c.compression for c in summary.chunk_indexes} == {"zstd"}
    for schema, channel, message in messages:
        assert schema is not None
        assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg")
        assert message.log_time == message.publish_time
        # the bytes are what ROS 2 would write of the message that they hold
        decoded: Any = store.deserialize_cdr(message.data, schema.name)
        assert store.serialize_cdr(decoded, schema.name) == message.data
        if schema.name != "std_msgs/msg/String":
            header = decoded.transforms[0].header if schema.name.endswith("TFMessage") else decoded.header
            assert header.stamp.sec * 10**9 + header.stamp.nanosec == message.log_time
    with path.open("rb") as file:  # from beginning to end, without its index
        records: list[Any] = list(StreamReader(file, validate_crcs=True).records)
    names = [type(record).__name__ for record in records]
    assert names[-1] == "Footer"
    assert records[-1].summary_crc != 0
    assert records[names.index("DataEnd")].data_section_crc != 0
    with path.open("rb") as file:
        whole: list[Any] = list(StreamReader(file, emit_chunks=True).records)
    assert all(record.uncompressed_crc for record in whole if type(record).__name__ == "Chunk")


def test_what_others_find_in_it(tmp_path: Path) -> None:
    from mcap.reader import make_reader

    given = frames()
    store, first = get_typestore(Stores.ROS2_JAZZY), given[0]
    path = recorded(tmp_path, given)
    found: dict[str, Any] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            found.setdefault(channel.topic, store.deserialize_cdr(message.data, schema.name))
    image, depth, info = (
        found[f"{COLOR}/image_raw"],
        found[f"{DEPTH}/image_raw"],
        found[f"{DEPTH}/camera_info"],
    )
    assert (image.encoding, image.step, image.header.frame_id) == ("rgb8", 64 * 3, CAMERA_FRAME)
    assert (depth.encoding, depth.is_bigendian, depth.height, depth.width) == ("16UC1", 0, 48, 64)
    np.testing.assert_array_equal(np.frombuffer(depth.data, "<u2").reshape(48, 64), first.depth)
    np.testing.assert_array_equal(info.k.reshape(3, 3), SMALL.matrix)
    transform = found["/tf"].transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", CAMERA_FRAME)
    assert first.T_map_camera is not None
    assert transform.transform.translation.z == pytest.approx(first.T_map_camera.position_m[2])
    labels = found[f"{LABELS}/image_raw"]
    assert labels.encoding == "mono8"
    assert first.labels is not None
    np.testing.assert_array_equal(labels.data.reshape(48, 64), first.labels)
    classes = json.loads(found[f"{LABELS}/classes"].data)
    assert {(c["id"], c["name"], c["role"]) for c in classes} >= {(1, "grass", "free")}


def test_what_is_sent_once_is_latched(tmp_path: Path) -> None:
    from mcap.reader import make_reader

    path = recorded(tmp_path, frames(T_map_camera=None), RecordOptions(T_base_camera=mount_pose(0.9, 20.0)))
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        metadata = list(make_reader(file).iter_metadata())
    assert summary is not None
    static = next(c for c in summary.channels.values() if c.topic == "/tf_static")
    assert "durability: 1" in static.metadata["offered_qos_profiles"]  # transient local
    assert "relative_file_paths:\n- drive.mcap\n" in metadata[0].metadata["serialized_metadata"]


@pytest.mark.parametrize(
    ("change", "match"),
    [({"stamp_ns": START_NS}, "expected a time"),
     ({"stamp_ns": -5}, "expected a time"),
     ({"stamp_ns": 2**63}, "below 2.31 seconds"),
     ({"intrinsics": replace(SMALL, fx=50.0)}, "one recording is of one camera"),
     ({"depth_unit_m": 0.0001}, "as in the first frame"),
     ({"depth": np.ones((48, 64), np.float32)}, "as in the first frame"),
     ({"tags": {"scene": "another"}}, "a world of its own")],
)  # fmt: skip
def test_frames_that_do_not_go_together_leave_no_file(
    tmp_path: Path, change: dict[str, Any], match: str
) -> None:
    given = frames()
    given[2] = replace(given[2], **change)
    with pytest.raises(InputError, match=match):
        record(Source(given), tmp_path / "drive.mcap")
    assert list(tmp_path.iterdir()) == []


def test_a_pose_after_a_mount_is_refused(tmp_path: Path) -> None:
    given = frames()
    given[0] = replace(given[0], T_map_camera=None)
    with pytest.raises(InputError, match=r"unset mount\.height_m"):
        record(Source(given), tmp_path / "a.mcap", RecordOptions(T_base_camera=mount_pose(0.9, 20.0)))


def test_nothing_to_record(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gave no frame to record .left out: 2 x a reason."):
        record(Source([]), tmp_path / "drive.mcap")
    assert list(tmp_path.iterdir()) == []


def test_names_that_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"ends in \.mcap"):
        record(Source(frames()), tmp_path / "drive.bag")
    (tmp_path / "folder.mcap").mkdir()
    with pytest.raises(OutputError, match="is a folder"):
        record(Source(frames()), tmp_path / "folder.mcap", overwrite=True)
    with pytest.raises(OutputError, match="cannot write /proc/nowhere"):
        record(Source(frames()), "/proc/nowhere/drive.mcap")
    with pytest.raises(OutputError, match="one of raw, png, jpeg, got 'gif'"):
        RecordOptions("gif")


def test_an_earlier_file_is_replaced_only_when_asked_and_only_by_a_whole_one(tmp_path: Path) -> None:
    path = recorded(tmp_path, frames(2))
    before = path.read_bytes()
    with pytest.raises(OutputError, match="--overwrite"):
        record(Source(frames()), path)
    bad = frames()
    bad[3] = replace(bad[3], stamp_ns=0)
    with pytest.raises(InputError):
        record(Source(bad), path, overwrite=True)
    assert path.read_bytes() == before
    record(Source(frames()), path, overwrite=True)
    assert len(read(path)) == 4
    assert [p.name for p in tmp_path.iterdir()] == ["drive.mcap"]


@pytest.mark.parametrize("where", ["add_message", "finish"])
def test_a_full_disk_is_one_error_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Writer, where, full)
    with pytest.raises(OutputError, match=r"cannot write .*drive\.mcap: No space left on device"):
        record(Source(frames(80)), tmp_path / "drive.mcap")
    assert list(tmp_path.iterdir()) == []


def test_an_error_of_the_source_is_its_own(tmp_path: Path) -> None:
    class Broken(Source):
        def __iter__(self) -> Iterator[Frame]:
            yield self._items[0]
            raise OSError(errno.EIO, "Input/output error")

    with pytest.raises(InputError, match="cannot read list: Input/output error"):  # not as the recording's
        record(Broken(frames()), tmp_path / "drive.mcap")
    assert list(tmp_path.iterdir()) == []


def test_memory_does_not_grow_with_the_length(tmp_path: Path) -> None:
    given = frames(1)[0]
    with mcap_writer(tmp_path / "long.mcap") as writer:
        writer.write(replace(given, stamp_ns=given.stamp_ns - 1))
        pending = 0
        tracemalloc.start()
        for i in range(400):
            writer.write(replace(given, stamp_ns=given.stamp_ns + i))
            pending = max(pending, tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert writer.frames * given.depth.nbytes > 2 * 2**20
    assert pending < 2 * 2**20


def test_a_part_of_a_source() -> None:
    source: FrameSource = Source(frames(10))
    assert len(list(LimitedSource(source, frames=3))) == 3
    assert LimitedSource(source, frames=3).frame_count == 3
    assert LimitedSource(source, frames=30).frame_count == 10
    assert list(LimitedSource(source, frames=0)) == []
    # 33.333333 ms apart: 0, 33.3 and 66.7 are less than 100 ms after the first
    assert len(list(LimitedSource(source, duration_s=0.09))) == 3
    stopped = LimitedSource(source)
    found = []
    for frame in stopped:
        found.append(frame)
        if len(found) == 2:
            stopped.stop()
    assert len(found) == 2
    assert LimitedSource(source).skipped == {"a reason": 2}


def flipped(content: bytes, bit: int) -> bytes:
    out = bytearray(content)
    out[bit // 8] ^= 1 << bit % 8
    return bytes(out)


def outcome(path: Path) -> list[tuple[Any, ...]] | None:
    """All that the frames of a file say; None if it is refused, or an image is left out and counted."""
    try:
        source = open_source(path)
        found = list(source)
    except InputError:
        return None
    told = [
        (f.stamp_ns, f.name, f.intrinsics, f.rgb.tobytes(), f.depth.tobytes(), f.depth_unit_m,
         None if f.T_map_camera is None else f.T_map_camera.matrix.tobytes())
        for f in found
    ]  # fmt: skip
    return None if source.skipped else told


def small_file(folder: Path) -> Path:
    tiny = Intrinsics(8, 6, 5.0, 5.0, 3.5, 2.5)
    rgb, depth = np.arange(144, dtype=np.uint8).reshape(6, 8, 3), np.full((6, 8), 900, np.uint16)
    given = [
        replace(f, intrinsics=tiny, rgb=rgb, depth=depth, labels=None, label_set=None) for f in frames(2)
    ]
    return recorded(folder, given)


def bits_to_flip(size: int, count: int) -> list[int]:
    edges = [*range(8 * 60), *range(8 * (size - 37), 8 * size)]  # head, and the footer that leads to all
    return [*edges, *map(int, np.random.default_rng(0).integers(0, 8 * size, count))]


def check_flips(path: Path, bits: list[int]) -> None:
    content, expected = path.read_bytes(), outcome(path)
    assert expected is not None
    damaged = path.with_name("damaged.mcap")
    differing = []
    for bit in bits:
        damaged.write_bytes(flipped(content, bit))
        found = outcome(damaged)
        if found is not None and found != expected:
            differing.append(bit)
    assert differing == []


def test_no_flipped_bit_gives_other_data(tmp_path: Path) -> None:
    path = small_file(tmp_path)
    check_flips(path, bits_to_flip(path.stat().st_size, 150)[::4])


@pytest.mark.slow
def test_no_flipped_bit_anywhere_gives_other_data(tmp_path: Path) -> None:
    path = small_file(tmp_path)
    size = path.stat().st_size
    places = np.arange(0, size, 6)
    one_of_each = 8 * places + np.random.default_rng(1).integers(0, 8, len(places))
    check_flips(path, [*bits_to_flip(size, 0), *map(int, one_of_each)])


@pytest.mark.parametrize("chunked", [True, False])
def test_checksums_of_other_writers_are_checked(tmp_path: Path, chunked: bool) -> None:
    from mcap.reader import make_reader

    path, plain = small_file(tmp_path), tmp_path / "plain.mcap"
    with path.open("rb") as given, plain.open("wb") as out:
        writer: Any = Writer(out, use_chunking=chunked, enable_data_crcs=True)
        writer.start("ros2", "test")
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(given).iter_messages():
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    content = plain.read_bytes()
    assert outcome(plain) == outcome(path)
    at = content.index(bytes(range(100, 140))) if not chunked else len(content) // 3
    check_flips(plain, [8 * at + k for k in range(8)])


def test_labels_come_back_with_their_classes(tmp_path: Path) -> None:
    given = frames()
    source = open_source(recorded(tmp_path, given))
    assert source.label_set == given[0].label_set
    for one, two in zip(source, given, strict=True):
        assert one.label_set == two.label_set
        assert one.labels is not None
        assert two.labels is not None
        np.testing.assert_array_equal(one.labels, two.labels)
    part = open_source(tmp_path / "drive.mcap", SourceConfig(start=1, every=2))
    second = next(iter(part)).labels
    assert second is not None
    np.testing.assert_array_equal(second, given[1].labels)


@pytest.mark.parametrize(
    "text", ["", "{", "[1]", '[{"id": 1}]', '[{"id": 1, "name": "a", "role": "x", "color": [1, 2, 3]}]']
)
def test_classes_that_are_none_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.setattr("swardmap.io.bags.record_messages.json.dumps", lambda _: text)
    path = recorded(tmp_path, frames(2))
    with pytest.raises(InputError, match=r"labels/classes: expected classes in JSON"):
        open_source(path)
