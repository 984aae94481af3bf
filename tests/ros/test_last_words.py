"""What the node says at the end of a run: as `swardmap map` does."""

from typing import Any

import pytest

from swardmap.errors import InputError
from swardmap.io.bags.topics import ImageTopic
from swardmap.ros.last_words import last_words
from tests.ros.test_live_pipeline import one_robot


def test_what_a_run_came_to(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = one_robot()
    robot.run([0.0, 0.1])

    def damaged(*_: Any) -> Any:
        raise InputError("expected 57600 bytes, got 12")

    with monkeypatch.context() as patch:
        patch.setattr(ImageTopic, "color", damaged)
        robot.step(2, 0.2)
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
