"""The one polygon fill: a cell or pixel belongs to a ring if its centre does, by the even-odd rule.

Written here and not taken from a library: OpenCV fills what its lines touch, and asking shapely for each
centre takes the number of cells times the number of corners. This takes their sum.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.errors import InvalidValueError
from swardmap.grid import GridSpec

Corners = NDArray[np.float64]
"""(N, 2) x and y, in order; the last joins the first."""

CHUNK = 1_000_000
MAX_CROSSINGS = 50_000_000
"""Rows crossed by edges, in all; some seconds. A real outline of 200,000 corners crosses as many."""


def cells_inside(spec: GridSpec, corners: ArrayLike) -> NDArray[np.bool_]:
    """(height, width) bool: cells of a grid whose centre lies in a ring in the grid's metres.

    Raises:
        InvalidValueError: see `points_inside`.
    """
    xs = spec.center_of(np.stack([np.arange(spec.width), np.zeros(spec.width)], axis=-1))[:, 0]
    ys = spec.center_of(np.stack([np.zeros(spec.height), np.arange(spec.height)], axis=-1))[:, 1]
    return points_inside(xs, ys, corners)


def points_inside(
    xs: NDArray[np.floating], ys: NDArray[np.floating], corners: ArrayLike
) -> NDArray[np.bool_]:
    """Which points of a lattice lie in a ring, by the even-odd rule.

    A point on an edge belongs to what lies right of it or above it, so that of two rings with a common edge
    exactly one has it.

    Args:
        xs: (W,) ascending.
        ys: (H,) ascending.
        corners: (N, 2), at least three, finite; the ring may cross itself.

    Returns:
        (H, W) bool.

    Raises:
        InvalidValueError: for other corners, or edges that cross more than `MAX_CROSSINGS` rows in all.
    """
    ring: Corners = np.asarray(corners, np.float64)
    if ring.ndim != 2 or ring.shape[1:] != (2,) or len(ring) < 3 or not np.isfinite(ring).all():
        raise InvalidValueError(
            f"polygon: expected at least three finite corners (N, 2), got shape {ring.shape}"
        )
    inside = np.zeros((len(ys), len(xs)), bool)
    rows, columns = _within(ys, ring[:, 1]), _within(xs, ring[:, 0])
    xs, ys = xs[columns], ys[rows]
    if xs.size and ys.size:
        # what lies left of an edge changes sides, row by row
        changes = np.zeros((len(ys), len(xs) + 1), np.uint8)
        for row, left in _crossings(xs, ys, ring):
            np.add.at(changes, (row, left), np.uint8(1))
        sides = np.bitwise_xor.accumulate(changes[:, ::-1], axis=1)[:, ::-1]
        inside[rows, columns] = (sides[:, 1:] & 1).astype(bool)
    return inside


def _within(values: NDArray[np.floating], of_ring: NDArray[np.float64]) -> slice:
    """The part of ascending values that the ring spans."""
    return slice(
        int(np.searchsorted(values, of_ring.min())), int(np.searchsorted(values, of_ring.max(), "right"))
    )


def _crossings(
    xs: NDArray[np.floating], ys: NDArray[np.floating], ring: Corners
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Row, and number of points left of the edge, of every edge in every row; in parts of bounded size."""
    x0, y0 = ring.T
    x1, y1 = np.roll(ring, -1, axis=0).T
    first = np.searchsorted(ys, np.minimum(y0, y1))
    counts = np.searchsorted(ys, np.maximum(y0, y1)) - first
    ends = np.cumsum(counts)
    total = int(ends[-1])
    if total > MAX_CROSSINGS:
        raise InvalidValueError(
            f"polygon: its {len(ring)} edges cross {total} rows, more than {MAX_CROSSINGS}: simplify it"
        )
    for start in range(0, total, CHUNK):
        number = np.arange(start, min(start + CHUNK, total))
        edge = np.searchsorted(ends, number, "right")
        row = first[edge] + number - (ends - counts)[edge]
        slope = (x1[edge] - x0[edge]) / (y1[edge] - y0[edge])
        yield row, np.searchsorted(xs, x0[edge] + (ys[row] - y0[edge]) * slope)
