"""The gate: what is refused and why, its zone against simulated braking, a mower that stops for a person."""

import math
import os
import re
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.errors import ConfigError
from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.ros import near_frame as near_frame_module
from swardmap.ros.clouds import obstacle_cells_fields
from swardmap.ros.gate import Command, GateConfig, GateInputs, nearest_in_zone_m, reach_m, refusal
from swardmap.ros.gate_node import GateNode, cell_centres_m, cloud_points_m
from swardmap.ros.messages import ros_message
from swardmap.ros.near_frame import NearFrames, in_frame, near_frame
from swardmap.ros.topics import BEST_EFFORT, image_qos
from tests.ros import drive
from tests.ros.node_process import ROOT, environment, running
from tests.ros.test_clouds import CLOUD

CONFIG = GateConfig()
AHEAD = Command(0.4, 0.0)


def pose_at(x_m: float, y_m: float, heading_rad: float) -> Pose:
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return Pose("map", "base_link", np.array([[c, -s, 0, x_m], [s, c, 0, y_m], [0, 0, 1, 0.2], [0, 0, 0, 1]]))


def known(**changes: object) -> GateInputs:
    fresh = {"stop": False, "T_map_base": pose_at(0, 0, 0), "flag_s": 9.9, "cells_s": 9.9, "pose_s": 9.9}
    return GateInputs(**fresh | changes)  # type: ignore[arg-type]


def test_with_all_well_and_the_way_free_it_lets_through() -> None:
    assert refusal(AHEAD, known(), 10.0, CONFIG) == ""


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"stop": None}, "no stop flag"),
        ({"flag_s": 9.4}, "no stop flag"),
        ({"stop": True}, "stop flag is set"),
        ({"cells_s": 8.9}, "no map"),
        ({"T_map_base": None}, "no pose"),
        ({"pose_s": 9.4}, "no pose"),
        ({"cells_m": np.array([[0.6, 0.1]])}, "an obstacle is 0.61 m"),
    ],
)
def test_what_speaks_against_it_is_named(changes: dict[str, object], reason: str) -> None:
    assert reason in refusal(AHEAD, known(**changes), 10.0, CONFIG)
    assert refusal(Command(0.0, 0.0), known(**changes), 10.0, CONFIG) == ""  # who stands still may go on


@pytest.mark.parametrize("command", [Command(math.nan, 0.0), Command(0.0, math.inf)])
def test_what_is_no_number_is_refused(command: Command) -> None:
    assert "not a number" in refusal(command, known(), 10.0, CONFIG)


@given(
    st.floats(-1.5, 1.5),
    st.floats(-3, 3),
    st.floats(-3, 3),
    st.floats(-math.pi, math.pi),
    st.floats(0.0, 0.5),
)
def test_no_obstacle_is_run_over_by_a_robot_that_brakes_when_it_is_refused(
    speed_mps: float, x_m: float, y_m: float, heading_rad: float, margin_m: float
) -> None:
    """Its body, grown by the margin, is moved step by step until it stands."""
    config = GateConfig(margin_m=margin_m)
    T_map_base = pose_at(1.0, -2.0, heading_rad)
    cell = T_map_base.apply(np.array([[x_m, y_m, 0.0]]))[:, :2]
    command = Command(speed_mps, 0.0)
    found = nearest_in_zone_m(cell, T_map_base, command, config)
    at_m, v, t, hit = 0.0, abs(speed_mps), 0.0, False
    toward = x_m if speed_mps > 0 else -x_m
    front_m = config.front_m if speed_mps > 0 else config.rear_m
    while v > 0 and command.moves:
        hit |= 0 <= toward - at_m <= front_m + margin_m and abs(y_m) <= config.half_width_m + margin_m
        at_m, t = at_m + v * 0.01, t + 0.01
        v = v if t < config.reaction_s else v - config.brake_mps2 * 0.01
    if hit:
        assert found == pytest.approx(math.hypot(x_m, y_m), abs=1e-9)
    if found is not None:  # and it is not refused for what lies elsewhere
        assert abs(y_m) <= config.half_width_m + margin_m + 1e-5
        assert -1e-5 <= toward <= front_m + margin_m + reach_m(abs(speed_mps), config) + 1e-5


def test_turning_on_the_spot_needs_a_free_circle() -> None:
    beside = np.array([[0.0, 0.55]])
    assert nearest_in_zone_m(beside, pose_at(0, 0, 0), Command(0.0, 0.3), CONFIG) == pytest.approx(0.55)
    assert nearest_in_zone_m(beside, pose_at(0, 0, 0), Command(0.3, 0.0), CONFIG) is None
    assert nearest_in_zone_m(np.zeros((0, 2)), pose_at(0, 0, 0), Command(0.3, 0.3), CONFIG) is None


