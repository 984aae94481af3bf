"""`swardmap compare`: evaluations side by side, with the confidence of their differences."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from swardmap.cli.options import Json
from swardmap.errors import InputError

EXAMPLES = """\b
Example:
  swardmap compare out/ other/ --unit sequence
"""


def compare_command(
    runs: Annotated[
        list[Path], typer.Argument(help="Folders that `swardmap evaluate` wrote; the first counts.")
    ],
    unit: Annotated[
        str, typer.Option(help="What is independent: frame, or a tag such as sequence.")
    ] = "frame",
    confidence: Annotated[float, typer.Option(help="Of the intervals.")] = 0.95,
    as_json: Json = False,
) -> None:
    """Put evaluations side by side: what differs on the frames they share, and how sure that is."""
    from swardmap.eval.compare import compare_runs

    if not 0 < confidence < 1:
        raise InputError(f"expected a confidence between 0 and 1, got {confidence}")
    comparisons = compare_runs(runs, unit, confidence)
    if as_json:
        print(json.dumps([asdict(c) for c in comparisons], indent=2, allow_nan=False))
        return
    for comparison in comparisons:
        print(f"{comparison.run} against {runs[0]}: {comparison.frames} frames, {comparison.units} {unit}s")
        print(f"{'':28}{'first':>10}{'other':>10}{'difference':>12}   {100 * confidence:g} % interval")
        for d in comparison.differences:
            numbers = f"{_text(d.first):>10}{_text(d.other):>10}{_text(d.difference, '+'):>12}"
            interval = "-" if d.low is None else f"{_text(d.low, '+')} .. {_text(d.high, '+')}"
            print(f"{d.measure:28}{numbers}   {interval}{'  *' if d.is_sure else ''}")
    print("* the interval leaves 0 out")


def _text(value: float | None, sign: str = "") -> str:
    return "-" if value is None else f"{value:{sign}.4f}"
