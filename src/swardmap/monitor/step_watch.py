"""Whether depth is of the same time as colour: in motion, edges of depth lie on edges of colour.

A depth image that is a frame late has its edges where those of the colour image before were; one that is a
frame early, where those of the next one are. Of each frame those edge pixels of depth are counted that lie on
a strong edge of one of two colour images and not of the other: its own and a neighbour's. Where little moves
nothing can be told, and nothing is said. Offsets below half a frame cannot be told either.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

STEP = 2
"""Every second row and column is looked at."""

STRONG_SHARE = 0.15
"""Of all pixels, those with the largest differences of colour count as edges."""

DEPTH_JUMP = 0.1
"""Neighbours whose depths differ by more than this share lie on an edge."""

LEAST_PIXELS = 40
"""A frame with fewer pixels that only one of two images explains decides nothing."""

WINDOW, DECIDED, AGREED = 12, 6, 5
"""Frames remembered; how many of them must have decided; how many of the last of those must agree."""

STAYS_ABOVE = 0.75
"""Of the ratio that begins it, a fault that was found ends below this share."""

Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class EdgeLook:
    """Edges of one frame at every second pixel: colour's, one pixel wider on each side, and depth's."""

    color: Bools
    depth: Bools


@dataclass(frozen=True, slots=True)
class StepCounts:
    """Edge pixels of depth by which colour image explains them, of two frames in turn.

    Attributes:
        late, not_late: of the second's depth: on edges of the first's colour alone, of its own alone.
        early, not_early: of the first's depth: on edges of the second's colour alone, of its own alone.
    """

    late: int
    not_late: int
    early: int
    not_early: int


def edge_look(rgb: NDArray[np.uint8], depth_m: NDArray[np.float32]) -> EdgeLook:
    """Edges of a frame.

    Args:
        rgb: (h, w, 3) uint8, every `STEP`-th row and column.
        depth_m: (h, w) float32 metres, the same rows and columns, NaN = no reading.
    """
    grey = rgb[..., 0].astype(np.int16) + 2 * rgb[..., 1].astype(np.int16) + rgb[..., 2]
    change = np.zeros(grey.shape, np.int16)
    change[:, 1:-1] = np.abs(grey[:, 2:] - grey[:, :-2])
    change[1:-1] = np.maximum(change[1:-1], np.abs(grey[2:] - grey[:-2]))
    limit = ranked(change, int((1 - STRONG_SHARE) * (change.size - 1)))
    return EdgeLook(_wider(change > limit), _depth_edges(depth_m))


def ranked(values: NDArray[np.integer], *places: int) -> NDArray[np.int64]:
    """What stands at places of the sorted values, none of them negative and all small: by counting them."""
    return np.searchsorted(np.cumsum(np.bincount(values.ravel())), places, side="right")


def _depth_edges(depth_m: NDArray[np.float32]) -> Bools:
    edges = np.zeros(depth_m.shape, np.bool_)
    for one, other, a, b in (
        (edges[:, :-1], edges[:, 1:], depth_m[:, :-1], depth_m[:, 1:]),
        (edges[:-1], edges[1:], depth_m[:-1], depth_m[1:]),
    ):
        jump = np.abs(a - b) > DEPTH_JUMP * np.minimum(a, b)  # NaN compares false
        one |= jump
        other |= jump
    edges[:2] = edges[-2:] = False
    edges[:, :2] = edges[:, -2:] = False
    return edges


def _wider(edges: Bools) -> Bools:
    wide = edges.copy()
    wide[1:] |= edges[:-1]
    wide[:-1] |= edges[1:]
    wide[:, 1:] |= edges[:, :-1]
    wide[:, :-1] |= edges[:, 1:]
    return wide


def step_counts(before: EdgeLook | None, now: EdgeLook | None) -> StepCounts | None:
    """Counts of two frames in turn; None if one is not known, or they are of another size."""
    if before is None or now is None or before.color.shape != now.color.shape:
        return None
    then, here = before.color & ~now.color, now.color & ~before.color
    counts = (now.depth & then, now.depth & here, before.depth & here, before.depth & then)
    return StepCounts(*(int(np.count_nonzero(c)) for c in counts))


@dataclass(slots=True)
class StepWatch:
    """Tells from the counts of the last frames whether depth is out of step with colour.

    Attributes:
        ratio: so many times as many edge pixels must lie in the other frame's place as in their own, over
            the decided frames; None = never.
    """

    ratio: float | None
    _counts: deque[StepCounts | None] = field(default_factory=lambda: deque(maxlen=WINDOW))
    _found: bool = False

    def add(self, counts: StepCounts | None) -> bool:
        """Take the counts of a frame and the one before it; whether depth is out of step."""
        if self.ratio is None:
            return False
        self._counts.append(counts)
        known = [c for c in self._counts if c is not None]
        ratio = self.ratio * (STAYS_ABOVE if self._found else 1.0)
        late = _disagrees([(c.late, c.not_late) for c in known], ratio)
        self._found = late or _disagrees([(c.early, c.not_early) for c in known], ratio)
        return self._found


def _disagrees(pairs: list[tuple[int, int]], ratio: float) -> bool:
    decided = [(other, own) for other, own in pairs if other + own >= LEAST_PIXELS][-DECIDED:]
    if len(decided) < DECIDED or sum(other > own for other, own in decided) < AGREED:
        return False
    return sum(other for other, _ in decided) > ratio * sum(own for _, own in decided)
