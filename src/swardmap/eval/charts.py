"""Charts as inline SVG: no script, no outside file, readable on a phone and on paper."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

WIDTH, HEIGHT = 460, 260
LEFT, RIGHT, TOP, BOTTOM = 52, 14, 18, 42


@dataclass(frozen=True, slots=True)
class Mark:
    """A vertical line with a name.

    Attributes:
        x: where.
        name: text beside it.
        color: a CSS colour.
    """

    x: float
    name: str
    color: str


def histogram(
    bins: Sequence[tuple[float, float, int]], marks: Sequence[Mark], x_label: str, y_label: str, title: str
) -> str:
    """Bars over equal bins (from, to, count), with marks."""
    x_max = max((high for _, high, _ in bins), default=1.0)
    y_max = max((n for *_, n in bins), default=1) or 1
    x, y = _Scale(0, x_max, LEFT, WIDTH - RIGHT), _Scale(0, y_max, HEIGHT - BOTTOM, TOP)
    bars = [
        f'<rect x="{x(low) + 0.5:.2f}" y="{y(n):.2f}" width="{max(0.6, x(high) - x(low) - 1):.2f}" '
        f'height="{y(0) - y(n):.2f}" fill="var(--miss)"><title>{low:.2f} to {high:.2f} m: {n}</title></rect>'
        for low, high, n in bins
        if n
    ]
    return _frame([*_axes(x, y, x_label, y_label), *bars, *_marks(marks, x)], title)


def curve(
    points: Sequence[tuple[float, float]],
    marks: Sequence[Mark],
    x_label: str,
    y_label: str,
    title: str,
    *,
    steps: bool = False,
    second: Sequence[tuple[float, float]] = (),
) -> str:
    """A line through points (x, share 0..1), and perhaps a second one; stairs for shares that jump."""
    x_max = max([p[0] for p in (*points, *second)] + [m.x for m in marks], default=1.0) or 1.0
    x, y = _Scale(0, x_max, LEFT, WIDTH - RIGHT), _Scale(0, 1, HEIGHT - BOTTOM, TOP)
    lines = []
    for line, color in ((points, "var(--miss)"), (second, "var(--grass)")):
        if line:
            drawn = _stairs(line) if steps and line is points else line
            path = " ".join(f"{x(px):.2f},{y(py):.2f}" for px, py in drawn)
            lines.append(f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="2"/>')
    return _frame([*_axes(x, y, x_label, y_label, percent=True), *lines, *_marks(marks, x)], title)


def bars(rows: Sequence[tuple[str, float | None, str]], title: str, unit: str, color: str) -> str:
    """Horizontal bars (name, value, text); an undefined value says so and has no bar."""
    step, left, right = 24, 128, 74
    height = step * len(rows) + 8
    largest = max((abs(v) for _, v, _ in rows if v is not None), default=0.0) or 1.0
    parts = []
    for i, (name, value, text) in enumerate(rows):
        middle = i * step + step / 2 + 4
        length = (WIDTH - left - right) * abs(value or 0) / largest
        parts.append(f'<text x="{left - 8}" y="{middle + 4}" text-anchor="end">{escape(name)}</text>')
        if value:
            parts.append(
                f'<rect x="{left}" y="{middle - 8}" width="{max(length, 1):.2f}" height="16" rx="2" '
                f'fill="{color}"><title>{escape(name)}: {escape(text)} {escape(unit)}</title></rect>'
            )
        parts.append(
            f'<text class="strong" x="{left + length + 6:.2f}" y="{middle + 4}">{escape(text)}</text>'
        )
    return _frame(parts, title, height)


class _Scale:
    """Values to pixels."""

    def __init__(self, low: float, high: float, start: float, end: float) -> None:
        self.low, self.high, self.start, self.end = low, high, start, end

    def __call__(self, value: float) -> float:
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self) -> list[float]:
        """About five round values."""
        rough = (self.high - self.low) / 5
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(f * power for f in (1, 2, 2.5, 5, 10) if f * power >= rough * 0.999)
        return [i * step for i in range(int(self.high / step + 1e-9) + 1)]


def _axes(x: _Scale, y: _Scale, x_label: str, y_label: str, percent: bool = False) -> list[str]:
    parts = []
    for value in y.ticks():
        text = f"{100 * value:.0f} %" if percent else f"{value:g}"
        parts.append(
            f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y(value):.2f}" y2="{y(value):.2f}"/>'
        )
        parts.append(f'<text x="{LEFT - 6}" y="{y(value) + 4:.2f}" text-anchor="end">{text}</text>')
    parts += [
        f'<text x="{x(value):.2f}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle">{value:g}</text>'
        for value in x.ticks()
    ]
    base = HEIGHT - BOTTOM
    parts.append(f'<line class="axis" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{base}" y2="{base}"/>')
    parts.append(
        f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 6}" text-anchor="middle">'
        f"{escape(x_label)}</text>"
    )
    parts.append(f'<text x="{LEFT}" y="11">{escape(y_label)}</text>')
    return parts


def _marks(marks: Sequence[Mark], x: _Scale) -> list[str]:
    parts = []
    for i, mark in enumerate(sorted(marks, key=lambda m: m.x)):
        at, top = x(mark.x), TOP + 12 + 15 * i
        side, dx = ("end", -5) if at > (LEFT + WIDTH) / 2 else ("start", 5)
        parts.append(
            f'<line x1="{at:.2f}" x2="{at:.2f}" y1="{TOP}" y2="{HEIGHT - BOTTOM}" stroke="{mark.color}" '
            'stroke-width="1.5" stroke-dasharray="4 3"/>'
            f'<text class="strong" x="{at + dx:.2f}" y="{top}" text-anchor="{side}">'
            f"{escape(mark.name)}</text>"
        )
    return parts


def _stairs(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    stairs = [(0.0, 0.0)]
    for px, py in points:
        stairs += [(px, stairs[-1][1]), (px, py)]
    return stairs


def _frame(parts: Sequence[str], title: str, height: float = HEIGHT) -> str:
    return (
        f'<svg class="chart" viewBox="0 0 {WIDTH} {height:g}" role="img" aria-label="{escape(title)}">'
        + "".join(parts)
        + "</svg>"
    )
