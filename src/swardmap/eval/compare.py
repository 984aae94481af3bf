"""Runs side by side: what differs, and how sure that is, over the frames that all of them have."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.eval.gathered import gather
from swardmap.eval.metrics import METRICS, UNDEFINED, Pair, metric
from swardmap.eval.pages import render, told_command
from swardmap.eval.results import tallies_of
from swardmap.eval.tables import Table
from swardmap.io.door import reading

Record = Mapping[str, Any]

DRAWS = 2000


@dataclass(frozen=True, slots=True)
class Difference:
    """One metric of one run against the first run.

    Attributes:
        key: of the metric (see `metrics.METRICS`).
        first, other: the two values; None where undefined.
        difference: other minus first; None where one is undefined.
        low, high: ends of the interval of the difference at the confidence asked for: both runs on the same
            frames, units drawn again; None where a draw leaves a value undefined.
    """

    key: str
    first: float | None
    other: float | None
    difference: float | None
    low: float | None
    high: float | None

    @property
    def is_sure(self) -> bool:
        """Whether the interval leaves 0 out."""
        return self.low is not None and self.high is not None and (self.low > 0 or self.high < 0)


@dataclass(frozen=True, slots=True)
class Comparison:
    """One run against the first.

    Attributes:
        run: folder of the other run.
        frames: frames that both have.
        units: independent units among them.
        differences: one for each metric.
    """

    run: str
    frames: int
    units: int
    differences: tuple[Difference, ...]


def compare_runs(
    folders: Sequence[Path], unit: str = "frame", confidence: float = 0.95, seed: int = 0
) -> list[Comparison]:
    """Compare runs with the first one, on the frames that two runs have in common, by name.

    Args:
        folders: at least two, written by `evaluate`.
        unit: what is independent: `frame`, or a tag such as `sequence`.
        confidence: of the intervals.
        seed: of the bootstrap.

    Raises:
        InputError: if a folder holds no run, or the runs have no kind of map or no frame in common.
    """
    if len(folders) < 2:
        raise InputError("expected at least two runs to compare")
    key, first = _named_records(folders[0])
    comparisons = []
    for folder in folders[1:]:
        _, other = _named_records(folder)
        with reading(f"{folders[0]} and {folder}", "whole records of evaluations"):
            names = [n for n in first if n in other and key in other[n]["maps"]]
            if not names:
                raise InputError(f"{folders[0]} and {folder} have no frame with maps {key} in common")
            units = [_unit(first[n], unit, n) for n in names]
            ours, theirs = (np.array([_measured(run[n], key) for n in names]) for run in (first, other))
        differences = _differences(ours, theirs, units, confidence, seed)
        comparisons.append(Comparison(str(folder), len(names), len(set(units)), differences))
    return comparisons


def _named_records(folder: Path) -> tuple[str, dict[str, Record]]:
    """Kind of map of a run, and its frames by name."""
    run = gather(folder)
    records = [r for r in run.records if "error" not in r]
    with reading(folder, "whole records of an evaluation"):
        return run.plan.main, {r["name"] or str(r["index"]): r for r in records}


def _measured(record: Record, key: str) -> list[Pair]:
    tallies = tallies_of(record, key)
    return [entry.take(tallies) for entry in METRICS]


def _differences(
    first: NDArray[np.float64],
    other: NDArray[np.float64],
    units: Sequence[str],
    confidence: float,
    seed: int,
) -> tuple[Difference, ...]:
    """Paired cluster bootstrap; the arrays are (frames, metrics, 2)."""
    names, owner = np.unique(units, return_inverse=True)
    sums = [np.zeros((len(names), *a.shape[1:])) for a in (first, other)]
    for total, values in zip(sums, (first, other), strict=True):
        np.add.at(total, owner, values)
    rng = np.random.default_rng(seed)
    drawn = np.empty((DRAWS, len(METRICS)))
    for draw in range(DRAWS):
        times = np.bincount(rng.integers(0, len(names), len(names)), minlength=len(names))
        drawn[draw] = _ratios(np.tensordot(times, sums[1], axes=1)) - _ratios(
            np.tensordot(times, sums[0], axes=1)
        )
    a, b = (_ratios(total.sum(axis=0)) for total in sums)
    tail = (1 - confidence) / 2
    rows = []
    for i, entry in enumerate(METRICS):
        column = drawn[:, i]
        whole = len(names) > 1 and bool(np.isfinite(column).all())
        low, high = np.quantile(column, [tail, 1 - tail]) if whole else (np.nan, np.nan)
        numbers = (a[i], b[i], b[i] - a[i], low, high)
        rows.append(Difference(entry.key, *(float(v) if np.isfinite(v) else None for v in numbers)))
    return tuple(rows)


def _ratios(sums: NDArray[Any]) -> NDArray[np.float64]:
    """(metrics, 2) sums to ratios; NaN where there is nothing to divide by."""
    of = np.where(sums[:, 1] > 0, sums[:, 1], np.nan)
    ratios: NDArray[np.float64] = sums[:, 0] / of
    return ratios


def _unit(record: Record, unit: str, name: str) -> str:
    return name if unit == "frame" else str(record["tags"].get(unit, ""))


def run_names(folders: Sequence[Path]) -> list[str]:
    """What tables call runs: their folders' names, with as many of the folders above as tell them apart."""
    parts = [folder.resolve().parts for folder in folders]
    for depth in range(1, max(map(len, parts)) + 1):
        names = ["/".join(p[-depth:]) for p in parts]
        if len(set(names)) == len(set(parts)):
            return names
    return [str(folder) for folder in folders]


def difference_row(found: Difference) -> tuple[str, ...]:
    """Title, both values, difference and interval as text, the sure ones with a star."""
    entry = metric(found.key)
    interval = (
        UNDEFINED if found.low is None else f"{entry.text(found.low, '+')} .. {entry.text(found.high, '+')}"
    )
    values = entry.text(found.first), entry.text(found.other), entry.text(found.difference, "+")
    return entry.title, *values, interval + (" *" if found.is_sure else "  ")


def comparison_html(
    folders: Sequence[Path], comparisons: Sequence[Comparison], unit: str, confidence: float, command: str
) -> str:
    """The comparisons as a page.

    Args:
        folders: of the runs, the first counts.
        comparisons: from `compare_runs`.
        unit: what was taken as independent.
        confidence: of the intervals.
        command: that made it.
    """
    first, *names = run_names(folders)
    heads = ("", first, "{}", "difference", f"{100 * confidence:g} % interval")
    return render(
        "compare.html",
        title=f"{' and '.join(names)} against {first}",
        first=first,
        unit=unit,
        command=told_command(command),
        comparisons=[
            {
                "name": name,
                "frames": one.frames,
                "units": one.units,
                "heads": [head.replace("{}", name) for head in heads],
                "rows": [difference_row(d) for d in one.differences],
            }
            for name, one in zip(names, comparisons, strict=True)
        ],
    )


def comparison_tables(
    folders: Sequence[Path], comparisons: Sequence[Comparison], unit: str, confidence: float
) -> list[Table]:
    """The comparisons for a paper; arguments as for `comparison_html`."""
    first, *names = run_names(folders)
    return [
        Table(
            f"C{number}",
            f"{name} against {first}: {one.frames} frames, {one.units} {unit}s drawn again together; "
            "a star: the interval leaves 0 out",
            ("", first, name, "difference", f"{100 * confidence:g} % interval"),
            tuple(tuple(cell.strip() for cell in difference_row(d)) for d in one.differences),
            "compare",
        )
        for number, (name, one) in enumerate(zip(names, comparisons, strict=True), start=1)
    ]
