import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest

from swardmap.config import config_from_dict, load_config
from swardmap.errors import InvalidValueError
from swardmap.eval.confusion import ConfusionMatrix
from swardmap.eval.dataset import DatasetSpec
from swardmap.eval.frame import Plan
from swardmap.eval.margin_section import MarginOptions
from swardmap.eval.output import METRIC_HEAD, write_results
from swardmap.eval.report import report_html
from swardmap.eval.results import groups_of, map_total, mask_total, results, worst_first
from swardmap.eval.run import evaluate, make_plan
from swardmap.eval.safety import SafetyTally
from swardmap.eval.tables import latex, markdown, paper_tables
from swardmap.eval.tally import MapTally

Run = tuple[Plan, list[dict[str, Any]], dict[str, Any]]
COMMAND = "swardmap evaluate 'a <b> & c' -o out"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    careless = {"min_grass_points": 1}  # so that frames have missed cells
    config = config_from_dict(
        {"geometry": {"enabled": False}, "segmenter": {"name": "colour"}, "grid": careless}
    )
    plan = make_plan(
        DatasetSpec("analytic:scenes=2,frames=4,width=128"), config, protocols=("dense", "paper-own")
    )
    records = evaluate(plan, tmp_path_factory.mktemp("run"), workers=1)
    records[5] = {"index": 5, "error": "rgb/<5>.png is truncated"}
    return plan, records, results(plan, records, MarginOptions(0.5, 0.8), COMMAND)


def test_groups_add_up_to_the_whole(run: Run) -> None:
    plan, records, found = run
    good = [r for r in records if "error" not in r]
    groups = groups_of(good)["sequence"]
    assert sum(map(len, groups.values())) == len(good) == 7
    whole = map_total(good, plan.main)
    assert sum((map_total(rs, plan.main) for rs in groups.values()), MapTally(0.05)) == whole
    masks = [mask_total(rs) for rs in groups.values()]
    assert masks[0] + masks[1] == mask_total(good)
    section = found["maps"][plan.main]["overall"]
    assert section["d_min"]["all"]["count"] + section["d_min"]["without_hit"] == sum(whole.misses.values())
    assert sum(b["count"] for b in section["d_min"]["by_range_m"]) == section["d_min"]["all"]["count"]
    assert sum(r["missed"] for r in section["missed"]["by_size"]) == section["missed"]["missed"]
    assert section["cells"]["obstacle_called_free"]["count"] == sum(whole.misses.values())


def test_results_are_json_without_nan_and_tell_what_was_left_out(run: Run) -> None:
    _, _, found = run
    again = json.loads(json.dumps(found, allow_nan=False))
    assert again["frames"] == {
        "total": 8, "evaluated": 7, "unreadable": [{"index": 5, "error": "rgb/<5>.png is truncated"}],
    }  # fmt: skip
    assert set(again["maps"]) == {"dense@0.05", "dense@0.1", "paper-own@0.05", "paper-own@0.1"}
    assert again["budget"]["not_run"] == {}
    assert again["budget"]["rows"][0]["stage"] == "truth"


def test_the_first_protocol_of_the_budget_is_the_main_map(run: Run) -> None:
    """+ depth is the whole pipeline on true poses against clean truth: the dense map itself."""
    _, _, found = run
    rows = {row["stage"]: row for row in found["budget"]["rows"]}
    main = found["maps"]["dense@0.05"]["overall"]
    assert rows["+ depth"]["called_free"] == main["cells"]["obstacle_called_free"]
    assert rows["+ depth"]["missed"] == main["missed"]["missed"]
    assert rows["+ depth"]["d_min"] == main["d_min"]["all"]


def test_margin_sections_name_every_claim(run: Run) -> None:
    _, _, found = run
    margin = found["margin"]
    combinations = {(c["unit"], c["population"], c["cells"]) for c in margin["claims"]}
    assert len(combinations) == len(margin["claims"]) == 8
    assert {c[0] for c in combinations} == {"frame", "sequence"}
    shares = [share for _, share in margin["curve"]]
    assert shares == sorted(shares)
    assert shares[-1] == 1
    assert margin["margin_m"] is not None
    assert f"{margin['margin_m']:.3f} m" in margin["statement"]
    assert "obstacles of which nothing was found" in margin["not_covered"]


def test_a_margin_that_cannot_be_meant_is_refused(run: Run) -> None:
    plan, records, _ = run
    with pytest.raises(InvalidValueError, match="tag 'lawn'; expected frame or one of: sequence"):
        results(plan, records, MarginOptions(unit="lawn"))
    with pytest.raises(InvalidValueError, match="between 0 and 1"):
        MarginOptions(share=99)
    with pytest.raises(InvalidValueError, match="population"):
        MarginOptions(population="some")


