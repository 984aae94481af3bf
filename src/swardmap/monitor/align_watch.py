"""Whether depth lies on colour: edges of depth are where edges of colour are, or all of them are beside.

A depth image that was never aligned to the colour image, or by another camera's calibration, is shifted to
the side by the same amount in every frame. Its edges lie on edges of colour far more often when moved back.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swardmap.monitor.step_watch import EdgeLook

FARTHEST, NEAREST = 0.08, 0.015
"""Shifts that are looked at, as shares of the width; one that is smaller is none."""
STEPS = 12
"""To each side."""
LEAST_PIXELS = 150
"""A frame with fewer edge pixels of depth says nothing."""
WINDOW, LEAST = 12, 6
"""Frames remembered; how many of them must say something."""
GAIN = 1.25
"""So many times as many edge pixels must lie on colour when they are moved."""
AGREED = 0.6
"""Share of the frames that lie best at nearly the same shift."""


@dataclass(slots=True)
class AlignWatch:
    """Tells from the edges of the last frames whether depth is shifted to the side of colour.

    Attributes:
        limit: so many times as much as usual it may look so; None = never looked at.
        shift: share of the width by which depth lies to the right of colour, if it does; else 0.
    """

    limit: float | None
    shift: float = 0.0
    _counts: deque[NDArray[np.int64]] = field(default_factory=lambda: deque(maxlen=WINDOW))

    def add(self, edges: EdgeLook | None) -> bool:
        """Take the edges of a frame; whether depth is shifted."""
        return self.take(None if self.limit is None or edges is None else shifted_counts(edges))

    def take(self, counts: NDArray[np.int64] | None) -> bool:
        """Take the `shifted_counts` of a frame; whether depth is shifted."""
        if self.limit is not None and counts is not None:
            self._counts.append(counts)
            self.shift = shift_of(list(self._counts), self.limit)
        return self.shift != 0


def shifted_counts(edges: EdgeLook) -> NDArray[np.int64] | None:
    """(2 STEPS + 1,) edge pixels of depth on edges of colour, moved from left to right; None = too few."""
    width = edges.depth.shape[1]
    reach = round(FARTHEST * width)
    inner = edges.depth[:, reach : width - reach]
    if reach < STEPS or np.count_nonzero(inner) < LEAST_PIXELS:
        return None
    moves = np.rint(np.linspace(-reach, reach, 2 * STEPS + 1)).astype(int)
    colors = (edges.color[:, reach + m : width - reach + m] for m in moves)
    return np.array([np.count_nonzero(inner & color) for color in colors])


def shift_of(counts: list[NDArray[np.int64]], limit: float = 1.0) -> float:
    """Share of the width by which depth lies to the right of colour, of the counts of some frames; else 0."""
    if len(counts) < LEAST:
        return 0.0
    total = np.sum(counts, axis=0)
    best = int(total.argmax())
    shift = (STEPS - best) / STEPS * FARTHEST
    agreed = sum(abs(int(c.argmax()) - best) <= 1 for c in counts)
    if abs(shift) < NEAREST or agreed < AGREED * len(counts):
        return 0.0
    return shift if total[best] > (1 + (GAIN - 1) * limit) * total[STEPS] else 0.0
