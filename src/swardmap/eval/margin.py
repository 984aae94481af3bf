"""The margin: how far found obstacles must be grown so that the missed cells around them are covered.

What is claimed, and why it holds. Units (frames, or whole sequences) are taken as independent draws of
what the robot will meet; cells of one unit may depend on each other as they like. For a margin t, the
loss of a unit is the share of its missed cells that are farther than t from every found cell, a number
in 0..1 that falls as t grows. The claim: *in a unit with missed cells, on average at least `share` of
them are within the margin*, with probability `confidence` over the draw of the calibration units.
By Hoeffding's inequality in its relative-entropy form (1963, Theorem 1), a true mean loss of at least
a = 1 - share would give a sample mean of r < a with probability at most exp(-n kl(r, a)); the margin is
the smallest t at which this is at most 1 - confidence. Since losses fall with t, choosing the smallest t
costs nothing (Bates et al. 2021, risk-controlling prediction sets). At r = 0 this needs the same number of
units as Wilks' order statistics: ln(1 - confidence) / ln(share), 299 for 99 % at 95 %.

It is not the share of all cells pooled: one bad frame could hold them all, and nothing distribution-free
can be said of that. The cluster bootstrap beside it is about the pooled share, and approximate.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.eval.distances import exact_share
from swardmap.eval.dmin import NO_HIT
from swardmap.eval.shares import share_text, told_share
from swardmap.eval.tally import MapTally, MissKind

UnitMisses = Mapping[str, Mapping[int, int]]
"""Unit -> squared distance in cells -> number of missed cells; -1 holds cells that no margin covers."""

POPULATIONS = ("found", "all")
"""found: missed cells of obstacles of which another cell was found. all: also those of obstacles that were
missed as a whole, at their distance to another obstacle; without any found cell in the map, at infinity."""

DRAWS = 1000


@dataclass(frozen=True, slots=True)
class Claim:
    """One margin with what it promises, or the reason why nothing can be promised.

    Attributes:
        cells: which missed cells: `all`, or `person` (those whose nearest found cell is mapped as a person).
        population: see POPULATIONS.
        unit: what was drawn independently: `frame`, or a tag such as `sequence`.
        share, confidence: as asked for.
        units: units with such cells; those without have nothing to cover and do not count.
        misses: such cells.
        margin_m: the claim's margin, rounded up to a millimetre; None if refused.
        reason: why it was refused, and how many units would do; empty otherwise.
        units_needed: smallest number of units that could carry the claim, if no cell were uncovered.
        claimable_share: largest share, in thousandths, that these units carry with some margin; 0 if none.
        units_more: units with missed cells that would do, beside these and like them; None if no number does.
        every_cell_m: order statistics: in `share` of the units no missed cell at all is farther; or None.
        bootstrap_m: cluster bootstrap: upper end of the pooled share's quantile; or None.
        pooled_m: quantile of the pooled cells here, without any confidence; or None.
    """

    cells: str
    population: str
    unit: str
    share: float
    confidence: float
    units: int
    misses: int
    margin_m: float | None
    reason: str
    units_needed: int
    claimable_share: float
    units_more: int | None
    every_cell_m: float | None
    bootstrap_m: float | None
    pooled_m: float | None


def units_needed(share: float, confidence: float) -> int:
    """Fewest units that can carry a claim, reached if not one of them has an uncovered cell.

    >>> units_needed(0.99, 0.95), units_needed(0.9, 0.95)
    (299, 29)
    """
    _check(share, confidence)
    return math.ceil(math.log(1 - confidence) / math.log(share))


def measure_margin(
    units: UnitMisses,
    resolution_m: float,
    share: float = 0.99,
    confidence: float = 0.95,
    *,
    cells: str = "all",
    population: str = "found",
    unit: str = "frame",
    seed: int = 0,
) -> Claim:
    """The smallest margin that covers a share of the missed cells, with a confidence (see the module).

    Args:
        units: missed cells of each unit; see `unit_misses`.
        resolution_m: edge of a cell.
        share: of a unit's missed cells to be covered on average.
        confidence: that this is so.
        cells: what `units` holds, for the record.
        population: what `units` holds, for the record.
        unit: what a unit is, for the record.
        seed: of the bootstrap.
    """
    filled = {name: counts for name, counts in sorted(units.items()) if any(counts.values())}
    n, needed = len(filled), units_needed(share, confidence)
    radii, losses = _mean_losses(filled)
    margin = next(
        (r for r, loss in zip(radii, losses, strict=True) if _is_proven(loss, n, share, confidence)), None
    )
    pooled = Counter[int]()
    for counts in filled.values():
        pooled.update(counts)
    return Claim(
        cells=cells,
        population=population,
        unit=unit,
        share=share,
        confidence=confidence,
        units=n,
        misses=sum(pooled.values()),
        margin_m=None if margin is None else _up_to_millimetre(math.sqrt(margin) * resolution_m),
        reason="" if margin is not None else _reason(n, needed, share, confidence, unit, losses),
        units_needed=needed,
        claimable_share=carried_share(losses, n, confidence),
        units_more=0 if margin is not None else _units_more(n, needed, share, confidence, losses),
        every_cell_m=_metres(_order_statistic(filled, share, confidence), resolution_m),
        bootstrap_m=_metres(_bootstrap(filled, share, confidence, seed), resolution_m),
        pooled_m=_metres(_quantile(pooled, share), resolution_m),
    )


def unit_misses(
    tallies: Iterable[tuple[str, MapTally]], population: str = "found", cells: str = "all"
) -> dict[str, dict[int, int]]:
    """Missed cells of each unit by squared distance.

    Args:
        tallies: name of the unit, tally; a unit may come in several parts, in any order.
        population: see POPULATIONS.
        cells: `all`, or `person`: cells whose nearest found cell is mapped as a person, which is what
            the robot grows by the persons' margin.
    """
    if population not in POPULATIONS or cells not in ("all", "person"):
        raise InvalidValueError(f"expected a population of {POPULATIONS}, got '{population}' and '{cells}'")

    def counts(kind: MissKind) -> bool:
        return (population == "all" or kind.found) and (cells == "all" or kind.from_person)

    units: dict[str, dict[int, int]] = {}
    for name, tally in tallies:
        unit = units.setdefault(name, {})
        for kind, n in tally.misses.items():
            if counts(kind):
                unit[kind.squared] = unit.get(kind.squared, 0) + n
    return units


def _mean_losses(units: UnitMisses) -> tuple[list[int], list[float]]:
    """Candidate radii (squared, ascending) and the mean loss at each; exactly rounded, so order-free."""
    parts: dict[int, list[float]] = {0: []}
    for counts in units.values():
        total = sum(counts.values())
        for squared, n in counts.items():
            parts.setdefault(squared, []).append(n / total)
    at = {squared: math.fsum(shares) for squared, shares in parts.items()}
    never = at.pop(NO_HIT, 0.0)
    radii = sorted(at)
    beyond = [math.fsum([never, *(at[r] for r in radii[i + 1 :])]) for i in range(len(radii))]
    return radii, [loss / len(units) if units else 1.0 for loss in beyond]


def _is_proven(mean_loss: float, n: int, share: float, confidence: float) -> bool:
    """Whether so small a mean loss over n units is improbable enough if the true one were 1 - share."""
    if n == 0 or mean_loss >= 1 - share:
        return False
    return -n * _divergence(mean_loss, 1 - share) <= math.log(1 - confidence) + 1e-12


def _divergence(r: float, a: float) -> float:
    """kl(r, a): relative entropy of two coins, r < a."""
    return (1 - r) * math.log((1 - r) / (1 - a)) + (r * math.log(r / a) if r > 0 else 0.0)


def _order_statistic(units: UnitMisses, share: float, confidence: float) -> float | None:
    """Wilks: the k-th smallest of the units' largest needs bounds their `share` quantile from above."""
    from scipy.stats import binom

    needs = sorted(
        math.inf if counts.get(NO_HIT) else max(s for s, n in counts.items() if n)
        for counts in units.values()
    )
    n = len(needs)
    k = (
        int(binom.ppf(confidence, n, share)) + 1 if n else 1
    )  # smallest k: P(Bin(n, share) <= k - 1) is enough
    return needs[k - 1] if k <= n else None


