"""The report: one HTML file that works from a disk, offline, on a phone and in print."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from swardmap.eval import charts
from swardmap.eval.charts import Mark
from swardmap.eval.dataset import dataset_name
from swardmap.eval.distances import DistanceHistogram
from swardmap.eval.frame import Plan
from swardmap.eval.gallery import LAYERS, frame_views
from swardmap.eval.gathered import alone
from swardmap.eval.look_again import FrameAgain
from swardmap.eval.metrics import UNDEFINED, interval_text, metric
from swardmap.eval.pages import metres, pct, points, render, told_command
from swardmap.eval.tables import paper_tables, safety_tables
from swardmap.eval.truth import GROUNDS
from swardmap.eval.worst import FRAMES_SHOWN, things_first, things_view, worst_frames
from swardmap.viz.maps import COLOR_OF_CLASS

Results = Mapping[str, Any]
Row = tuple[str, ...]

SECTIONS = {
    "safety": "What a safety engineer reads first",
    "things": "Worst things first",
    "frames": "Where they stand: frames with most at stake first",
    "budget": "Where the errors come from",
    "distances": "How far misses are from what was found",
    "margin": "The margin",
    "cost": "What the margin costs",
    "missed": "Obstacles missed as a whole",
    "tables": "The paper's tables",
    "left-out": "Frames left out",
}
"""Sections by name, which is that of their template, and their titles; empty ones are left out."""


def report_html(plan: Plan, results: Results, again: Sequence[tuple[int, FrameAgain]] | None = None) -> str:
    """The whole page.

    Args:
        plan: of the run.
        results: from `results.results`.
        again: from `worst_frames`; None reads them of the plan.
    """
    frames, has_frames = results["frames"], results["masks"]["overall"] is not None
    if again is None:
        again = worst_frames(alone(plan, [{}] * frames["total"]), results)
    views = frame_views(things_first(again)[:FRAMES_SHOWN], results["margin_in_use_m"])
    told: dict[str, Any] = {
        "safety": safety_view(results) if has_frames else None,
        "things": things_view(results, again, {view["id"] for view in views}) if again else None,
        "budget": budget_view(results),
        "distances": distances_view(results) if has_frames else None,
        "margin": results["margin"],
        "cost": cost_view(results),
        "missed": missed_view(results) if has_frames else None,
        "frames": views,
        "tables": [*safety_tables(results)[1:], *paper_tables(results)],
        "left_out": frames["unreadable"],
    }
    shown = [{"name": n, "title": t} for n, t in SECTIONS.items() if told[n.replace("-", "_")]]
    return render(
        "evaluation.html",
        title=title(results),
        subtitle=f"{frames['evaluated']} of {frames['total']} frames, segmenter {results['segmenter']}, "
        f"maps {results['main']} m",
        sections=shown,
        command=told_command(results["command"]) or "made from Python",
        has_frames=has_frames,
        warnings=results.get("warnings", []),
        cards=cards(results) if has_frames else [],
        margin_chart=margin_chart(results),
        claims={"heads": CLAIM_HEADS, "rows": [claim_row(c) for c in results["margin"]["claims"]]},
        cost_keys=_markup('<span class="key" style="background:var(--miss)"></span>misses covered'
                          '<span class="key" style="background:var(--grass)"></span>lawn still reached'),
        map_colors=_map_colors(),
        layers=LAYERS,
        **told,
    )  # fmt: skip


def title(results: Results) -> str:
    """What was judged: the recording, and how many were added to it."""
    more = len(results.get("recordings", ())) - 1
    added = "" if more < 1 else f" and {more} more recording{'s' if more > 1 else ''}"
    return f"How far the maps of {dataset_name(results['dataset'])}{added} can be trusted"


CARDS = ("things_missed", "things_dangerous", "corridor_missed", "false_stops", "free_beyond_margin_near",
         "lawn_kept_near", "d_min_mean", "pixels_right")  # fmt: skip


def cards(results: Results) -> list[tuple[str, str, str]]:
    """What matters, as (value, what it is, its counts)."""
    told = []
    for key in CARDS:
        found, entry = results["metrics"]["overall"][key], metric(key)
        interval = interval_text(found)
        more = f"{found['count']} of {found['of']}" if entry.unit == "%" else f"{found['of']} missed cells"
        told.append(
            (entry.text(found["value"]), entry.title, f"{more}; 95 %: {interval}" if interval else more)
        )
    return told


def safety_view(results: Results) -> dict[str, Any]:
    """Headlines, things by height, kind and distance, cells by what is in them, what nobody judged."""
    (headline, *_), section = safety_tables(results), results["safety"]
    edges = [*section["range_edges_m"], None]
    bands = [
        f"{low:g} m and more" if high is None else f"{low:g} to {high:g} m" for low, high in pairwise(edges)
    ]
    counts = section["counts"]
    groups = [
        (title, str(counts.get(name, 0)), _share(counts, f"{name}_free", name),
         _share(counts, f"{name}_free_beyond", name))
        for name, title in (("standing", "over 5 cm high"), ("flat", "flat"), ("water", "water"))
    ]  # fmt: skip
    return {
        "headline": headline,
        "things": {
            "by height": [things_row(r, r["height"]) for r in section["by_height"]],
            "by distance": [things_row(r, bands[r["band"]]) for r in section["by_range"] if r["things"]],
            "by kind": [things_row(r, r["kind"]) for r in section["by_kind"]],
            "test body of ISO 18497, by distance": [
                things_row(r, bands[r["band"]]) for r in section["test_body_by_range"] if r["things"]
            ],
        },
        "groups": groups,
        "margin_m": section["margin_m"],
        "unjudged": {name.removeprefix("unjudged_"): n for name, n in counts.items() if "unjudged" in name},
        "judged": counts.get("judged_pixels", 0),
        "grounds": {
            said: counts[key] for name, said in GROUNDS.items() if counts.get(key := f"frames_ground_{name}")
        },
        "with_ids": counts.get("frames_with_ids", 0),
        "frames": counts.get("frames", 0),
    }


def things_row(row: Mapping[str, Any], name: str) -> Row:
    """One row of things, missed and dangerous."""
    return name, str(row["things"]), str(row["missed"]), str(row["dangerous"])


def _share(counts: Mapping[str, int], part: str, whole: str) -> str:
    return pct(counts.get(part, 0) / counts[whole] if counts.get(whole) else None)


def budget_view(results: Results) -> dict[str, Any] | None:
    """The error budget as bars and as a table."""
    rows, not_run = results["budget"]["rows"], results["budget"]["not_run"]
    if not rows:
        return {"rows": [], "not_run": not_run} if not_run else None
    heads = ("", "called free", "not seen", "false alarms", "mean d_min", "missed", "called free",
             "adds to called free", "adds to missed")  # fmt: skip
    body = [
        (r["stage"], pct(r["called_free"]["share"]), pct(r["not_seen"]["share"]),
         pct(r["false_alarm"]["share"]), metres(r["d_min"]["mean_m"]), str(r["missed"]),
         str(r["missed_called_free"]), points(r["added"]["called_free"]), f"{r['added']['missed']:+.0f}")
        for r in rows
    ]  # fmt: skip
    called = [(r["stage"], r["called_free"]["share"], pct(r["called_free"]["share"])) for r in rows]
    unseen = [(r["stage"], r["not_seen"]["share"], pct(r["not_seen"]["share"])) for r in rows]
    return {
        "heads": heads,
        "rows": body,
        "not_run": not_run,
        "called_chart": _markup(charts.bars(called, "obstacle cells called free", "", "var(--miss)")),
        "unseen_chart": _markup(charts.bars(unseen, "obstacle cells not seen", "", "var(--soft)")),
    }


DISTANCE_HEADS = ("missed cells", "count", "mean", "variance", "median", "90 %", "95 %", "99 %", "largest")


def distances_view(results: Results) -> dict[str, Any]:
    """Histogram of d_min-obst and its summary by class and range."""
    d_min = results["maps"][results["main"]]["overall"]["d_min"]
    names = {
        "all": "all", "obstacle": "obstacle cells", "person": "person cells",
        "obstacles_found_in_part": "of obstacles found in part",
    }  # fmt: skip
    rows = [distance_row(name, d_min[key]) for key, name in names.items()]
    for band in d_min["by_range_m"]:
        upper = "and more" if band["to"] is None else f"to {band['to']:g} m"
        rows.append(distance_row(f"{band['from']:g} {upper} away", band))
    histogram = DistanceHistogram.from_dict(d_min["histogram"])
    if histogram.count == 0:
        return {"chart": None, "heads": DISTANCE_HEADS, "rows": rows}
    mean, q99 = d_min["all"]["mean_m"], d_min["all"]["quantiles_m"]["0.99"]
    marks = [
        Mark(mean, f"mean {mean:.2f} m", "var(--obstacle)"),
        Mark(q99, f"99 % {q99:.2f} m", "var(--ink)"),
    ]
    width = max(histogram.resolution_m, (d_min["all"]["max_m"] or 0) / 40)
    chart = charts.histogram(histogram.bins(width), marks, "d_min-obst in metres", "cells", "d_min-obst")
    return {"chart": _markup(chart), "heads": DISTANCE_HEADS, "rows": rows}


def distance_row(name: str, d_min: Mapping[str, Any]) -> Row:
    """One row of the summary of distances."""
    variance = UNDEFINED if d_min["variance_m2"] is None else f"{d_min['variance_m2']:.4f} m²"
    quantiles = map(metres, d_min["quantiles_m"].values())
    return name, str(d_min["count"]), metres(d_min["mean_m"]), variance, *quantiles, metres(d_min["max_m"])


def margin_chart(results: Results) -> str | None:
    """The curve of coverage."""
    margin = results["margin"]
    if not margin["curve"]:
        return None
    marks = []
    if margin["margin_m"] is not None:
        marks.append(Mark(margin["margin_m"], f"margin {margin['margin_m']:.2f} m", "var(--grass)"))
    d_min = results["maps"][results["main"]]["overall"]["d_min"]
    population = "obstacles_found_in_part" if margin["options"]["population"] == "found" else "all"
    if (mean := d_min[population]["mean_m"]) is not None:
        marks.append(Mark(mean, f"mean {mean:.2f} m", "var(--obstacle)"))
    chart = charts.curve(
        [(p[0], p[1]) for p in margin["curve"]], marks, "margin in metres", "missed cells covered",
        "share of missed cells covered by a margin", steps=True,
    )  # fmt: skip
    return _markup(chart)


CLAIM_HEADS = ("missed cells", "of obstacles", "independent", "units", "cells", "proven margin",
               "no cell farther", "bootstrap", "plain quantile", "units needed")  # fmt: skip


def claim_row(claim: Mapping[str, Any]) -> Row:
    """One claim with what it needs."""
    return (
        "all" if claim["cells"] == "all" else "nearest to a person",
        "found in part" if claim["population"] == "found" else "all",
        claim["unit"],
        *(str(claim[k]) for k in ("units", "misses")),
        *(metres(claim[k]) for k in ("margin_m", "every_cell_m", "bootstrap_m", "pooled_m")),
        str(claim["units_needed"]),
    )


def cost_view(results: Results) -> dict[str, Any] | None:
    """Reachable area and coverage over the margin."""
    cost = results.get("cost")
    if not cost:
        return None
    covered = [(p["margin_m"], p["covered"]) for p in cost["points"] if p["covered"] is not None]
    reached = [(p["margin_m"], p["share"]) for p in cost["points"] if p["share"] is not None]
    marks = [] if cost["margin_m"] is None else [Mark(cost["margin_m"], "margin", "var(--ink)")]
    chart = charts.curve(covered, marks, "margin in metres", "share", "cost of the margin", second=reached)
    return {
        "chart": _markup(chart),
        "map": Path(cost["map"]).name,
        "mower_width_m": cost["mower_width_m"],
    }


def missed_view(results: Results) -> dict[str, Any]:
    """Missed obstacles by size."""
    missed = results["maps"][results["main"]]["overall"]["missed"]
    rows = [(_size(r), str(r["missed"]), str(r["called_free"])) for r in missed["by_size"]]
    return {**{k: missed[k] for k in ("missed", "obstacles", "persons")}, "rows": rows}


def _size(row: Mapping[str, Any]) -> str:
    low, below = row["from"], row["below"]
    if below is None:
        return f"{low} and more"
    return str(low) if below == low + 1 else f"{low} to {below - 1}"


def _map_colors() -> dict[str, str]:
    colors = (f"#{r:02x}{g:02x}{b:02x}" for r, g, b in COLOR_OF_CLASS[1:].tolist())
    return dict(zip(("grass", "obstacle", "person"), colors, strict=True)) | {"unknown": "var(--unknown)"}


def _markup(html: str) -> str:
    """What this package itself made as HTML, whose parts are escaped."""
    from markupsafe import Markup

    return Markup(html)  # noqa: S704 - charts escape what they are told