def test_limits_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(ConfigError, match="turn_radius_m"):
        GateConfig(turn_radius_m=0.2)


def test_the_cells_are_those_that_the_node_sends() -> None:
    classes = np.zeros((4, 6), np.uint8)
    classes[1, 2] = classes[3, 0] = 2
    grid = OccupancyGrid(GridSpec(0.5, 6, 4, (-1.0, 2.0), "map"), classes)
    message = drive.message(CLOUD, obstacle_cells_fields(grid, (0.0, 0.0), 10.0))
    np.testing.assert_allclose(cell_centres_m(message), [[0.25, 2.75], [-0.75, 3.75]])


def test_cells_of_a_map_far_from_its_origin_are_taken_where_they_are() -> None:
    """A gate that reads them as they come sees nothing ahead: they are 5000 km from the robot."""
    x_m, y_m = 500_123.4, 5_000_456.7
    T = np.eye(4)
    T[:2, 3] = x_m, y_m
    inputs = known(T_map_base=Pose("map", "base_link", T))
    spec = GridSpec(0.05, 100, 40, (500_122.0, 5_000_455.7), "map")
    classes = np.zeros(spec.shape, np.uint8)
    ix, iy = spec.cell_of((x_m + 0.6, y_m))
    classes[iy, ix] = MapClass.OBSTACLE
    message = drive.message(CLOUD, obstacle_cells_fields(OccupancyGrid(spec, classes), (x_m, y_m), 10.0))
    points, frame = in_frame(cloud_points_m(message), message.header.frame_id, "map")
    assert frame == "map"
    np.testing.assert_allclose(points[:, :2], [spec.center_of((ix, iy))], atol=1e-3)
    inputs.cells_m = cell_centres_m(message, "map")
    assert refusal(AHEAD, inputs, 10.0, CONFIG).startswith("an obstacle is 0.6")


def test_cells_of_a_frame_that_leads_nowhere_stay_in_it() -> None:
    """The gate then refuses, for they are not in the frame of its poses."""
    points = np.ones((2, 3))
    for frame, wanted in (("map", "odom"), ("map", ""), ("map_e10000_n0", "odom"), ("a_e1_n2", "a_e1_n2")):
        found, named = in_frame(points, frame, wanted)
        assert named == frame
        assert found is points