def _bootstrap(units: UnitMisses, share: float, confidence: float, seed: int) -> float | None:
    """Upper `confidence` end of the pooled cells' `share` quantile when whole units are drawn again."""
    n = len(units)
    if n < 2:
        return None
    entries = [
        (i, math.inf if s == NO_HIT else s, c)
        for i, counts in enumerate(units.values())
        for s, c in counts.items()
    ]
    owner, squared, count = (np.array(column) for column in zip(*entries, strict=True))
    radii, place = np.unique(squared, return_inverse=True)
    rng = np.random.default_rng(seed)
    wanted, found = float(exact_share(share)), np.empty(DRAWS)
    for draw in range(DRAWS):
        times = np.bincount(rng.integers(0, n, n), minlength=n)
        covered = np.cumsum(np.bincount(place, times[owner] * count, len(radii)))
        found[draw] = radii[np.searchsorted(covered, wanted * covered[-1] - 1e-9)]
    return float(np.quantile(found, confidence, method="inverted_cdf"))


def _quantile(pooled: Mapping[int, int], share: float) -> float | None:
    wanted, covered = exact_share(share) * sum(pooled.values()), 0
    for squared in sorted(s for s in pooled if s != NO_HIT):
        covered += pooled[squared]
        if covered >= wanted:
            return squared
    return None


