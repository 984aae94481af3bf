"""The gate: the old and the new network on what must not get worse, and a verdict that may be no.

A dangerous figure of the new network (see `faults`) may not lie above the 95 % interval of the old one's;
nor may it rise by more than chance in the same gardens, for these differ from each other far more than one
network from another. In the drive's light the old one may have been blind to the lawn, and so to all its
faults: there the new one may have as many as the old one has in the light that it knows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swardmap.eval.intervals import share_interval
from swardmap.teach.faults import LIT, Counts

WITHOUT_INTERVAL = 0.01
"""By which a share may rise where there are too few cases for an interval."""
RISE_ON_DRIVE = 0.02
"""By which one of what stands on the drive may: it is of one place, whose interval may reach to 92 %."""
MOST_FREED = 0.10
"""Of the ground that surely was no lawn, grass now: beyond it somebody must look whether it is lawn."""
LEAST_RISE = 0.002
"""A share that rises less, however surely, is no reason to refuse."""
LEAST_LOST = 0.01
"""Of the driven ground: a network that knows so much less of it has learnt nothing."""

PIXELS = {
    "obstacle_called_grass": "obstacle pixels called grass",
    "obstacle_clears": "obstacle pixels surely grass: they clear",
    "person_called_grass": "person pixels called grass",
    "person_clears": "person pixels surely grass",
    "bare_called_grass": "pixels of paths and beds called grass",
    "bare_clears": "pixels of paths and beds surely grass",
}
DANGEROUS = {
    **PIXELS,
    "things_5-20 cm": "things of 5-20 cm overlooked",
    "things_20-50 cm": "things of 20-50 cm overlooked",
    "things_over 50 cm": "things over 50 cm overlooked",
    "persons": "persons overlooked",
    **{f"{LIT}{figure}": f"in your light: {what}" for figure, what in PIXELS.items()},
    "held_stands_called_grass": "pixels of what stands on your drive called grass",
    "held_stands_clears": "pixels of what stands on your drive surely grass",
}
ON_DRIVE = frozenset({"held_stands_called_grass", "held_stands_clears"})
FREED = {
    "held_ground_called_grass": "pixels of your drive that surely were no lawn called grass",
    "held_ground_clears": "pixels of your drive that surely were no lawn surely grass",
}
"""Dangerous where it is none, and what teaching is for where it is lawn: no figure says which."""
USEFUL = {
    "held_driven_called_grass": "pixels of the driven ground called grass, part held out",
    "held_driven_clears": "pixels of the driven ground surely grass, part held out",
    "grass_called_grass": "pixels of lawn called grass, gardens",
    "grass_clears": "pixels of lawn surely grass, gardens",
    f"{LIT}grass_called_grass": "in your light: pixels of lawn called grass",
    f"{LIT}grass_clears": "in your light: pixels of lawn surely grass",
}
KNOWN_LESS = {
    "held_driven_called_grass": "it knows less of the driven ground than before",
    "held_driven_clears": "it is sure of less of the driven ground than before",
}


@dataclass(frozen=True, slots=True)
class Row:
    """A figure of both networks.

    Attributes:
        figure: key in DANGEROUS, FREED or USEFUL.
        old, new: shares; None where there are no cases.
        limit: what a dangerous one may not exceed; None for another.
        cases: pixels or things.
        sure_rise: lower end of the 95 % interval of the rise, garden by garden; None if too few of them.
    """

    figure: str
    old: float | None
    new: float | None
    limit: float | None
    cases: int
    sure_rise: float | None = None

    @property
    def reason(self) -> str:
        """Why the new network is refused for this figure; empty if it is not."""
        if self.limit is None or self.new is None or self.old is None:
            return ""
        rise = f"{DANGEROUS[self.figure]} rise from {self.old:.2%} to {self.new:.2%}"
        if self.new > self.limit:
            return f"{rise}, beyond {self.limit:.2%}"
        if self.sure_rise is not None and self.sure_rise > 0 and self.new - self.old > LEAST_RISE:
            return f"{rise}, in the same gardens by {self.sure_rise:.2%} at least"
        return ""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Figures, and why the new network is refused; empty = it passes."""

    rows: tuple[Row, ...]
    reasons: tuple[str, ...]

    @property
    def passes(self) -> bool:
        """Whether the new network may be written."""
        return not self.reasons

    @property
    def warning(self) -> str:
        """What a person must look at, though the network passes; empty if there is nothing."""
        freed = next((r.new or 0.0 for r in self.rows if r.figure == "held_ground_called_grass"), 0.0)
        if freed <= MOST_FREED:
            return ""
        return (
            f"{freed:.0%} of the ground of your drive that the network so far was surest is no lawn is grass "
            "to the new one: if paths are in view, compare maps by both before you use it"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for a file."""
        rows = {
            r.figure: {"before": r.old, "after": r.new, "limit": r.limit, "cases": r.cases} for r in self.rows
        }
        return {"figures": rows, "refused_for": list(self.reasons), "warning": self.warning}


def judge(old: Counts, new: Counts) -> Verdict:
    """Hold the new network against the old one."""
    rows = [_row(figure, old, new, True) for figure in DANGEROUS]
    rows += [_row(figure, old, new, False) for figure in FREED | USEFUL]
    reasons = [row.reason for row in rows if row.reason]
    for figure, what in KNOWN_LESS.items():
        before, after = old.share(figure), new.share(figure)
        if before is not None and after is not None and after < before - LEAST_LOST:
            reasons.append(f"{what}: {before:.1%} before, {after:.1%} now")
    return Verdict(tuple(rows), tuple(reasons))


def _row(figure: str, old: Counts, new: Counts, dangerous: bool) -> Row:
    hits, of = old.cases(figure)
    share = old.share(figure)
    limit = rise = None
    if dangerous and share is not None:
        limit, rise = _limit(hits, of), sure_rise(hits, new.cases(figure)[0], of)
        if figure in ON_DRIVE:
            limit = min(limit, share + RISE_ON_DRIVE)
        elif figure.startswith(LIT):
            known = old.share(figure.removeprefix(LIT)) or 0.0
            limit = max(limit, known)
            rise = None if (new.share(figure) or 0.0) <= known else rise
    return Row(figure, share, new.share(figure), limit, sum(of), rise)


def _limit(hits: Sequence[int], of: Sequence[int]) -> float:
    """Upper end of the 95 % interval of a share."""
    interval = share_interval(hits, of)
    return sum(hits) / sum(of) + WITHOUT_INTERVAL if interval is None else interval.high


def sure_rise(
    old: Sequence[int], new: Sequence[int], of: Sequence[int], confidence: float = 0.95
) -> float | None:
    """Lower end of the interval of the rise of a share, garden by garden; None with less than two.

    Args:
        old: hits of the old network, one a garden.
        new: of the new one.
        of: cases, the same for both.
        confidence: two-sided.

    >>> round(sure_rise([0, 1, 0, 2], [2, 3, 2, 4], [10, 10, 10, 10]), 3)
    0.2
    >>> sure_rise([0, 1, 0, 2], [0, 1, 0, 6], [10, 10, 10, 10]) < 0
    True
    """
    from scipy.stats import t

    k, total = len(of), float(sum(of))
    if k < 2:
        return None
    change, cases = np.subtract(new, old).astype(np.float64), np.asarray(of, np.float64)
    rise = float(change.sum()) / total
    variance = k / (k - 1) * float(np.square(change - rise * cases).sum()) / total**2
    return rise - float(t.ppf(0.5 + confidence / 2, k - 1)) * float(np.sqrt(variance))


def table(rows: Sequence[Row] | Mapping[str, Any]) -> list[str]:
    """The figures as lines, of a verdict or of what a file tells."""
    names = DANGEROUS | FREED | USEFUL
    if isinstance(rows, Mapping):
        known = [(k, rows[k]) for k in names if k in rows]  # JSON has them by the alphabet
        rows = [Row(k, v["before"], v["after"], v["limit"], int(v["cases"])) for k, v in known]
    lines = []
    for row in rows:
        old, new = (("-" if v is None else f"{v:.2%}") for v in (row.old, row.new))
        limit = "" if row.limit is None else f"  (at most {row.limit:.2%})"
        lines.append(f"{names.get(row.figure, row.figure):<55} {old:>7} -> {new:>7}{limit}")
    return lines
