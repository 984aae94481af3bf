"""Images by pattern, named on the command line."""

import json
from pathlib import Path

import pytest

from swardmap.cli.app import run
from swardmap.geometry import Intrinsics
from swardmap.io.sources.folder import write_folder
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses

LENS = Intrinsics(96, 72, 80.0, 80.0, 47.5, 35.5)


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("images")
    drive = AnalyticSource(garden_scene(0), tuple(lane_poses(3, step_m=0.4)), LENS)
    write_folder(drive, folder)
    poses = [frame.T_map_camera for frame in drive]
    rows = [" ".join(map(str, pose.matrix[:3].ravel())) for pose in poses if pose is not None]
    (folder / "kitti.txt").write_text("\n".join(rows))
    return folder


def test_flags_name_colour_depth_and_poses(images: Path, tmp_path: Path) -> None:
    flags = ["--rgb", "rgb/*.png", "--depth", "depth/*.png", "--poses", "kitti.txt"]
    lens = ["--set", "source.intrinsics=[80,80,47.5,35.5]", "--segmenter", "colour"]
    assert run(["map", str(images), "-o", str(tmp_path / "flags"), *flags, *lens]) == 0
    plain = run(["map", str(images), "-o", str(tmp_path / "plain"), "--segmenter", "colour"])
    assert plain == 0
    found, expected = (
        json.loads((tmp_path / name / "summary.json").read_text()) for name in ("flags", "plain")
    )
    assert found["config"]["source"]["format"] == "images"
    assert (found["frames"], found["frames_without_pose"]) == (3, 0)
    assert found["map"]["cells"] == expected["map"]["cells"]


def test_one_of_two_patterns_is_wrong_usage(
    images: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for verb in ("map", "evaluate"):
        assert run([verb, str(images), "-o", str(tmp_path / "out"), "--depth", "depth/*.png"]) == 2
        assert "--rgb and --depth go together" in " ".join(capsys.readouterr().err.split())


def test_an_evaluation_takes_them_with_masks(images: Path, tmp_path: Path) -> None:
    flags = ["--rgb", "rgb/*.png", "--depth", "depth/*.png", "--poses", "kitti.txt"]
    lens = ["--set", "source.intrinsics=[80,80,47.5,35.5]", "--segmenter", "colour", "--no-budget"]
    out = tmp_path / "out"
    code = run(["evaluate", str(images), "-o", str(out), *flags, *lens, "--workers", "1"])
    assert code == 1, "no masks: the images have no true labels"
