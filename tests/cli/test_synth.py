"""`swardmap synth` on a stage without a driver: what it prints, refuses, and leaves behind."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer

from swardmap.cli.app import run
from swardmap.cli.synth import lights_of
from swardmap.synth.config import load_synth_config
from swardmap.synth.stage import Stage
from tests.synth.small_stage import small_stage

SMALL = ["--scenes", "1", "--frames", "2", "--width", "96", "--height", "72", "--set", "map.resolution_m=0.1"]
ROOT = Path(__file__).parents[2]


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swardmap.synth.stage.garden_stage", small_stage)


def make(out: Path, *more: str) -> int:
    return run(["synth", str(out), *SMALL, "--jobs", "1", *more])


@pytest.mark.usefixtures("small")
def test_gardens_are_made_resumed_and_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "gardens"
    assert make(out, "--illumination", "clear,sunset") == 0
    told = capsys.readouterr()
    assert "2 sequences, 4 frames" in told.out
    assert "(2 made now)" in told.out
    assert "made 4 of 4 frames" in told.err
    assert make(out, "--illumination", "clear", "--illumination", "sunset", "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"out": str(out), "sequences": 2, "frames": 4, "made": 0}
    assert run(["synth", str(out), "--census"]) == 0
    assert "4 frames, 100 % of them with a person" in capsys.readouterr().out
    assert run(["synth", str(out), "--census", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["all"]["poses"] == {"walking": 4}
    assert found["illuminations"].keys() == {"clear", "sunset"}


@pytest.mark.usefixtures("small")
def test_map_and_evaluate_take_what_synth_makes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "gardens"
    assert make(out, "--illumination", "clear") == 0
    here = out / "folder" / "0000" / "clear"
    assert run(["map", str(here), "-o", str(tmp_path / "map"), "--segmenter", "truth", "--json"]) == 0
    capsys.readouterr()
    common = ["--segmenter", "truth", "--workers", "1", "--json"]
    assert run(["evaluate", str(out / "eden"), "-o", str(tmp_path / "a"), "--no-budget", *common]) == 0
    on_eden = json.loads(capsys.readouterr().out)
    assert on_eden["frames"]["evaluated"] == 2
    clean = ["--clean", str(here / "exact")]
    assert run(["evaluate", str(here), "-o", str(tmp_path / "b"), *clean, *common]) == 0
    assert json.loads(capsys.readouterr().out)["frames"]["evaluated"] == 2


@pytest.mark.usefixtures("small")
def test_other_settings_in_the_same_folder_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "gardens"
    assert make(out, "--illumination", "clear") == 0
    assert make(out, "--illumination", "clear", "--no-sensor") == 1
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith("swardmap: ")
    assert "config.stereo.enabled: True there, False now" in told
    assert make(out, "--illumination", "clear", "--no-sensor", "--overwrite") == 0
    assert not (out / "folder" / "0000" / "clear" / "exact").exists()


def test_wrong_words_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert make(tmp_path / "o", "--illumination", "noon") == 2
    assert "expected clear, cloudy, overcast, sunset, twilight or all, got 'noon'" in capsys.readouterr().err
    assert make(tmp_path / "o", "--set", "camera.jpeg_qualty=3") == 1
    assert "unknown setting 'camera.jpeg_qualty'; did you mean 'jpeg_quality'?" in capsys.readouterr().err
    assert make(tmp_path / "o", "--set", "camera.jpeg_quality=3") == 1
    assert "expected a list of 2 numbers, got 3" in capsys.readouterr().err
    assert run(["synth", str(tmp_path / "none"), "--census"]) == 1
    assert "no such folder" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_lights_are_named_in_any_order() -> None:
    assert lights_of(["twilight", "clear"]) == ("clear", "twilight")
    assert len(lights_of(["all"])) == 5
    with pytest.raises(typer.BadParameter):
        lights_of(["dawn"])


def test_the_printed_settings_are_a_config_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["synth", str(tmp_path), "--settings", "--set", "stereo.dropout=[0, 0.1]"]) == 0
    file = tmp_path / "garden.yaml"
    file.write_text(capsys.readouterr().out)
    assert load_synth_config(file) == load_synth_config(None, ["stereo.dropout=[0, 0.1]"])


def test_without_the_extra_one_line_names_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "moderngl", None)
    assert make(tmp_path / "out", "--set", "scene.assets=false", "--illumination", "clear") == 1
    told = capsys.readouterr().err.splitlines()[-1]
    assert "pip install 'swardmap[synth]'" in told


def slow_stage(config: object) -> Stage:
    """For the process below: a stage whose frames take a while."""
    from tests.synth.small_stage import SmallStage

    class Slow(SmallStage):
        def view(self, *args: object) -> object:  # type: ignore[override]
            time.sleep(0.2)
            return super().view(*args)  # type: ignore[arg-type]

    return Slow()  # type: ignore[return-value]


@pytest.mark.slow
def test_ctrl_c_and_a_stop_by_the_system_are_one_line_and_can_be_resumed(tmp_path: Path) -> None:
    out = tmp_path / "gardens"
    code = (
        "import swardmap.synth.stage as s; from tests.cli.test_synth import slow_stage; "
        "s.garden_stage = slow_stage; from swardmap.cli import main; main()"
    )
    command = [
        sys.executable,
        "-c",
        code,
        "synth",
        str(out),
        *SMALL,
        "--scenes",
        "2",
        "--frames",
        "8",
        "--jobs",
        "2",
    ]
    for number in (signal.SIGINT, signal.SIGTERM):
        process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True, env=dict(os.environ))
        assert process.stderr is not None
        for line in process.stderr:
            if "min left" in line or "less than a minute" in line:
                break
        process.send_signal(number)
        _, told = process.communicate(timeout=60)
        assert process.returncode == 130
        assert "sequences are whole; give the same command again" in told.splitlines()[-1]
        assert "Traceback" not in told
    subprocess.run(command, cwd=ROOT, check=True, timeout=120)
    assert len(list(out.glob("folder/*/*/complete.json"))) == 10
