"""What CONTRIBUTING.md says of the code is so: the walk of a frame, and the table of additions."""

import re
import sys
from pathlib import Path
from types import FrameType

import pytest

from swardmap.config import config_from_dict
from swardmap.geometry import Intrinsics
from swardmap.io.sources.folder import write_folder
from swardmap.runs.recording import map_recording
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def calls_of_one_frame(recording: Path, out: Path) -> list[str]:
    """Every function of ours that mapping a recording of one frame calls, in order."""
    calls: list[str] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        module = frame.f_globals.get("__name__", "")
        if event == "call" and module.startswith("swardmap."):
            calls.append(f"{module.removeprefix('swardmap.')}.{frame.f_code.co_qualname}")

    settings = {
        "segmenter": {"name": "truth"},
        "backend": "plain",
        "geometry": {"enabled": True},
        "output": {"pictures": 0},
    }
    config = config_from_dict(settings)
    before = sys.getprofile()
    sys.setprofile(note)
    try:
        map_recording(recording, out, config, ahead=False)  # a profile is of one thread
    finally:
        sys.setprofile(before)
    return calls


def test_a_frame_walks_as_it_is_told(tmp_path: Path) -> None:
    section = TEXT.split("## One depth image")[1].split("\n## ")[0]
    told = re.findall(r"^    ([\w.]+)  ", section, re.MULTILINE)
    assert len(told) > 12
    camera = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
    write_folder(AnalyticSource(garden_scene(0), tuple(lane_poses(1)), camera), tmp_path / "in")
    calls = calls_of_one_frame(tmp_path / "in", tmp_path / "out")
    at = -1
    for name in told:
        assert name in calls, f"{name} is not called"
        assert name in calls[at + 1 :], f"{name} is not called after the one told before it"
        at = calls.index(name, at + 1)


@pytest.mark.parametrize("row", re.findall(r"^\| an? .*$", TEXT, re.MULTILINE))
def test_the_table_of_additions_names_what_is_there(row: str) -> None:
    _, _, file, entry, test, _ = (cell.strip() for cell in row.split("|"))
    for path in re.findall(r"`((?:src|tests)/[\w/.<>]+)`", " ".join([file, entry, test])):
        place = ROOT / (path if "<" not in path else Path(path).parent)
        assert place.exists(), path
    for name, path in re.findall(r"`([\w.]+)` in `(src/[\w/.]+)`", entry):
        assert re.search(rf"\b{re.escape(name)}\b", (ROOT / path).read_text()), f"{name} in {path}"
