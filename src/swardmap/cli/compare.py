"""`swardmap compare`: evaluations side by side, with the confidence of their differences."""

import json
import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swardmap.cli.options import Json
from swardmap.errors import InputError

if TYPE_CHECKING:
    from swardmap.eval.compare import Comparison

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
        Path | None,
        typer.Option("--out", "-o", help="Write the tables: a page (.html), LaTeX (.tex) or Markdown (.md)."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Put evaluations side by side: what differs on the frames they share, and how sure that is."""
    from swardmap.eval.compare import compare_runs, difference_row, run_names

    if not 0 < confidence < 1:
        raise InputError(f"expected a confidence between 0 and 1, got {confidence}")
    comparisons = compare_runs(runs, unit, confidence)
    if out is not None:
        _write_tables(out, runs, comparisons, unit, confidence)
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


def _write_tables(
    out: Path, runs: list[Path], comparisons: "list[Comparison]", unit: str, confidence: float
) -> None:
    """The tables in the form that the file's name asks for."""
    from swardmap.eval.compare import comparison_html, comparison_tables
    from swardmap.eval.tables import latex, markdown
    from swardmap.io.files import write_text

    if out.suffix in (".tex", ".md"):
        tables = comparison_tables(runs, comparisons, unit, confidence)
        write_text(out, latex(tables) if out.suffix == ".tex" else markdown(tables))
        return
    if out.suffix not in (".html", ".htm"):
        raise InputError(f"{out}: expected a name that ends in .html, .tex or .md")
    command = "swardmap " + shlex.join(sys.argv[1:])
    write_text(out, comparison_html(runs, comparisons, unit, confidence, command))
