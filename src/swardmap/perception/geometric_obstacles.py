"""What stands above the local ground, and holes in it: marks from depth, beside the network's classes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import GeometryConfig
from swardmap.labels import MapClass
from swardmap.perception.passes import Counted


@dataclass(frozen=True, slots=True, eq=False)
class GeometricMarks:
    """Cells of one frame that depth marks; it never says that a cell is free.

    Attributes:
        marks: (height, width) bool, where something stands or a hole gapes.
        holes: (height, width) bool, the marks with points below the ground.
        doubted: (height, width) bool, the marks for which the network's doubt was needed too.
    """

    marks: NDArray[np.bool_]
    holes: NDArray[np.bool_]
    doubted: NDArray[np.bool_]


ALWAYS_ENOUGH = 1_000_000
"""Points that mark a cell whatever `grid.min_points` is: the geometric rule has counted already."""


def geometric_marks(counted: Counted, config: GeometryConfig) -> GeometricMarks:
    """Cells with enough points above or below the ground, or enough that are a little above it and doubted.

    Args:
        counted: points of a frame by cell.
        config: how many points are enough.
    """
    above, holes, raised = (n >= config.min_points for n in (counted.above, counted.below, counted.raised))
    return GeometricMarks(above | holes | raised, holes, raised & ~(above | holes))


def with_marks(
    points: NDArray[np.uint32], classes: NDArray[np.uint8], marks: NDArray[np.bool_], semantics: bool = True
) -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
    """Points and classes of a frame with its geometric marks: a mark of either is a mark.

    Points on a mark speak for an obstacle, so that no map takes them for grass.

    Args:
        points: (height, width, 4) uint32 points by MapClass.
        classes: (height, width) uint8 MapClass.
        marks: (height, width) bool.
        semantics: whether the network is asked at all; without it nothing is ever free.
    """
    marked = np.where(marks, np.uint8(MapClass.OBSTACLE), np.uint8(MapClass.UNKNOWN))
    told = points.copy() if semantics else np.zeros_like(points)
    hazard = told[marks, MapClass.OBSTACLE] + told[marks, MapClass.GRASS]
    told[marks, MapClass.OBSTACLE] = np.maximum(hazard, ALWAYS_ENOUGH)
    told[marks, MapClass.GRASS] = 0
    return told, np.maximum(classes, marked) if semantics else marked
