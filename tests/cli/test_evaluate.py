"""`swardmap evaluate` and `swardmap compare` on recordings on the disk."""

import json
from pathlib import Path

import pytest
import typer

from swardmap.cli.compare import compare_command
from swardmap.cli.evaluate import EXAMPLES, evaluate_command
from swardmap.config import load_config
from swardmap.errors import InputError, InvalidValueError, OutputError
from swardmap.geometry import Intrinsics
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.maps.map_files import write_map
from swardmap.io.maps.margin_file import read_margin
from swardmap.io.sources.eden import write_eden
from swardmap.io.sources.folder import write_folder
from swardmap.synth.analytic import AnalyticSource, StereoNoise, garden_scene, lane_poses

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
FILES = {"config.yaml", "frames.csv", "metrics.csv", "plan.json", "report.html", "results.json",
         "tables.md", "tables.tex", "parts", ".swardmap"}  # fmt: skip

app = typer.Typer(add_completion=False, rich_markup_mode=None)
app.command("evaluate", epilog=EXAMPLES)(evaluate_command)
app.command("compare")(compare_command)


def run(*words: object) -> None:
    app([str(word) for word in words], standalone_mode=False)


def garden(noise: StereoNoise | None, n: int = 6) -> AnalyticSource:
    return AnalyticSource(garden_scene(1), tuple(lane_poses(n, step_m=0.3)), SMALL, noise=noise)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    write_folder(garden(StereoNoise()), tmp_path / "garden")
    return tmp_path / "garden"


