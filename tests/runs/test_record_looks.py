"""An evaluation names what `map` and the node name, doubts of pose and mount too, however it is split."""

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from swardmap.cli.app import run
from swardmap.config import Config, WatchdogConfig
from swardmap.eval.dataset import DatasetSpec
from swardmap.eval.frame import evaluate_part
from swardmap.eval.run import make_plan
from swardmap.io.sources.folder import write_folder
from swardmap.runs.frame_check import FrameCheck
from swardmap.runs.record_looks import Looker, first_looked_at, watchdog_of
from swardmap.types import Frame
from tests.runs import semantic_faults

FAULTS = {fault.name: fault for fault in semantic_faults.FAULTS}
NAMED = {
    "nothing wrong": set(),
    "depth 10 % too long": {"motion mismatch"},
    "mount off by 3 degrees of yaw": {"motion mismatch"},
    "depth 20 pixels to the side": {"misaligned"},
    "mount off by 3 degrees of roll": {"tilted ground"},
    "pose jumps by 1 m for good": {"pose jumped"},
}


def recorded(name: str, folder: Path) -> list[Frame]:
    frames = FAULTS[name].frames(list(semantic_faults.drive()))
    write_folder(frames, folder)
    return frames


@pytest.mark.parametrize("name", NAMED)
def test_an_evaluation_names_what_map_names(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(name, tmp_path / "drive")
    chosen = ["--segmenter", "truth", "--set", "output.pictures=0", "--set", "grid.resolution_m=0.1"]
    assert run(["map", str(tmp_path / "drive"), "-o", str(tmp_path / "map"), *chosen]) == 0
    capsys.readouterr()
    command = ["evaluate", str(tmp_path / "drive"), "-o", str(tmp_path / "out"), *chosen, "--no-budget",
               "--resolution", "0.1", "--workers", "1"]  # fmt: skip
    assert run(command) == 0
    said = capsys.readouterr().out
    found = json.loads((tmp_path / "out" / "results.json").read_text())
    mapped = json.loads((tmp_path / "map" / "summary.json").read_text())["watchdog"]
    assert set(found["faults"]) == set(mapped["faults"]) == NAMED[name]
    doubted = NAMED[name] - {"pose jumped"}
    assert [line.split(" (from")[0] for line in found["warnings"]] == sorted(doubted)
    assert all(f"warning: {line}" in said for line in found["warnings"])
    report = (tmp_path / "out" / "report.html").read_text()
    assert report.count("<strong>Warning:</strong>") == len(doubted)
    strict = [*command, "--overwrite", "--strict"]
    assert run(strict) == (1 if "pose jumped" in NAMED[name] else 0), "what is mapped does not stop it"


def test_records_are_the_same_however_frames_are_split(tmp_path: Path) -> None:
    recorded("pose drifts by 2 cm an image", tmp_path / "drive")
    config = replace(Config(), segmenter=semantic_faults.CONFIG.segmenter)
    plan = make_plan(
        DatasetSpec(str(tmp_path / "drive")), config,
        resolutions_m=(0.2,), protocols=("dense",), with_budget=False,
    )  # fmt: skip
    whole = evaluate_part(plan, 0, 14)
    assert '"pair":[' in whole
    assert '"ground":[' in whole
    for cuts in ([0, 8, 14], [0, 3, 9, 10, 14]):
        assert "".join(evaluate_part(plan, a, b) for a, b in pairwise(cuts)) == whole


def looks(frames: Sequence[Frame], config: WatchdogConfig) -> list[dict[str, object]]:
    looker = Looker(config)
    return [{"name": f.name, "looks": looker.see(i, f)} for i, f in enumerate(frames)]


def test_a_record_of_any_frame_needs_a_few_before_it() -> None:
    frames, config = semantic_faults.drive(), WatchdogConfig()
    whole = looks(frames, config)
    for start in range(len(frames)):
        looker, begin = Looker(config), first_looked_at(start)
        assert start - begin < 10
        seen = [looker.see(i, frames[i]) for i in range(begin, len(frames))]
        assert seen[start - begin :] == [record["looks"] for record in whole[start:]]


def test_frames_of_another_place_neither_jump_nor_move() -> None:
    here = [replace(f, tags={"sequence": "a"}) for f in semantic_faults.drive()[:7]]
    there = semantic_faults.moved(lambda _, m: m + semantic_faults.by(x=50))(list(here))
    there = [
        replace(f, tags={"sequence": "b"}, rgb=np.ascontiguousarray(255 - f.rgb), stamp_ns=f.stamp_ns + 10**9)
        for f in there
    ]
    config = WatchdogConfig()
    assert not watchdog_of(looks([*here, *there], config), config)["faults"]
    one_place = [replace(f, tags={}) for f in [*here, *there]]
    assert "pose jumped" in watchdog_of(looks(one_place, config), config)["faults"]


def test_frames_that_are_not_mapped_put_no_pose_in_doubt() -> None:
    frames = FAULTS["every image twice"].frames(list(semantic_faults.drive()))
    config = WatchdogConfig()
    found = watchdog_of(looks(frames, config), config)
    assert set(found["faults"]) == {"frozen"}
    check = FrameCheck(config)
    assert sum(not check.is_fit(f) for f in frames) == found["faults"]["frozen"] == 7
    assert found["first"]["frozen"] == check.first["frozen"]


def test_switched_off_nothing_is_compared() -> None:
    off = WatchdogConfig(doubt_limit=None)
    records = looks(FAULTS["depth 10 % too long"].frames(list(semantic_faults.drive())), off)
    assert not any({"pair", "shifted"} & set(record["looks"]) for record in records)  # type: ignore[call-overload]
    assert watchdog_of(records, off) == {"faults": {}, "first": {}, "doubts": {}}
