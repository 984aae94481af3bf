"""The list of metrics: one entry feeds results.json, the CSV, tables, report and comparison.

To add one: a function that takes two sums from tallies, an entry in METRICS, a test.
Every metric is a ratio of two sums over frames, so that tallies merge in any order and whole frames or
sequences can be drawn again for an interval.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from swardmap.errors import InvalidValueError
from swardmap.eval.confusion import ConfusionMatrix, Share
from swardmap.eval.intervals import share_interval
from swardmap.eval.safety import SafetyTally
from swardmap.eval.tally import MapTally
from swardmap.eval.things import HEIGHT_CLASSES, PERSON

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
        safety: things, corridors, what lies beyond the margin; always of the robot's own map.
    """

    mask: ConfusionMatrix
    map: MapTally
    safety: SafetyTally


@dataclass(frozen=True, slots=True)
class Metric:
    """One figure of an evaluation.

    Attributes:
        key: in files; never changes its meaning.
        title: what a person reads, without the unit.
        unit: `%` (a share, told in percent), `m`, or empty for a plain ratio.
        take: the two sums; the value is undefined where the second is 0.
        decimals: that are told.
        headline: among what a safety engineer reads first; told with an interval by sequence.
    """

    key: str
    title: str
    unit: str
    take: Callable[[Tallies], Pair]
    decimals: int = 2
    headline: bool = False

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


def _things(height: str | None, what: str) -> Callable[[Tallies], Pair]:
    """Things of a height class, all if None: those missed or those dangerous."""

    def take(t: Tallies) -> Pair:
        n, missed, dangerous = t.safety.of_things(**({} if height is None else {"height": height}))
        return missed if what == "missed" else dangerous, n

    return take


def _missed_and_free(t: Tallies) -> Pair:
    kinds = t.safety.things
    return sum(n for kind, n in kinds.items() if kind.missed and kind.dangerous), sum(kinds.values())


def _counts(name: str, of: str) -> Callable[[Tallies], Pair]:
    """One of the counts of `safety` over another."""
    return lambda t: (t.safety.count(name), t.safety.count(of))


def _pair(share: Share) -> Pair:
    return share.count, share.of


def _things_metrics(height: str | None) -> tuple[Metric, ...]:
    name = "things" if height is None else f"things {height}" if height != PERSON else "persons"
    key = name.replace(" ", "_").replace("-", "_")
    return tuple(
        Metric(f"{key}_{what}", f"{name} {what}", "%", _things(height, what), headline=True)
        for what in ("missed", "dangerous")
    )


METRICS: tuple[Metric, ...] = (
    *(entry for height in (None, *HEIGHT_CLASSES) for entry in _things_metrics(height)),
    Metric("things_missed_free", "things missed and called free", "%", _missed_and_free, headline=True),
    Metric("corridor_missed", "corridors missed", "%", _counts("corridor_missed", "corridor_thing"),
           headline=True),
    Metric("false_stops", "false stops", "%", _counts("corridor_stopped", "corridor_clear"), headline=True),
    Metric("free_beyond_margin_near", "called free beyond the margin, within 5 m", "%",
           _counts("obstacle_free_beyond_near", "obstacle_near"), headline=True),
    Metric("free_beyond_margin", "called free beyond the margin", "%",
           _counts("obstacle_free_beyond", "obstacle"), headline=True),
    Metric("free_near", "called free within 5 m", "%", _counts("obstacle_free_near", "obstacle_near"),
           headline=True),
    Metric("lawn_kept_near", "lawn kept within 5 m", "%", _counts("lawn_kept_near", "lawn_near"),
           headline=True),
    Metric("lawn_marked", "lawn marked, margin included", "%", _counts("lawn_marked", "lawn")),
    *(Metric(f"{group}_free", f"{title} called free", "%", _counts(f"{group}_free", group))
      for group, title in (("standing", "cells over 5 cm"), ("flat", "flat areas"), ("water", "water"))),
    Metric("unjudged_cells", "obstacle cells left out of the truth by height", "%",
           lambda t: (t.safety.count("unjudged_cells"),
                      t.safety.count("unjudged_cells") + t.safety.count("obstacle"))),
    Metric("pixels_right", "pixels right", "%", _pixels_right),
    Metric("obstacle_called_free", "obstacle cells called free", "%", _called_free),
    Metric("person_called_free", "person cells called free", "%", _person_called_free),
    Metric("obstacle_not_seen", "obstacle cells not seen", "%", _not_seen),
    Metric("free_called_obstacle", "false alarms", "%", _false_alarms),
    Metric("components_missed", "obstacles missed", "%", _components_missed),
    Metric("components_called_free", "obstacles called free", "%", _components_called_free),
    Metric("d_min_mean", "mean d_min-obst", "m", _mean_d_min, decimals=3),
)  # fmt: skip


def metric(key: str) -> Metric:
    """The entry of a key."""
    return next(m for m in METRICS if m.key == key)


def interval_text(found: Mapping[str, Any]) -> str:
    """The interval of a metric of `metrics_section`, in percent; empty if it has none."""
    if found.get("high") is None:
        return ""
    return f"{100 * found['low']:.1f} to {100 * found['high']:.1f} %"


def metrics_section(
    total: Tallies, units: Sequence[Tallies] = (), confidence: float = 0.95
) -> dict[str, dict[str, Any]]:
    """Every metric of one group: value, and the two sums that it is the ratio of.

    Args:
        total: of all its frames.
        units: of each independent sequence; headlines then have an interval (`low`, `high`).
        confidence: of the intervals.
    """
    section: dict[str, dict[str, Any]] = {}
    for m in METRICS:
        count, of = m.take(total)
        section[m.key] = {"value": count / of if of else None, "count": count, "of": of}
        if m.headline and units:
            counts, sizes = zip(*(m.take(unit) for unit in units), strict=True)
            found = share_interval(counts, sizes, confidence)
            section[m.key] |= {"low": found and found.low, "high": found and found.high}
    return section
