"""`swardmap map realsense:`: a live camera through the SDK's software device."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swardmap.cli.app import run
from swardmap.config import config_from_dict
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.maps.map_files import read_map
from swardmap.models.colour import open_segmenter
from swardmap.perception.align import align_depth_to_color
from swardmap.pipeline import ObstacleMapper
from swardmap.types import Frame
from tests.realsense import (
    HEIGHT,
    PERIOD_MS,
    SETTINGS,
    START_MS,
    WIDTH,
    SoftwareCamera,
    color_image,
    ctrl_c_after,
    depth_image,
    feeding,
    plug_in,
    steady,
)

COLOR = Intrinsics(WIDTH, HEIGHT, 50.0, 50.0, 31.5, 23.5)
DEPTH = Intrinsics(WIDTH, HEIGHT, 60.0, 60.0, 31.5, 23.5)
MOUNT = ["--set", "mount.height_m=0.9", "--set", "mount.pitch_deg=22"]
OPTIONS = [
    *SETTINGS,
    *MOUNT,
    "--set",
    "camera.queue=15",
    "--segmenter",
    "colour",
    "--pictures",
    "0",
    "--json",
]


def mapped(out: Path, capsys: pytest.CaptureFixture[str], *options: str, code: int = 0) -> dict[str, Any]:
    assert run(["map", "realsense:123", "-o", str(out), *OPTIONS, *options]) == code
    summary: dict[str, Any] = json.loads(capsys.readouterr().out)
    return summary


def test_each_frame_gives_the_map_of_its_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plug_in(monkeypatch, steady(6))
    summary = mapped(tmp_path / "out", capsys, "--frames", "4")
    assert (summary["frames"], summary["frames_without_pose"], summary["interrupted"]) == (4, 4, False)
    assert (summary["source"]["name"], summary["source"]["frame_count"]) == ("Software D435I 123", 4)
    config = config_from_dict({"mount": {"height_m": 0.9, "pitch_deg": 22}, "segmenter": {"name": "colour"}})
    mapper = ObstacleMapper(open_segmenter(config.segmenter, None), config)
    apart = np.array([[1, 0, 0, 0.015], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    T_color_depth = Pose("color", "depth", apart)
    for number in range(1, 5):  # the SDK gives the images of the first pair apart
        depth = align_depth_to_color(depth_image(number), 0.001, DEPTH, COLOR, T_color_depth)
        stamp_ns = round((START_MS + number * PERIOD_MS) * 1e6)
        seen = mapper.step(Frame(stamp_ns, COLOR, color_image(number), depth, 0.001)).seen
        grid = read_map(tmp_path / f"out/maps/{number - 1:06d}.yaml")
        assert grid.spec == seen.spec
        assert (grid.classes == seen.classes).all()


def test_ctrl_c_is_how_it_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plug_in(monkeypatch, ctrl_c_after(monkeypatch, 4, steady(5)))
    summary = mapped(tmp_path / "out", capsys)
    assert summary["frames"] == 4
    assert json.loads((tmp_path / "out/summary.json").read_text()) == summary
    assert len(list((tmp_path / "out/maps").glob("*.yaml"))) == 4


def test_a_camera_that_is_lost_keeps_what_came_and_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plug_in(monkeypatch, steady(4))
    patience = ["--set", "camera.reconnect_s=0.5", "--set", "camera.timeout_s=0.3"]
    assert run(["map", "realsense:", "-o", str(tmp_path / "out"), *OPTIONS, *patience]) == 1
    captured = capsys.readouterr()
    assert json.loads(captured.out)["frames"] == 3
    assert "holds the 3 frames that came." in captured.err
    assert (tmp_path / "out/summary.json").exists()


def test_it_goes_on_after_unplugging(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plugged = [feeding(SoftwareCamera, steady(4)), None, feeding(SoftwareCamera, steady(4, first=20))]

    def find(serial: str | None) -> Any:
        now = plugged.pop(0)
        return now and now(serial)

    monkeypatch.setattr("swardmap.io.sources.realsense_live.finder", lambda _: find)
    summary = mapped(tmp_path / "out", capsys, "--frames", "6", "--set", "camera.timeout_s=0.3")
    assert summary["frames"] == 6
    assert plugged == []


@pytest.mark.parametrize(
    ("address", "options", "words"),
    [("realsense:9", [], "no RealSense camera 9 is connected"),
     ("realsense:123,9", [], "expected one camera"),
     ("realsense:123", ["--set", "camera.width=640"], "it has 64x48 at 30"),
     ("realsense:123", ["--set", "camera.threshold_m=[3, 1]"], "nearest and farthest")],
)  # fmt: skip
def test_what_cannot_be_is_one_line_and_leaves_nothing(
    address: str,
    options: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    plug_in(monkeypatch, steady(3))
    assert run(["map", address, "-o", str(tmp_path / "out"), *OPTIONS, *options]) == 1
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert words in said[0]
    assert list(tmp_path.iterdir()) == []


def test_what_nobody_fetched_is_in_the_summary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def feed(camera: SoftwareCamera) -> None:
        for number in range(0, 20, 2):  # the camera's own numbers have gaps, as after a full USB bus
            camera.push(number, START_MS + number * PERIOD_MS)

    plug_in(monkeypatch, feed)
    summary = mapped(tmp_path / "out", capsys, "--frames", "5")
    assert summary["skipped"]["image the camera took and nobody fetched in time"] == 5
