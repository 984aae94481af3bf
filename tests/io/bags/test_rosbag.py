"""Frames out of bags that the test writes, in every format, compared to what was put in."""

import os
import re
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from swardmap.config import SourceConfig
from swardmap.errors import InputError, SwardmapError
from swardmap.geometry import R_BODY_OPTICAL, Intrinsics, Pose
from swardmap.io import FrameSource
from swardmap.io import open_source as open_any
from swardmap.io.bags import ros_fields as rf
from swardmap.io.bags.rosbag import REASON_DAMAGED, REASON_POSE, REASON_TRANSFORM, open_source, recognises
from swardmap.perception.align import align_depth_to_color
from tests import bags
from tests.bags import COMPRESSED, IMAGE, INFO, KINDS, ODOMETRY, TF, Event, Kind
from tests.io.contract import check_source

MS = 1_000_000
START_NS = 1_700_000_000_000_000_000
CAMERA = Intrinsics(24, 18, 20.0, 20.5, 11.3, 8.9)
COLOR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
OPTICAL = "camera_color_optical_frame"


def rgb_of(i: int) -> Any:
    return np.random.default_rng(i).integers(0, 255, (CAMERA.height, CAMERA.width, 3), dtype=np.uint8)


def depth_of(i: int) -> Any:
    return np.random.default_rng(100 + i).integers(0, 5000, (CAMERA.height, CAMERA.width)).astype(np.uint16)


def pose(parent: str, child: str, yaw_deg: float, place: tuple[float, float, float]) -> Pose:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix()
    matrix[:3, 3] = place
    return Pose(parent, child, matrix)


def mount() -> Pose:
    matrix = np.eye(4)
    matrix[:3, :3] = R_BODY_OPTICAL
    matrix[:3, 3] = [0.2, 0.0, 0.7]
    return Pose("base_link", OPTICAL, matrix)


def T_odom_base(t_ns: int) -> Pose:
    """Steady motion, so that interpolation between any two moments is the truth."""
    s = (t_ns - START_NS) / 1e9
    return pose("odom", "base_link", 40 * s, (0.5 * s, -0.1 * s, 0.0))


def T_map_odom(t_ns: int) -> Pose:
    s = (t_ns - START_NS) / 1e9
    return pose("map", "odom", 90 - 3 * s, (2 + 0.01 * s, 3.0, 0.0))


def images(count: int, color_form: str = "raw", depth_form: str = "16UC1") -> Iterator[Event]:
    for i in range(count):
        t = START_NS + i * 33 * MS + 7 * MS
        arrival = t + 5 * MS
        stamped = (t, OPTICAL)
        yield arrival, "/camera/color/camera_info", INFO, rf.camera_info_fields(CAMERA, *stamped)
        if color_form == "raw":
            yield arrival, COLOR, IMAGE, rf.image_fields(rgb_of(i), *stamped)
        else:
            fields = rf.compressed_image_fields(rgb_of(i), *stamped, form=color_form)
            yield arrival, f"{COLOR}/compressed", COMPRESSED, fields
        at_depth = (t + 2 * MS, OPTICAL)
        info = rf.camera_info_fields(CAMERA, *at_depth)
        yield arrival + MS, "/camera/aligned_depth_to_color/camera_info", INFO, info
        if depth_form == "16UC1":
            yield arrival + MS, DEPTH, IMAGE, rf.image_fields(depth_of(i), *at_depth)
        elif depth_form == "32FC1":
            metres = depth_of(i) / np.float32(1000)
            yield arrival + MS, DEPTH, IMAGE, rf.image_fields(metres, *at_depth)
        else:
            fields = rf.compressed_image_fields(depth_of(i), *at_depth)
            yield arrival + MS, f"{DEPTH}/compressedDepth", COMPRESSED, fields


def transforms(until_ms: int = 400) -> Iterator[Event]:
    yield START_NS, "/tf_static", TF, rf.tf_fields([mount()], START_NS)
    for ms in range(0, until_ms, 20):
        t = START_NS + ms * MS
        yield t + 15 * MS, "/tf", TF, rf.tf_fields([T_odom_base(t)], t)
        if ms % 80 == 0:
            yield t + 18 * MS, "/tf", TF, rf.tf_fields([T_map_odom(t)], t)


