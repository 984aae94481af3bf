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
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.errors import ConfigError
from swardmap.geometry import Pose
from swardmap.ros.clouds import obstacle_cells_fields
from swardmap.ros.gate import Command, GateConfig, GateInputs, nearest_in_zone_m, reach_m, refusal
from swardmap.ros.gate_node import GateNode, cell_centres_m
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
    from swardmap.grid import GridSpec, OccupancyGrid

    classes = np.zeros((4, 6), np.uint8)
    classes[1, 2] = classes[3, 0] = 2
    grid = OccupancyGrid(GridSpec(0.5, 6, 4, (-1.0, 2.0), "map"), classes)
    message = drive.message(CLOUD, obstacle_cells_fields(grid, (0.0, 0.0), 10.0))
    np.testing.assert_allclose(cell_centres_m(message), [[0.25, 2.75], [-0.75, 3.75]])


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
