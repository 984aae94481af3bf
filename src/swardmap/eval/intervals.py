"""Confidence intervals of shares whose cases come in sequences that resemble themselves.

Things of one drive are missed together, so that the drive and not the thing is the unit. The interval is
the exact one of Clopper and Pearson at the effective number of cases (Korn and Graubard, Survey Methodology
24, 1998): the number divided by the design effect, which is the variance of the share between sequences over
that of independent cases, never taken below 1, with Student's t for few sequences. Unlike a bootstrap of
sequences it is not empty where nothing was missed: nothing missed says nothing of how misses cluster, so
that each sequence then counts as one case.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swardmap.errors import InvalidValueError


@dataclass(frozen=True, slots=True)
class Interval:
    """Ends of an interval of a share, and the number of sequences behind it."""

    low: float
    high: float
    units: int


def share_interval(counts: Sequence[float], of: Sequence[float], confidence: float = 0.95) -> Interval | None:
    """Interval of sum(counts) / sum(of); None with less than two sequences that have cases.

    Args:
        counts: cases with the property, one a sequence.
        of: cases, one a sequence.
        confidence: of the interval.

    >>> interval = share_interval([1, 0, 0, 1, 0, 0, 0, 0], [20] * 8)
    >>> round(interval.low, 4), round(interval.high, 4)
    (0.001, 0.0525)
    """
    if not 0 < confidence < 1:
        raise InvalidValueError(f"expected a confidence between 0 and 1, got {confidence}")
    x, n = np.asarray(counts, np.float64), np.asarray(of, np.float64)
    x, n = x[n > 0], n[n > 0]
    k, total = len(n), float(n.sum())
    if k < 2:
        return None
    from scipy.stats import beta, norm, t

    share = float(x.sum()) / total
    if 0 < share < 1:
        rest = x - share * n
        variance = k / (k - 1) * float((rest**2).sum()) / total**2
        effect = max(1.0, variance / (share * (1 - share) / total))
        few = (norm.ppf(0.5 + confidence / 2) / t.ppf(0.5 + confidence / 2, k - 1)) ** 2
        effective = total / effect * few
    else:
        effective = float(k)
    tail, hits = (1 - confidence) / 2, share * effective
    low = 0.0 if hits == 0 else float(beta.ppf(tail, hits, effective - hits + 1))
    high = 1.0 if share == 1 else float(beta.ppf(1 - tail, hits + 1, effective - hits))
    return Interval(low, high, k)