def odometry(until_ms: int = 400) -> Iterator[Event]:
    for ms in range(0, until_ms, 20):
        t = START_NS + ms * MS
        yield t + 3 * MS, "/odom", ODOMETRY, rf.odometry_fields(T_odom_base(t), t)


def in_order(*streams: Iterator[Event]) -> list[Event]:
    return sorted((event for stream in streams for event in stream), key=lambda event: event[0])


def read(path: Path, **settings_: Any) -> tuple[list[Any], Any]:
    source = open_source(path, SourceConfig(**settings_))
    assert isinstance(source, FrameSource)
    return list(source), source


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("color_form", "depth_form"), [("raw", "16UC1"), ("png", "compressedDepth"), ("raw", "32FC1")]
)
def test_frames_come_back_as_they_were_written(
    tmp_path: Path, kind: Kind, color_form: str, depth_form: str
) -> None:
    bag = bags.write_bag(tmp_path, kind, in_order(images(6, color_form, depth_form), transforms()))
    assert recognises(bag)
    frames, source = read(bag)
    assert len(frames) == 6
    assert source.skipped == {}
    for i, frame in enumerate(frames):
        t = START_NS + i * 33 * MS + 7 * MS
        assert frame.stamp_ns == t
        assert frame.intrinsics == CAMERA
        np.testing.assert_array_equal(frame.rgb, rgb_of(i))
        if depth_form == "32FC1":
            np.testing.assert_array_equal(frame.depth, depth_of(i) / np.float32(1000))
        else:
            np.testing.assert_array_equal(frame.depth, depth_of(i))
            assert frame.depth_unit_m == 0.001
        truth = T_map_odom(t) @ T_odom_base(t) @ mount()
        assert (frame.T_map_camera.parent, frame.T_map_camera.child) == ("map", OPTICAL)
        np.testing.assert_allclose(frame.T_map_camera.matrix, truth.matrix, atol=1e-9)
    again = [frame.stamp_ns for frame in source]  # from the beginning
    assert again == [frame.stamp_ns for frame in frames]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("settings_", [{}, {"start": 1, "stop": 9, "every": 3}])
