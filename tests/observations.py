"""Observations made by hand, for tests of what takes them in."""

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec
from swardmap.perception.observation import Observation, PixelCounts

NO_PIXELS = PixelCounts(*(0,) * 9)


def observation(
    spec: GridSpec,
    classes: NDArray[np.uint8],
    points: NDArray[np.uint32] | None = None,
    viewpoint_m: tuple[float, float, float] = (0.0, 0.0, 1.0),
    stamp_ns: int = 0,
) -> Observation:
    """One frame that says these classes of the cells of a grid."""
    points = np.zeros((*spec.shape, 4), np.uint32) if points is None else points
    return Observation(spec, classes, points, viewpoint_m, stamp_ns, NO_PIXELS, classes)
