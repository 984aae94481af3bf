"""The end of a run says what a person must know to believe the map."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swardmap.config import Config, config_from_dict
from swardmap.errors import InputError
from swardmap.geometry import Intrinsics, Pose
from swardmap.runs.recording import map_recording
from swardmap.runs.told import report_lines
from swardmap.runs.warnings import pixel_warnings, warnings_of
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)


def config(**sections: dict[str, Any]) -> Config:
    return config_from_dict({"segmenter": {"name": "truth"}, "output": {"pictures": 0}, **sections})


class Drive(AnalyticSource):
    """A drive with facts, whose poses can be moved."""

    def __init__(self, moves_m: dict[int, tuple[float, float, float]] | None = None, **facts: Any) -> None:
        drive = AnalyticSource(garden_scene(0), tuple(lane_poses(4, step_m=0.4)), SMALL)
        self.__dict__.update(drive.__dict__)
        self.moves_m, self.facts, self.notes = moves_m or {}, facts, ["tf is of one robot of two"]

    def __iter__(self) -> Any:
        for index, frame in enumerate(super().__iter__()):
            assert frame.T_map_camera is not None
            matrix = frame.T_map_camera.matrix.copy()
            matrix[:3, 3] += np.array(self.moves_m.get(index, (0.0, 0.0, 0.0)))
            yield replace(frame, T_map_camera=Pose("map", "camera", matrix))


def summary(drive: Drive, **sections: dict[str, Any]) -> dict[str, Any]:
    return map_recording(drive, config=config(**sections)).summary


def test_an_ordinary_run_has_no_warnings_and_tells_its_margin() -> None:
    found = summary(Drive(), costmap={"margin_m": 0.1})
    assert found["warnings"] == []
    lines = "\n".join(report_lines(found))
    assert "margin in use: 0.1 m" in lines
    assert "note: tf is of one robot of two" in lines


@pytest.mark.parametrize(
    ("sections", "warning"),
    [({"cloud": {"max_height_m": -0.2}}, "% of the readings are out of height: check cloud.max_height_m"),
     ({"cloud": {"max_range_m": 1.5}}, "% of the readings are out of range: check cloud.max_range_m"),
     ({"cloud": {"max_range_m": 0.5}}, "no lawn was seen")],
)  # fmt: skip
def test_what_makes_a_map_poor_is_said_in_one_line(sections: dict[str, dict[str, Any]], warning: str) -> None:
    found = summary(Drive(), **sections)
    assert any(warning in line for line in found["warnings"])
    lines = report_lines(found)
    assert any(line.startswith("warning: ") and warning in line for line in lines)
    assert any("% of the pixels are in the map; " in line for line in lines)
    assert all(len(line) <= 300 for line in lines)


def test_a_run_without_geometry_is_told_what_that_means() -> None:
    (warning,) = summary(Drive(), geometry={"enabled": False})["warnings"]
    assert "what the network calls grass is free however high it stands, up to 2 m" in warning


@pytest.mark.parametrize(
    ("frame", "warned"), [("base_link", True), ("camera_link", True), ("camera_color_optical_frame", False)]
)
def test_a_camera_frame_that_looks_like_a_body_is_said(frame: str, warned: bool) -> None:
    found = summary(Drive(poses={"from": "tf", "frames": f"map <- odom <- {frame}"}))
    assert any(f"'{frame}', which looks like a body frame" in w for w in found["warnings"]) == warned
    assert f"poses: tf map <- odom <- {frame}" in report_lines(found)
    told = summary(
        Drive(poses={"from": "tf", "frames": f"map <- odom <- {frame}"}), source={"camera_axes": "body"}
    )
    assert not any("body frame" in w for w in told["warnings"]), "it was asked, and answered"


def test_how_the_poses_were_found_is_told_with_topic_and_largest_gap() -> None:
    gaps = {"map <- odom": 20.0, "odom <- base_link": 190.5}
    found = {"from": "tf", "frames": "map <- odom <- base_link <- lens", "topics": ["/robot1/tf"]}
    lines = report_lines(summary(Drive(poses={**found, "largest_gap_ms": gaps, "tolerance_ms": 250.0})))
    told = "of /robot1/tf, gaps of 190.5 ms at most (odom <- base_link; 250 allowed)"
    assert f"poses: tf map <- odom <- base_link <- lens, {told}" in lines


def test_readings_that_the_filter_takes_are_said() -> None:
    counts = {"pixels": 100, "no_reading": 0, "out_of_range": 0, "out_of_height": 0, "inconsistent": 80}
    (warning,) = pixel_warnings(counts)
    assert warning.startswith("80 % of the readings are inconsistent: check cloud.consistent_neighbours")


def test_what_was_left_out_is_told_with_the_first_of_each_kind() -> None:
    drive = Drive(
        left_out={"image that cannot be used": {"count": 3, "first": "yuv9 of /front is no known code"}},
        pairing={"pairs": 4, "median_ms": 1.5, "worst_ms": 12.0},
    )
    found = summary(drive) | {"skipped": {"image that cannot be used": 3}}
    lines = report_lines(found)
    assert "left out: 3 x image that cannot be used" in lines
    assert "  image that cannot be used, the first: yuv9 of /front is no known code" in lines
    assert "colour and depth are 1.5 ms apart (median), 12 at most" in lines


def test_a_jump_of_the_poses_is_refused_before_it_costs_memory() -> None:
    unwatched: dict[str, Any] = {"watchdog": {"pose_speed_mps": None}}
    with pytest.raises(
        InputError, match=r"frame .* is 84\d\.\d m from the one before.* \d+ cells, more than 64000000"
    ):
        summary(Drive({2: (600.0, 600.0, 0.0)}), **unwatched)
    rolling: dict[str, Any] = {"grid": {"mode": "log_odds"}, "evidence": {"window_m": 10.0}} | unwatched
    assert summary(Drive({2: (600.0, 600.0, 0.0)}), **rolling)["frames"] == 4
    fixed: dict[str, Any] = {"grid": {"origin_m": [-5, -5], "size_m": [10, 10]}} | unwatched
    assert summary(Drive({2: (600.0, 600.0, 0.0)}), **fixed)["frames"] == 4


def test_a_voxel_grid_that_leaves_too_few_points_is_said() -> None:
    found = summary(Drive())
    assert "voxel" not in " ".join(found["warnings"])
    found["config"]["cloud"]["voxel_m"] = 0.06
    warning = next(line for line in warnings_of(found) if "voxel" in line)
    assert (
        "cloud.voxel_m of 0.06 m leaves about 1 of the points of a cell, and 8 of lawn are needed" in warning
    )
    assert "make it 0.053 m or less" in warning
    found["config"]["cloud"]["voxel_m"] = 0.05
    assert "voxel" not in " ".join(warnings_of(found))


def test_a_frame_whose_pose_jumps_away_and_back_is_left_out_and_named() -> None:
    found = summary(Drive({2: (600.0, 600.0, 0.0)}))
    assert found["watchdog"]["faults"] == {"pose jumped": 2}, "away, and back"
    assert found["frames"] == 2


def test_warnings_of_nothing() -> None:
    found = summary(Drive())
    assert warnings_of(found | {"pixels": {}, "map": None, "frames_without_pose": 4}) == []
