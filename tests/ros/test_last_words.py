"""What the node says at the end of a run, and of a saved map: as `swardmap map` does."""

import json
from pathlib import Path

import pytest

from swardmap.config import config_from_dict
from swardmap.ros.last_words import last_words
from swardmap.ros.run_facts import run_facts
from swardmap.runs.recording import map_recording
from swardmap.runs.told import seen_lines
from tests import lawn_bags
from tests.bags import write_bag
from tests.ros import drive
from tests.ros.test_live_pipeline import Robot, one_robot, parameters, pipeline_of, robot_with_a_damaged_image


def test_what_a_run_came_to(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = robot_with_a_damaged_image(monkeypatch)
    lines = last_words(robot.pipeline)
    assert lines[0] == "frames mapped: 2 of camera"
    assert "left out: 1 x image that cannot be used" in lines
    assert "  image that cannot be used, the first: expected 57600 bytes, got 12" in lines
    way = "map <- base_link <- camera_optical_frame"
    edge = "map <- base_link; 250 allowed"
    assert f"poses: odometry {way}, of /odom, gaps of 100 ms at most ({edge})" in lines
    assert "colour and depth are 0 ms apart (median), 0 at most" in lines


def test_a_run_that_mapped_nothing_says_why_its_pixels_are_lost() -> None:
    robot = one_robot({"cloud": {"max_range_m": 0.5}})
    robot.run([0.0, 0.1, 0.2])
    lines = last_words(robot.pipeline)
    assert any("of the pixels are in the map; " in line for line in lines)
    assert any(line.startswith("warning: ") and "are out of range" in line for line in lines)
    silent = one_robot()
    assert last_words(silent.pipeline)[0] == "frames mapped: none"


def test_what_is_saved_says_the_same_as_a_run_offline(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = robot_with_a_damaged_image(monkeypatch)
    robot.pipeline.mapper.save(tmp_path / "saved", run_facts(robot.pipeline))
    told = json.loads((tmp_path / "saved/summary.json").read_text(encoding="utf-8"))
    bag = write_bag(tmp_path, "mcap", lawn_bags.Lawn().events())
    mapped = map_recording(bag, config=config_from_dict({"segmenter": {"name": "colour"}})).summary
    for block in ("pixels", "warnings", "skipped"):
        assert type(told[block]) is type(mapped[block])
    assert told["pixels"].keys() == mapped["pixels"].keys()
    for part in ("poses", "pairing"):
        assert told["source"][part].keys() >= mapped["source"][part].keys(), part
    assert told["source"]["left_out"] == {
        "image that cannot be used": {"count": 1, "first": "expected 57600 bytes, got 12"}
    }
    assert told["source"]["poses"]["largest_gap_ms"] == {"map <- base_link": 100.0}
    assert told["source"]["pairing"] == {"pairs": 3, "median_ms": 0.0, "worst_ms": 0.0}
    assert told["frames"] == {"camera": 2}
    assert told["pixels"]["pixels"] == sum(v for k, v in told["pixels"].items() if k != "pixels")
    told_lines = seen_lines(told)
    assert told_lines, "and it is told by the same lines"
    assert set(told_lines) <= set(last_words(robot.pipeline))


def test_each_camera_of_a_rig_says_how_it_was_placed() -> None:
    rig = drive.rig_of(drive.RIG)
    robot = Robot(pipeline_of(parameters(), rig), rig)
    robot.run([0.0, 0.1, 0.2])
    poses = run_facts(robot.pipeline)["source"]["poses"]
    assert poses["frames"].count("map <- base_link <- ") == poses["frames"].count(";") + 1 > 1
    assert poses["largest_gap_ms"] == {"map <- base_link": 100.0}
