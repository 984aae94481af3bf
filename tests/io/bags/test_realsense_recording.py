"""What librealsense itself writes: the layout imitated, real files, and its own playback as the judge."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.bags import ros_fields as rf
from swardmap.io.bags.reader import appended_bytes
from swardmap.io.bags.rosbag import open_source
from swardmap.perception.align import align_depth_to_color
from swardmap.perception.cloud import consistent_depth
from tests import bags
from tests.bags import INFO, Event

TRANSFORM = "geometry_msgs/msg/Transform"
CAMERA = Intrinsics(24, 18, 20.0, 20.5, 11.3, 8.9)
TURN = Rotation.from_euler("xyz", [2, -3, 1], degrees=True)
PLACE = [0.015, 0.001, -0.002]
RGB = np.random.default_rng(0).integers(0, 255, (18, 24, 3), dtype=np.uint8)
RAW = np.random.default_rng(1).integers(5000, 5400, (18, 24)).astype(np.uint16)
RAW[4:7, 9] = 9000


def place(turn: Rotation, translation: list[float]) -> rf.Fields:
    return {
        "translation": dict(zip("xyz", translation, strict=True)),
        "rotation": dict(zip("xyzw", turn.as_quat().tolist(), strict=True)),
    }


def sdk_events(behind: bytes = struct.pack("<f", 0.00025), with_places: bool = True) -> Iterator[Event]:
    """As librealsense 2.55 writes a .bag: all frame ids alike, mono16, four bytes behind each image."""
    store = bags.typestore("ros1")
    streams: tuple[tuple[str, Any, str, rf.Fields], ...] = (
        ("/device_0/sensor_0/Depth_0", RAW, "mono16", place(Rotation.identity(), [0.0, 0.0, 0.0])),
        ("/device_0/sensor_1/Color_0", RGB, "rgb8", place(TURN, PLACE)),
    )
    for prefix, _, _, where in streams:
        info = rf.camera_info_fields(CAMERA, 0, "")
        yield (
            1,
            f"{prefix}/info/camera_info",
            INFO,
            {**info, "distortion_model": "Brown Conrady", "p": np.zeros(12)},
        )
        if with_places:
            yield 1, f"{prefix}/tf/1", TRANSFORM, where
    yield 1, "/device_0/sensor_0/option/Depth_Units/value", "std_msgs/msg/Float32", {"data": 0.00025}
    for i in range(3):
        for prefix, pixels, encoding, _ in streams:
            fields = {**rf.image_fields(pixels, (1000 + 33 * i) * 1_000_000, "1"), "encoding": encoding}
            image = bags.serialized(store, "ros1", bags.IMAGE, fields)
            tail = behind if encoding == "mono16" or len(behind) != 4 else bytes(4)
            yield 1000 + i, f"{prefix}/image/data", bags.IMAGE, image + tail


def test_a_bag_of_the_sdk(tmp_path: Path) -> None:
    source = open_source(bags.write_bag(tmp_path, "ros1", sdk_events()), SourceConfig())
    frames = list(source)
    assert [f.stamp_ns for f in frames] == [1_000_000_000, 1_033_000_000, 1_066_000_000]
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = TURN.as_matrix(), PLACE
    # the cameras do not coincide, though both images carry the same frame id
    kept = np.isfinite(consistent_depth(RAW * np.float32(0.00025), 3, 0.03, 0.02))
    T = Pose("color", "depth", matrix)
    aligned = align_depth_to_color(np.where(kept, RAW, 0).astype(np.uint16), 0.00025, CAMERA, CAMERA, T)
    for frame in frames:
        np.testing.assert_array_equal(frame.rgb, RGB)
        np.testing.assert_array_equal(frame.depth, aligned)
        assert frame.depth_unit_m == 0.00025
        assert frame.T_map_camera is None
    assert source.skipped == {}


def test_the_unit_may_be_set(tmp_path: Path) -> None:
    bag = bags.write_bag(tmp_path, "ros1", sdk_events())
    assert next(iter(open_source(bag, SourceConfig(depth_unit_m=0.002)))).depth_unit_m == 0.002


def test_without_bytes_behind_the_sensor_option_tells_the_unit(tmp_path: Path) -> None:
    bag = bags.write_bag(tmp_path, "ros1", sdk_events(behind=b""))
    assert next(iter(open_source(bag, SourceConfig()))).depth_unit_m == 0.00025


@pytest.mark.parametrize("behind", [b"x", b"xxx", b"xxxxx", b"x" * 8])
def test_no_other_number_of_bytes_is_tolerated(tmp_path: Path, behind: bytes) -> None:
    with pytest.raises(InputError, match="size mismatch"):
        open_source(bags.write_bag(tmp_path, "ros1", sdk_events(behind)), SourceConfig())


def test_without_places_depth_cannot_be_aligned(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be aligned"):
        open_source(bags.write_bag(tmp_path, "ros1", sdk_events(with_places=False)), SourceConfig())


def test_appended_bytes_of_anything() -> None:
    store = bags.typestore("ros1")
    whole = bags.serialized(store, "ros1", bags.IMAGE, rf.image_fields(RGB, 0, "1"))
    assert appended_bytes(whole) == b""
    assert appended_bytes(whole + b"abcd") == b"abcd"
    assert appended_bytes(whole + b"abc") == b""
    for length in range(60):
        assert appended_bytes(whole[:length]) == b""


RECORDINGS = ("sw_device_2.55.1.bag", "sw_device_2.59.1.db3")


def recording(data_dir: Path, name: str) -> Path:
    path = data_dir / "bags" / "librealsense_written" / name
    if not path.is_file():
        pytest.skip(f"no {name} among the optional recordings")
    return path


@pytest.mark.parametrize("name", RECORDINGS)
def test_real_recordings(data_dir: Path, name: str) -> None:
    source = open_source(recording(data_dir, name), SourceConfig())
    frames = list(source)
    assert len(frames) == 10
    assert source.skipped == {}
    for i, frame in enumerate(frames):
        assert (frame.rgb == (30, 140, 40)).all()
        assert set(np.unique(frame.depth)) == {0, 1000 + 10 * i}
        seen = np.flatnonzero(frame.depth[240])
        baseline_px = 615 * 0.015 / (1 + 0.01 * i)
        assert seen[0] == pytest.approx(baseline_px, abs=1)
        assert frame.depth_unit_m == 0.001


@pytest.mark.parametrize("name", RECORDINGS)
def test_playback_of_the_sdk_gives_the_same_images(data_dir: Path, name: str) -> None:
    rs = pytest.importorskip(
        "pyrealsense2", reason="compares with the camera maker's playback", exc_type=ImportError
    )
    path = recording(data_dir, name)
    device = rs.context().load_device(str(path))
    rs.playback(device).set_real_time(False)
    queue = rs.frame_queue(50)
    profiles = {}
    for sensor in device.query_sensors():
        for profile in sensor.get_stream_profiles():
            profiles[profile.stream_type()] = profile
        sensor.open(sensor.get_stream_profiles())
    for sensor in device.query_sensors():
        sensor.start(queue)
    played: dict[Any, dict[int, Any]] = {rs.stream.color: {}, rs.stream.depth: {}}
    while min(map(len, played.values())) < 10:
        came, frame = queue.try_wait_for_frame(1000)
        if not came:
            break  # playback loses a frame at its start now and then
        image = np.asanyarray(frame.get_data()).copy()
        played[frame.get_profile().stream_type()][frame.get_frame_number()] = image
    extrinsics = profiles[rs.stream.depth].get_extrinsics_to(profiles[rs.stream.color])
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(extrinsics.rotation, (3, 3)).T  # column by column
    matrix[:3, 3] = extrinsics.translation
    frames = list(open_source(path, SourceConfig()))
    assert min(map(len, played.values())) >= 8
    for number, color in played[rs.stream.color].items():
        np.testing.assert_array_equal(frames[number - 1].rgb, color)
    T = Pose("color", "depth", matrix)
    for number, depth in played[rs.stream.depth].items():
        ours = frames[number - 1]
        expected = align_depth_to_color(depth, 0.001, ours.intrinsics, ours.intrinsics, T)
        np.testing.assert_array_equal(ours.depth, expected)
