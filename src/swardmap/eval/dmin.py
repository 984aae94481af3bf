"""d_min-obst (Eq. 3): how far a missed obstacle cell is from the nearest one that was found."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.labels import MapClass

PAIRS_BY_BRUTE_FORCE = 10_000_000
"""Beyond so many pairs of a miss and a hit, a distance transform of the whole map is faster."""

WIDEST = 30_000
"""Cells along an edge up to which squared distances fit into 32 bits."""

NO_HIT = -1


@dataclass(frozen=True, slots=True)
class MissedObstacle:
    """A connected obstacle of the reference map without one cell that was found.

    Attributes:
        cells: its size.
        called_free: cells of it that were called grass; the rest was not seen.
        person: whether one of its cells is a person's.
        center: (x, y) of its middle in cells; (0.5, 0.5) is the centre of cell (0, 0).
    """

    cells: int
    called_free: int
    person: bool
    center: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Misses:
    """The FN cells of one map, row by row, and the obstacles of which nothing was found.

    Attributes:
        cells: (N, 2) int64 (ix, iy) of reference obstacle or person cells that were called grass.
        squared: (N,) int64 squared distance to the nearest TP cell, in cells; -1 if the map has none.
        person: (N,) bool, the reference says person.
        from_person: (N,) bool, the nearest TP cell is mapped as a person; at equal distance it is not.
        found: (N,) bool, another cell of the same connected obstacle is a TP.
        obstacles: number of connected obstacles in the reference.
        missed: those without one TP cell, in order of their first cell.
        hits: number of TP cells.
    """

    cells: NDArray[np.int64]
    squared: NDArray[np.int64]
    person: NDArray[np.bool_]
    from_person: NDArray[np.bool_]
    found: NDArray[np.bool_]
    obstacles: int
    missed: tuple[MissedObstacle, ...]
    hits: int

    def d_min_m(self, resolution_m: float) -> NDArray[np.float64]:
        """(N,) float64 d_min-obst of each FN cell in metres; infinite where the map has no TP cell."""
        return _metres(self.squared, resolution_m)


def d_min_obst(
    reference: NDArray[np.uint8], predicted: NDArray[np.uint8], resolution_m: float
) -> NDArray[np.float64]:
    """Eq. 3 for every FN cell: the distance in metres between its centre and that of the nearest TP cell.

    Args:
        reference: (height, width) uint8 MapClass; person counts as obstacle.
        predicted: the same of the map to be judged.
        resolution_m: edge of a cell.

    Returns:
        (N,) float64, one for each FN cell, row by row; infinite if the map has no TP cell.

    Figure 5: the cell (2, 1) is missed, and the nearest one that was found is (1, 4).

    >>> reference = np.full((7, 7), MapClass.GRASS, np.uint8)
    >>> reference[[1, 4, 4, 5], [2, 1, 0, 1]] = MapClass.OBSTACLE
    >>> predicted = reference.copy()
    >>> predicted[1, 2] = MapClass.GRASS
    >>> d_min_obst(reference, predicted, resolution_m=1.0).round(4).tolist()
    [3.1623]
    """
    cells = _gather(reference, predicted)
    squared, _ = _nearest(cells.misses, cells.hits, cells.person_hits, reference.shape)
    return _metres(squared, resolution_m)


def find_misses(reference: NDArray[np.uint8], predicted: NDArray[np.uint8]) -> Misses:
    """Find the FN cells of a map, their distances to what was found, and the missed obstacles.

    Args:
        reference: (height, width) uint8 MapClass.
        predicted: the same of the map to be judged.
    """
    from swardmap.kernels import metrics as kernel

    truth, called, hazards, misses, hits, person_hits = _gather(reference, predicted)
    height, width = reference.shape
    squared, from_person = _nearest(misses, hits, person_hits, reference.shape)
    component = np.empty(len(hazards), np.int32)
    groups = kernel.connected_cells(truth, hazards, height, width, component)
    group_hits = np.bincount(component[called[hazards] >= MapClass.OBSTACLE], minlength=groups)
    component_of_miss = component[called[hazards] == MapClass.GRASS]
    return Misses(
        cells=np.stack((misses % width, misses // width), axis=1),
        squared=squared,
        person=truth[misses] == MapClass.PERSON,
        from_person=from_person,
        found=group_hits[component_of_miss] > 0,
        obstacles=int(groups),
        missed=_missed_obstacles(truth, called, hazards, component, group_hits, width),
        hits=len(hits) + len(person_hits),
    )


class _Cells(NamedTuple):
    """Both maps flat, and flat indices of the cells that matter (see `kernels.metrics.gather_cells`)."""

    truth: NDArray[np.uint8]
    called: NDArray[np.uint8]
    hazards: NDArray[np.int64]
    misses: NDArray[np.int64]
    hits: NDArray[np.int64]
    person_hits: NDArray[np.int64]


def _gather(reference: NDArray[np.uint8], predicted: NDArray[np.uint8]) -> _Cells:
    if reference.shape != predicted.shape or {reference.dtype, predicted.dtype} != {np.dtype(np.uint8)}:
        raise InvalidValueError(
            f"maps: expected two uint8 arrays of one shape, got {reference.dtype} {reference.shape} "
            f"and {predicted.dtype} {predicted.shape}"
        )
    from swardmap.kernels import metrics as kernel

    truth, called = np.ascontiguousarray(reference).ravel(), np.ascontiguousarray(predicted).ravel()
    counts = np.empty((kernel.CODES, kernel.CODES), np.int64)
    kernel.count_pairs(truth, called, counts)
    _, grass, obstacle, person, *_ = of_hazard = counts[MapClass.OBSTACLE :].sum(axis=0).tolist()
    sizes = (sum(of_hazard), grass, obstacle, person)
    hazards, misses, hits, person_hits = (np.empty(n, np.int64) for n in sizes)
    kernel.gather_cells(truth, called, hazards, misses, hits, person_hits)
    return _Cells(truth, called, hazards, misses, hits, person_hits)


def _metres(squared: NDArray[np.int64], resolution_m: float) -> NDArray[np.float64]:
    """Squared distances in cells as metres; infinite for NO_HIT."""
    distance = np.sqrt(np.maximum(squared, 0).astype(np.float64)) * resolution_m
    return np.where(squared == NO_HIT, np.inf, distance)


def nearest_hits(
    reference: NDArray[np.uint8], predicted: NDArray[np.uint8], cells: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Cell (ix, iy) of the nearest TP for each of some FN cells, to draw them tied together as in Fig. 5.

    Args:
        reference: (height, width) uint8 MapClass.
        predicted: the same of the map to be judged; it must have a TP cell.
        cells: (N, 2) int64 (ix, iy).
    """
    iy, ix = np.nonzero((reference >= MapClass.OBSTACLE) & (predicted >= MapClass.OBSTACLE))
    hits = np.stack((ix, iy), axis=1).astype(np.int64)
    if len(hits) == 0:
        raise InvalidValueError("nearest hit: expected a map with a TP cell, got one without")
    nearest = [((hits - cell) ** 2).sum(axis=1).argmin() for cell in cells]
    return hits[np.array(nearest, np.intp)]


