"""Whether two views that follow each other lie on the map as their poses say: a jump that no clock betrays.

What stands in one view is laid over what stands in the next, moved by up to a metre. If it fits clearly
better when moved, one of the two poses is wrong.
"""

from dataclasses import dataclass

import numpy as np

from swardmap.grid import GridSpec, overlap
from swardmap.teach.evidence import grid_around
from swardmap.teach.views import Float32, SeenCells

REACH_M = 1.0
LEAST_SHIFT_M = 0.2
LEAST_GAIN = 0.15
"""Of the agreement, 1 = perfect, by which the moved view must fit better."""
FEWEST_CELLS = 25
"""With something standing, in both views."""
FLAT_WEIGHT = 0.1
"""Of flat ground against what stands: there is so much more of it."""
LEAST_OVERLAP = 0.5


@dataclass(frozen=True, slots=True)
class Shift:
    """How a view fits onto the one before.

    Attributes:
        xy_m: by which it fits best.
        gain: of the agreement there over that where it is said to be.
    """

    xy_m: tuple[float, float]
    gain: float

    @property
    def jumped(self) -> bool:
        """Whether one of the two poses must be wrong."""
        return self.gain > LEAST_GAIN and float(np.hypot(*self.xy_m)) >= LEAST_SHIFT_M


def shift_between(one: SeenCells, two: SeenCells) -> Shift | None:
    """How the second view fits onto the first; None where too little stands in them to say."""
    import cv2

    if min(int((s.raised & ~s.persons).sum()) for s in (one, two)) < FEWEST_CELLS:
        return None
    spec = grid_around([one, two])
    reach = round(REACH_M / spec.resolution_m)
    (first, first_known), (second, second_known) = (_weights(s, spec) for s in (one, two))
    if not ((first > 0) & (second_known > 0)).any() or not ((second > 0) & (first_known > 0)).any():
        return None  # of what stands in one nothing lies in the other: after a sharp turn
    padded = [np.pad(a, reach) for a in (first, first_known)]
    total = cv2.matchTemplate(padded[0], second, cv2.TM_CCORR)
    known = cv2.matchTemplate(padded[1], second_known, cv2.TM_CCORR)
    agreement = np.where(known >= LEAST_OVERLAP * known[reach, reach], total / np.maximum(known, 1e-6), -1.0)
    if known[reach, reach] <= 0:
        return None
    y, x = np.unravel_index(int(agreement.argmax()), agreement.shape)
    r = spec.resolution_m
    return Shift(
        ((int(x) - reach) * r, (int(y) - reach) * r), float(agreement[y, x] - agreement[reach, reach])
    )


def _weights(seen: SeenCells, spec: GridSpec) -> tuple[Float32, Float32]:
    """+1 where something stands, a little below 0 where it is flat; and how much that counts."""
    own, there = overlap(seen.spec, spec)
    weights = np.zeros(spec.shape, np.float32)
    stands, flat = seen.raised[own] & ~seen.persons[own], seen.flat[own]
    weights[there] = stands.astype(np.float32) - np.float32(FLAT_WEIGHT) * flat
    return weights, np.abs(weights)