def test_keeps_the_contract_of_sources(tmp_path: Path, kind: Kind, settings_: dict[str, Any]) -> None:
    lost = START_NS + (66 + 13) * MS  # a depth image, and the poses of the last images
    events = [e for e in in_order(images(9), transforms(230)) if not (e[0] == lost and e[1] == DEPTH)]
    bag = bags.write_bag(tmp_path, kind, events)
    frames = check_source(lambda: open_source(bag, SourceConfig(**settings_)))
    # map <- odom comes at 80 and 160 ms, so that later images have no pose
    assert [(f.stamp_ns - START_NS) // MS for f in frames] == ([40] if settings_ else [7, 40, 106, 139])


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_a_bare_file_needs_no_metadata(tmp_path: Path, kind: Kind) -> None:
    bag = bags.write_bag(tmp_path, kind, in_order(images(2), transforms()))
    file = bags.bare_file(bag)
    (bag / "metadata.yaml").unlink()
    assert recognises(file)
    assert recognises(bag)
    assert len(list(open_any(file, SourceConfig(format="rosbag")))) == 2
    assert len(read(bag)[0]) == 2


def test_jpeg_colors_are_near(tmp_path: Path) -> None:
    events = [
        (
            t,
            topic,
            name,
            rf.compressed_image_fields(
                np.full((18, 24, 3), (180, 40, 90), np.uint8), START_NS + 7 * MS, OPTICAL
            ),
        )
        if name == COMPRESSED
        else (t, topic, name, fields)
        for t, topic, name, fields in images(1, "jpeg")
    ]
    frames, _ = read(bags.write_bag(tmp_path, "mcap", events))
    assert np.abs(frames[0].rgb.astype(int) - (180, 40, 90)).max() <= 3


def test_start_stop_every(tmp_path: Path) -> None:
    bag = bags.write_bag(tmp_path, "mcap", in_order(images(9), transforms()))
    everything = [f.stamp_ns for f in read(bag)[0]]
    for start, stop, every in [(0, None, 2), (3, None, 1), (1, 8, 3), (20, None, 1), (0, 0, 1)]:
        frames, _ = read(bag, start=start, stop=stop, every=every)
        assert [f.stamp_ns for f in frames] == everything[start:stop:every]
    assert [f.name for f in read(bag, start=3, every=4)[0]] == ["000003", "000007"]


def test_without_tf_there_are_no_poses(tmp_path: Path) -> None:
    frames, _ = read(bags.write_bag(tmp_path, "mcap", images(2)))
    assert [f.T_map_camera for f in frames] == [None, None]


def test_a_frame_without_pose_is_left_out_and_counted(tmp_path: Path) -> None:
    # tf begins with the third image and ends before the last one
    late = [e for e in transforms(200) if e[1] == "/tf_static" or e[0] > START_NS + 75 * MS]
    frames, source = read(bags.write_bag(tmp_path, "mcap", in_order(images(8), iter(late))))
    used = [(f.stamp_ns - START_NS) // MS for f in frames]
    assert used == [106, 139]  # map <- odom comes at 80 and 160 ms
    assert source.skipped == {REASON_POSE: 6}


def test_a_gap_in_tf_is_not_interpolated_over(tmp_path: Path) -> None:
    events = in_order(images(6), transforms())
    holed = [e for e in events if not (e[1] == "/tf" and START_NS + 60 * MS < e[0] < START_NS + 330 * MS)]
    bag = bags.write_bag(tmp_path, "ros1", holed)
    frames, source = read(bag)
    assert source.skipped[REASON_POSE] > 0
    assert len(frames) + source.skipped[REASON_POSE] == 6
    assert len(read(bag, pose_tolerance_ms=500.0)[0]) == 6


def test_a_broken_transform_is_counted(tmp_path: Path) -> None:
    events = in_order(images(3), transforms())
    good = rf.tf_fields([T_odom_base(START_NS + 50 * MS)], START_NS + 50 * MS)
    bad = rf.tf_fields([T_odom_base(START_NS + 50 * MS)], START_NS + 50 * MS)
    bad["transforms"] += good["transforms"]
    bad["transforms"][0]["transform"]["rotation"]["w"] = float("nan")
    spoilt = in_order(iter(events), iter([(START_NS + 50 * MS, "/tf", TF, bad)]))
    frames, source = read(bags.write_bag(tmp_path, "mcap", spoilt))
    assert len(frames) == 3
    assert source.skipped == {REASON_TRANSFORM: 1}


def test_odometry_in_place_of_tf(tmp_path: Path) -> None:
    static = [e for e in transforms(20) if e[1] == "/tf_static"]
    bag = bags.write_bag(tmp_path, "ros1", in_order(images(4), iter(static), odometry()))
    for named in ({}, {"odometry_topic": "/odom"}):  # the only one is found by itself
        frames, _ = read(bag, **named)
        for frame in frames:
            truth = T_odom_base(frame.stamp_ns) @ mount()
            np.testing.assert_allclose(frame.T_map_camera.matrix, truth.matrix, atol=1e-9)
    with pytest.raises(InputError, match="topics with odometry: /odom"):
        read(bag, odometry_topic="/odometry")


def test_odometry_without_the_mount_is_refused(tmp_path: Path) -> None:
    bag = bags.write_bag(tmp_path, "mcap", in_order(images(2), odometry()))
    with pytest.raises(InputError, match=r"source\.camera_frame=base_link"):
        read(bag, odometry_topic="/odom")
    with pytest.raises(InputError, match=r"'base_link' looks up.*source\.camera_axes=body"):
        read(bag, odometry_topic="/odom", camera_frame="base_link")
    frames, _ = read(bag, odometry_topic="/odom", camera_frame="base_link", camera_axes="body")
    assert frames[0].T_map_camera.child == "base_link"
    np.testing.assert_allclose(
        frames[0].T_map_camera.matrix[:3, 2], T_odom_base(frames[0].stamp_ns).matrix[:3, 0]
    )
    assert read(bag)[0][0].T_map_camera is None  # not asked for, and nothing says where the camera sits


def test_frames_of_tf_by_name(tmp_path: Path) -> None:
    bag = bags.write_bag(tmp_path, "mcap", in_order(images(2), transforms()))
    frames, _ = read(bag, map_frame="odom")
    truth = T_odom_base(frames[0].stamp_ns) @ mount()
    np.testing.assert_allclose(frames[0].T_map_camera.matrix, truth.matrix, atol=1e-9)
    with pytest.raises(InputError, match=r"no frame 'earth' in tf; frames: base_link.*map, odom"):
        read(bag, map_frame="earth")
    with pytest.raises(InputError, match="not 'lens', the frame of the colour images"):
        read(bag, camera_frame="lens")


def two_cameras(with_place: bool = True, with_map: bool = False) -> Iterator[Event]:
    """Depth that is seen from beside the colour camera, and is smaller."""
    small = Intrinsics(16, 12, 14.0, 14.0, 7.5, 5.5)
    place = Pose(OPTICAL, "camera_depth_optical_frame", pose("a", "b", 2, (-0.05, 0.01, 0.0)).matrix)
    if with_place:
        yield START_NS, "/tf_static", TF, rf.tf_fields([place], START_NS)
    for i in range(2):
        t = START_NS + i * 33 * MS
        yield t, "/camera/color/image_raw", IMAGE, rf.image_fields(rgb_of(i), t, OPTICAL)
        yield t, "/camera/color/camera_info", INFO, rf.camera_info_fields(CAMERA, t, OPTICAL)
        depth = np.full((12, 16), 1500 + i, np.uint16)
        stamped = (t, "camera_depth_optical_frame")
        yield t, "/camera/depth/image_rect_raw", IMAGE, rf.image_fields(depth, *stamped)
        yield t, "/camera/depth/camera_info", INFO, rf.camera_info_fields(small, *stamped)


def test_depth_of_another_camera_is_aligned(tmp_path: Path) -> None:
    frames, _ = read(bags.write_bag(tmp_path, "mcap", two_cameras()))
    T = Pose(OPTICAL, "depth", pose("a", "b", 2, (-0.05, 0.01, 0.0)).matrix)
    small = Intrinsics(16, 12, 14.0, 14.0, 7.5, 5.5)
    for i, frame in enumerate(frames):
        expected = align_depth_to_color(np.full((12, 16), 1500 + i, np.uint16), 0.001, small, CAMERA, T)
        np.testing.assert_array_equal(frame.depth, expected)
        assert (frame.depth > 0).mean() > 0.5


def test_depth_of_another_camera_without_its_place_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no tf says how they stand to each other"):
        read(bags.write_bag(tmp_path, "mcap", two_cameras(with_place=False)))


def test_aligned_depth_is_preferred(tmp_path: Path) -> None:
    both = in_order(two_cameras(with_place=False), (e for e in images(2) if "aligned" in e[1]))
    frames, source = read(bags.write_bag(tmp_path, "mcap", both))
    assert source.name == "bag_mcap"
    np.testing.assert_array_equal(frames[0].depth, depth_of(0))
    with pytest.raises(InputError, match="no tf says"):
        read(tmp_path / "bag_mcap", depth_topic="/camera/depth/image_rect_raw")


def test_a_lens_is_rectified(tmp_path: Path) -> None:
    d = [-0.3, 0.1, 0.0, 0.0, 0.0]
    v, u = np.mgrid[:18, :24]
    smooth = np.stack([u * 10, v * 14, 100 + u], axis=-1).astype(np.uint8)

    def bend(event: Event) -> Event:
        t, topic, name, fields = event
        assert isinstance(fields, dict)
        if name == INFO:
            return t, topic, name, {**fields, "d": np.array(d)}
        return (t, topic, name, rf.image_fields(smooth, t - 5 * MS, OPTICAL)) if topic == COLOR else event

    frames, _ = read(bags.write_bag(tmp_path, "mcap", [bend(event) for event in images(1)]))
    expected = cv2.undistort(smooth, CAMERA.matrix, np.array(d))
    np.testing.assert_allclose(frames[0].rgb.astype(int), expected, atol=1)
    assert np.abs(expected.astype(int) - smooth).max() > 5
    assert set(np.unique(frames[0].depth)) <= set(np.unique(depth_of(0))) | {0}


def test_ambiguous_topics_are_listed(tmp_path: Path) -> None:
    second = [(t, topic.replace("/camera", "/rear", 1), name, f) for t, topic, name, f in images(1)]
    bag = bags.write_bag(tmp_path, "ros1", in_order(images(1), iter(second)))
    with pytest.raises(InputError, match=r"2 topics could be the color image") as caught:
        read(bag)
    text = str(caught.value)
    for words in ("source.color_topic", "/rear/color/image_raw", "sensor_msgs/msg/Image", "depth (16UC1)"):
        assert words in text
    frames, _ = read(
        bag, color_topic="/rear/color/image_raw", depth_topic="/rear/aligned_depth_to_color/image_raw"
    )
    assert len(frames) == 1
    with pytest.raises(InputError, match="holds no depth images"):
        read(bag, color_topic=COLOR, depth_topic=COLOR)


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        ("/camera/color/camera_info", "no CameraInfo beside /camera/color/image_raw"),
        (COLOR, "no topic with color images"),
        (DEPTH, "no topic with depth images"),
    ],
)
def test_what_is_missing_is_said(tmp_path: Path, missing: str, words: str) -> None:
    events = [e for e in images(1) if e[1] != missing]
    with pytest.raises(InputError, match=words):
        read(bags.write_bag(tmp_path, "mcap", events))


