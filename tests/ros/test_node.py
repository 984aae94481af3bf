"""The node over real DDS on loopback: a separate program plays a recording and receives every output."""

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.config import config_from_dict
from swardmap.geometry import Pose, mount_pose
from swardmap.grid import GridSpec
from swardmap.io import open_source
from swardmap.io.bags.ros_fields import camera_info_fields, image_fields, odometry_fields, tf_fields
from swardmap.io.files import write_text
from swardmap.io.maps.map_files import read_map
from swardmap.io.maps.margin_file import Margin, margin_text
from swardmap.mapping.costmap import occupancy_from_costs
from swardmap.models import build_segmenter
from swardmap.pipeline import ObstacleMapper
from swardmap.ros.map_outputs import OF_MAP
from swardmap.ros.outputs import OF_CAMERA, OF_NODE
from swardmap.runs.recording import MapRun, map_recording
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from tests.bags import IMAGE, INFO, ODOMETRY, TF, Event, write_bag
from tests.ros import drive
from tests.ros.node_process import RELIABLY, environment, running

if find_spec("rclpy") is None:
    pytest.skip("rclpy is not installed (pip install 'swardmap[ros]')", allow_module_level=True)

pytestmark = pytest.mark.slow

SMALL = drive.SMALL
START_NS = drive.START_NS
FRAMES = 12
SLOW_NS = 250_000_000
OPTICAL = "camera_color_optical_frame"

SETTINGS = {
    "segmenter": {"name": "colour"},
    "source": {"odometry_topic": "/odom"},
    "watchdog": {"forget_s": 600.0},
}


def garden_events() -> Iterator[Event]:
    source = AnalyticSource(garden_scene(0), tuple(lane_poses(FRAMES, step_m=0.25)), SMALL, 100_000_000)
    for frame in source:
        stamp_ns = START_NS + frame.stamp_ns
        assert frame.T_map_camera is not None
        T = Pose("map", OPTICAL, frame.T_map_camera.matrix)
        info = camera_info_fields(SMALL, stamp_ns, OPTICAL)
        yield stamp_ns, "/odom", ODOMETRY, odometry_fields(T, stamp_ns)
        yield stamp_ns, "/color/camera_info", INFO, info
        yield stamp_ns, "/depth/camera_info", INFO, info
        yield stamp_ns, "/color/image_raw", IMAGE, image_fields(frame.rgb, stamp_ns, OPTICAL)
        yield stamp_ns, "/depth/image_raw", IMAGE, image_fields(frame.depth, stamp_ns, OPTICAL)


def tf_events() -> Iterator[Event]:
    """The same drive, but poses are a tree: map, odom, base_link, and the camera on it."""
    mount = mount_pose(0.9, 20.0, parent="base_link", child=OPTICAL)
    yield START_NS, "/tf_static", TF, tf_fields([mount], START_NS)
    for event in garden_events():
        stamp_ns, topic, _, fields = event
        if topic != "/odom":
            yield event
            continue
        assert isinstance(fields, dict)
        place = fields["pose"]["pose"]["position"]
        half = base_pose(place["x"] / 2, place["y"], "odom", "base_link")
        other = base_pose(place["x"] / 2, 0.0, "map", "odom")
        yield stamp_ns, "/tf", TF, tf_fields([half], stamp_ns)
        yield stamp_ns, "/tf", TF, tf_fields([other], stamp_ns)


def base_pose(x_m: float, y_m: float, parent: str, child: str) -> Pose:
    matrix = np.eye(4)
    matrix[:2, 3] = x_m, y_m
    return Pose(parent, child, matrix)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag"), "mcap", garden_events())


@pytest.fixture(scope="module")
def offline(bag: Path) -> MapRun:
    return map_recording(bag, config=config_from_dict(SETTINGS))


