"""The node without ROS: the same map as offline, faults by name, cameras by direction of travel."""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swardmap.config import Config, config_from_dict
from swardmap.errors import ConfigError, InputError, InvalidValueError
from swardmap.geometry import R_BODY_OPTICAL, Pose
from swardmap.io.bags.ros_fields import odometry_fields
from swardmap.io.bags.topics import ImageTopic
from swardmap.io.maps.log_odds_files import write_living
from swardmap.io.maps.map_files import read_map
from swardmap.labels import MapClass
from swardmap.mapping.costmap import LETHAL
from swardmap.models import build_segmenter
from swardmap.monitor.diagnostics import Fault, HealthReport, Severity
from swardmap.pipeline import ObstacleMapper
from swardmap.rig.rig import Rig
from swardmap.ros.live_pipeline import LivePipeline
from swardmap.ros.parameters import Parameters, changed, parameters_from
from swardmap.types import Frame
from tests.bags import ODOMETRY
from tests.ros import drive
from tests.ros.drive import MS, ONE, PERIOD_NS, RIG, START_NS

LATENCY_NS = 20 * MS
SETTINGS = {"segmenter": {"name": "colour"}, "source": {"odometry_topic": "/odom"}}


def parameters(settings: dict[str, Any] | None = None, **node: Any) -> Parameters:
    merged = {**SETTINGS, **(settings or {})}
    return parameters_from(node, Parameters(config=config_from_dict(merged)))


def pipeline_of(parameters: Parameters, rig: Rig | None = None) -> LivePipeline:
    return LivePipeline(parameters, build_segmenter(parameters.config.segmenter), rig)


class Robot:
    """Sends messages to a pipeline and lets it work, in the order of a simulated clock."""

    def __init__(self, pipeline: LivePipeline, rig: Rig) -> None:
        self.pipeline, self.rig = pipeline, rig
        self.now_ns = START_NS
        self.frames: list[Frame] = []
        self.reports: list[HealthReport] = []

    def pose(self, x_m: float, stamp_ns: int) -> None:
        self.pipeline.intake.on_odometry(drive.odometry(x_m, stamp_ns), self.now_ns)

    def look(self, name: str, frame: Frame, stamp_ns: int) -> None:
        """One pair of images with their CameraInfo."""
        for topic, (kind, fields) in drive.camera_fields(frame, name, stamp_ns).items():
            which, what = topic.split("/")
            message = drive.message(kind, fields)
            if what == "camera_info":
                self.pipeline.intake.on_info(name, which, message)
            else:
                self.pipeline.intake.on_image(name, which, message, self.now_ns)

    def work(self) -> None:
        while (mapped := self.pipeline.process(0)) is not None or len(self.pipeline.intake.queue):
            if mapped is not None:
                self.pipeline.mapped(mapped, self.now_ns)
                self.frames.append(mapped.step.frame)
        self.reports.append(self.pipeline.check(self.now_ns))

    def step(self, i: int, x_m: float, posed: bool = True, skew_ns: int = 0) -> HealthReport:
        """The i-th tenth of a second: a pose, and an image of every camera."""
        stamp_ns = START_NS + i * PERIOD_NS
        self.now_ns = stamp_ns + LATENCY_NS
        if posed:
            self.pose(x_m, stamp_ns)
        for name in self.rig.names:
            key = name if name in self.pipeline.intake.inputs else "camera"
            self.look(key, drive.view(self.rig, name, x_m, i % 20), stamp_ns + skew_ns)
        self.work()
        return self.reports[-1]

    def run(self, xs_m: Sequence[float], start: int = 0, **options: Any) -> HealthReport:
        for i, x_m in enumerate(xs_m, start):
            self.step(i, x_m, **options)
        return self.reports[-1]


def one_robot(settings: dict[str, Any] | None = None, **node: Any) -> Robot:
    rig = drive.rig_of(ONE)
    return Robot(pipeline_of(parameters(settings, **node), rig), rig)


def offline_map(frames: Sequence[Frame], config: Config) -> ObstacleMapper:
    mapper = ObstacleMapper(build_segmenter(config.segmenter), config)
    for frame in frames:
        mapper.step(frame)
    return mapper


def snapshot(pipeline: LivePipeline) -> Any:
    report = pipeline.report
    return pipeline.mapper.snapshot(None if report is None else report.forget_before_ns)


