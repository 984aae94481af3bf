"""Distances as an exact histogram: squared cells are integers, so nothing is lost and order is free."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from swardmap.errors import InvalidValueError

QUANTILES = (0.5, 0.9, 0.95, 0.99)


@dataclass(frozen=True, slots=True)
class DistanceSummary:
    """What a report says of a set of distances; all None where there are none.

    Attributes:
        count: number of distances.
        mean_m: the paper's avg(d_min-obst).
        variance_m2: the paper's var(d_min-obst); of these distances, not of a population behind them.
        quantiles_m: share -> smallest distance that at least this share does not exceed.
        max_m: largest distance.
    """

    count: int
    mean_m: float | None
    variance_m2: float | None
    quantiles_m: Mapping[float, float | None]
    max_m: float | None


@dataclass(frozen=True, slots=True)
class DistanceHistogram:
    """How often each distance between two cells of a grid occurs.

    Attributes:
        resolution_m: edge of a cell.
        counts: squared distance in cells -> how often.

    >>> histogram = DistanceHistogram(0.05, {1: 2, 4: 1, 25: 1})
    >>> histogram.summary().mean_m, histogram.quantile_m(0.75)
    (0.1125, 0.1)
    """

    resolution_m: float
    counts: Mapping[int, int]

    def __post_init__(self) -> None:
        object.__setattr__(self, "counts", {int(k): int(n) for k, n in sorted(self.counts.items()) if n})
        if self.counts and (min(self.counts) < 0 or min(self.counts.values()) < 0):
            raise InvalidValueError("distance histogram: expected squared distances and counts of 0 or more")

    def __add__(self, other: "DistanceHistogram") -> "DistanceHistogram":
        if self.resolution_m != other.resolution_m:
            raise InvalidValueError(
                f"cannot add distances on grids of {self.resolution_m} m and {other.resolution_m} m"
            )
        return DistanceHistogram(self.resolution_m, Counter(self.counts) + Counter(other.counts))

    @property
    def count(self) -> int:
        """Number of distances."""
        return sum(self.counts.values())

    def quantile_m(self, share: float) -> float | None:
        """Smallest distance in metres that at least `share` of all do not exceed; None if there are none."""
        wanted = exact_share(share) * self.count
        covered = 0
        for squared, n in self.counts.items():
            covered += n
            if covered >= wanted:
                return self.distance_m(squared)
        return None

    def covered(self, distance_m: float) -> int:
        """How many distances do not exceed `distance_m`."""
        return sum(n for squared, n in self.counts.items() if self.distance_m(squared) <= distance_m)

    def summary(self, quantiles: Iterable[float] = QUANTILES) -> DistanceSummary:
        """Mean, variance, quantiles and maximum."""
        count = self.count
        if count == 0:
            return DistanceSummary(0, None, None, dict.fromkeys(quantiles), None)
        pairs = [(math.sqrt(squared), n) for squared, n in self.counts.items()]
        mean = math.fsum(d * n for d, n in pairs) / count
        variance = math.fsum((d - mean) ** 2 * n for d, n in pairs) / count
        return DistanceSummary(
            count=count,
            mean_m=mean * self.resolution_m,
            variance_m2=variance * self.resolution_m**2,
            quantiles_m={q: self.quantile_m(q) for q in quantiles},
            max_m=self.distance_m(max(self.counts)),
        )

    def bins(self, width_m: float) -> list[tuple[float, float, int]]:
        """(from, to, count) of equal bins (from, to] up to the maximum, empty ones included."""
        filled = Counter[int]()
        for squared, n in self.counts.items():
            filled[max(0, math.ceil(round(self.distance_m(squared) / width_m, 9)) - 1)] += n
        last = max(filled, default=-1)
        return [(i * width_m, (i + 1) * width_m, filled[i]) for i in range(last + 1)]

    def distance_m(self, squared: int) -> float:
        """A squared distance in cells as metres."""
        return math.sqrt(squared) * self.resolution_m

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers; squared distances as strings, as JSON wants its keys."""
        return {"resolution_m": self.resolution_m, "counts": {str(k): n for k, n in self.counts.items()}}

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any]) -> "DistanceHistogram":
        """What `to_dict` gave."""
        return cls(float(plain["resolution_m"]), {int(k): n for k, n in plain["counts"].items()})


def exact_share(share: float) -> Fraction:
    """A share as it is written: 0.99 is 99/100, not the binary number beside it.

    Raises:
        InvalidValueError: if it is not above 0 and up to 1.
    """
    if not 0 < share <= 1:
        raise InvalidValueError(f"expected a share above 0 and up to 1, got {share}")
    return Fraction(repr(float(share)))
