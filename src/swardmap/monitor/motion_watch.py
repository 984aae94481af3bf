"""Whether poses say the same of the way of the camera as what it sees does.

A pose that drifts or stands still comes in time and does not jump; a camera that is mounted a few degrees
aside, and depth that is too long by a tenth, look like any other. All of them show between two views: what
was seen from the first is not where the second sees it. One pair of views proves nothing; several that
agree do.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swardmap.monitor.seen_motion import View, seen_motion

STEP_M, STEP_RAD, STEP_NS = 0.15, np.deg2rad(5), 200_000_000
"""Two views are compared once the pose says that one lies so far from the other, or after so long."""
LONGEST_M, LONGEST_NS = 1.5, 3_000_000_000
"""Views that are farther apart are not compared."""

AHEAD, ASIDE = 0.07, 0.035
"""Metres a metre of way by which view and pose may differ: twice what good depth and odometry are out by."""
GROSS, GROSS_TURN, GROSS_RAD = 0.3, 0.5, np.deg2rad(2)
"""Likewise, of one pair alone; and so much of a turn, if it is so much."""
LEAST_WAY_M = 0.1
"""Of a pair, to say how much a metre of way it is out; with less, only what is gross by this way counts."""
WINDOW, LEAST, LEAST_GROSS = 12, 6, 4
"""Pairs remembered, and how many of them must say something."""
SURE = 4.0
"""What they agree on is so many times its own uncertainty."""


@dataclass(frozen=True, slots=True)
class PairOff:
    """By how much view and pose of two frames differ.

    Attributes:
        ahead, aside: a metre of way, along it and to its left; None where there is too little way.
        is_gross: they do not speak of the same way at all.
    """

    ahead: float | None
    aside: float | None
    is_gross: bool


def pair_off(before: View, now: View) -> PairOff | None:
    """By how much two views differ; None where too little is seen to tell."""
    seen = seen_motion(before, now)
    if seen is None:
        return None
    start, said = before.T_map_camera.matrix, now.T_map_camera.matrix
    said_m = said[:3, 3] - start[:3, 3]
    off, way_m = (seen - said)[:2, 3], float(np.hypot(*said_m[:2]))
    is_gross = float(np.hypot(*off)) > GROSS * max(way_m, LEAST_WAY_M / GROSS)
    is_gross |= _turn_rad(seen, said) > max(GROSS_RAD, GROSS_TURN * _turn_rad(start, said))
    if way_m < LEAST_WAY_M:
        return PairOff(None, None, is_gross)
    x, y = said_m[:2] / way_m
    return PairOff(float(off @ (x, y)) / way_m, float(off @ (-y, x)) / way_m, is_gross)


def _turn_rad(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    between = one[:3, :3].T @ other[:3, :3]
    return float(np.arccos(np.clip((np.trace(between) - 1) / 2, -1, 1)))


@dataclass(slots=True)
class PairFinder:
    """Finds views of one camera that lie far enough apart to be compared.

    Attributes:
        key: the view that those after it are compared with; None = the next one begins.
    """

    key: View | None = None

    def add(self, view: View | None) -> PairOff | None:
        """Take the view of a frame; by how much it and the key differ, where that can be told now."""
        if view is None:
            return None
        key = self.key
        if key is None or not _may_compare(key, view):
            self.key = view
        elif _are_apart(key, view):
            self.key = view
            return pair_off(key, view)
        return None


@dataclass(slots=True)
class MotionWatch:
    """Tells from the last pairs of views whether their poses can be right.

    Attributes:
        limit: so many times `AHEAD` and `ASIDE` they may be out; None = never looked at.
        found: whether they are.
    """

    limit: float | None
    found: bool = False
    _finder: PairFinder = field(default_factory=PairFinder)
    _pairs: deque[PairOff] = field(default_factory=lambda: deque(maxlen=WINDOW))

    def add(self, view: View | None) -> bool:
        """Take the view of a frame; whether view and pose differ. None = a frame without pose."""
        return self.found if self.limit is None else self.take(self._finder.add(view))

    def take(self, pair: PairOff | None) -> bool:
        """Take what a `PairFinder` found at a frame; whether view and pose differ."""
        if self.limit is not None and pair is not None:
            self._pairs.append(pair)
            self.found = is_off(list(self._pairs), self.limit)
        return self.found

    def message(self) -> str:
        """By how much they differ, for a person."""
        gross = sum(p.is_gross for p in self._pairs)
        if _mostly(gross, len(self._pairs)):
            return f"in {gross} of {len(self._pairs)} pairs of views the camera did not move as its pose did"
        ahead, aside = (_middle(values) for values in _columns(self._pairs))
        return (
            f"a metre of the pose's way is {1 + ahead:.2f} m by what is seen, "
            f"and {abs(aside):.2f} m to the {'left' if aside > 0 else 'right'}"
        )


def _are_apart(key: View, view: View) -> bool:
    one, two = key.T_map_camera.matrix, view.T_map_camera.matrix
    way_m = float(np.linalg.norm(two[:3, 3] - one[:3, 3]))
    return way_m >= STEP_M or _turn_rad(one, two) >= STEP_RAD or view.stamp_ns - key.stamp_ns >= STEP_NS


def _may_compare(key: View, view: View) -> bool:
    way_m = float(np.linalg.norm(view.T_map_camera.position_m - key.T_map_camera.position_m))
    near = way_m <= LONGEST_M and 0 <= view.stamp_ns - key.stamp_ns <= LONGEST_NS
    return near and key.grey.shape == view.grey.shape


def is_off(pairs: list[PairOff], limit: float = 1.0) -> bool:
    """Whether pairs agree that view and pose differ: most of them by much, or all by the same."""
    if _mostly(sum(p.is_gross for p in pairs), len(pairs)):
        return True
    ahead, aside = _columns(pairs)
    return _agree(ahead, AHEAD * limit) or _agree(aside, ASIDE * limit)


def _mostly(gross: int, pairs: int) -> bool:
    return pairs >= LEAST_GROSS and gross > pairs / 2


def _columns(pairs: Iterable[PairOff]) -> tuple[list[float], list[float]]:
    known = [(p.ahead, p.aside) for p in pairs if p.ahead is not None and p.aside is not None]
    return [ahead for ahead, _ in known], [aside for _, aside in known]


def _middle(values: list[float]) -> float:
    return float(np.median(values)) if values else 0.0


def _agree(values: list[float], limit: float) -> bool:
    if len(values) < LEAST:
        return False
    middle = float(np.median(values))
    spread = 1.48 * float(np.median(np.abs(np.asarray(values) - middle)))
    return bool(abs(middle) > max(limit, SURE * spread / len(values) ** 0.5))
