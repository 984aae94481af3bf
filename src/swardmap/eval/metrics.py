"""The list of metrics: one entry feeds results.json, the CSV, tables, report and comparison.

To add one: a function that takes two sums from tallies, an entry in METRICS, a test.
Every metric is a ratio of two sums over frames, so that tallies merge in any order and whole frames or
sequences can be drawn again for an interval.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from swardmap.errors import InvalidValueError
from swardmap.eval.confusion import ConfusionMatrix, Share
from swardmap.eval.tally import MapTally

Pair = tuple[float, float]
"""What is counted, and what it is a share of."""

UNDEFINED = "–"  # noqa: RUF001 - as the paper prints it
UNITS = ("%", "m", "")


@dataclass(frozen=True, slots=True)
class Tallies:
    """All that was counted of one frame or of many, with one kind of map.

    Attributes:
        mask: pixels by true class and class given.
        map: cells, distances and missed obstacles.
    """

    mask: ConfusionMatrix
    map: MapTally


@dataclass(frozen=True, slots=True)
class Metric:
    """One figure of an evaluation.

    Attributes:
        key: in files; never changes its meaning.
        title: what a person reads, without the unit.
        unit: `%` (a share, told in percent), `m`, or empty for a plain ratio.
        take: the two sums; the value is undefined where the second is 0.
        higher_is_better: whether a larger value is a better map.
        decimals: that are told.
    """

    key: str
    title: str
    unit: str
    take: Callable[[Tallies], Pair]
    higher_is_better: bool = False
    decimals: int = 2

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise InvalidValueError(f"metric {self.key}: expected a unit of {UNITS}, got '{self.unit}'")

    def value(self, tallies: Tallies) -> float | None:
        """First sum over the second, or None if that is 0."""
        count, of = self.take(tallies)
        return count / of if of else None

    def text(self, value: float | None, sign: str = "") -> str:
        """A value with its unit; shares in percent, undefined ones as a dash."""
        if value is None:
            return UNDEFINED
        number = f"{100 * value if self.unit == '%' else value:{sign}.{self.decimals}f}"
        return f"{number} {self.unit}".rstrip()


def _pixels_right(t: Tallies) -> Pair:
    return sum(t.mask.counts[i][i] for i in range(len(t.mask.names))), t.mask.total


def _called_free(t: Tallies) -> Pair:
    return _pair(t.map.matrix.obstacle_called_free)


def _person_called_free(t: Tallies) -> Pair:
    return _pair(t.map.matrix.person_called_free)


def _not_seen(t: Tallies) -> Pair:
    return _pair(t.map.matrix.obstacle_not_seen)


def _false_alarms(t: Tallies) -> Pair:
    return _pair(t.map.matrix.free_called_obstacle)


def _components_missed(t: Tallies) -> Pair:
    return t.map.missed_obstacles, t.map.obstacles


def _components_called_free(t: Tallies) -> Pair:
    return t.map.missed_called_free, t.map.obstacles


def _mean_d_min(t: Tallies) -> Pair:
    summary = t.map.distances().summary()
    return (summary.mean_m or 0.0) * summary.count, summary.count


def _pair(share: Share) -> Pair:
    return share.count, share.of


METRICS: tuple[Metric, ...] = (
    Metric("pixels_right", "pixels right", "%", _pixels_right, higher_is_better=True),
    Metric("obstacle_called_free", "obstacle cells called free", "%", _called_free),
    Metric("person_called_free", "person cells called free", "%", _person_called_free),
    Metric("obstacle_not_seen", "obstacle cells not seen", "%", _not_seen),
    Metric("free_called_obstacle", "false alarms", "%", _false_alarms),
    Metric("components_missed", "obstacles missed", "%", _components_missed),
    Metric("components_called_free", "obstacles called free", "%", _components_called_free),
    Metric("d_min_mean", "mean d_min-obst", "m", _mean_d_min, decimals=3),
)


def metric(key: str) -> Metric:
    """The entry of a key."""
    return next(m for m in METRICS if m.key == key)


def metrics_section(tallies: Tallies) -> dict[str, Mapping[str, Any]]:
    """Every metric of one group: value, and the two sums that it is the ratio of."""
    section: dict[str, Mapping[str, Any]] = {}
    for m in METRICS:
        count, of = m.take(tallies)
        section[m.key] = {"value": count / of if of else None, "count": count, "of": of}
    return section