def free_cells(pipeline: LivePipeline) -> int:
    grid = snapshot(pipeline)
    return 0 if grid is None else int(grid.count(MapClass.GRASS))


MODES: list[dict[str, Any]] = [{}, {"grid": {"mode": "evidence"}}, {"geometry": {"enabled": True}}]


@pytest.mark.parametrize("settings", MODES, ids=["paper", "evidence", "geometry"])
def test_the_map_is_that_of_the_frames_one_by_one(settings: dict[str, Any]) -> None:
    robot = one_robot(settings)
    xs_m = [0.1 * i for i in range(8)]
    robot.run(xs_m)
    pipeline, config = robot.pipeline, parameters(settings).config
    poses = [drive.base_at(x) @ robot.rig.T_base_camera("camera") for x in xs_m]
    frames = [
        replace(drive.view(robot.rig, "camera", x, i), stamp_ns=START_NS + i * PERIOD_NS, T_map_camera=pose)
        for i, (x, pose) in enumerate(zip(xs_m, poses, strict=True))
    ]
    expected = offline_map(frames, config)
    grid = pipeline.mapper.snapshot(None)
    assert grid is not None
    assert expected.map is not None
    np.testing.assert_array_equal(grid.classes, expected.map.classes)
    assert grid.spec == expected.map.spec
    costs, offline = pipeline.mapper.costmap(grid), expected.costmap()
    assert costs is not None
    assert offline is not None
    np.testing.assert_array_equal(costs.costs, offline.costs)
    assert (pipeline.mapper.snapshot(None).classes == MapClass.OBSTACLE).any()  # type: ignore[union-attr]


def test_poses_by_tf_give_the_map_that_odometry_gives() -> None:
    by_odometry = one_robot()
    by_odometry.run([0.0, 0.1, 0.2])
    rig = drive.rig_of(ONE)
    by_tf = Robot(pipeline_of(parameters({"source": {}}), rig), rig)
    mount = rig.T_base_camera("camera")
    static = [Pose(drive.BASE, drive.optical("camera"), mount.matrix)]
    by_tf.pipeline.intake.on_tf(drive.transforms(static, 0), True, START_NS)
    for i, x_m in enumerate([0.0, 0.1, 0.2]):
        by_tf.now_ns = START_NS + i * PERIOD_NS + LATENCY_NS
        by_tf.pipeline.intake.on_tf(
            drive.transforms([drive.base_at(x_m)], START_NS + i * PERIOD_NS), False, by_tf.now_ns
        )
        by_tf.step(i, x_m, posed=False)
    one, two = snapshot(by_odometry.pipeline), snapshot(by_tf.pipeline)
    np.testing.assert_array_equal(one.classes, two.classes)


def test_a_mount_is_measured_from_the_robots_base_wherever_the_odometry_sits() -> None:
    """The antenna of the odometry is 0.4 m ahead of the base; tf says so."""
    robot = one_robot()
    T_base_antenna = Pose(drive.BASE, "antenna", np.eye(4) + 0.4 * np.eye(4, k=3))
    robot.pipeline.intake.on_tf(drive.transforms([T_base_antenna.inverse()], 0), True, START_NS)
    robot.now_ns = START_NS + LATENCY_NS
    antenna = drive.message(ODOMETRY, odometry_fields(drive.base_at(1.0) @ T_base_antenna, START_NS))
    robot.pipeline.intake.on_odometry(antenna, robot.now_ns)
    robot.look("camera", drive.view(robot.rig, "camera", 1.0), START_NS)
    robot.work()
    pose = robot.frames[0].T_map_camera
    assert pose is not None
    expected = drive.base_at(1.0) @ robot.rig.T_base_camera("camera")
    np.testing.assert_allclose(pose.matrix, expected.matrix, atol=1e-12)


def test_the_frames_that_do_not_meet_are_named() -> None:
    rig = drive.rig_of(ONE)
    robot = Robot(pipeline_of(parameters({"source": {}}), rig), rig)
    T = Pose("odom", drive.BASE, np.eye(4))
    for i in range(6):  # odom alone: what is above it may yet come, so it is not taken for the map
        robot.pipeline.intake.on_tf(drive.transforms([T], START_NS + i * PERIOD_NS), False, robot.now_ns)
        robot.step(i, 0.1 * i, posed=False)
    assert robot.frames == []
    error = robot.pipeline.facts["error"]
    assert isinstance(error, str)
    assert "in 'map'" in error
    assert "base_link, camera_optical_frame, odom" in error