def part_of(heard: dict[str, Any], name: str, spec: GridSpec) -> NDArray[np.int8]:
    """The cells of a grid in one that was given out, which reaches around the robot, too."""
    kind = name.replace("_", "/").split("/")[0]
    x, y, resolution_m = heard[f"{kind}_at_last" if name.endswith("_last") else name.replace("/", "_at/")]
    assert resolution_m == pytest.approx(spec.resolution_m)
    ix, iy = np.round((np.array(spec.origin_m) - (x, y)) / spec.resolution_m).astype(int).tolist()
    assert ix >= 0
    assert iy >= 0
    whole: NDArray[np.int8] = heard[name]
    assert whole.shape[0] >= iy + spec.height
    assert whole.shape[1] >= ix + spec.width
    if kind == "map":  # nothing is known beside it
        assert (whole != -1).sum() == (whole[iy:, ix:][: spec.height, : spec.width] != -1).sum()
    return whole[iy : iy + spec.height, ix : ix + spec.width]


def assert_same_map(heard: dict[str, Any], offline: MapRun) -> None:
    assert offline.grid is not None
    assert offline.costmap is not None
    last_ns, spec = START_NS + (FRAMES - 1) * 100_000_000, offline.grid.spec
    np.testing.assert_array_equal(part_of(heard, f"map/{last_ns}", spec), offline.grid.nav_values)
    costs = occupancy_from_costs(offline.costmap.costs)
    np.testing.assert_array_equal(part_of(heard, f"costmap/{last_ns}", spec), costs)


def assert_published(topics: dict[str, list[str]], namespace: str) -> None:
    """What the node publishes is what the documents and the files for Nav2 name."""
    there = {name.removeprefix(f"{namespace}/swardmap/"): types for name, types in topics.items()}
    expected = {name: [kind] for name, kind in OF_NODE.items()}
    expected |= {f"camera/{name}": [kind] for name, kind in OF_CAMERA.items()}
    expected |= {name: [kind] for name, kind in OF_MAP.items()}
    missing = set(expected) - set(there)
    may_lack = [("map_msgs", {"map_updates", "costmap_updates"}), ("vision_msgs", {"label_info", "persons"})]
    allowed = {name for package, names in may_lack if find_spec(package) is None for name in names}
    instead = {"labels_json", "persons_json"} if find_spec("vision_msgs") is not None else set()
    assert missing == allowed | instead
    assert there["/diagnostics"] == ["diagnostic_msgs/msg/DiagnosticArray"]
    for name in set(expected) - missing:
        assert there[name] == expected[name]


def test_every_output_equals_the_map_of_the_recording(bag: Path, offline: MapRun, tmp_path: Path) -> None:
    config = config_from_dict(SETTINGS)
    with running(tmp_path, SETTINGS, RELIABLY) as robot:
        heard, told = robot.play(bag)
        saved, other, topics = robot.ask(["call", "save"], ["state"], ["topics"])
        assert other == "active"
        assert_published(topics, robot.namespace)
        assert saved[0], saved[1]
        assert_same_map(heard, offline)
        assert offline.grid is not None
        np.testing.assert_array_equal(read_map(Path(saved[1]) / "map.yaml").classes, offline.grid.classes)
    mapper = ObstacleMapper(build_segmenter(config.segmenter), config)
    frames = 0
    for step in mapper.run(open_source(bag, config.source)):
        stamp = step.frame.stamp_ns
        np.testing.assert_array_equal(heard[f"mask/{stamp}"], step.segmentation.labels)
        assert (heard[f"confidence/{stamp}"] == 255).all()  # this segmenter has none of its own
        cloud = step.cloud(config)
        received = heard[f"cloud/{stamp}"]
        np.testing.assert_array_equal(received[:, 3], cloud.labels)
        in_map = step.T_map_camera.apply(received[:, :3])
        np.testing.assert_allclose(in_map, cloud.xyz, atol=1e-5)
        hazard = cloud.label_set.map_class_table[cloud.labels] >= 2
        np.testing.assert_array_equal(heard[f"obstacles/{stamp}"][:, :3], received[hazard, :3])
        frames += 1
    assert frames == FRAMES
    names = {c["class_name"] for c in json.loads(str(heard["labels"]))}
    assert names - {"void"} == {"other", "grass"}
    if find_spec("map_msgs") is not None:  # whole maps and updates, one after another
        assert told["updates"] > 0
        patched = heard | {"map_last": heard["map_patched"]}
        np.testing.assert_array_equal(
            part_of(patched, "map_last", offline.grid.spec), offline.grid.nav_values
        )
    assert told["diagnostics"] > 0
    last = told["health"][-1]
    assert last["mapped"] == {"camera": FRAMES}
    assert not last["left_out"]
    assert 0 < last["latency_p50_ms"] <= last["latency_p99_ms"]
    assert 0 < last["costmap_latency_p50_ms"] <= last["costmap_latency_p99_ms"]
    assert last["first_map_s"] < 3  # whatever has to be compiled was compiled before
    assert last["dropped_by_queue"] == {}
    assert 0 < last["cores_used"] <= last["cores"]


