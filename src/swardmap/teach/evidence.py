"""What all frames of a drive say of the ground together, and which of them contradict the rest.

A pose that is wrong puts what stands onto cells that other frames see flat, and lays the robot's way across
hedges. Such frames, and the way of the robot at those moments, are left out and told; too many are refused.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec, overlap
from swardmap.teach.views import Bools, SeenCells

FEWEST_OTHERS = 2
"""Frames that must have seen a cell before they can be contradicted."""
FEWEST_CELLS = 20
"""Cells on which a frame must be compared before it is judged."""
MOST_AGAINST = 0.6
"""Share of the raised cells, of this frame or of the others, on which they may differ."""
MOST_BLOCKED = 0.15
"""Share of the driven cells of a view that may have something standing on them."""
AGREED = 0.7
"""Share of the frames that decides a cell."""


@dataclass(frozen=True, slots=True, eq=False)
class Votes:
    """How many frames saw each cell flat and raised.

    Attributes:
        spec: grid around all that was seen.
        flat, raised: (height, width) int32.
    """

    spec: GridSpec
    flat: NDArray[np.int32]
    raised: NDArray[np.int32]


def grid_around(seen: Sequence[SeenCells]) -> GridSpec:
    """The smallest grid that holds all views, on their lattice."""
    extents = np.array([s.spec.extent_m for s in seen])
    low, high = extents[:, [0, 2]].min(0), extents[:, [1, 3]].max(0)
    first = seen[0].spec
    return GridSpec.covering(first.resolution_m, (low[0], low[1]), (high[0], high[1]), first.frame_id)


def votes_of(seen: Sequence[SeenCells], kept: Bools, spec: GridSpec) -> Votes:
    """The votes of the frames that are kept."""
    votes = Votes(spec, np.zeros(spec.shape, np.int32), np.zeros(spec.shape, np.int32))
    for one in (s for s, k in zip(seen, kept, strict=True) if k):
        own, there = overlap(one.spec, spec)
        votes.flat[there] += one.flat[own]
        votes.raised[there] += one.raised[own] & ~one.persons[own]
    return votes


def disagreement(one: SeenCells, votes: Votes, voted: bool) -> float | None:
    """Share of what stands, by this frame or by the others, on which they contradict each other.

    Args:
        one: the frame.
        votes: of all.
        voted: whether its own are among them.

    Returns:
        None where too little stands in view to say.
    """
    own, there = overlap(one.spec, votes.spec)
    stands = one.raised[own] & ~one.persons[own]
    flat, raised = votes.flat[there] - voted * one.flat[own], votes.raised[there] - voted * stands
    total = flat + raised
    known = total >= FEWEST_OTHERS
    others_flat, others_raised = known & (flat > AGREED * total), known & (raised > AGREED * total)
    against = (stands & others_flat) | (one.flat[own] & others_raised)
    agreed = stands & others_raised
    cells = int(against.sum() + agreed.sum())
    return float(against.sum()) / cells if cells >= FEWEST_CELLS else None


def blocked(one: SeenCells, driven: Bools, spec: GridSpec) -> float | None:
    """Share of the driven cells in view that have something standing on them, persons left out."""
    own, there = overlap(one.spec, spec)
    seen = driven[there] & (one.flat[own] | one.raised[own])
    if seen.sum() < FEWEST_CELLS:
        return None
    return float((seen & one.raised[own] & ~one.persons[own]).sum()) / float(seen.sum())


def contradicted(values: Sequence[float | None], limit: float) -> Bools:
    """(N,) frames beyond a limit: by themselves and in the middle of their neighbours, or far beyond it.

    One frame alone may be struck by what moves; a pose that is wrong is so for a while.
    """
    n = len(values)
    numbers = np.array([np.nan if v is None else v for v in values], np.float64)
    beyond = np.zeros(n, np.bool_)
    for i in range(n):
        around = numbers[max(0, i - 1) : i + 2]
        around = around[np.isfinite(around)]
        if len(around) and np.isfinite(numbers[i]):
            beyond[i] = min(float(np.median(around)), numbers[i]) > limit
    return beyond
