"""A way over a published costmap: the cheapest one through free cells, never through an unknown one.

For the simulated mower and for tests; a robot has Nav2's planners.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from swardmap.grid import GridSpec

INSCRIBED = 99
"""Of nav_msgs/OccupancyGrid, as Nav2 publishes its costs: from here on the base must not be there."""

DEAR = 4.0
"""The dearest free cell counts as so many free ones: ways keep off obstacles where there is room."""

STRAY_M = 0.6
"""A robot whose own cell is not free begins at the nearest that is, at most so far away."""

STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""(rows, columns) to half of the eight neighbours."""


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """A way.

    Attributes:
        xy_m: (N, 2) centres of its cells in the map, from the robot's on.
        short_m: how far its end is from the goal.
    """

    xy_m: NDArray[np.float64]
    short_m: float


def route(
    values: NDArray[np.int8], spec: GridSpec, from_m: tuple[float, float], to_m: tuple[float, float]
) -> Route | None:
    """The cheapest way to the goal, or to the cell nearest to it that can be reached.

    Args:
        values: (height, width) costs of a nav_msgs/OccupancyGrid: -1 unknown, 0 free, 99 and 100 blocked.
        spec: where they lie.
        from_m: (x, y) of the robot.
        to_m: (x, y) of the goal.

    Returns:
        None if there is no free cell about the robot.
    """
    free = (values >= 0) & (values < INSCRIBED)
    rows, columns = np.nonzero(free)
    if len(rows) == 0:
        return None
    centres = spec.center_of(np.column_stack([columns, rows]))
    away = np.hypot(*(centres - from_m).T)
    start = int(away.argmin())
    if away[start] > STRAY_M:
        return None
    lengths, before = dijkstra(
        _graph(free, values, spec.resolution_m), directed=False, indices=start, return_predecessors=True
    )
    short_m = np.where(np.isfinite(lengths), np.hypot(*(centres - to_m).T), np.inf)
    end = int(short_m.argmin())
    cells = [end]
    while cells[-1] != start:
        cells.append(int(before[cells[-1]]))
    return Route(centres[cells[::-1]], float(short_m[end]))


def _graph(free: NDArray[np.bool_], values: NDArray[np.int8], resolution_m: float) -> csr_matrix:
    """Free cells, numbered row by row, and the ways between neighbours."""
    number = np.full(free.shape, -1, np.int64)
    number[free] = np.arange(np.count_nonzero(free))
    dear = 1 + (DEAR - 1) * np.clip(values, 0, INSCRIBED) / INSCRIBED
    height, width = free.shape
    edges = []
    for down, right in STEPS:
        here = slice(0, height - down), slice(max(0, -right), width - max(0, right))
        there = slice(down, height), slice(max(0, right), width + min(0, right))
        both = free[here] & free[there]
        if down and right:  # not between two blocked corners
            side, below = (here[0], there[1]), (there[0], here[1])
            both &= free[side] & free[below]
        length_m = resolution_m * np.hypot(down, right) * (dear[here] + dear[there])[both] / 2
        edges.append(np.stack([number[here][both], number[there][both], length_m]))
    one, two, length_m = np.concatenate(edges, axis=1)
    count = int(np.count_nonzero(free))
    return csr_matrix((length_m, (one.astype(np.int64), two.astype(np.int64))), shape=(count, count))
