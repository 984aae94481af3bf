"""`swardmap compare`: evaluations side by side, with the confidence of their differences."""

import json
import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from swardmap.cli.options import Json
from swardmap.errors import InputError

EXAMPLES = """\b
Example:
  swardmap compare out/ other/ --unit sequence --out compare.html
"""


def compare_command(
    runs: Annotated[
        list[Path], typer.Argument(help="Folders that `swardmap evaluate` wrote; the first counts.")
    ],
    unit: Annotated[
        str, typer.Option(help="What is independent: frame, or a tag such as sequence.")
    ] = "frame",
    confidence: Annotated[float, typer.Option(help="Of the intervals.")] = 0.95,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write the tables as a page (HTML).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Put evaluations side by side: what differs on the frames they share, and how sure that is."""
    from swardmap.eval.compare import compare_runs, difference_row, run_names

    if not 0 < confidence < 1:
        raise InputError(f"expected a confidence between 0 and 1, got {confidence}")
    comparisons = compare_runs(runs, unit, confidence)
    if out is not None:
        from swardmap.eval.compare import comparison_html
        from swardmap.io.files import write_text

        command = "swardmap " + shlex.join(sys.argv[1:])
        write_text(out, comparison_html(runs, comparisons, unit, confidence, command))
    if as_json:
        print(json.dumps([asdict(c) for c in comparisons], indent=2, allow_nan=False))
        return
    names = run_names(runs)
    for name, comparison in zip(names[1:], comparisons, strict=True):
        print(f"{name} against {names[0]}: {comparison.frames} frames, {comparison.units} {unit}s")
        rows = [("", names[0], name, "difference", f"{100 * confidence:g} % interval"),
                *(difference_row(d) for d in comparison.differences)]  # fmt: skip
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for first, *others in rows:
            cells = [text.rjust(width) for text, width in zip(others, widths[1:], strict=True)]
            print("  ".join([first.ljust(widths[0]), *cells]).rstrip())
    print("* the interval leaves 0 out")
