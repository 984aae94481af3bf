"""The commands of the pages by task run as they are shown, one after another, in an empty folder."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

import swardmap
from swardmap.cli.app import run
from swardmap.geometry import Intrinsics
from swardmap.io.sources.folder import write_folder
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.teach.gate import judge
from tests.teach.test_run import gardens

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
ROOT = Path(__file__).parent.parent
DEMO = Path(swardmap.__file__).parent / "data" / "demo"
LAWN = """<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>lawn</name><Polygon>
<outerBoundaryIs><LinearRing><coordinates>16.8997,52.3998,0 16.9003,52.3998,0 16.9003,52.4002,0
16.8997,52.4002,0 16.8997,52.3998,0</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
</Document></kml>"""


def shown_commands(page: str) -> list[str]:
    """Every line of the console blocks of a page."""
    text = (ROOT / page).read_text(encoding="utf-8").replace("\\\n", " ")
    blocks = re.findall(r"```console\n(.*?)```", text, re.DOTALL)
    return [line for block in blocks for line in block.splitlines() if line.strip()]


def run_shown(command: str, folder: Path, more: str = "") -> subprocess.CompletedProcess[str]:
    """One line as a shell takes it, with more options behind it; at home in the folder."""
    python = shlex.quote(sys.executable)
    program = command.partition("  #")[0].replace("swardmap ", f"{python} -m swardmap ", 1)
    environment = os.environ | {"HOME": str(folder)}
    return subprocess.run(
        ["bash", "-c", f"{program} {more}"],
        cwd=folder, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


def check_install(command: str) -> None:
    """What a page says to install is this package, with extras that it has and releases that it takes."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {r.name: r for r in map(Requirement, declared["dependencies"])}
    for wanted in map(Requirement, shlex.split(command)[2:]):
        if wanted.name == declared["name"]:
            assert wanted.extras <= set(declared["optional-dependencies"]), command
        else:
            (limit,) = needed[wanted.name].specifier
            assert wanted.specifier.contains(limit.version), command


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_bag_is_mapped_as_the_page_says(tmp_path: Path) -> None:
    made = run_shown(f"swardmap record {DEMO} -o drive.mcap", tmp_path)
    assert made.returncode == 0, made.stderr
    (tmp_path / "lawn.kml").write_text(LAWN)
    (tmp_path / "drives").mkdir()
    for day in ("monday", "friday"):
        shutil.copy(tmp_path / "drive.mcap", tmp_path / f"drives/{day}.mcap")
    commands = shown_commands("docs/tasks/map.md")
    assert len(commands) >= 6
    for command in commands:
        if "lawn.kml" in command:
            pytest.importorskip("pyproj", reason="work areas need the extra gps")
        done = run_shown(command, tmp_path, "--overwrite" if " -o " in command else "")
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    assert (tmp_path / "my_map/report.html").stat().st_size < 20_000_000
    assert (tmp_path / "my_map/map.yaml").is_file()
    assert 'href="monday/report.html"' in (tmp_path / "maps/report.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_margin_is_set_as_the_page_says(tmp_path: Path) -> None:
    made = run_shown(f"swardmap record {DEMO} -o other_drive.mcap --frames 2", tmp_path)
    assert made.returncode == 0, made.stderr
    shutil.copytree(DEMO, tmp_path / "annotated_drive")
    poses = tuple(lane_poses(2, step_m=0.4))
    write_folder(AnalyticSource(garden_scene(0), poses, SMALL), tmp_path / "another_drive")
    said = []
    for command in shown_commands("docs/tasks/margin.md"):
        done = run_shown(command, tmp_path)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        said.append(done.stdout)
    refused, added, measured, mapped = said
    assert "no margin: 99 % of the missed cells" in refused
    assert "of 2 recordings: annotated_drive, another_drive" in added
    assert "margin: " in measured
    assert "the default" not in mapped  # the margin is the one that was measured


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_paper_is_evaluated_for_as_the_page_says(tmp_path: Path) -> None:
    """Fewer gardens than the page has, and small images."""
    pytest.importorskip("moderngl", reason="gardens are drawn with moderngl (pip install 'swardmap[synth]')")
    synth, evaluate, evaluate_other, compare = shown_commands("docs/tasks/paper.md")
    few = "--scenes 2 --frames 1 --width 160 --height 120 --samples 1 --illumination cloudy --jobs 1"
    for command, more in ((synth, few), (evaluate, ""), (evaluate_other, ""), (compare, "")):
        done = run_shown(command, tmp_path, more)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    for name in re.findall(r"`(run/[\w.]+)`", (ROOT / "docs/tasks/paper.md").read_text(encoding="utf-8")):
        assert (tmp_path / name).stat().st_size > 0, name
    assert r"\toprule" in (tmp_path / "compare.tex").read_text(encoding="utf-8")


def test_a_robot_gets_its_files_as_the_page_says(tmp_path: Path) -> None:
    """The third line, the node, is started in `tests/ros/test_robot_page.py`."""
    install, write_files, start = shown_commands("docs/tasks/robot.md")
    check_install(install)
    done = run_shown(write_files, tmp_path)
    assert done.returncode == 0, done.stderr
    file = tmp_path / shlex.split(start)[-1].removeprefix("~/")
    assert yaml.safe_load(file.read_text(encoding="utf-8"))


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_lawn_is_taught_as_the_page_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One step of learning in place of sixty, and four images for the gate, which lets all pass."""
    pytest.importorskip("torch", reason="learning needs torch (pip install 'swardmap[train]')")
    pytest.importorskip("onnxscript", reason="export needs the package onnxscript")
    shown = shown_commands("docs/tasks/teach.md")
    told = [command for command in shown if command.startswith(("pip", "swardmap"))]
    install, label, learn, use, compare = told
    check_install(install)
    for command in set(shown) - set(told):
        program, file, *_ = shlex.split(command)
        assert program == "ros2" or (ROOT / file).is_file(), command
    for command in (f"swardmap record {DEMO} -o drive.mcap", label):
        assert (done := run_shown(command, tmp_path)).returncode == 0, f"{command}\n{done.stderr}"
    next_command = learn.partition("  #")[0].strip()
    assert done.stdout.splitlines()[-1] == f"when it is right: {next_command}"
    assert (tmp_path / "my-lawn.teach/page.html").stat().st_size > 10_000
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("swardmap.teach.faults.safety_frames", gardens)
    monkeypatch.setattr("swardmap.teach.run.judge", lambda old, new: replace(judge(old, new), reasons=()))
    assert run([*shlex.split(next_command)[1:], "--steps", "1", "--device", "cpu", "--threads", "1"]) == 0
    assert (done := run_shown(use, tmp_path)).returncode == 0, done.stderr
    for name, network in (("run_before", ""), ("run_after", "--segmenter my-lawn.onnx")):
        done = run_shown(f"swardmap evaluate {DEMO} -o {name} --set source.stop=2 {network}", tmp_path)
        assert done.returncode == 0, done.stderr
    assert (done := run_shown(compare, tmp_path)).returncode == 0, done.stderr
    assert "run_after" in done.stdout