def test_messages_that_nobody_knows_do_no_harm(tmp_path: Path) -> None:
    definitions = {"robot_msgs/msg/Blades": "float32 rpm\nuint8[] wear"}
    blades: Event = (
        START_NS,
        "/blades",
        "robot_msgs/msg/Blades",
        {"rpm": 3.0, "wear": np.zeros(3, np.uint8)},
    )
    for kind in KINDS:
        folder = tmp_path / kind
        folder.mkdir()
        bag = bags.write_bag(folder, kind, [blades, *images(1)], definitions)
        assert len(read(bag)[0]) == 1


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
@pytest.mark.parametrize(("chunks", "profile"), [(True, "ros2"), (False, "ros2"), (True, "")])
def test_files_of_another_mcap_writer(tmp_path: Path, compression: str, chunks: bool, profile: str) -> None:
    writer_module = pytest.importorskip("mcap.writer", reason="writes with the reference library")
    store = bags.typestore("mcap")
    file = tmp_path / "other.mcap"
    with file.open("wb") as stream:
        kind = getattr(writer_module.CompressionType, compression)
        writer = writer_module.Writer(stream, chunk_size=4096, compression=kind, use_chunking=chunks)
        writer.start(profile=profile, library="test")
        channels: dict[str, int] = {}
        for t, topic, name, fields in in_order(images(3), transforms(200)):
            if topic not in channels:  # short type names, and definitions that cannot be parsed
                schema = writer.register_schema(name.replace("/msg/", "/"), "ros2msg", b"*** none ***")
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            assert isinstance(fields, dict)
            writer.add_message(channels[topic], t, bags.serialized(store, "mcap", name, fields), t)
        writer.finish()
    frames, _ = read(file)
    for i, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.rgb, rgb_of(i))
        np.testing.assert_array_equal(frame.depth, depth_of(i))
    assert len(frames) == 3


