"""The report: one HTML file that works from a disk, offline, on a phone and in print."""

from collections.abc import Mapping
from html import escape
from importlib import resources
from string import Template
from typing import Any

from swardmap import __version__
from swardmap.eval import charts
from swardmap.eval.charts import Mark
from swardmap.eval.dataset import dataset_name
from swardmap.eval.distances import DistanceHistogram
from swardmap.eval.fragments import card, d_min_row, figure, keys, metres, pct, points, sentence, table
from swardmap.eval.frame import Plan
from swardmap.eval.gallery import frame_figure
from swardmap.eval.tables import paper_tables

Results = Mapping[str, Any]
FRAMES_SHOWN = 8


def report_html(plan: Plan, results: Results) -> str:
    """The whole page.

    Args:
        plan: of the run; the worst frames are read again for their pictures.
        results: from `results.results`.
    """
    sections = [
        ("budget", "Where the errors come from", budget_html(results)),
        ("distances", "How far misses are from what was found", distances_html(results)),
        ("margin", "The margin", margin_html(results)),
        ("cost", "What the margin costs", cost_html(results)),
        ("missed", "Obstacles missed as a whole", missed_html(results)),
        ("frames", "Worst frames first", gallery_html(plan, results)),
        ("tables", "The paper's tables", tables_html(results)),
        ("left-out", "Frames left out", left_out_html(results)),
    ]
    shown = [(name, title, html) for name, title, html in sections if html]
    page = Template(resources.files("swardmap").joinpath("data/report/page.html").read_text("utf-8"))
    frames = results["frames"]
    return page.substitute(
        version=escape(__version__),
        title=escape(f"How far the maps of {dataset_name(results['dataset'])} can be trusted"),
        subtitle=escape(
            f"{frames['evaluated']} of {frames['total']} frames, segmenter {results['segmenter']}, "
            f"maps {results['main']} m"
        ),
        style=resources.files("swardmap").joinpath("data/report/style.css").read_text("utf-8"),
        contents=" ".join(f'<a href="#{name}">{escape(title)}</a>' for name, title, _ in shown),
        command=escape(results["command"] or "made from Python"),
        body=summary_html(results)
        + "".join(f'<section><h2 id="{n}">{escape(t)}</h2>{html}</section>\n' for n, t, html in shown),
    )


def summary_html(results: Results) -> str:
    """What matters, first."""
    margin = results["margin"]
    if margin["margin_m"] is None:
        verdict = (
            '<div class="verdict none"><p><strong>No margin can be promised</strong></p>'
            f"<p>{escape(sentence(margin['reason']))}</p>"
        )
    else:
        persons = margin["person_margin_m"]
        more = f", persons by <strong>{persons:.3f} m</strong>" if persons is not None else ""
        verdict = (
            '<div class="verdict"><p>Grow obstacles by '
            f"<strong>{margin['margin_m']:.3f} m</strong>{more}.</p>"
            + "".join(f"<p>{escape(line)}</p>" for line in margin["statement"].splitlines()[1:2])
        )
    verdict += f"<p>{escape(margin['not_covered'])}</p></div>"
    if results["masks"]["overall"] is None:
        return verdict + "<p>No frame could be evaluated.</p>"
    return verdict + f'<div class="cards">{"".join(_cards(results))}</div>'


def _cards(results: Results) -> list[str]:
    section = results["maps"][results["main"]]["overall"]
    cells, d_min, missed = section["cells"], section["d_min"]["all"], section["missed"]
    free, person = cells["obstacle_called_free"], cells["person_called_free"]
    return [
        card(pct(free["share"]), "of obstacle cells called free", f"{free['count']} of {free['of']}"),
        card(pct(person["share"]), "of person cells called free", f"{person['count']} of {person['of']}"),
        card(metres(d_min["mean_m"]), "mean d_min-obst", f"{d_min['count']} missed cells"),
        card(metres(d_min["quantiles_m"]["0.99"]), "d_min-obst of 99 %", f"largest {metres(d_min['max_m'])}"),
        card(str(missed["called_free"]), "whole obstacles called free",
              f"of {missed['obstacles']}; {missed['missed'] - missed['called_free']} more were not seen"),
        card(pct(results["masks"]["overall"]["accuracy"]), "of pixels right",
              f"{results['masks']['overall']['counted']} pixels"),
    ]  # fmt: skip