@pytest.mark.skipif(find_spec("tf2_msgs") is None, reason="this ROS has no tf2_msgs")
def test_poses_by_tf_give_the_map_of_the_recording(tmp_path: Path) -> None:
    bag = write_bag(tmp_path, "mcap", tf_events())
    settings = {name: value for name, value in SETTINGS.items() if name != "source"}
    offline = map_recording(bag, config=config_from_dict(settings))
    with running(tmp_path, settings, RELIABLY) as robot:
        heard, _ = robot.play(bag)
    assert_same_map(heard, offline)


def test_poses_that_come_late_are_waited_for(bag: Path, offline: MapRun, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY | {"pose_wait_ms": 3000.0}) as robot:
        heard, _ = robot.play(bag, "--late", "0.35")
    assert_same_map(heard, offline)


def test_poses_that_come_too_late_map_nothing(bag: Path, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY | {"pose_wait_ms": 50.0}) as robot:
        heard, told = robot.play(bag, "--late", "0.6", "--count", "4")
    assert not told["health"][-1]["mapped"]
    assert told["health"][-1]["left_out"] == {"no pose of the camera at the time of the image": 4}
    assert told["health"][-1]["stop"]
    assert "map_last" not in heard


def test_with_30_percent_lost_nothing_is_free_that_is_not(bag: Path, offline: MapRun, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY) as robot:
        heard, told = robot.play(bag, "--drop", "0.3")
    last = told["health"][-1]
    assert 0 < last["mapped"]["camera"] < FRAMES
    assert sum(last["left_out"].values()) > 0
    # what is left makes the map of the frames that got through, each of them whole
    stamps = sorted(int(name.split("/")[1]) for name in heard if name.startswith("mask/"))
    assert len(stamps) == last["mapped"]["camera"]
    config = config_from_dict(SETTINGS)
    mapper = ObstacleMapper(build_segmenter(config.segmenter), config)
    for frame in open_source(bag, config.source):
        if frame.stamp_ns in stamps:
            mapper.step(frame)
    assert mapper.map is not None
    np.testing.assert_array_equal(part_of(heard, "map_last", mapper.map.spec), mapper.map.nav_values)


def test_a_killed_node_comes_back(bag: Path, offline: MapRun, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY) as robot:
        robot.play(bag, "--count", "5")
        robot.kill()
    with running(tmp_path, SETTINGS, RELIABLY) as again:
        heard, told = again.play(bag)
    assert told["stops"][0][1]  # it begins with stop
    assert_same_map(heard, offline)


def test_camera_and_odometry_that_offer_best_effort_are_heard_too(bag: Path, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY | {"image_reliability": "auto"}) as robot:
        _, first = robot.play(bag, "--best-effort", "--count", "4")
        _, again = robot.play(bag)  # the camera is back, reliable now: each image once
    assert first["health"][-1]["mapped"]["camera"] >= 1
    before, after = again["health"][0]["mapped"]["camera"], again["health"][-1]["mapped"]["camera"]
    assert after == before + FRAMES