def by_another_clock(events: list[Event], which: str, shift_ns: int) -> Iterator[Event]:
    """The same with other times in the headers of the topics that have a word in their names."""
    for time_ns, topic, name, fields in events:
        if which in topic and topic != "/tf_static" and isinstance(fields, dict):
            headers = [fields, *fields.get("transforms", [])]
            for header in (part["header"] for part in headers if "header" in part):
                stamp = header["stamp"]
                stamp["sec"], stamp["nanosec"] = divmod(
                    stamp["sec"] * 10**9 + stamp["nanosec"] + shift_ns, 10**9
                )
        yield time_ns, topic, name, fields


@pytest.mark.parametrize("shift_s", [-1_600_000_000, 3600])
def test_cameras_with_two_clocks_are_told_with_both_spans_and_what_to_do(
    tmp_path: Path, shift_s: int
) -> None:
    events = in_order(images(70), transforms(2600))
    bag = bags.write_bag(tmp_path, "mcap", by_another_clock(events, "_depth", shift_s * 10**9))
    spans = r"colour images are of \d+\.\d+ to \d+\.\d+ s, depth images of \d+\.\d+ to \d+\.\d+ s"
    with pytest.raises(InputError, match=spans + ": two clocks.*use_sim_time"):
        read(bag)


def test_poses_of_another_clock_are_told_with_both_times_and_what_to_do(tmp_path: Path) -> None:
    events = in_order(images(8), transforms(400))
    bag = bags.write_bag(tmp_path, "mcap", by_another_clock(events, "/tf", -1_600_000_000 * 10**9))
    frames, source = read(bag)
    assert frames == []
    first = source.facts["left_out"]["no pose of the camera at the time of the image"]["first"]
    assert re.search(r"is known from 1\d+\.\d+ to .* s, the image is of 17\d+\.\d+ s: two clocks\?", first)