def body_framed(settings: dict[str, Any]) -> Robot:
    """A robot whose images are of a frame with the axes of a body; tf says where that sits."""
    rig = drive.rig_of(ONE)
    robot = Robot(pipeline_of(parameters({"source": settings}), rig), rig)
    T_base_optical = rig.T_base_camera("camera")
    turn = np.eye(4)
    turn[:3, :3] = R_BODY_OPTICAL.T
    T_base_body = Pose(drive.BASE, drive.optical("camera"), T_base_optical.matrix @ turn)
    robot.pipeline.intake.on_tf(drive.transforms([T_base_body], 0), True, START_NS)
    for i in range(16):
        T = Pose("map", drive.BASE, drive.base_at(0.1 * i).matrix)
        robot.pipeline.intake.on_tf(drive.transforms([T], START_NS + i * PERIOD_NS), False, robot.now_ns)
        robot.step(i, 0.1 * i, posed=False)
    return robot


def test_a_body_frame_in_place_of_the_lens_is_refused_and_named() -> None:
    robot = body_framed({})
    assert robot.frames == []
    assert "looks up: is it a body frame" in str(robot.pipeline.facts["error"])
    assert robot.pipeline.skipped["image of a frame that looks up"] == 16
    told = {d.fault: d for d in robot.reports[-1].diagnoses}
    assert "source.camera_axes=body" in told[Fault.IMPLAUSIBLE].message
    assert Fault.IDLE in told
    assert robot.reports[-1].stop


def test_a_body_frame_that_is_said_to_be_one_is_turned() -> None:
    robot = body_framed({"camera_axes": "body"})
    assert len(robot.frames) >= 14
    pose = robot.frames[0].T_map_camera
    assert pose is not None
    expected = drive.base_at(0.0) @ robot.rig.T_base_camera("camera")
    np.testing.assert_allclose(pose.matrix, expected.matrix, atol=1e-9)


def test_a_view_whose_readings_are_mostly_lost_is_called_implausible() -> None:
    robot = one_robot({"cloud": {"max_range_m": 0.5}})
    robot.run([0.1 * i for i in range(8)])
    told = {d.fault: d for d in robot.reports[-1].diagnoses}
    assert "out of range: check cloud.max_range_m" in told[Fault.IMPLAUSIBLE].message
    assert told[Fault.IMPLAUSIBLE].severity == Severity.WARN


def test_a_pose_between_two_is_interpolated_at_the_image_stamp() -> None:
    robot = one_robot()
    stamp_ns = START_NS + 40 * MS
    robot.now_ns = stamp_ns + LATENCY_NS
    robot.pose(0.0, START_NS)
    robot.look("camera", drive.view(robot.rig, "camera", 0.4), stamp_ns)
    robot.work()
    assert robot.frames == []  # it waits: the newest pose is not that of the image
    robot.pose(1.0, START_NS + 100 * MS)
    robot.work()
    pose = robot.frames[0].T_map_camera
    assert pose is not None
    expected = drive.base_at(0.4) @ robot.rig.T_base_camera("camera")
    np.testing.assert_allclose(pose.matrix, expected.matrix, atol=1e-12)


class Sealed:
    """A message of which only the header may be read."""

    def __init__(self, message: Any) -> None:
        self.header = message.header

    def __getattr__(self, name: str) -> Any:
        raise AssertionError(f"somebody reads {name} of an image that is not to be processed")


def test_only_the_cameras_that_face_the_way_are_decoded() -> None:
    rig = drive.rig_of(RIG)
    robot = Robot(pipeline_of(parameters(), rig), rig)
    forward, backward = [0.1 * i for i in range(10)], [0.85 - 0.1 * i for i in range(12)]
    for i, x_m in enumerate([*forward, *backward]):
        stamp_ns = START_NS + i * PERIOD_NS
        robot.now_ns = stamp_ns + LATENCY_NS
        robot.pose(x_m, stamp_ns)
        for name in rig.names:
            if name in robot.pipeline.intake.active_names:
                robot.look(name, drive.view(rig, name, x_m, i), stamp_ns)
                continue
            for kind, topic in (("color", "color/image_raw"), ("depth", "depth/image_raw")):
                type_, fields = drive.camera_fields(drive.view(rig, name, x_m), name, stamp_ns)[topic]
                robot.pipeline.intake.on_image(name, kind, Sealed(drive.message(type_, fields)), robot.now_ns)
        robot.work()
    facts = robot.pipeline.facts
    assert facts["direction"] == "backward"
    assert facts["active"] == ["rear_left", "rear_right"]
    mapped, dropped = facts["mapped"], facts["dropped"]
    assert isinstance(mapped, dict)
    assert isinstance(dropped, dict)
    for name in rig.names:  # every frame is either mapped or dropped for the direction
        assert mapped[name] + dropped[name] == 22
        assert mapped[name] >= 5
        assert dropped[name] >= 5
    assert facts["left_out"] == {}
    expected = offline_map([replace(f, stamp_ns=0) for f in robot.frames], parameters().config)
    np.testing.assert_array_equal(snapshot(robot.pipeline).classes, expected.map.classes)  # type: ignore[union-attr]


