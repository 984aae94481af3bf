"""One list feeds every table: what it holds, and that sums of parts are the sums of the whole."""

import csv
import json
from pathlib import Path

import pytest

from swardmap.config import config_from_dict
from swardmap.errors import InvalidValueError
from swardmap.eval.compare import compare_runs, difference_row, run_names
from swardmap.eval.dataset import DatasetSpec
from swardmap.eval.metrics import METRICS, Metric, metric
from swardmap.eval.output import write_results
from swardmap.eval.pages import told_command
from swardmap.eval.report import report_html
from swardmap.eval.results import results, tallies_of, total_tallies
from swardmap.eval.run import evaluate, make_plan


def test_keys_are_unique_and_units_known() -> None:
    keys = [m.key for m in METRICS]
    assert len(set(keys)) == len(keys)
    with pytest.raises(InvalidValueError, match="unit"):
        Metric("x", "x", "furlong", lambda _: (0, 0))


def test_values_are_told_with_unit_and_sign() -> None:
    share, metres = metric("obstacle_called_free"), metric("d_min_mean")
    assert share.text(0.1234) == "12.34 %"
    assert share.text(-0.01, "+") == "-1.00 %"
    assert metres.text(0.2, "+") == "+0.200 m"
    assert share.text(None) == "–"  # noqa: RUF001 - the dash of the paper


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs over the same frames, with all their files."""
    out = tmp_path_factory.mktemp("metrics")
    for name in ("truth", "colour"):
        config = config_from_dict({"segmenter": {"name": name}})
        plan = make_plan(DatasetSpec("analytic:scenes=2,frames=3,width=96"), config, with_budget=False)
        records = evaluate(plan, out / name, workers=1)
        found = results(plan, records)
        write_results(out / name, plan, records, found, report_html(plan, found))
    return out


def test_one_entry_is_in_every_table(folder: Path) -> None:
    found = json.loads((folder / "colour" / "results.json").read_text())["metrics"]["overall"]
    rows = list(csv.DictReader((folder / "colour" / "metrics.csv").read_text().splitlines()))
    told = {r["metric"]: r["value"] for r in rows if r["section"] == "metric" and not r["group"]}
    (comparison,) = compare_runs([folder / "truth", folder / "colour"])
    compared = {d.key: d for d in comparison.differences}
    for entry in METRICS:
        value = found[entry.key]["value"]
        assert told[entry.key] == ("" if value is None else str(value))
        assert compared[entry.key].other == pytest.approx(value)
        assert difference_row(compared[entry.key])[0] == entry.title


def test_sums_of_frames_are_those_of_the_whole(folder: Path) -> None:
    config = config_from_dict({"segmenter": {"name": "colour"}})
    plan = make_plan(DatasetSpec("analytic:scenes=2,frames=3,width=96"), config, with_budget=False)
    records = evaluate(plan, folder / "colour", workers=1)
    whole = total_tallies(records, plan.main)
    for entry in METRICS:
        pairs = [entry.take(tallies_of(r, plan.main)) for r in reversed(records)]
        assert entry.take(whole) == pytest.approx(tuple(map(sum, zip(*pairs, strict=True))))


def test_runs_are_called_by_what_tells_them_apart() -> None:
    assert run_names([Path("/a/out"), Path("/b/other")]) == ["out", "other"]
    assert run_names([Path("/a/x/out"), Path("/a/y/out")]) == ["x/out", "y/out"]
    assert run_names([Path("/a/out"), Path("/a/out")]) == ["out", "out"]


def test_commands_are_told_without_folders() -> None:
    assert told_command("swardmap evaluate 'a b/c' -o /x/y") == "swardmap evaluate 'a b/c' -o y"
    assert told_command("swardmap evaluate 'unpaired") == "swardmap evaluate 'unpaired"