def test_worst_frames_first(run: Run) -> None:
    plan, records, found = run
    good = [r for r in records if "error" not in r]
    order = worst_first(good, plan.main)
    assert [r["index"] for r in order] == found["worst"]
    assert sorted(found["worst"]) == [r["index"] for r in good]
    tallies = [SafetyTally.from_dict(r["safety"]) for r in order]
    stakes = [
        (t.of_things(height="person")[2], t.of_things()[2], r["maps"][plan.main]["frames"][2])
        for t, r in zip(tallies, order, strict=True)
    ]
    assert stakes == sorted(stakes, reverse=True)


def test_the_papers_tables_in_its_layout(run: Run) -> None:
    _, _, found = run
    tables = paper_tables(found)
    assert [t.number for t in tables] == [3, 4, 5, 6, 7, 8, 9, 10, 6, 7, 8, 9, 10]
    assert all(len(row) == len(t.head) for t in tables for row in t.rows)
    six = tables[8]
    assert [row[:2] for row in six.rows] == [
        ("0.05", "Unknown"), ("", "Obstacle"), ("", "Grass"),
        ("0.1", "Unknown"), ("", "Obstacle"), ("", "Grass"),
    ]  # fmt: skip
    assert six.rows[0][2:] == ("100.00",) * 5  # the paper's protocol: unknown agrees exactly
    matrix = ConfusionMatrix.from_dict(found["masks"]["overall"]["matrix"])
    three = tables[0]
    assert three.head[0] == "Class"
    assert three.rows[1][1] == ""  # two classes: the accuracy is printed once
    right = sum(matrix.counts[i][i] for i in range(len(matrix.names)))
    if len(matrix.names) == 2:
        assert three.rows[0][1] == f"{100 * right / matrix.total:.2f}"
    text = markdown(tables)
    assert "| Sequence | Class | Accuracy [%] | F1 [%] |" in text
    tex = latex(tables)
    assert tex.count(r"\begin{tabular}") == tex.count(r"\end{tabular}") == len(tables)
    labels = re.findall(r"\\label\{(.+?)\}", tex)
    assert len(set(labels)) == len(tables)
    assert {"tab:masks-3", "tab:dense-6", "tab:paper-own-10"} <= set(labels)
    assert not re.search(r"(?<!\\)%(?! needs)", tex)
    assert not re.search(r"(?<!\\)_(?!\{)", tex)


def test_illumination_gives_table_2(run: Run) -> None:
    plan, records, _ = run
    lit = [
        r if "error" in r else r | {"tags": {"illumination": "clear" if r["index"] % 2 else "sunset"}}
        for r in records
    ]
    tables = paper_tables(results(plan, lit))
    assert [t.number for t in tables][:3] == [2, 3, 6]
    assert [row[0] for row in tables[0].rows if row[0]] == ["Clear", "Sunset"]


def test_every_file_is_written_and_reads_back(run: Run, tmp_path: Path) -> None:
    plan, records, found = run
    write_results(tmp_path, plan, records, found, "<html></html>")
    assert json.loads((tmp_path / "results.json").read_text()) == json.loads(json.dumps(found))
    rows = list(csv.DictReader((tmp_path / "metrics.csv").read_text().splitlines()))
    assert tuple(rows[0]) == METRIC_HEAD
    (accuracy,) = [
        r for r in rows
        if r["section"] == "map" and r["protocol"] == "dense" and r["resolution_m"] == "0.1"
        and r["metric"] == "accuracy" and not r["group"] and not r["class"]
    ]  # fmt: skip
    assert float(accuracy["value"]) == found["maps"]["dense@0.1"]["overall"]["cells"]["accuracy"]
    undefined = [r for r in rows if r["value"] == ""]
    assert undefined
    assert all(r["count"] for r in undefined)
    frames = list(csv.DictReader((tmp_path / "frames.csv").read_text().splitlines()))
    assert [f["index"] for f in frames] == [str(i) for i in range(8)]
    assert "truncated" in frames[5]["error"]
    assert load_config(tmp_path / "margin.yaml").costmap.margin_m == found["margin"]["margin_m"]
    assert load_config(tmp_path / "config.yaml") == plan.config
    refused = results(plan, records)  # 99 % cannot be claimed from 7 frames
    write_results(tmp_path, plan, records, refused)
    assert not (tmp_path / "margin.yaml").exists()


def test_no_frame_at_all_is_a_report_too(run: Run, tmp_path: Path) -> None:
    plan, _, _ = run
    records = [{"index": i, "error": "gone"} for i in range(3)]
    found = results(plan, records)
    assert found["masks"]["overall"] is None
    html = report_html(plan, found)
    assert "No frame could be evaluated" in html
    write_results(tmp_path, plan, records, found, html)
    assert json.loads((tmp_path / "results.json").read_text())["frames"]["evaluated"] == 0
