"""Recordings that are added to a finished run: counted once, whole or not at all, as drives of their own."""

import json
from pathlib import Path

import pytest
import typer

from swardmap.cli.compare import compare_command
from swardmap.cli.evaluate import EXAMPLES, evaluate_command
from swardmap.errors import InputError
from swardmap.eval.dataset import DatasetSpec
from swardmap.eval.gathered import added_folders, gather, place_for_more
from swardmap.eval.run import evaluate
from swardmap.geometry import Intrinsics
from swardmap.io.sources.folder import write_folder
from swardmap.synth.analytic import AnalyticSource, StereoNoise, garden_scene, lane_poses

SMALL = Intrinsics(96, 72, 69.0, 69.0, 47.5, 35.5)

CARELESS = ("--set", "grid.min_grass_points=1")
"""So that frames have missed cells."""

app = typer.Typer(add_completion=False, rich_markup_mode=None)
app.command("evaluate", epilog=EXAMPLES)(evaluate_command)
app.command("compare")(compare_command)


def run(*words: object) -> None:
    app([str(word) for word in words], standalone_mode=False)


@pytest.fixture
def drives(tmp_path: Path) -> list[Path]:
    for i in range(3):
        source = AnalyticSource(
            garden_scene(i), tuple(lane_poses(3 + i, step_m=0.3)), SMALL, noise=StereoNoise()
        )
        write_folder(source, tmp_path / f"drive{i}")
    return [tmp_path / f"drive{i}" for i in range(3)]


@pytest.fixture
def out(drives: list[Path], tmp_path: Path) -> Path:
    run("evaluate", drives[0], "-o", tmp_path / "out", "--segmenter", "colour", *CARELESS, "--workers", 1,
        "--no-budget", "--resolution", 0.1, "--share", 0.5, "--confidence", 0.6,
        "--protocol", "dense")  # fmt: skip
    return tmp_path / "out"


def found_in(out: Path) -> dict:  # type: ignore[type-arg]
    return dict(json.loads((out / "results.json").read_text()))


def test_what_is_added_counts_as_if_it_had_been_there(out: Path, drives: list[Path], tmp_path: Path) -> None:
    run("evaluate", drives[1], "-o", out, "--more", "--workers", 1)
    both = found_in(out)
    run("evaluate", drives[1], "-o", tmp_path / "second", "--segmenter", "colour", *CARELESS, "--workers", 1,
        "--no-budget", "--resolution", 0.1, "--protocol", "dense")  # fmt: skip
    second = found_in(tmp_path / "second")
    assert both["frames"] == {"total": 7, "evaluated": 7, "unreadable": []}
    assert both["recordings"] == [{"name": "drive0", "frames": 3}, {"name": "drive1", "frames": 4}]
    assert both["margin"]["options"]["share"] == 0.5  # as the run had it
    first = gather(out)
    assert [m.first for m in first.members] == [0, 3]
    added = second["masks"]["overall"]["counted"]
    alone = sum(sum(map(sum, r["mask"]["counts"])) for r in first.records[:3])
    assert both["masks"]["overall"]["counted"] == alone + added
    assert set(both["masks"]["by"]["sequence"]) == {"drive0", "drive1"}
    assert both["unit"] == "scene"  # gardens know it; else drives are what is independent
    assert [r["index"] for r in first.records] == list(range(7))
    assert first.records[3]["name"].startswith("drive1/")
    assert first.locate(3)[0].dataset.location == str(drives[1])
    assert first.locate(5) == (first.members[1].plan, 2)
    page = (out / "report.html").read_text()
    assert "the maps of drive0 and 1 more recording can be trusted" in page
    assert "drive1/" in page


def test_a_recording_without_clean_depth_is_left_out_of_the_budget_alone(tmp_path: Path) -> None:
    for i, clean in ((0, True), (1, False)):
        poses = tuple(lane_poses(2, step_m=0.3))
        write_folder(
            AnalyticSource(garden_scene(i), poses, SMALL, noise=StereoNoise()), tmp_path / f"drive{i}"
        )
        if clean:
            write_folder(AnalyticSource(garden_scene(i), poses, SMALL), tmp_path / "clean")
    few = ("--workers", 1, "--segmenter", "truth", "--resolution", 0.1, "--protocol", "dense")
    out = tmp_path / "out"
    run("evaluate", tmp_path / "drive0", "--clean", tmp_path / "clean", "-o", out, *few)
    rows = found_in(out)["budget"]["rows"]
    run("evaluate", tmp_path / "drive1", "-o", out, "--more", "--workers", 1)
    assert found_in(out)["frames"]["evaluated"] == 4
    assert found_in(out)["budget"]["rows"] == rows
    assert list(found_in(out)["budget"]["not_run"]) == ["2 frames"]