def test_of_a_rig_the_pair_that_faces_the_way_makes_one_map(tmp_path: Path) -> None:
    rig_file = tmp_path / "rig.yaml"
    rig_file.write_text(json.dumps(drive.RIG))
    rig = drive.rig_of(drive.RIG)
    forward, backward = [0.1 * i for i in range(8)], [0.65 - 0.1 * i for i in range(14)]
    # slowly, so that a busy machine does not hear of the turn before it has seen the images before it
    events = drive.drive_events(rig, [*forward, *backward], SLOW_NS)
    bag = write_bag(tmp_path, "mcap", events)
    # an obstacle is never cleared here, so that the order in which cameras are mapped does not matter
    grid: dict[str, Any] = {"obstacle_clear_frames": 255, "person_clear_frames": 255}
    grid |= {"origin_m": [-13.0, -13.0], "size_m": [26.0, 26.0]}  # a map that grows does so in that order
    settings = SETTINGS | {"grid": grid}
    with running(tmp_path, settings, RELIABLY | {"rig_file": str(rig_file)}) as robot:
        heard, told = robot.play(bag, "--cameras", ",".join(rig.names))
    last = told["health"][-1]
    assert last["direction"] == "backward"
    assert last["active"] == ["rear_left", "rear_right"]
    assert set(last["rates_hz"]) == set(rig.names)
    mapper = ObstacleMapper(build_segmenter(config_from_dict(settings).segmenter), config_from_dict(settings))
    for name in rig.names:
        stamps = sorted(int(key.split("/")[2]) for key in heard if key.startswith(f"{name}/mask/"))
        assert len(stamps) == last["mapped"][name] >= 3
        assert last["dropped"][name] >= 3
        assert len(stamps) + last["dropped"][name] >= 20  # of 22; some may wait when the direction changes
        for stamp in stamps:
            i = (stamp - START_NS) // SLOW_NS
            x_m = [*forward, *backward][i]
            T = drive.base_at(x_m) @ rig.T_base_camera(name)
            mapper.step(replace(drive.view(rig, name, x_m, i), stamp_ns=0, T_map_camera=T))
    assert mapper.map is not None
    np.testing.assert_array_equal(part_of(heard, "map_last", mapper.map.spec), mapper.map.nav_values)


def test_a_rig_that_asks_more_than_the_cores_map_is_given_the_smaller_network(tmp_path: Path) -> None:
    rig_file = tmp_path / "rig.yaml"
    hasty = {name: camera | {"rate_hz": 1000.0} for name, camera in drive.RIG["cameras"].items()}
    rig_file.write_text(json.dumps(drive.RIG | {"cameras": hasty}))
    for named, taken in (("auto", "small"), ("large", "large")):
        settings = SETTINGS | {"segmenter": {"name": named}}
        with running(tmp_path, settings, RELIABLY | {"rig_file": str(rig_file)}) as robot:
            assert robot.ask(["get", "segmenter.name"]) == [taken]


def test_work_area_margin_geometry_and_evidence_give_the_costs_of_the_recording(
    bag: Path, tmp_path: Path
) -> None:
    pytest.importorskip("pyproj")
    from swardmap.mapping.geodesy import Projection

    ring = Projection(52.4, 16.9).to_gps([(-1, -1.5), (4, -1.5), (4, 1.5), (-1, 1.5)]).tolist()
    lawn, margin = tmp_path / "lawn.geojson", tmp_path / "margin.yaml"
    lawn.write_text(json.dumps({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}))
    write_text(margin, margin_text(Margin(0.21, 0.34), "Measured."))
    settings = SETTINGS | {
        "area": {"file": str(lawn), "datum_lat": 52.4, "datum_lon": 16.9},
        "grid": {"mode": "evidence"},
        "geometry": {"enabled": True},
    }
    costs = {"margin_m": 0.21, "person_margin_m": 0.34}
    expected = map_recording(bag, config=config_from_dict(settings | {"costmap": costs}))
    with running(tmp_path, settings, RELIABLY | {"margin_file": str(margin)}) as robot:
        heard, _ = robot.play(bag)
        assert robot.ask(["get", "costmap.margin_m"], ["get", "costmap.person_margin_m"]) == [0.21, 0.34]
        (refused,) = robot.ask(["set", "margin_file", "other.yaml"])
    assert_same_map(heard, expected)
    assert not refused[0]
    assert "costmap.margin_m" in refused[1]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("not: [a parameter file", "params file"),
        ("/**: {ros__parameters: {grid: {resolution_m: fine}}}", "grid.resolution_m"),
        ("/**: {ros__parameters: {grid: {resolution_m: -0.1}}}", "resolution_m: expected at least"),
        ("/**: {ros__parameters: {rig_file: nowhere.yaml}}", "could not be configured"),
    ],
)
def test_what_is_wrong_with_the_parameters_is_one_line(text: str, expected: str, tmp_path: Path) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(text)
    command = [sys.executable, "-m", "swardmap", "ros", "--params", str(file)]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("swardmap: ")]
    assert expected in line