def budget_html(results: Results) -> str:
    """The error budget as bars and as a table."""
    rows, not_run = results["budget"]["rows"], results["budget"]["not_run"]
    notes = "".join(f"<li>{escape(k)}: {escape(v)}</li>" for k, v in not_run.items())
    left_out = f'<p>Not run:</p><ul class="plain">{notes}</ul>' if notes else ""
    if not rows:
        return left_out
    heads = ("", "called free", "not seen", "false alarms", "mean d_min", "missed", "called free",
             "adds to called free", "adds to missed")  # fmt: skip
    body = [
        (r["rung"], pct(r["called_free"]["share"]), pct(r["not_seen"]["share"]),
         pct(r["false_alarm"]["share"]), metres(r["d_min"]["mean_m"]), str(r["missed"]),
         str(r["missed_called_free"]), points(r["added"]["called_free"]), f"{r['added']['missed']:+.0f}")
        for r in rows
    ]  # fmt: skip
    called = [(r["rung"], r["called_free"]["share"], pct(r["called_free"]["share"])) for r in rows]
    unseen = [(r["rung"], r["not_seen"]["share"], pct(r["not_seen"]["share"])) for r in rows]
    return (
        "<p>The same frames, mapped again with one stage after another switched from true to real. Rungs "
        'with a + build on the one above; below them each stage alone.</p><div class="pair">'
        + figure(charts.bars(called, "obstacle cells called free", "", "var(--miss)"),
                  "Obstacle cells called free: what hits something.", results)
        + figure(charts.bars(unseen, "obstacle cells not seen", "", "var(--soft)"),
                  "Obstacle cells of which nothing is said: they stay unknown, which is never free.", results)
        + "</div>"
        + table(heads, body)
        + "<p class='soft'>Shares are of obstacle cells, false alarms of grass; missed: whole obstacles, "
          "and how many of them were called free. A rung adds percentage points, and obstacles.</p>"
        + left_out
    )  # fmt: skip


def distances_html(results: Results) -> str:
    """Histogram of d_min-obst and its summary by class and range."""
    if results["masks"]["overall"] is None:
        return ""
    d_min = results["maps"][results["main"]]["overall"]["d_min"]
    histogram = DistanceHistogram.from_dict(d_min["histogram"])
    rows = [
        d_min_row("all", d_min["all"]),
        d_min_row("obstacle cells", d_min["obstacle"]),
        d_min_row("person cells", d_min["person"]),
        d_min_row("of obstacles found in part", d_min["obstacles_found_in_part"]),
    ]
    for band in d_min["by_range_m"]:
        upper = "and more" if band["to"] is None else f"to {band['to']:g} m"
        rows.append(d_min_row(f"{band['from']:g} {upper} away", band))
    heads = ("missed cells", "count", "mean", "variance", "median", "90 %", "95 %", "99 %", "largest")
    if histogram.count == 0:
        return "<p>No missed cell has a distance.</p>" + table(heads, rows)
    mean, q99 = d_min["all"]["mean_m"], d_min["all"]["quantiles_m"]["0.99"]
    marks = [
        Mark(mean, f"mean {mean:.2f} m", "var(--obstacle)"),
        Mark(q99, f"99 % {q99:.2f} m", "var(--ink)"),
    ]
    width = max(histogram.resolution_m, (d_min["all"]["max_m"] or 0) / 40)
    chart = charts.histogram(histogram.bins(width), marks, "d_min-obst in metres", "cells", "d_min-obst")
    return (
        "<p>d_min-obst (Eq. 3) of each obstacle cell that was called grass: its distance to the nearest cell "
        "that was found. The paper reports its mean; a margin has to cover the tail.</p>"
        + figure(chart, "Missed cells by distance to the nearest found cell.", results)
        + table(heads, rows)
    )