def _nearest(
    misses: NDArray[np.int64],
    hits: NDArray[np.int64],
    person_hits: NDArray[np.int64],
    shape: tuple[int, int],
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Squared distance of each miss to the nearest hit, and whether that one is a person's."""
    to_obstacle = _nearest_squared(misses, hits, shape)
    to_person = _nearest_squared(misses, person_hits, shape)
    from_person = (to_person != NO_HIT) & ((to_obstacle == NO_HIT) | (to_person < to_obstacle))
    return np.where(from_person, to_person, to_obstacle), from_person


def _nearest_squared(
    misses: NDArray[np.int64], hits: NDArray[np.int64], shape: tuple[int, int]
) -> NDArray[np.int64]:
    from swardmap.kernels import metrics as kernel

    squared = np.full(len(misses), NO_HIT, np.int64)
    if len(misses) == 0 or len(hits) == 0:
        return squared
    if len(misses) * len(hits) <= PAIRS_BY_BRUTE_FORCE and max(shape) <= WIDEST:
        kernel.nearest_squared(misses, hits, shape[1], squared)
        return squared
    return _squared_by_transform(misses, hits, shape)


def _squared_by_transform(
    misses: NDArray[np.int64], hits: NDArray[np.int64], shape: tuple[int, int]
) -> NDArray[np.int64]:
    """The same by an exact distance transform; the nearest cell is found, its distance stays an integer."""
    from scipy.ndimage import distance_transform_edt

    away = np.ones(shape, np.bool_)
    away.ravel()[hits] = False
    nearest = distance_transform_edt(away, return_distances=False, return_indices=True)
    iy, ix = np.divmod(misses, shape[1])
    dy, dx = (nearest[axis, iy, ix].astype(np.int64) - own for axis, own in ((0, iy), (1, ix)))
    squared: NDArray[np.int64] = dx * dx + dy * dy
    return squared


def _missed_obstacles(
    truth: NDArray[np.uint8],
    called: NDArray[np.uint8],
    hazards: NDArray[np.int64],
    component: NDArray[np.int32],
    group_hits: NDArray[np.int64],
    width: int,
) -> tuple[MissedObstacle, ...]:
    missed = np.flatnonzero(group_hits == 0)
    if len(missed) == 0:
        return ()
    inside = group_hits[component] == 0
    cells, group = hazards[inside], np.searchsorted(missed, component[inside])
    sizes = np.bincount(group, minlength=len(missed))
    free = np.bincount(group[called[cells] == MapClass.GRASS], minlength=len(missed))
    persons = np.bincount(group[truth[cells] == MapClass.PERSON], minlength=len(missed))
    x = np.bincount(group, cells % width, len(missed)) / sizes + 0.5
    y = np.bincount(group, cells // width, len(missed)) / sizes + 0.5
    return tuple(
        MissedObstacle(int(n), int(f), bool(p), (float(cx), float(cy)))
        for n, f, p, cx, cy in zip(sizes, free, persons, x, y, strict=True)
    )