@pytest.mark.parametrize(("profile", "schema"), [("", "protobuf"), ("", "jsonschema"), ("ros1", "ros1msg")])
def test_an_mcap_file_of_other_messages_is_refused_as_such(tmp_path: Path, profile: str, schema: str) -> None:
    writer_module = pytest.importorskip("mcap.writer", reason="writes with the reference library")
    with (tmp_path / "other.mcap").open("wb") as stream:
        writer = writer_module.Writer(stream)
        writer.start(profile=profile, library="test")
        channel = writer.register_channel("/image", schema, writer.register_schema("Image", schema, b"x"))
        writer.add_message(channel, 1, b"\x00" * 20, 1)
        writer.finish()
    with pytest.raises(InputError, match=r"Only (MCAP files with ROS 2|CDR) messages"):
        read(tmp_path / "other.mcap")


def test_a_definition_of_its_own_under_a_standard_name_is_refused(tmp_path: Path) -> None:
    from rosbags.rosbag1 import Writer

    path = tmp_path / "own.bag"
    store = bags.typestore("ros1")
    with Writer(path) as writer:
        connection = writer.add_connection(COLOR, IMAGE, msgdef="uint8 a", md5sum="0" * 32)
        writer.write(connection, 1, bags.serialized(store, "ros1", IMAGE, rf.image_fields(rgb_of(0), 1, "c")))
    with pytest.raises(InputError, match="that is not the standard one"):
        read(path)


@pytest.mark.parametrize("kind", KINDS)
def test_memory_does_not_grow_with_the_recording(tmp_path: Path, kind: Kind) -> None:
    camera = Intrinsics(320, 240, 300.0, 300.0, 160.0, 120.0)
    rgb, depth = np.zeros((240, 320, 3), np.uint8), np.ones((240, 320), np.uint16)

    def long_recording() -> Iterator[Event]:
        for i in range(60):
            t = START_NS + i * 33 * MS
            yield t, COLOR, IMAGE, rf.image_fields(rgb, t, OPTICAL)
            yield t, "/camera/color/camera_info", INFO, rf.camera_info_fields(camera, t, OPTICAL)
            yield t, DEPTH, IMAGE, rf.image_fields(depth, t, OPTICAL)

    source = open_source(bags.write_bag(tmp_path, kind, long_recording()), SourceConfig())
    tracemalloc.start()
    try:
        count = sum(1 for _ in source)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert count == 60
    assert peak < 60 * (rgb.nbytes + depth.nbytes) / 3


def test_unpaired_and_damaged_images_are_counted(tmp_path: Path) -> None:
    def spoil(event: Event) -> Event:
        t, topic, name, fields = event
        broken = name == COMPRESSED and t == START_NS + (33 + 12) * MS
        return (
            (t, topic, name, {**fields, "data": np.zeros(20, np.uint8)})
            if broken and isinstance(fields, dict)
            else event
        )

    events = [spoil(e) for e in images(4, "png") if not (e[1] == DEPTH and e[0] == START_NS + (66 + 13) * MS)]
    frames, source = read(bags.write_bag(tmp_path, "mcap", events))
    assert [f.name for f in frames] == ["000000", "000002"]
    assert source.skipped == {REASON_DAMAGED: 1, "colour image without a depth image near in time": 1}