def carried_share(losses: Sequence[float], n: int, confidence: float) -> float:
    """Largest share, in thousandths, that n units carry at the largest margin; 0 if they carry none.

    Args:
        losses: mean loss at each radius, the last the smallest.
        n: number of units.
        confidence: of the claim.
    """
    thousandths = range(999, 0, -1) if losses else ()
    return next((k / 1000 for k in thousandths if _is_proven(losses[-1], n, k / 1000, confidence)), 0.0)


def _units_more(n: int, needed: int, share: float, confidence: float, losses: list[float]) -> int | None:
    """How many more units of the same kind would do; None where a part stays uncovered by any margin."""
    least = losses[-1] if n else 0.0
    if least == 0:
        return needed - n
    if least >= 1 - share:
        return None
    return math.ceil(-math.log(1 - confidence) / _divergence(least, 1 - share)) - n


def _reason(n: int, needed: int, share: float, confidence: float, unit: str, losses: list[float]) -> str:
    what = f"{share_text(share)} of the missed cells at {share_text(confidence)} confidence"
    if n == 0:
        return f"no {unit} has missed cells to measure a margin from; {what} needs at least {needed} that do"
    if n < needed:
        most = told_share(carried_share(losses, n, confidence))
        carried = f"these carry {share_text(most)} at most" if most else "these carry no share at all"
        return (
            f"{what} needs at least {needed} independent {unit}s with missed cells, got {n}: "
            f"{needed - n} more without an uncovered cell would do; {carried}"
        )
    refusal = (
        f"no margin covers {what}: even the largest leaves {share_text(losses[-1])} of a {unit}'s missed "
        "cells uncovered on average, in maps without one found cell"
    )
    more = _units_more(n, needed, share, confidence, losses)
    if more is None:
        return refusal
    return f"{refusal}; at this rate {n + more} {unit}s with missed cells would do, got {n}: {more} more"


def _metres(squared: float | None, resolution_m: float) -> float | None:
    if squared is None or math.isinf(squared):
        return None
    return math.sqrt(squared) * resolution_m


def _up_to_millimetre(metres: float) -> float:
    return math.ceil(round(metres * 1000, 6)) / 1000


def _check(share: float, confidence: float) -> None:
    if not (0 < share < 1 and 0 < confidence < 1):
        raise InvalidValueError(
            f"margin: expected a share and a confidence between 0 and 1, got {share} and {confidence}"
        )