def test_no_frame_counts_twice(out: Path, drives: list[Path]) -> None:
    with pytest.raises(InputError, match="no frame counts twice"):
        run("evaluate", drives[0], "-o", out, "--more", "--set", "source.start=1")
    run("evaluate", drives[1], "-o", out, "--more", "--workers", 1, "--set", "source.every=2")
    before = found_in(out)
    run("evaluate", drives[1], "-o", out, "--more", "--workers", 1, "--set", "source.every=2")
    assert {k: v for k, v in found_in(out).items() if k != "command"} == {
        k: v for k, v in before.items() if k != "command"
    }
    with pytest.raises(InputError, match="no frame counts twice"):
        run("evaluate", drives[1], "-o", out, "--more")
    run("evaluate", drives[1], "-o", out, "--more", "--workers", 1,
        "--set", "source.start=1", "--set", "source.every=2")  # fmt: skip
    assert found_in(out)["frames"]["total"] == 7
    assert [r["name"] for r in found_in(out)["recordings"]] == ["drive0", "drive1", "drive1 (2)"]


def test_an_addition_that_was_interrupted_counts_when_it_is_whole(out: Path, drives: list[Path]) -> None:
    plan, folder = place_for_more(out, DatasetSpec(str(drives[2])))
    evaluate(plan, folder, workers=1)
    (part,) = (folder / "parts").iterdir()
    part.write_bytes(part.read_bytes()[:-40])
    half = gather(out)
    assert len(half.records) == 3
    assert half.unfinished == ("drive2",)
    run("evaluate", drives[1], "-o", out, "--more", "--workers", 1)
    assert found_in(out)["frames"]["total"] == 7
    assert found_in(out)["unfinished"] == ["drive2"]
    run("evaluate", drives[2], "-o", out, "--more", "--workers", 1)
    assert found_in(out)["frames"]["total"] == 12
    assert [f.name for f in added_folders(out)] == ["001-drive2", "002-drive1"]


@pytest.mark.parametrize("frames", [10**12, -1, "many", None])
def test_a_number_of_frames_that_cannot_be_is_refused(out: Path, frames: object) -> None:
    written = json.loads((out / "plan.json").read_text())
    (out / "plan.json").write_text(json.dumps(written | {"frames": frames}))
    with pytest.raises(InputError, match="expected a number of frames"):
        gather(out)


def test_what_is_added_is_judged_as_the_run_was(out: Path, drives: list[Path], tmp_path: Path) -> None:
    for words in (
        ["--resolution", 0.2],
        ["--set", "grid.min_points=9"],
        ["--segmenter", "truth"],
        ["--overwrite"],
    ):
        with pytest.raises(typer.BadParameter, match="takes these from the run"):
            run("evaluate", drives[1], "-o", out, "--more", *words)
    with pytest.raises(InputError, match="evaluate"):
        run("evaluate", drives[1], "-o", tmp_path / "nothing", "--more")
    written = json.loads((out / "plan.json").read_text())
    written["plan"]["version"] = "0.0.1"
    (out / "plan.json").write_text(json.dumps(written))
    with pytest.raises(InputError, match="two versions are not added up"):
        run("evaluate", drives[1], "-o", out, "--more")


def test_a_refusal_names_both_ways_out(
    out: Path, drives: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    run("evaluate", drives[1], "-o", out, "--more", "--workers", 1, "--share", 0.99, "--confidence", 0.95)
    printed = capsys.readouterr().out
    assert "no margin: 99 % of the missed cells at 95 % confidence" in printed
    assert f"each added by: swardmap evaluate ANOTHER_RECORDING -o {out} --more" in printed
    assert "of 2 recordings: drive0, drive1" in printed