def test_a_clock_that_goes_back_is_counted(tmp_path: Path) -> None:
    once = list(images(3))
    later = [(t + 1000 * MS, topic, name, fields) for t, topic, name, fields in once]  # the bag, looped
    frames, source = read(bags.write_bag(tmp_path, "mcap", [*once, *later]))
    assert len(frames) == 3
    assert source.skipped == {"image not later than the one before it": 6}


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_cut_off_anywhere_gives_one_clear_error(tmp_path: Path, kind: Kind) -> None:
    bag = bags.write_bag(tmp_path, kind, in_order(images(3), transforms(200)))
    file = bag if kind == "ros1" else bags.bare_file(bag)
    whole = file.read_bytes()
    cut = tmp_path / f"cut{file.suffix}"
    for share in (0.0, 0.1, 0.5, 0.9, 0.999):
        cut.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(SwardmapError) as caught:
            read(cut)
        assert str(cut) in str(caught.value)


@pytest.fixture(scope="module")
def small_bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    out = {}
    for kind in KINDS:
        folder = tmp_path_factory.mktemp(kind)
        bag = bags.write_bag(folder, kind, in_order(images(1), transforms(200)))
        out[".bag" if kind == "ros1" else bags.bare_file(bag).suffix] = (
            bag if kind == "ros1" else bags.bare_file(bag)
        ).read_bytes()
    return out


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(suffix=st.sampled_from([".bag", ".db3", ".mcap"]), data=st.data())
def test_flipped_bytes_never_give_a_foreign_error(
    tmp_path: Path, small_bags: dict[str, bytes], suffix: str, data: st.DataObject
) -> None:
    content = bytearray(small_bags[suffix])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at] = data.draw(st.integers(0, 255))
    file = tmp_path / f"damaged{suffix}"
    file.write_bytes(content)
    try:
        frames, _ = read(file)
    except SwardmapError:
        return
    assert len(frames) <= 1


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    suffix=st.sampled_from([".bag", ".db3", ".mcap"]), content=st.binary(max_size=300), magic=st.booleans()
)
def test_random_bytes_are_refused(tmp_path: Path, suffix: str, content: bytes, magic: bool) -> None:
    starts = {".bag": b"#ROSBAG V2.0\n", ".db3": b"SQLite format 3\0", ".mcap": b"\x89MCAP0\r\n"}
    file = tmp_path / f"random{suffix}"
    file.write_bytes((starts[suffix] if magic else b"") + content)
    with pytest.raises(InputError) as caught:
        read(file)
    assert str(file) in str(caught.value)


def test_what_may_not_be_read_or_is_none(tmp_path: Path) -> None:
    assert not recognises(tmp_path)
    assert not recognises(tmp_path / "picture.png")
    with pytest.raises(InputError, match="expected the folder of a ROS 2 bag"):
        open_source(tmp_path, SourceConfig())
    if os.geteuid() != 0:
        secret = tmp_path / "secret.mcap"
        secret.write_bytes(b"")
        secret.chmod(0)
        with pytest.raises(InputError, match="permission"):
            open_source(secret, SourceConfig())


def test_metadata_that_points_outside_is_not_followed(tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    other = bags.bare_file(bags.write_bag(outside, "mcap", images(1)))
    bag = bags.write_bag(tmp_path, "mcap", images(1))
    metadata = bag / "metadata.yaml"
    inside = bags.bare_file(bag)
    metadata.write_text(metadata.read_text().replace(inside.name, f"../outside/bag_mcap/{other.name}"))
    inside.unlink()
    with pytest.raises(InputError, match="missing"):
        open_source(bag, SourceConfig())


def each(data_dir: Path, keep: Callable[[Path], bool]) -> list[Path]:
    root = data_dir / "bags" / "rosbag2_formats"
    if not root.is_dir():
        pytest.skip("no rosbag2_formats among the optional recordings")
    return [p for p in sorted(root.rglob("*")) if keep(p)]


def test_real_bags_without_images_say_so(data_dir: Path) -> None:
    found = each(data_dir, lambda p: p.suffix in (".db3", ".mcap") or (p / "metadata.yaml").is_file())
    assert len(found) > 40
    for path in found:
        assert recognises(path)
        with pytest.raises(InputError, match=r"no topic with color images|can be read") as caught:
            open_source(path, SourceConfig())
        if "wrong_rmw" not in str(path):
            assert "Topics (name, type, messages" in str(caught.value), path