def test_a_frame_near_the_robot_is_told_of_once_and_every_one_stays_latched(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(near_frame_module, "latched_qos", lambda: None)
    monkeypatch.setattr(near_frame_module, "ros_message", lambda _, fields: fields)
    sent: list[Any] = []
    said: list[str] = []
    node = SimpleNamespace(
        create_publisher=lambda *_: SimpleNamespace(publish=sent.append),
        get_logger=lambda: SimpleNamespace(warning=said.append),
    )
    near, farther = near_frame("map", (500_123.0, 5_000_456.0)), near_frame("map", (520_000.0, 5_000_456.0))
    frames = NearFrames(node, "tf")
    for frame in (None, near, near, farther, near):
        frames.tell(frame, 1)
    told = [[t["child_frame_id"] for t in message["transforms"]] for message in sent]
    assert told == [["map_e500000_n5000000"], ["map_e500000_n5000000", "map_e520000_n5000000"]]
    assert sent[0]["transforms"][0]["transform"]["translation"] == {"x": 5e5, "y": 5e6, "z": 0.0}
    without = NearFrames(node, None)
    for _ in range(2):
        without.tell(near, 1)
    assert len(said) == 1
    assert len(sent) == 2


@pytest.mark.skipif(find_spec("rclpy") is None, reason="needs rclpy")
def test_the_gate_reads_cells_far_from_the_origin_in_the_frame_of_its_poses() -> None:
    import rclpy
    from sensor_msgs.msg import PointCloud2

    around_m = (500_123.0, 5_000_456.0)
    spec = GridSpec(0.05, 20, 20, around_m, "map")
    cells = obstacle_cells_fields(OccupancyGrid(spec, np.full(spec.shape, 2, np.uint8)), around_m, 10.0)
    with mock.patch.dict(os.environ, environment()):
        rclpy.init()
        try:
            gate = GateNode()
            gate.on_cells(ros_message(PointCloud2, cells))
            assert gate.frames["map"] == "map_e500000_n5000000", "no pose was heard yet"
            gate.frames["pose"] = "map"
            gate.on_cells(ros_message(PointCloud2, cells))
            assert gate.frames["map"] == "map"
            assert np.abs(gate.inputs.cells_m.min(axis=0) - (np.array(around_m) + 0.025)).max() < 1e-3
        finally:
            rclpy.shutdown()


SIMULATED = {
    "segmenter": {"name": "colour"},
    "source": {"odometry_topic": "odom"},
    "mount": {"height_m": 0.9, "pitch_deg": 25.0, "x_m": 0.3},
    "watchdog": {"stopped_s": 2.0, "stale_s": 2.0, "pose_s": 2.0},
}


def drive_to_the_person(folder: Path, kill_after_m: float | None = None) -> tuple[float, float]:
    """How far the mower of the example drove, and what was left, in metres."""
    with running(folder, SIMULATED, {}) as robot:
        assert robot.ask(["state"]) == ["active"]  # on a busy machine getting ready may take a minute
        options = ["--ros-args", "-r", f"__ns:={robot.namespace}", "-p", "pose_timeout_s:=2.0"]
        options += ["-p", "flag_timeout_s:=2.0", "-p", "map_timeout_s:=3.0"]  # a busy machine is no fault
        gate = [sys.executable, "-m", "swardmap.ros.gate_node", *options]
        mower = [sys.executable, str(ROOT / "examples/simulated_mower.py"), *options[:3]]
        out = folder / "out.txt"
        with subprocess.Popen(gate, env=environment()) as gate_process:
            try:
                with out.open("w") as file:
                    driving = subprocess.Popen(
                        mower, env=environment() | {"PYTHONUNBUFFERED": "1"}, stdout=file
                    )
                if kill_after_m is not None:
                    wait_for(out, kill_after_m)
                    robot.kill()
                driving.wait(timeout=400)
            finally:
                os.kill(gate_process.pid, signal.SIGINT)
        said = re.search(r"drove (\S+) m in \d+ s, (\S+) m left", out.read_text())
        assert said is not None
        return float(said[1]), float(said[2])


def wait_for(out: Path, distance_m: float) -> None:
    end = time.monotonic() + 400
    while time.monotonic() < end:
        driven = re.findall(r"at (\S+) m", out.read_text())
        if driven and float(driven[-1]) >= distance_m:
            return
        time.sleep(0.05)
    raise AssertionError(out.read_text())


needs_ros = pytest.mark.skipif(
    find_spec("rclpy") is None, reason="rclpy is not installed (pip install 'swardmap[ros]')"
)


@pytest.mark.slow
@pytest.mark.timeout(900)
@needs_ros
def test_a_mower_stops_for_a_person(tmp_path: Path) -> None:
    driven_m, left_m = drive_to_the_person(tmp_path)
    assert driven_m > 3.0
    assert 0.1 < left_m < 1.5


@pytest.mark.slow
@pytest.mark.timeout(900)
@needs_ros
def test_a_mower_stops_when_the_node_is_killed(tmp_path: Path) -> None:
    driven_m, left_m = drive_to_the_person(tmp_path, kill_after_m=1.0)
    assert 1.0 <= driven_m < 1.0 + 0.4 * 2.0 + 0.7  # the flag's time, and as much again for a busy machine
    assert left_m > 1.5


@pytest.mark.slow
@needs_ros
def test_odometry_that_is_offered_as_best_effort_is_heard() -> None:
    import rclpy
    from nav_msgs.msg import Odometry
    from rclpy.executors import SingleThreadedExecutor

    space = f"/t{os.getpid()}_{time.monotonic_ns()}"
    with mock.patch.dict(os.environ, environment()):
        rclpy.init(args=["--ros-args", "-r", f"__ns:={space}"])
    try:
        gate, says = GateNode(), rclpy.create_node("says")
        publisher = says.create_publisher(Odometry, "odom", image_qos(BEST_EFFORT, 5))
        executor = SingleThreadedExecutor()
        for node in (gate.node, says):
            executor.add_node(node)
        message = Odometry()
        message.header.frame_id, message.child_frame_id = "map", "base_link"
        message.pose.pose.position.x, message.pose.pose.orientation.w = 2.0, 1.0
        end = time.monotonic() + 30
        while gate.inputs.T_map_base is None and time.monotonic() < end:
            publisher.publish(message)
            executor.spin_once(timeout_sec=0.05)
        assert gate.inputs.T_map_base is not None
        assert gate.inputs.T_map_base.matrix[0, 3] == 2.0
    finally:
        rclpy.shutdown()