def test_cameras_of_one_rig_have_health_of_their_own() -> None:
    rig = drive.rig_of(RIG)
    robot = Robot(pipeline_of(parameters(), rig), rig)
    robot.run([0.1 * i for i in range(10)])
    for i in range(10, 20):  # one of the front pair falls silent, the rear pair is not listened to
        robot.now_ns = START_NS + i * PERIOD_NS + LATENCY_NS
        robot.pose(0.1 * i, START_NS + i * PERIOD_NS)
        robot.look("front_left", drive.view(rig, "front_left", 0.1 * i), START_NS + i * PERIOD_NS)
        robot.work()
    report = robot.reports[-1]
    assert {(d.subject, d.fault) for d in report.diagnoses} >= {("front_right", Fault.STOPPED)}
    assert {d.subject for d in report.diagnoses} == {"front_right"}
    assert report.stop
    assert report.rates_hz["front_left"] > 5


def test_a_robot_that_travels_where_no_camera_looks_says_so() -> None:
    tree = {**RIG, "cameras": {name: RIG["cameras"][name] for name in ("front_left", "front_right")}}
    rig = drive.rig_of(tree)
    robot = Robot(pipeline_of(parameters(), rig), rig)
    robot.run([0.1 * i for i in range(8)])
    assert not robot.reports[-1].faults("rig")
    robot.run([0.7 - 0.1 * i for i in range(12)], start=8)
    (diagnosis,) = robot.reports[-1].of("rig")
    assert (diagnosis.fault, diagnosis.severity) == (Fault.BLIND, Severity.WARN)
    assert "backward" in diagnosis.message
    assert set(robot.pipeline.intake.active_names) == set(rig.names)  # better these than none


def recovered(robot: Robot, start: int, steps: int = 30) -> HealthReport:
    return robot.run([0.05 * i for i in range(steps)], start=start)


def test_a_lost_pose_is_named_and_the_camera_is_not_blamed() -> None:
    robot = one_robot()
    assert not recovered(robot, 0).stop
    report = robot.run([1.5 + 0.05 * i for i in range(30)], start=30, posed=False)
    assert report.faults("pose") == {Fault.LOST_POSE}
    assert report.faults("camera") == set()
    assert report.stop
    assert free_cells(robot.pipeline) == 0  # the frames that came are of places nobody knows
    assert robot.pipeline.skipped["no pose of the camera at the time of the image"] > 20
    assert not recovered(robot, 60, 40).stop
    assert free_cells(robot.pipeline) > 0


@pytest.mark.parametrize(
    ("skew_s", "fault"), [(2.0, Fault.JUMPED_AHEAD), (-0.4, Fault.JUMPED_BACK), (-5.0, Fault.JUMPED_BACK)]
)
def test_stamps_that_jump_are_named_whether_there_are_poses_for_them_or_not(
    skew_s: float, fault: Fault
) -> None:
    robot = one_robot()
    assert not recovered(robot, 0).stop
    for i in range(30, 40):
        robot.step(i, 0.05 * i, skew_ns=round(skew_s * 1e9))
    found = set().union(*(report.faults("camera") for report in robot.reports[30:]))
    assert fault in found
    assert robot.reports[-1].stop
    recovered(robot, 40, 70)
    assert not robot.reports[-1].stop
    assert free_cells(robot.pipeline) > 0


