"""`swardmap map` on recordings of every kind: bags written here, and the real ones where they are."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swardmap.cli.app import run
from swardmap.config import config_from_dict
from swardmap.geometry import Intrinsics
from swardmap.io.bags.ros_fields import camera_info_fields, image_fields, tf_fields
from swardmap.io.maps.map_files import read_map
from swardmap.labels import MapClass
from swardmap.runs.recording import map_recording
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from tests.bags import IMAGE, INFO, KINDS, TF, Event, Kind, write_bag

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
START_NS = 1_700_000_000_000_000_000


def garden() -> AnalyticSource:
    return AnalyticSource(garden_scene(0), tuple(lane_poses(4, step_m=0.4)), SMALL)


def garden_events() -> Iterator[Event]:
    for frame in garden():
        stamp_ns = START_NS + frame.stamp_ns
        assert frame.T_map_camera is not None
        yield stamp_ns, "/tf", TF, tf_fields([frame.T_map_camera], stamp_ns)
        yield stamp_ns, "/color/image_raw", IMAGE, image_fields(frame.rgb, stamp_ns, "camera")
        yield stamp_ns, "/color/camera_info", INFO, camera_info_fields(SMALL, stamp_ns, "camera")
        yield stamp_ns, "/depth/image_raw", IMAGE, image_fields(frame.depth, stamp_ns, "camera")
        yield stamp_ns, "/depth/camera_info", INFO, camera_info_fields(SMALL, stamp_ns, "camera")


def mapped(source: Path, out: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, Any]:
    assert run(["map", str(source), "-o", str(out), "--json", *options]) == 0
    summary: dict[str, Any] = json.loads(capsys.readouterr().out)
    return summary


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_gives_the_map_of_its_frames(
    kind: Kind, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path, kind, garden_events())
    summary = mapped(bag, tmp_path / "out", capsys, "--segmenter", "colour", "--pictures", "0")
    assert summary["frames"] == 4
    assert not any(summary["skipped"].values())
    direct = map_recording(garden(), config=config_from_dict({"segmenter": {"name": "colour"}}))
    grid = read_map(tmp_path / "out/map.yaml")
    assert direct.grid is not None
    assert grid.spec == direct.grid.spec
    np.testing.assert_array_equal(grid.classes, direct.grid.classes)


def test_orfd(data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    summary = mapped(data_dir / "orfd", tmp_path / "out", capsys, "--segmenter", "colour")
    assert summary["frames"] == summary["frames_without_pose"] == 6
    assert 1.5 < summary["mount"]["height_m"] < 2.5  # the camera sits on the roof of a car
    grids = [read_map(file) for file in sorted((tmp_path / "out/maps").glob("*.yaml"))]
    assert len(grids) == 6
    assert min(grid.count(MapClass.GRASS) + grid.count(MapClass.OBSTACLE) for grid in grids) > 1000
    assert len(list((tmp_path / "out/frames").iterdir())) == 6


def test_3dmatch(data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    summary = mapped(data_dir / "rgbd_3dmatch", tmp_path / "out", capsys, "--segmenter", "colour")
    assert summary["frames"] == 5
    grid = read_map(tmp_path / "out/map.yaml")
    assert grid.count(MapClass.OBSTACLE) > 1000


@pytest.mark.parametrize("name", ["sw_device_2.55.1.bag", "sw_device_2.59.1.db3"])
def test_librealsense_recordings(
    name: str, data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mount = ["--set", "mount.height_m=1.0", "--set", "mount.pitch_deg=10"]  # drawn images: there is no ground
    bag = data_dir / "bags/librealsense_written" / name
    drawn = [*mount, "--set", "watchdog.frozen_s=null"]  # one depth image for all
    summary = mapped(bag, tmp_path / "out", capsys, "--pictures", "0", *drawn)
    assert 9 <= summary["frames"] <= 19
    assert len(list((tmp_path / "out/maps").glob("*.yaml"))) == summary["frames"]


def test_a_bag_without_images_is_one_line_with_its_topics(
    data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = data_dir / "bags/rosbag2_formats/rosbag2_tests/resources/mcap/cdr_test"
    assert run(["map", str(bag), "-o", str(tmp_path / "out")]) == 1
    message = capsys.readouterr().err
    assert "no topic with color images" in message
    assert "/test_topic" in message