def margin_html(results: Results) -> str:
    """The curve of coverage, and every claim with what it needs."""
    margin = results["margin"]
    text = "".join(f"<p>{escape(line)}</p>" for line in margin["statement"].splitlines())
    html = text
    if margin["curve"]:
        marks = []
        if margin["margin_m"] is not None:
            marks.append(Mark(margin["margin_m"], f"margin {margin['margin_m']:.2f} m", "var(--grass)"))
        d_min = results["maps"][results["main"]]["overall"]["d_min"]
        mean = d_min["obstacles_found_in_part" if margin["options"]["population"] == "found" else "all"][
            "mean_m"
        ]
        if mean is not None:
            marks.append(Mark(mean, f"mean {mean:.2f} m", "var(--obstacle)"))
        chart = charts.curve(
            [(p[0], p[1]) for p in margin["curve"]], marks, "margin in metres", "missed cells covered",
            "share of missed cells covered by a margin", steps=True,
        )  # fmt: skip
        html += figure(chart, "Share of the missed cells of these frames that a margin covers.", results)
    heads = ("missed cells", "of obstacles", "independent", "units", "cells", "proven margin",
             "no cell farther", "bootstrap", "plain quantile", "units needed")  # fmt: skip
    rows = [
        ("all" if c["cells"] == "all" else "nearest to a person",
         "found in part" if c["population"] == "found" else "all", c["unit"],
         *(str(c[k]) for k in ("units", "misses")),
         *(metres(c[k]) for k in ("margin_m", "every_cell_m", "bootstrap_m", "pooled_m")),
         str(c["units_needed"]))
        for c in margin["claims"]
    ]  # fmt: skip
    note = (
        "<p class='soft'>Proven margin: distribution-free bound on the average share covered in a unit. No "
        "cell farther: order statistics, in that share of the units no missed cell at all is farther. "
        "Bootstrap: share of all cells pooled, units drawn again; approximate. A dash: too few units, or no "
        "such cells. Frames of one sequence resemble each other: where the rows by sequence are refused, the "
        "rows by frame hold only as far as frames can be taken as independent.</p>"
    )
    return html + table(heads, rows) + note


def cost_html(results: Results) -> str:
    """Reachable area and coverage over the margin."""
    cost = results.get("cost")
    if not cost:
        return ""
    covered = [(p["margin_m"], p["covered"]) for p in cost["points"] if p["covered"] is not None]
    reached = [(p["margin_m"], p["share"]) for p in cost["points"] if p["share"] is not None]
    marks = [] if cost["margin_m"] is None else [Mark(cost["margin_m"], "margin", "var(--ink)")]
    chart = charts.curve(covered, marks, "margin in metres", "share", "cost of the margin", second=reached)
    legend = keys({"misses covered": "var(--miss)", "lawn still reached": "var(--grass)"})
    return figure(
        chart, f"A mower {cost['mower_width_m']:g} m wide on {escape(str(cost['map']))}.", results, legend
    )


def missed_html(results: Results) -> str:
    """Missed obstacles by size."""
    if results["masks"]["overall"] is None:
        return ""
    missed = results["maps"][results["main"]]["overall"]["missed"]
    rows = []
    for row in missed["by_size"]:
        size = f"{row['from']} and more" if row["below"] is None else (
            str(row["from"]) if row["below"] == row["from"] + 1 else f"{row['from']} to {row['below'] - 1}"
        )  # fmt: skip
        rows.append((size, str(row["missed"]), str(row["called_free"])))
    return (
        f"<p>{missed['missed']} of {missed['obstacles']} connected obstacles of the reference maps have no "
        f"found cell ({missed['persons']} of them persons). No margin covers them. Single cells are often "
        "noise of the reference or a rim; large ones never are.</p>"
        + table(("cells", "missed", "called free"), rows)
    )


def gallery_html(plan: Plan, results: Results) -> str:
    """The worst frames."""
    figures = [frame_figure(plan, index, results["command"]) for index in results["worst"][:FRAMES_SHOWN]]
    colors = {"grass": "#68b454", "obstacle": "#4267b2", "person": "#f0b428", "unknown": "var(--unknown)"}
    legend = keys(colors | {"missed, tied to the nearest found cell": "#d6333a"})
    return f'<p>{legend}</p><div class="frames">{"".join(figures)}</div>' if any(figures) else ""


def tables_html(results: Results) -> str:
    """Tables 2-10, closed until asked for."""
    return "".join(
        f"<details><summary>Table {t.number}. {escape(t.caption)}</summary>{table(t.head, t.rows)}</details>"
        for t in paper_tables(results)
    )


def left_out_html(results: Results) -> str:
    """Frames that could not be evaluated, by name."""
    bad = results["frames"]["unreadable"]
    if not bad:
        return ""
    items = "".join(f"<li>frame {b['index']}: {escape(b['error'])}</li>" for b in bad[:200])
    more = f"<p>and {len(bad) - 200} more, see frames.csv</p>" if len(bad) > 200 else ""
    return f'<p>{len(bad)} frames are in none of the numbers.</p><ul class="plain">{items}</ul>{more}'
