"""What the node says at the end of a run: as `swardmap map` does."""

import pytest

from swardmap.ros.last_words import last_words
from tests.ros.test_live_pipeline import one_robot, robot_with_a_damaged_image


def test_what_a_run_came_to(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = robot_with_a_damaged_image(monkeypatch)
    lines = last_words(robot.pipeline)
    assert lines[0] == "frames mapped: 2 of camera"
    assert "left out: 1 x image that cannot be used" in lines
    assert "  image that cannot be used, the first: expected 57600 bytes, got 12" in lines
    assert "poses: odometry, in the frame 'map'" in lines
    assert "colour and depth are 0 ms apart (median), 0 at most" in lines


def test_a_run_that_mapped_nothing_says_why_its_pixels_are_lost() -> None:
    robot = one_robot({"cloud": {"max_range_m": 0.5}})
    robot.run([0.0, 0.1, 0.2])
    lines = last_words(robot.pipeline)
    assert any("of the pixels are in the map; " in line for line in lines)
    assert any(line.startswith("warning: ") and "are out of range" in line for line in lines)
    silent = one_robot()
    assert last_words(silent.pipeline)[0] == "frames mapped: none"
