"""The verbs as a user types them: exit codes, one clear line for a known error, help with an example."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from swardmap import __version__
from swardmap.cli.app import app, run
from swardmap.config import Config, config_from_dict
from swardmap.errors import OutputError
from swardmap.geometry import Intrinsics
from swardmap.io.folders import MARKER
from swardmap.io.sources.folder import write_folder
from swardmap.runs.recording import map_recording
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
VERBS = sorted(command.name or "" for command in app.registered_commands)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "garden"
    write_folder(AnalyticSource(garden_scene(0), tuple(lane_poses(3, step_m=0.4)), SMALL), folder)
    return folder


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    captured = capsys.readouterr()
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("swardmap: ")
    return lines[0]


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_with_an_example(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([verb, "--help"]) == 0
    out = capsys.readouterr().out
    assert f"swardmap {verb}" in out.split("Usage:")[1].split("\n", 1)[1], "the help should show an example"


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.strip() == f"swardmap {__version__}"


def test_map_a_recording(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(["map", str(recording), "-o", str(out), "--segmenter", "truth", "--resolution", "0.1"]) == 0
    text = capsys.readouterr().out
    assert "3 frames mapped with" in text
    assert f"results in {out}" in text
    assert yaml.safe_load((out / "map.yaml").read_text())["resolution"] == 0.1


def test_json_is_all_that_is_printed(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["map", str(recording), "-o", str(tmp_path / "o"), "--json", "--pictures", "0"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["frames"] == 3
    assert captured.err == ""


def test_an_option_wins_over_set_file_and_environment(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "c.yaml").write_text("grid: {resolution_m: 0.5, min_points: 9}")
    monkeypatch.setenv("SWARDMAP_GRID__RESOLUTION_M", "0.4")
    arguments = ["map", str(recording), "-o", str(tmp_path / "o"), "-c", str(tmp_path / "c.yaml"),
                 "--set", "grid.resolution_m=0.3", "--resolution", "0.2", "--pictures", "0"]  # fmt: skip
    assert run(arguments) == 0
    grid = yaml.safe_load((tmp_path / "o/config.yaml").read_text())["grid"]
    assert (grid["resolution_m"], grid["min_points"]) == (0.2, 9)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [(["map", "nowhere", "-o", "out"], "no such recording"),
     (["map", ".", "-o", "out"], "not a recording that swardmap knows"),
     (["map", "{rec}", "-o", "out", "--set", "grid.resolution_m=0"], "at least 0.001"),
     (["map", "{rec}", "-o", "out", "--set", "grid.nonsense=0"], "unknown setting"),
     (["map", "{rec}", "-o", "out", "--segmenter", "missing.onnx"], "missing.onnx"),
     (["map", "{rec}", "-o", "out", "--format", "zip"], "one of"),
     (["map", "{rec}", "-o", "{rec}"], "holds the recording itself"),
     (["map", "{rec}", "-o", "/proc/nowhere/out"], "/proc/nowhere"),
     (["config", "-c", "nowhere.yaml"], "cannot read"),
     (["convert", "nowhere.yaml", "out.png"], "nowhere.yaml")],
)  # fmt: skip
def test_known_errors_are_one_line_and_exit_1(
    arguments: list[str],
    match: str,
    recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run([a.format(rec=recording) for a in arguments]) == 1
    assert match in one_line(capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments", [["map"], ["fly"], ["map", "x"], ["map", "x", "-o", "y", "--no-such-option"]]
)
def test_wrong_usage_exits_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(arguments) == 2
    assert "Usage" in capsys.readouterr().err


def test_a_truncated_image_stops_the_run(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_folder(AnalyticSource(garden_scene(0), tuple(lane_poses(2)), SMALL), tmp_path / "rec")
    depth = tmp_path / "rec/depth/000001.png"
    depth.write_bytes(depth.read_bytes()[:500])
    assert run(["map", str(tmp_path / "rec"), "-o", str(tmp_path / "out")]) == 1
    assert "truncated" in one_line(capsys)
    assert not (tmp_path / "out").exists()


def test_config_prints_what_it_reads(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["config"]) == 0
    assert config_from_dict(yaml.safe_load(capsys.readouterr().out)) == Config()
    assert run(["config", "--json", "--set", "grid.min_points=7"]) == 0
    assert json.loads(capsys.readouterr().out)["grid"]["min_points"] == 7


def test_doctor(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["doctor", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert rows["kernels"]["works"]
    assert rows["onnxruntime"]["about"]


def test_demo_from_the_command_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "swardmap", "demo", "-o", str(tmp_path / "d"), "--frames", "2"]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env=os.environ | {"TERM": "dumb"}
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "d/map.png").stat().st_size > 1000
    assert len(list((tmp_path / "d/frames").glob("*.png"))) == 2
    assert "Margin: " in done.stdout
    assert "swardmap map MY_DRIVE" in done.stdout.splitlines()[-1]
    assert (tmp_path / "d/evaluation/report.html").stat().st_size > 10_000
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert again.returncode == 1
    assert "--overwrite" in again.stderr


@pytest.mark.parametrize("out", ["", ".."])
def test_overwrite_never_replaces_the_recording(
    recording: Path, tmp_path: Path, out: str, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "drives" / "one"
    shutil.copytree(recording, mine)  # written by swardmap, so it holds the marker
    (mine.parent / MARKER).write_text("")
    before = sorted(mine.rglob("*"))
    assert run(["map", str(mine), "-o", str(mine / out), "--overwrite", "--pictures", "0"]) == 1
    assert "holds the recording itself" in one_line(capsys)
    with pytest.raises(OutputError, match="holds the recording itself"):
        map_recording(mine, mine / out, overwrite=True)
    assert sorted(mine.rglob("*")) == before


def test_a_broken_settings_file_is_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "c.yaml").write_text("grid: {a: [\n")
    assert run(["config", "-c", str(tmp_path / "c.yaml")]) == 1
    assert "line 2, column 1" in one_line(capsys)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_run_keeps_what_it_finished(tmp_path: Path, number: signal.Signals) -> None:
    command = [sys.executable, "-m", "swardmap", "demo", "--no-evaluate", "-o", str(tmp_path / "out"),
               "--set", "output.pictures=1"]  # fmt: skip
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as running:
        while not any(tmp_path.glob(".out.*/frames/*.png")):
            assert running.poll() is None
            time.sleep(0.02)
        running.send_signal(number)
        _, said = running.communicate(timeout=60)
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert running.returncode == 130
    assert (
        said
        == f"swardmap: interrupted: {tmp_path}/out holds the {summary['frames']} frames that were finished\n"
    )
    assert summary["interrupted"]
    pictures = len(list((tmp_path / "out/frames").glob("*.png")))
    assert summary["frames"] - 1 <= pictures <= summary["frames"]  # it may have been at the last one
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    "error", [PermissionError(errno.EACCES, "Permission denied"), OSError(errno.EIO, "Input/output error")]
)
def test_a_place_that_may_not_be_looked_at_is_one_line(
    error: OSError, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(Path, "exists", refuse)  # as below a folder that is closed to us
    assert run(["map", str(tmp_path / "x"), "-o", "out"]) == 1
    assert f"cannot read {tmp_path}/x: {error.strerror}" in one_line(capsys)