def test_a_recording_becomes_tables_report_and_margin(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_folder(garden(None), tmp_path / "clean")
    lawn = OccupancyGrid.unknown(GridSpec(0.1, 30, 30))
    lawn.classes[:] = 1
    write_map(lawn, tmp_path / "map.yaml")
    run("evaluate", recording, "-o", tmp_path / "out", "--segmenter", "colour", "--clean", tmp_path / "clean",
        "--share", 0.5, "--confidence", 0.8, "--workers", 1, "--map", tmp_path / "map.yaml",
        "--set", "grid.min_points=5", "--set", "grid.min_grass_points=1")  # fmt: skip
    printed = capsys.readouterr()
    assert "6 of 6 frames evaluated with 'colour'" in printed.out
    assert "evaluated 6 of 6 frames" in printed.err
    assert {p.name for p in (tmp_path / "out").iterdir()} == FILES | {"margin.yaml"}
    found = json.loads((tmp_path / "out" / "results.json").read_text())
    margin = read_margin(tmp_path / "out" / "margin.yaml")
    assert found["margin"]["margin_m"] == margin.margin_m > 0
    assert load_config(tmp_path / "out" / "margin.yaml").costmap.margin_m == margin.margin_m
    assert f"margin: {margin.margin_m:.3f} m" in printed.out
    assert found["budget"]["not_run"] == {}
    assert found["cost"]["points"][0]["share"] > 0.9
    assert found["cost"]["margin_m"] == margin.margin_m


def test_true_labels_have_no_error_in_the_mask_stage(recording: Path, tmp_path: Path) -> None:
    run("evaluate", recording, "-o", tmp_path / "out", "--segmenter", "truth", "--workers", 1,
        "--protocol", "dense", "--protocol", "paper-own")  # fmt: skip
    found = json.loads((tmp_path / "out" / "results.json").read_text())
    assert found["masks"]["overall"]["accuracy"] == 1
    rows = {row["stage"]: row for row in found["budget"]["rows"]}
    assert rows["+ mask"]["added"] == {
        k: 0.0 if v is not None else None for k, v in rows["+ mask"]["added"].items()
    }
    assert "clean depth" in found["budget"]["not_run"]["depth"]
    assert found["margin"]["margin_m"] is None
    assert (
        "at least 299 independent frames" in found["margin"]["reason"]
        or "no frame" in found["margin"]["reason"]
    )
    assert not (tmp_path / "out" / "margin.yaml").exists()
    paper = found["maps"]["paper-own@0.05"]["overall"]["joined"]
    assert paper["accuracy"] == 1
    assert all(c["f1"] in (1, None) for c in paper["classes"])


def test_a_damaged_frame_is_named_and_strict_stops_on_it(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = sorted((recording / "depth").iterdir())[2]
    bad.write_bytes(bad.read_bytes()[:100])
    (sorted((recording / "rgb").iterdir())[4]).unlink()
    run("evaluate", recording, "-o", tmp_path / "out", "--segmenter", "truth", "--workers", 1, "--no-budget")
    printed = capsys.readouterr().out
    assert "4 of 6 frames evaluated" in printed
    assert "not evaluated: frame 2: " in printed
    assert bad.name in printed
    assert "not evaluated: frame 4" in printed
    assert bad.name in (tmp_path / "out" / "report.html").read_text()
    with pytest.raises(InputError, match="frame 2"):
        run(
            "evaluate",
            recording,
            "-o",
            tmp_path / "strict",
            "--segmenter",
            "truth",
            "--workers",
            1,
            "--strict",
        )


def test_json_for_programs(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(
        "evaluate",
        recording,
        "-o",
        tmp_path / "out",
        "--segmenter",
        "truth",
        "--workers",
        1,
        "--no-budget",
        "--json",
    )
    printed = capsys.readouterr()
    assert printed.err == ""
    assert json.loads(printed.out) == json.loads((tmp_path / "out" / "results.json").read_text())


def test_eden_written_here_is_evaluated_by_illumination_and_scene(tmp_path: Path) -> None:
    write_eden(garden(None, 3), tmp_path / "eden", scene="0003", illumination="clear")
    run("evaluate", tmp_path / "eden", "-o", tmp_path / "out", "--segmenter", "truth", "--workers", 1)
    found = json.loads((tmp_path / "out" / "results.json").read_text())
    assert found["frames"]["evaluated"] == 3
    assert set(found["masks"]["by"]) >= {"illumination", "scene"}
    assert "**Table 2.**" in (tmp_path / "out" / "tables.md").read_text()


def test_runs_are_compared(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("truth", "colour"):
        run("evaluate", recording, "-o", tmp_path / name, "--segmenter", name, "--workers", 1, "--no-budget")
    capsys.readouterr()
    run("compare", tmp_path / "truth", tmp_path / "colour", "--out", tmp_path / "compare.html")
    table = capsys.readouterr().out
    page = (tmp_path / "compare.html").read_text()
    assert "<h1>colour against truth</h1>" in page
    assert "things dangerous" in page
    assert str(tmp_path) not in page
    assert "6 frames, 6 frames" in table
    assert "pixels right" in table
    run("compare", tmp_path / "truth", tmp_path / "colour", "--out", tmp_path / "compare.tex")
    paper = (tmp_path / "compare.tex").read_text()
    assert r"\label{tab:compare-C1}" in paper
    assert r"pixels right & 100.00 \% &" in paper
    assert r"\toprule" in paper
    with pytest.raises(InputError, match=r"ends in .html, .tex or .md"):
        run("compare", tmp_path / "truth", tmp_path / "colour", "--out", tmp_path / "compare.doc")
    capsys.readouterr()
    run("compare", tmp_path / "truth", tmp_path / "colour", "--json")
    (comparison,) = json.loads(capsys.readouterr().out)
    (first,) = (d for d in comparison["differences"] if d["key"] == "pixels_right")
    assert first["first"] == 1
    assert first["low"] <= first["difference"] <= first["high"] <= 0
    with pytest.raises(InputError, match="confidence"):
        run("compare", tmp_path / "truth", tmp_path / "colour", "--confidence", 95)


def test_wrong_use_is_one_clear_error(recording: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such recording"):
        run("evaluate", tmp_path / "nothing", "-o", tmp_path / "out")
    with pytest.raises(InvalidValueError, match="between 0 and 1"):
        run(
            "evaluate",
            recording,
            "-o",
            tmp_path / "out",
            "--segmenter",
            "truth",
            "--share",
            99,
            "--workers",
            1,
        )
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("mine")
    with pytest.raises(OutputError, match="was not made by swardmap"):
        run("evaluate", recording, "-o", tmp_path / "full")
    with pytest.raises(InputError, match="swardmap evaluate"):
        run("compare", tmp_path / "full", tmp_path / "full")