def test_while_paused_the_flag_is_stop_and_no_camera_is_blamed() -> None:
    robot = one_robot()
    assert not recovered(robot, 0).stop
    robot.pipeline.intake.paused = True
    assert robot.step(30, 1.5).stop  # at once
    report = robot.run([1.5] * 30, start=31)
    assert {(d.subject, d.fault) for d in report.diagnoses} == {("map", Fault.IDLE)}
    assert free_cells(robot.pipeline) == 0
    robot.pipeline.intake.paused = False
    assert robot.run([1.5 + 0.05 * i for i in range(5)], start=61).stop  # it takes recover_s to trust again
    assert not robot.run([1.7 + 0.05 * i for i in range(30)], start=66).stop


def test_images_that_the_network_does_not_know_stop_the_robot_and_keep_nothing_free(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = one_robot()
    assert not recovered(robot, 0).stop
    mapper = robot.pipeline.mapper
    known = mapper.segmenter
    monkeypatch.setattr(mapper, "segmenter", lambda frame: replace(known(frame), unfamiliar=1.5))
    assert not robot.step(30, 1.5).stop, "one such image is no fault"
    report = robot.run([1.5 + 0.05 * i for i in range(1, 30)], start=31)
    assert report.faults() == report.faults("camera") == {Fault.UNFAMILIAR}
    assert report.stop
    assert free_cells(robot.pipeline) == 0
    monkeypatch.setattr(mapper, "segmenter", known)
    assert not recovered(robot, 60).stop
    assert free_cells(robot.pipeline) > 0


def test_a_network_that_fails_on_each_frame_stops_the_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = one_robot()
    assert not recovered(robot, 0).stop

    def fails(_: Frame) -> Any:
        raise InputError("out of memory")

    monkeypatch.setattr(robot.pipeline.mapper, "segmenter", fails)
    report = robot.run([1.5 + 0.05 * i for i in range(30)], start=30)
    assert report.faults("map") == {Fault.IDLE}
    assert report.stop
    assert robot.pipeline.facts["error"] == "out of memory"
    assert free_cells(robot.pipeline) == 0


def robot_with_a_damaged_image(monkeypatch: pytest.MonkeyPatch) -> Robot:
    """After two images that were mapped, a third that cannot be read."""
    robot = one_robot()
    robot.run([0.0, 0.1])

    def damaged(*_: Any) -> Any:
        raise InputError("expected 57600 bytes, got 12")

    with monkeypatch.context() as patch:
        patch.setattr(ImageTopic, "color", damaged)
        robot.step(2, 0.2)
    return robot


def test_a_damaged_image_is_left_out_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = robot_with_a_damaged_image(monkeypatch)
    robot.step(3, 0.3)
    assert robot.pipeline.skipped == {"image that cannot be used": 1}
    assert robot.pipeline.facts["mapped"] == {"camera": 3}


def lawn_file(folder: Path, ring: list[list[float]]) -> Path:
    file = folder / "lawn.geojson"
    file.write_text(json.dumps({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}))
    return file


def test_outside_the_work_area_the_costmap_is_lethal(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    from swardmap.mapping.geodesy import Projection

    datum = Projection(52.4, 16.9)
    ring = datum.to_gps([(-1.0, -1.0), (3.0, -1.0), (3.0, 1.0), (-1.0, 1.0)]).tolist()
    area = {"file": str(lawn_file(tmp_path, ring)), "datum_lat": 52.4, "datum_lon": 16.9}
    robot = one_robot({"area": area})
    robot.run([0.1 * i for i in range(5)])
    grid = snapshot(robot.pipeline)
    costmap = robot.pipeline.mapper.costmap(grid)
    assert costmap is not None
    iy, ix = np.indices(grid.spec.shape)
    x, y = np.moveaxis(grid.spec.center_of(np.stack([ix, iy], axis=-1).reshape(-1, 2)), -1, 0)
    outside = ((x < -1) | (x > 3) | (np.abs(y) > 1)).reshape(grid.spec.shape)
    assert (costmap.costs[outside] == LETHAL).all()
    assert (costmap.costs[~outside] == 0).any()
    assert (grid.classes[outside] == MapClass.GRASS).any()  # the map stays what was seen


def test_a_work_area_in_another_frame_is_never_mapped(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    ring = [[16.9, 52.4], [16.9001, 52.4], [16.9, 52.4001]]
    area = {"file": str(lawn_file(tmp_path, ring)), "datum_lat": 52.4, "datum_lon": 16.9, "frame_id": "odom"}
    robot = one_robot({"area": area})
    report = robot.run([0.1 * i for i in range(15)])
    assert "area.frame_id" in robot.pipeline.intake.last_error
    assert report.stop
    assert robot.pipeline.mapper.mapped.total() == 0


def test_what_a_saved_map_calls_free_is_unknown_until_all_is_well(tmp_path: Path) -> None:
    living = {"grid": {"mode": "evidence"}}
    first = one_robot(living)
    first.run([0.1 * i for i in range(8)])
    saved = first.pipeline.mapper._mapper.log_odds
    assert saved is not None
    write_living(saved, tmp_path / "living.npz")
    robot = one_robot({"grid": {"mode": "evidence", "resume": str(tmp_path / "living.npz")}})
    robot.pipeline.check(START_NS)
    before = snapshot(robot.pipeline)
    assert before.count(MapClass.GRASS) == 0
    assert before.count(MapClass.OBSTACLE) > 0  # obstacles are remembered
    robot.run([0.1 * i for i in range(30)])
    assert not robot.reports[-1].stop
    assert free_cells(robot.pipeline) > first.pipeline.mapper.snapshot(None).count(MapClass.GRASS)  # type: ignore[union-attr]


def test_a_map_that_was_cleared_is_given_out_as_unknown_until_there_is_another() -> None:
    """Who holds the old one must not go on by it."""
    robot = one_robot()
    assert snapshot(robot.pipeline) is None
    robot.run([0.05 * i for i in range(30)])
    before = snapshot(robot.pipeline)
    robot.pipeline.clear()
    after = snapshot(robot.pipeline)
    assert after.spec == before.spec
    assert (after.classes == MapClass.UNKNOWN).all()
    with pytest.raises(InputError, match="no map yet"):
        robot.pipeline.mapper.save(Path("nowhere"))
    robot.run([1.5 + 0.05 * i for i in range(3)], start=30)
    assert free_cells(robot.pipeline) > 0


def test_without_poses_each_frame_is_a_map_of_its_own() -> None:
    rig = drive.rig_of(ONE)
    robot = Robot(pipeline_of(parameters({"source": {}, "mount": drive.MOUNT}, pose_source="none")), rig)
    for i in range(30):
        robot.step(i, 0.05 * i, posed=False)
    report = robot.reports[-1]
    assert not report.stop
    frame = replace(drive.view(rig, "camera", 0.05 * 29, 9), T_map_camera=None)
    config = parameters({"mount": drive.MOUNT}).config
    seen = ObstacleMapper(build_segmenter(config.segmenter), config).step(frame).seen
    np.testing.assert_array_equal(snapshot(robot.pipeline).classes, seen.classes)
    robot.pipeline.check(robot.now_ns + 5_000_000_000)
    assert free_cells(robot.pipeline) == 0


@pytest.mark.parametrize(
    ("node", "source", "with_rig", "expected"),
    [
        ({"pose_source": "none"}, {}, False, "mount.height_m"),
        ({"pose_source": "none"}, {}, True, "rig needs poses"),
        ({"pose_source": "odometry"}, {}, False, "source.odometry_topic"),
    ],
)
def test_contradictions_are_refused(
    node: dict[str, Any], source: dict[str, Any], with_rig: bool, expected: str
) -> None:
    rig = drive.rig_of(RIG) if with_rig else None
    with pytest.raises(ConfigError, match=expected):
        pipeline_of(parameters({"source": source}, **node), rig)


def test_a_saved_map_has_a_page(tmp_path: Path) -> None:
    robot = one_robot()
    robot.run([0.05 * i for i in range(30)])
    robot.pipeline.mapper.save(tmp_path / "saved")
    page = (tmp_path / "saved/report.html").read_text(encoding="utf-8")
    assert 'id="map-svg"' in page
    assert 'data-layer="grass"' in page


def test_while_the_page_of_a_saved_map_is_built_frames_are_mapped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And what is saved is the map as it was when it was asked for."""
    robot = one_robot({"grid": {"mode": "evidence"}})
    robot.run([0.05 * i for i in range(10)])
    mapper, before = robot.pipeline.mapper, snapshot(robot.pipeline)
    assert mapper._mapper.log_odds is not None
    write_living(mapper._mapper.log_odds, tmp_path / "before.npz")

    def page(*_: object) -> str:
        with ThreadPoolExecutor(1) as pool:
            pool.submit(robot.run, [0.5 + 0.05 * i for i in range(10)], start=10).result(timeout=30)
        return "built"

    monkeypatch.setattr("swardmap.viz.map_page.map_page", page)
    mapper.save(tmp_path / "saved")
    assert mapper.mapped.total() == 20
    assert (tmp_path / "saved/report.html").read_text(encoding="utf-8") == "built"
    np.testing.assert_array_equal(read_map(tmp_path / "saved/map.yaml").classes, before.classes)
    told = json.loads((tmp_path / "saved/summary.json").read_text(encoding="utf-8"))
    assert told["frames"] == {"camera": 10}
    with np.load(tmp_path / "before.npz") as old, np.load(tmp_path / "saved/living.npz") as saved:
        for name in ("keys", "evidence", "person", "classes"):
            np.testing.assert_array_equal(saved[name], old[name])


def test_a_node_without_geometry_is_told_what_that_means() -> None:
    (severity, text), *_ = one_robot({"geometry": {"enabled": False}}).pipeline.events
    assert severity == Severity.WARN
    assert "grass is free however high it stands" in text
    assert not one_robot().pipeline.events


def far_steps(robot: Robot, start: int, count: int, at_m: tuple[float, float]) -> HealthReport:
    """Steps of a robot whose poses say that it is far away, all at once."""
    for i in range(start, start + count):
        stamp_ns = START_NS + i * PERIOD_NS
        robot.now_ns = stamp_ns + LATENCY_NS
        matrix = drive.base_at(0.05 * (i - start)).matrix.copy()
        matrix[:2, 3] += at_m
        T = Pose("map", drive.BASE, matrix)
        robot.pipeline.intake.on_odometry(drive.message(ODOMETRY, odometry_fields(T, stamp_ns)), robot.now_ns)
        robot.look("camera", drive.view(robot.rig, "camera", 0.05 * (i - start), i % 20), stamp_ns)
        robot.work()
    return robot.reports[-1]


UTM_M, DIAGONAL_M = (500_000.0, 5_800_000.0), (1_500.0, 1_500.0)


@pytest.mark.parametrize("settings", MODES[:2], ids=["paper", "evidence"])
@pytest.mark.parametrize("at_m", [UTM_M, DIAGONAL_M], ids=["UTM", "diagonal"])
def test_poses_that_jump_far_away_are_named_and_a_clear_recovers(
    settings: dict[str, Any], at_m: tuple[float, float]
) -> None:
    robot = one_robot(settings)
    assert not recovered(robot, 0, 25).stop
    before = robot.pipeline.mapper.snapshot(None)
    report = far_steps(robot, 25, 10, at_m)
    after = robot.pipeline.mapper.snapshot(None)
    assert before is not None
    assert after is not None
    assert after.spec == before.spec
    assert robot.pipeline.given_out(None) is not None
    assert report.stop
    assert {d.subject for d in report.diagnoses if d.fault == "too far"} == {"map"}
    (told,) = (d.message for d in report.diagnoses if d.fault == "too far")
    assert "more than 64000000" in told
    assert "clear" in told
    assert robot.pipeline.skipped["frame so far away that the map would become too large"] >= 8
    robot.pipeline.clear()
    cleared = robot.pipeline.mapper.snapshot(None)
    assert cleared is not None
    assert (cleared.classes == MapClass.UNKNOWN).all()
    assert not far_steps(robot, 35, 25, at_m).stop
    assert free_cells(robot.pipeline) > 0


def test_a_map_is_cleared_whatever_its_grid_has_become(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = one_robot()
    robot.run([0.05 * i for i in range(3)])
    before = robot.pipeline.mapper.snapshot(None)

    def fails(_: object) -> Any:
        raise InvalidValueError("grid: expected between 1 and 400000000 cells")

    with monkeypatch.context() as patch:
        patch.setattr(ObstacleMapper, "map", property(fails))
        robot.pipeline.clear()
    after = robot.pipeline.mapper.snapshot(None)
    assert before is not None
    assert after is not None
    assert after.spec == before.spec
    assert (after.classes == MapClass.UNKNOWN).all()


def test_a_robot_far_from_its_saved_map_is_told_so(tmp_path: Path) -> None:
    first = one_robot({"grid": {"mode": "evidence"}})
    first.run([0.1 * i for i in range(3)])
    saved = first.pipeline.mapper._mapper.log_odds
    assert saved is not None
    write_living(saved, tmp_path / "living.npz")
    robot = one_robot({"grid": {"mode": "evidence", "resume": str(tmp_path / "living.npz")}})
    report = far_steps(robot, 0, 5, UTM_M)
    assert robot.pipeline.given_out(None) is not None
    (told,) = (d.message for d in report.diagnoses if d.fault == "too far")
    assert "from the middle of the saved map" in told


def test_when_the_clock_of_all_goes_back_no_pose_is_made_of_two_times() -> None:
    """By 5 s: more than images may go back, less than transforms are remembered."""
    robot = one_robot()
    robot.run([0.1 * i for i in range(80)])
    robot.frames.clear()
    for i in range(30, 50):  # the same times again, 50 m aside
        stamp_ns = START_NS + i * PERIOD_NS
        robot.now_ns = stamp_ns + LATENCY_NS
        robot.pose(50.03 + 0.1 * i, stamp_ns + 30 * MS)
        robot.look("camera", drive.view(robot.rig, "camera", 0.1 * i, i % 20), stamp_ns)
        robot.work()
    assert len(robot.frames) > 10
    offset_m = robot.rig.T_base_camera("camera").position_m[0]
    for frame in robot.frames:
        x_m = 50.0 + 1.0 * (frame.stamp_ns - START_NS) / 1e9 + offset_m
        assert frame.T_map_camera is not None
        assert frame.T_map_camera.position_m[0] == pytest.approx(x_m, abs=1e-3)


def test_a_base_with_two_parents_in_tf_is_a_lost_pose_and_ends_nothing() -> None:
    rig = drive.rig_of(ONE)
    robot = Robot(pipeline_of(parameters({"source": {}}), rig), rig)

    def at(i: int, *parents: str) -> None:
        stamp_ns = START_NS + i * PERIOD_NS
        robot.now_ns = stamp_ns + LATENCY_NS
        for parent in parents:
            T = Pose(parent, drive.BASE, drive.base_at(0.05 * i).matrix)
            robot.pipeline.intake.on_tf(drive.transforms([T], stamp_ns), False, robot.now_ns)
        robot.step(i, 0.05 * i, posed=False)

    for i in range(25):
        at(i, "map")
    assert not robot.reports[-1].stop
    for i in range(25, 40):
        at(i, "map", "odom")
    assert robot.reports[-1].stop
    assert Fault.LOST_POSE in robot.reports[-1].faults("pose")
    assert "two parents" in str(robot.pipeline.facts["error"])
    assert any("two parents" in why for why in robot.pipeline.intake.poses.live.refused)


def test_a_frame_in_flight_when_the_clock_goes_back_is_not_of_the_new_map(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = one_robot()
    robot.run([0.05 * i for i in range(5)])
    build = robot.pipeline.intake.build_frame

    def built(job: Any) -> Frame:
        frame = build(job)
        robot.pipeline.clear()  # by another thread, while it was decoded
        return frame

    with monkeypatch.context() as patch:
        patch.setattr(robot.pipeline.intake, "build_frame", built)
        robot.step(5, 0.25)
    assert robot.pipeline.facts["mapped"] == {"camera": 5}
    assert snapshot(robot.pipeline) is None or free_cells(robot.pipeline) == 0
    assert robot.pipeline.mapper._newest_ns == 0
    robot.step(6, 0.3)
    assert robot.pipeline.facts["mapped"] == {"camera": 6}


def test_the_filter_of_flying_pixels_changes_for_depth_that_the_node_aligns() -> None:
    robot = one_robot({"cloud": {"consistent_neighbours": 0}})
    camera = robot.pipeline.intake.inputs["camera"]
    pairs: list[Any] = []
    for i in range(2):  # depth seen from 1 cm aside is rendered into the colour image
        frame = drive.view(robot.rig, "camera", 0.0, i)
        for topic, (kind, fields) in drive.camera_fields(frame, "camera", START_NS + i).items():
            which, what = topic.split("/")
            message = drive.message(kind, fields)
            if what == "camera_info":
                camera.add_info(which, message)
            else:
                pairs += camera.add_image(which, message, START_NS + i)
    aside = np.eye(4)
    aside[0, 3] = 0.01
    T_color_depth = Pose("color", "depth", aside)
    before = camera.build_frame(pairs[0], None, T_color_depth)
    robot.pipeline.configure(changed(robot.pipeline.parameters, {"cloud.consistent_neighbours": 8}, True))
    after = camera.build_frame(pairs[0], None, T_color_depth)
    assert not before.depth_filtered
    assert after.depth_filtered
    assert np.count_nonzero(after.depth) < np.count_nonzero(before.depth)
