"""The node over real DDS on loopback: a separate program plays a recording and receives every output."""

import importlib.util
import json
import os
import signal
import subprocess
import sys
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swardmap.config import config_from_dict
from swardmap.costmap import occupancy_from_costs
from swardmap.geometry import Intrinsics, Pose
from swardmap.io import open_source
from swardmap.io.map_files import read_map
from swardmap.io.ros_fields import camera_info_fields, image_fields, odometry_fields
from swardmap.models import build_segmenter
from swardmap.pipeline import ObstacleMapper
from swardmap.recording import MapRun, map_recording
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from tests.bags import IMAGE, INFO, ODOMETRY, Event, write_bag

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("rclpy is not installed (pip install 'swardmap[ros]')", allow_module_level=True)

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
START_NS = 1_700_000_000_000_000_000
FRAMES = 12
OPTICAL = "camera_color_optical_frame"

SETTINGS = {
    "segmenter": {"name": "colour"},
    "source": {"odometry_topic": "/odom"},
    "watchdog": {"forget_s": 600.0},
}
RELIABLY = {"queue_frames": 100, "image_reliability": "reliable", "image_depth": 50, "map_rate_hz": 20.0}


def environment() -> dict[str, str]:
    # a domain for each worker; a namespace for each test besides, since others may use this machine
    domain = 1 + (os.getpid() % 99)
    return os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(domain)}


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


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag"), "mcap", garden_events())


@pytest.fixture(scope="module")
def offline(bag: Path) -> MapRun:
    return map_recording(bag, config=config_from_dict(SETTINGS))


@dataclass
class Robot:
    """A running node, and the programs that talk to it."""

    process: "subprocess.Popen[str]"
    namespace: str
    folder: Path

    def play(self, bag: Path, *options: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Arrays by name, and what was told, of all outputs while a recording was played."""
        out = self.folder / f"{uuid.uuid4().hex}.npz"
        command = [sys.executable, str(HERE / "player.py"), str(bag), str(out), self.namespace, *options]
        subprocess.run(command, env=environment(), check=True, timeout=200)
        with np.load(out, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        return arrays, json.loads(str(arrays.pop("told")))

    def ask(self, *questions: list[Any]) -> list[Any]:
        command = [sys.executable, str(HERE / "ask.py"), self.namespace, json.dumps(questions)]
        done = subprocess.run(
            command, env=environment(), check=True, capture_output=True, text=True, timeout=200
        )
        answers: list[Any] = json.loads(done.stdout)
        return answers


@contextmanager
def running(folder: Path, settings: dict[str, Any], node: dict[str, Any]) -> Iterator[Robot]:
    """The node, started as a user starts it: `swardmap ros --params FILE`, here in a namespace."""
    namespace = f"/t{uuid.uuid4().hex[:8]}"
    file = folder / f"{namespace[1:]}.yaml"
    # ROS parameters are YAML, and so is JSON
    file.write_text(json.dumps({"/**": {"ros__parameters": node | settings}}))
    command = [
        sys.executable,
        "-m",
        "swardmap",
        "ros",
        "--params",
        str(file),
        "--",
        "-r",
        f"__ns:={namespace}",
    ]
    remapped = ["-r", "/odom:=odom"]
    with subprocess.Popen([*command, *remapped], env=environment(), text=True, cwd=folder) as process:
        try:
            yield Robot(process, namespace, folder)
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            assert process.wait(timeout=30) in (0, -signal.SIGKILL)


def assert_same_map(heard: dict[str, Any], offline: MapRun) -> None:
    assert offline.grid is not None
    assert offline.costmap is not None
    last_ns = START_NS + (FRAMES - 1) * 100_000_000
    np.testing.assert_array_equal(heard[f"map/{last_ns}"], offline.grid.nav_values)
    np.testing.assert_array_equal(heard[f"costmap/{last_ns}"], occupancy_from_costs(offline.costmap.costs))
    x, y, resolution_m = heard[f"map_at/{last_ns}"]
    assert (x, y) == offline.grid.spec.origin_m
    assert resolution_m == pytest.approx(offline.grid.spec.resolution_m)


def test_every_output_equals_the_map_of_the_recording(bag: Path, offline: MapRun, tmp_path: Path) -> None:
    config = config_from_dict(SETTINGS)
    with running(tmp_path, SETTINGS, RELIABLY) as robot:
        heard, told = robot.play(bag)
        saved, other = robot.ask(["call", "save"], ["state"])
        assert other == "active"
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
    assert names == {"other", "grass", "void"}
    assert told["diagnostics"] > 0
    last = told["health"][-1]
    assert last["mapped"] == {"camera": FRAMES}
    assert not last["left_out"]
    assert 0 < last["latency_p50_ms"] <= last["latency_p99_ms"]


def test_poses_that_come_late_are_waited_for(bag: Path, offline: MapRun, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY | {"pose_wait_ms": 3000.0}) as robot:
        heard, _ = robot.play(bag, "--late", "0.35")
    assert_same_map(heard, offline)


def test_poses_that_come_too_late_map_nothing(bag: Path, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY | {"pose_wait_ms": 50.0}) as robot:
        heard, told = robot.play(bag, "--late", "0.6", "--count", "4", "--wait", "2")
    assert not told["health"][-1]["mapped"]
    assert told["health"][-1]["left_out"] == {"no pose of the camera at the time of the image": 4}
    assert told["health"][-1]["stop"]
    assert "map_last" not in heard


def test_with_30_percent_lost_nothing_is_free_that_is_not(bag: Path, offline: MapRun, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY) as robot:
        heard, told = robot.play(bag, "--drop", "0.3", "--wait", "3")
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
    np.testing.assert_array_equal(heard["map_last"], mapper.map.nav_values)


def test_a_killed_node_comes_back(bag: Path, offline: MapRun, tmp_path: Path) -> None:
    with running(tmp_path, SETTINGS, RELIABLY) as robot:
        robot.play(bag, "--count", "5")
        robot.process.kill()
        robot.process.wait(timeout=30)
    with running(tmp_path, SETTINGS, RELIABLY) as again:
        heard, _ = again.play(bag)
    assert_same_map(heard, offline)


def test_silence_turns_free_space_unknown_and_sets_the_flag(bag: Path, tmp_path: Path) -> None:
    settings = SETTINGS | {"watchdog": {"forget_s": 1.0, "recover_s": 0.2, "stale_s": 2.0}}
    with running(tmp_path, settings, RELIABLY) as robot:
        heard, told = robot.play(bag, "--linger", "4.0")
    after = heard["map_last"]
    assert (heard["map_most"] == 0).sum() > 1000
    assert (after == 0).sum() == 0  # no stale free space
    assert (after == 100).sum() > 50  # what stood there is still given
    assert any(not stop for _, stop in told["stops"])  # it had been free to go
    assert told["stops"][-1][1]
    assert {"stopped"} <= {f["fault"] for f in told["health"][-1]["faults"]}


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
        assert "staged" in road[1]
        assert cleared[0]
        assert not no_map[0]
        assert "no map yet" in no_map[1]
        assert paused[0]
        _, told = robot.play(bag, "--count", "3", "--wait", "2")
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
