"""Faults injected over real DDS, one by one: named, no stale free space, recovered from."""

import importlib.util
from pathlib import Path
from typing import Any

import pytest

from tests.ros import drive
from tests.ros.node_process import running

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("rclpy is not installed (pip install 'swardmap[ros]')", allow_module_level=True)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1600)]

STOPS = (
    "stopped",
    "stale",
    "frozen",
    "black",
    "flipped",
    "no depth",
    "stamp jumped ahead",
    "stamp jumped back",
    "lost pose",
)
WARNINGS = ("slow", "falling frame rate")

# short memories, so that a fault takes seconds; limits that a busy machine does not reach by itself
WATCHDOG = {
    "stopped_s": 1.5, "stale_s": 1.0, "pose_s": 1.0, "forget_s": 1.0, "recover_s": 0.5, "min_rate_hz": 3.0,
    "falling_share": 0.7, "rate_reference_s": 6.0,
}  # fmt: skip
SETTINGS = {
    "segmenter": {"name": "colour"},
    "source": {"odometry_topic": "odom"},
    "mount": drive.MOUNT,
    "watchdog": WATCHDOG,
}


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """One robot, all faults one after another."""
    with running(tmp_path_factory.mktemp("faults"), SETTINGS, {"map_rate_hz": 10.0}) as robot:
        return robot.inject(*STOPS, *WARNINGS, "terminated")


@pytest.mark.parametrize("fault", STOPS)
def test_a_fault_that_demands_a_stop_is_named_and_stops_the_robot(told: dict[str, Any], fault: str) -> None:
    happened = told[fault]
    assert happened["well"] is not None
    assert happened["named"] is not None, happened
    assert happened["stopped"] is not None, happened
    assert happened["nothing_free"] is not None, "free cells that nobody has seen for long"
    assert happened["recovered"] is not None, happened


def test_obstacles_stay_when_free_space_turns_unknown(told: dict[str, Any]) -> None:
    assert told["stopped"]["lethal_left"] > 50


def test_a_node_that_is_ended_says_stop_and_nothing_free_at_last(told: dict[str, Any]) -> None:
    assert told["terminated"]["well"] is not None
    assert told["terminated"]["stopped"] is not None


@pytest.mark.parametrize("fault", WARNINGS)
def test_a_fault_that_leaves_the_map_right_is_named(told: dict[str, Any], fault: str) -> None:
    happened = told[fault]
    assert happened["named"] is not None, happened
    assert {f["severity"] for f in happened["faults"] if f["fault"] == fault} == {"warn"}
    assert happened["recovered"] is not None, happened


def test_a_full_queue_drops_the_oldest_and_never_the_newest(tmp_path: Path) -> None:
    """The shipped network, and a hundred images a second."""
    settings = SETTINGS | {"segmenter": {"name": "auto"}, "watchdog": WATCHDOG | {"stale_s": 10.0}}
    with running(tmp_path, settings, {"queue_frames": 2}) as robot:
        told = robot.inject("full queue")["full queue"]
    sent, masks = told["sent"], told["masks"]
    assert told["named"]
    assert told["left_out"]["frame dropped by a full queue, the oldest first"] > 0
    assert masks == sorted(masks)
    assert len(masks) < len(sent)
    assert masks[-1] >= sent[-1]  # the newest came through
    assert told["recovered"] is not None
