"""What the documents say is so: links lead somewhere, commands and settings exist, examples run."""

import dataclasses
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command

from swardmap.cli.app import app, run
from swardmap.config import Config, SourceConfig, config_from_dict
from swardmap.geometry import Intrinsics, Pose, deproject
from swardmap.io import SOURCES, open_source
from swardmap.io.files import write_bytes
from swardmap.io.images import encode_png
from swardmap.io.maps.map_files import read_costmap
from swardmap.labels import MapClass
from swardmap.runs.recording import map_recording

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
TEXTS = {page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8") for page in PAGES}

each_page = pytest.mark.parametrize("page", sorted(TEXTS))


def settings() -> dict[str, set[str]]:
    """Section -> its keys."""
    sections = {f.name: getattr(Config(), f.name) for f in dataclasses.fields(Config)}
    return {
        name: {f.name for f in dataclasses.fields(section)}
        for name, section in sections.items()
        if dataclasses.is_dataclass(section)
    }


def commands(text: str) -> list[list[str]]:
    """Every `swardmap ...` of the code in a page, in words; a line that ends in a backslash goes on."""
    text = re.sub(r"\\\n\s*", " ", text)
    fences = re.findall(r"^```(\w*)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    code = [body for language, body in fences if language in ("", "console", "bash", "sh")]
    code += re.findall(r"`(swardmap [^`]+)`", text)
    code += re.findall(r"^ {4}(swardmap .*)$", text, re.MULTILINE)
    lines = "\n".join(code).replace("\n  ", " ").splitlines()
    cut = (re.split(r"\s{2,}[A-Z]|\s#|\s>|\s&&", line)[0] for line in lines if line.startswith("swardmap "))
    return [shlex.split(line) for line in cut]


@each_page
def test_links_lead_somewhere(page: str) -> None:
    here = (ROOT / page).parent
    for target in re.findall(r"\]\(([^)]+)\)", TEXTS[page]):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        file = here / path if path else ROOT / page
        assert file.exists(), f"{page}: {target}"
        if anchor:
            titles = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), re.MULTILINE)
            anchors = {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
            assert anchor in anchors, f"{page}: {target}"


@each_page
def test_pages_that_are_named_exist(page: str) -> None:
    for name in re.findall(
        r"\b((?:docs|examples|benchmarks|tests|src)/[\w/.-]+\.(?:md|py|ipynb|jpg|png))\b", TEXTS[page]
    ):
        assert (ROOT / name).exists(), f"{page}: {name}"


@each_page
def test_commands_have_the_options_that_are_shown(page: str) -> None:
    verbs = getattr(get_command(app), "commands")  # noqa: B009 - typer's type hides them
    for command in commands(TEXTS[page]):
        words = command[1 : command.index("--") if "--" in command else None]
        assert words, page
        if words[0].startswith("--"):
            assert words[0] in ("--help", "--version"), f"{page}: {command}"
            continue
        assert words[0] in verbs, f"{page}: {command}"
        known = {option for p in verbs[words[0]].params for option in (*p.opts, *p.secondary_opts)}
        shown = {word.partition("=")[0] for word in words[1:] if re.match(r"--?[a-z]", word)}
        assert shown <= known | {"--help"}, f"{page}: {command}"


@each_page
def test_settings_that_are_named_exist(page: str) -> None:
    known = settings()
    for section, key in re.findall(rf"(?<![\w.])({'|'.join(known)})\.([a-z][a-z_]*)\b(?!\()", TEXTS[page]):
        module = ROOT / "src/swardmap" / section
        named = known[section] | {"md", "py", "yaml", "png", "pgm", "npz", "jpg"}
        assert key in named or module.is_dir() or module.with_suffix(".py").is_file(), (
            f"{page}: {section}.{key}"
        )


@each_page
def test_make_targets_exist(page: str) -> None:
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert len(targets) == len(set(targets)), "a target has two recipes"
    for target in re.findall(r"^make ([a-z-]+)", TEXTS[page], re.MULTILINE):
        assert target in targets, f"{page}: make {target}"


def test_there_is_something_to_check() -> None:
    found = [command for text in TEXTS.values() for command in commands(text)]
    assert {"map", "demo", "convert", "config", "doctor"} <= {command[1] for command in found}


def test_ci_and_phony_name_targets_that_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    phony = re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert phony is not None
    assert set(phony[1].split()) == targets
    assert set(re.findall(r"^make ([a-z-]+)", (ROOT / ".ci/run").read_text(), re.MULTILINE)) <= targets


def test_every_kind_of_recording_is_described() -> None:
    described = re.findall(r"^\| `(\w+)` \|", TEXTS["docs/recordings.md"], re.MULTILINE)
    assert sorted(described) == sorted(SOURCES)


def test_the_layout_shown_is_read(tmp_path: Path) -> None:
    page = TEXTS["docs/recordings.md"]
    camera = re.search(r"```yaml\n(width:.*?)```", page, re.DOTALL)
    poses = re.search(r"^ {4}# name stamp_ns .*\n((?: {4}.*\n)+)", page, re.MULTILINE)
    assert camera is not None
    assert poses is not None
    (tmp_path / "camera.yaml").write_text(camera[1])
    (tmp_path / "poses.txt").write_text(poses[0])
    names = [line.split()[0] for line in poses[1].splitlines()]
    place = [float(v) for v in poses[1].splitlines()[0].split()[2:]]
    pose = Pose.from_quaternion("map", "camera", place[:3], np.array(place[3:]) / np.linalg.norm(place[3:]))
    rays = (
        deproject(np.ones((480, 640)), Intrinsics(640, 480, 600.0, 600.0, 319.5, 239.5)) @ pose.matrix[2, :3]
    )
    lawn = np.where(rays < -0.1, -place[2] / np.minimum(rays, -0.1), 0)
    for shift, name in enumerate(names):  # no two images the same, as of no camera
        write_bytes(tmp_path / f"rgb/{name}.png", encode_png(np.full((480, 640, 3), 90 + shift, np.uint8)))
        write_bytes(tmp_path / f"depth/{name}.png", encode_png((1000 * lawn + shift).astype(np.uint16)))
        write_bytes(tmp_path / f"labels/{name}.png", encode_png(np.ones((480, 640), np.uint8)))
    frames = list(open_source(tmp_path, SourceConfig()))
    assert [frame.name for frame in frames] == names
    assert [frame.T_map_camera is None for frame in frames] == [False, True]
    assert frames[0].tags == {"scene": "backyard", "illumination": "cloudy"}
    settings = {"segmenter": {"name": "truth"}, "mount": {"height_m": 0.9, "pitch_deg": 22}}
    grid = map_recording(tmp_path, config=config_from_dict(settings)).grid
    assert grid is not None
    assert grid.count(MapClass.GRASS) > 0


@pytest.mark.parametrize(
    "command", ["swardmap config", "swardmap doctor --seconds 0", "swardmap --version", "swardmap --help"]
)
def test_commands_that_need_nothing_run(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(shlex.split(command)[1:]) == 0
    assert capsys.readouterr().out


def test_python_shown_in_the_readme_runs(tmp_path: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", TEXTS["README.md"], re.DOTALL)
    assert blocks
    for block in blocks:
        environment = os.environ | {"PYTHONWARNINGS": "error"}
        subprocess.run([sys.executable, "-c", block], env=environment, check=True, cwd=tmp_path)
    costs = read_costmap(tmp_path / "my_costmap.yaml").costs
    assert costs.shape == (218, 151)  # as the comment says
    assert np.count_nonzero(costs == 254) > 100  # the box and its margin
    assert np.count_nonzero(costs == 0) > 10_000  # the lawn
