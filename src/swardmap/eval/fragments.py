"""Pieces of HTML that the report is put together from; everything that is told is escaped here."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from swardmap.eval.tables import UNDEFINED, percent

Results = Mapping[str, Any]


def figure(chart: str, caption: str, results: Results, legend: str = "") -> str:
    """A chart with its caption and the command that made it."""
    return (
        f"<figure>{legend}{chart}<figcaption>{escape(caption)}<br>"
        f"<code>{escape(results['command'])}</code></figcaption></figure>"
    )


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table that scrolls sideways where it is wider than the screen."""
    head = "".join(f"<th>{escape(h)}</th>" for h in heads)
    body = "".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def d_min_row(name: str, d_min: Mapping[str, Any]) -> tuple[str, ...]:
    """One row of the summary of distances."""
    q = d_min["quantiles_m"]
    variance = UNDEFINED if d_min["variance_m2"] is None else f"{d_min['variance_m2']:.4f} m²"
    return (
        name,
        str(d_min["count"]),
        metres(d_min["mean_m"]),
        variance,
        *map(metres, q.values()),
        metres(d_min["max_m"]),
    )


def card(value: str, what: str, more: str) -> str:
    """One number of the summary."""
    return f"<div><b>{escape(value)}</b>{escape(what)}<small>{escape(more)}</small></div>"


def keys(colors: Mapping[str, str]) -> str:
    """A legend: name -> CSS colour."""
    return "".join(f'<span class="key" style="background:{c}"></span>{escape(n)}' for n, c in colors.items())


def sentence(text: str) -> str:
    """Text with a capital and a full stop."""
    return text[:1].upper() + text[1:] + "."


def pct(share: float | None) -> str:
    """A share in percent, or a dash."""
    return UNDEFINED if share is None else f"{percent(share)} %"


def points(share: float | None) -> str:
    """A difference of shares in percentage points, or a dash."""
    return UNDEFINED if share is None else f"{100 * share:+.2f}"


def metres(value: float | None) -> str:
    """Metres with millimetres, or a dash."""
    return UNDEFINED if value is None else f"{value:.3f} m"