def test_transitions_that_a_state_does_not_allow_are_refused_and_the_node_lives(tmp_path: Path) -> None:
    """As Nav2's lifecycle manager with `autostart` asks a node that has started by itself."""
    # 1: configure, 2: cleanup, 3: activate, 4: deactivate, 5: shut down when unconfigured
    with running(tmp_path, SETTINGS, RELIABLY) as robot:
        answers = robot.ask(*(["change", i] for i in (1, 3, 2, 5)), ["state"], ["change", 99], ["state"])
        assert answers == [False, False, False, False, "active", False, "active"]
        assert robot.ask(["change", 4], ["change", 4], ["change", 2], ["state"]) == [
            True, False, True, "unconfigured"
        ]  # fmt: skip
        assert robot.ask(["change", 1], ["change", 3], ["state"]) == [True, True, "active"]
        assert robot.process.poll() is None


def test_a_start_area_is_granted_by_the_service(bag: Path, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY) as robot:
        (early,) = robot.ask(["call", "grant_start_area"])
        assert not early[0]
        assert "pose" in early[1]


def test_a_drive_is_recorded_by_the_service(bag: Path, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY) as robot:
        (begun,) = robot.ask(["call", "teach_record", True])
        assert begun[0]
        robot.play(bag)
        (ended,) = robot.ask(["call", "teach_record", False])
    assert ended[0]
    assert "swardmap teach" in ended[1]
    (folder,) = (tmp_path / "swardmap_maps").iterdir()
    recorded, played = list(open_source(folder)), list(open_source(bag))
    assert len(recorded) > 3
    first = next(f for f in played if np.array_equal(f.rgb, recorded[0].rgb))
    shift_ns = recorded[0].stamp_ns - first.stamp_ns  # it is played at another time
    for frame in recorded:
        truth = next(f for f in played if f.stamp_ns + shift_ns == frame.stamp_ns)
        np.testing.assert_array_equal(frame.rgb, truth.rgb)
        assert frame.T_map_camera is not None
        assert truth.T_map_camera is not None
        np.testing.assert_allclose(frame.T_map_camera.matrix, truth.T_map_camera.matrix, atol=1e-6)


def test_parameters_services_and_states(bag: Path, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY) as robot:
        robot.play(bag, "--count", "3")
        changed, now, same, refused, wrong, road, cleared, no_map, paused = robot.ask(
            ["set", "cloud.max_range_m", 5.0],
            ["get", "cloud.max_range_m"],
            ["set", "grid.resolution_m", 0.05],
            ["set", "grid.resolution_m", 0.1],
            ["set", "cloud.max_range_m", 0.1],
            ["set", "cloud.voxel_m", 0.05],
            ["call", "clear"],
            ["call", "save"],
            ["call", "pause", True],
        )
        assert changed == [True, ""]
        assert now == 5.0
        assert same[0]  # it is no change
        assert not refused[0]
        assert "begin anew" in refused[1]
        assert not wrong[0]
        assert "min_range_m below max_range_m" in wrong[1]
        assert not road[0]
        assert "backend: plain" in road[1]
        assert cleared[0]
        assert not no_map[0]
        assert "no map yet" in no_map[1]
        assert paused[0]
        _, told = robot.play(bag, "--count", "3")
        assert told["health"][-1]["stop"]
        assert told["health"][-1]["left_out"]["image while the node was paused"] == 3
        # 4: deactivate, 2: cleanup, 1: configure, 3: activate
        assert robot.ask(["change", 4], ["state"]) == [True, "inactive"]
        state = robot.ask(
            ["change", 2], ["state"], ["set", "grid.resolution_m", 0.1], ["change", 1], ["change", 3]
        )
        assert state == [True, "unconfigured", [True, ""], True, True]
        heard, _ = robot.play(bag)
    coarse = map_recording(
        bag,
        config=config_from_dict(SETTINGS | {"grid": {"resolution_m": 0.1}, "cloud": {"max_range_m": 5.0}}),
    )
    assert_same_map(heard, coarse)
