"""The files of an evaluation.

results.json    everything, for programs
metrics.csv     every score, one a line        frames.csv   every frame, one a line
tables.md, .tex safety, and the paper's tables 2-10        report.html  for people
margin.yaml     the margin, as `map --config` takes it; only if the data carries the claim
config.yaml     all settings that were used
"""

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from swardmap.config import config_to_yaml
from swardmap.errors import InputError
from swardmap.eval.frame import Plan, split_key
from swardmap.eval.tables import latex, markdown, paper_tables, safety_tables
from swardmap.eval.tally import MapTally
from swardmap.io.door import MAX_JSON_BYTES, parse_json
from swardmap.io.files import read_bytes, write_text
from swardmap.io.maps.margin_file import Margin, MeasuredWith, margin_text

Record = Mapping[str, Any]


def write_results(
    out: Path, plan: Plan, records: Sequence[Record], results: Mapping[str, Any], html: str | None = None
) -> None:
    """Write all files; each is whole or not there, results.json comes last.

    Args:
        out: folder of the run.
        plan: of the run.
        records: of all frames.
        results: from `results.results`.
        html: the report; None writes none.

    Raises:
        OutputError: if one cannot be written.
    """
    tables = [*safety_tables(results), *paper_tables(results)]
    for name in ("results.json", "margin.yaml"):  # of an earlier run; both must not stand beside what follows
        (out / name).unlink(missing_ok=True)
    write_text(out / "config.yaml", config_to_yaml(plan.config))
    write_text(out / "metrics.csv", _csv(METRIC_HEAD, metric_rows(results)))
    write_text(out / "frames.csv", _csv(FRAME_HEAD, (frame_row(r, plan.main) for r in records)))
    write_text(out / "tables.md", markdown(tables))
    write_text(out / "tables.tex", latex(tables))
    margin = results["margin"]
    if margin["margin_m"] is not None:
        measured = MeasuredWith(**margin["measured_with"])
        known = Margin(margin["margin_m"], margin["person_margin_m"], measured)
        text = margin_text(known, margin["statement"])
        write_text(out / "margin.yaml", text)
    if html is not None:
        write_text(out / "report.html", html)
    write_text(out / "results.json", json.dumps(results, indent=1, allow_nan=False) + "\n")


def written_margin_options(out: Path) -> dict[str, Any]:
    """What the margin of an earlier evaluation was to promise; empty where there is none."""
    shape = {"share": float, "confidence": float, "unit": str, "population": str}
    try:
        content = read_bytes(out / "results.json", MAX_JSON_BYTES)
        found = parse_json(content, out, {"margin": {"options": shape}})
    except InputError:
        return {}
    return {name: found["margin"]["options"][name] for name in shape}


METRIC_HEAD = ("section", "protocol", "resolution_m", "tag", "group", "class", "metric", "value", "count")


def metric_rows(results: Mapping[str, Any]) -> Iterator[tuple[Any, ...]]:
    """Every score of masks and maps; an undefined value is an empty field with its count beside it."""
    for tag, group, section in _sections(results["masks"]):
        yield from _matrix_rows(("mask", "", "", tag, group), section)
    for key, grouped in results["maps"].items():
        protocol, resolution_m = split_key(key)
        for tag, group, section in _sections(grouped):
            where = ("map", protocol, resolution_m, tag, group)
            yield from _matrix_rows(where, section["cells"])
            yield from _matrix_rows(("map_joined", *where[1:]), section["joined"])
            for sort in ("all", "obstacle", "person", "obstacles_found_in_part"):
                d_min = section["d_min"][sort]
                for name in ("mean_m", "variance_m2", "max_m"):
                    yield (*where, sort, f"d_min_{name}", d_min[name], d_min["count"])
                for q, value in d_min["quantiles_m"].items():
                    yield (*where, sort, f"d_min_q{q}_m", value, d_min["count"])
            yield (*where, "", "frames_without_hit", section["frames_without_hit"], section["frames"])
    protocol, resolution_m = split_key(results["main"])
    for tag, group, section in _sections(results["metrics"]):
        for key, found in section.items():
            yield ("metric", protocol, resolution_m, tag, group, "", key, found["value"], found["of"])


FRAME_HEAD = (
    "index", "name", "tags", "error", "mask_accuracy", "obstacle_cells", "called_free", "not_seen",
    "false_alarms", "d_min_mean_m", "d_min_max_m", "missed_obstacles", "missed_called_free", "without_hit",
)  # fmt: skip


def frame_row(record: Record, key: str) -> tuple[Any, ...]:
    """One frame in the main kind of map."""
    from swardmap.eval.confusion import ConfusionMatrix

    if "error" in record:
        return (record["index"], "", "", record["error"], *[None] * (len(FRAME_HEAD) - 4))
    tally = MapTally.from_dict(record["maps"][key], split_key(key)[1])
    matrix, summary = tally.matrix, tally.distances().summary()
    tags = " ".join(f"{k}={v}" for k, v in record["tags"].items())
    return (
        record["index"], record["name"], tags, "", ConfusionMatrix.from_dict(record["mask"]).accuracy,
        matrix.obstacle_called_free.of, matrix.obstacle_called_free.count, matrix.obstacle_not_seen.count,
        matrix.free_called_obstacle.count, summary.mean_m, summary.max_m,
        tally.missed_obstacles, tally.missed_called_free, tally.frames_without_hit,
    )  # fmt: skip


def _sections(grouped: Mapping[str, Any]) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    if grouped["overall"] is not None:
        yield "", "", grouped["overall"]
    for tag, values in grouped["by"].items():
        for group, section in values.items():
            yield tag, group, section


def _matrix_rows(where: tuple[Any, ...], section: Mapping[str, Any]) -> Iterator[tuple[Any, ...]]:
    yield (*where, "", "accuracy", section["accuracy"], section["counted"])
    for scores in section["classes"]:
        for name in ("accuracy", "f1", "precision", "recall", "specificity", "iou"):
            yield (*where, scores["name"], name, scores[name], scores["support"])
    for name in ("obstacle_called_free", "person_called_free", "free_called_obstacle", "obstacle_not_seen"):
        yield (*where, "", name, section[name]["share"], section[name]["of"])


def _csv(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(["" if v is None else v for v in row] for row in rows)
    return text.getvalue()
