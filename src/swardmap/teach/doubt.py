"""Driven ground that does not look like the rest of it: a path that was crossed, a terrace, a bed's edge.

Whoever drives also crosses what is no lawn. Geometry cannot tell: paving is as flat. What differs much from
most of the driven ground in colour, or is surely no grass to a network that knows the rest of this lawn, is
taken for doubtful: not learnt from, and shown.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec, overlap
from swardmap.teach.plan import LabelConfig
from swardmap.teach.views import Bools, Float32, Heights
from swardmap.types import Frame, Segmentation

KNOWN_SHARE = 0.6
"""A network that calls so much of the driven ground grass knows this lawn, and may doubt the rest of it."""
SURELY_OTHER = 0.85
"""Mean probability of an obstacle in a cell, from which on such a network's doubt counts."""
DEVIATIONS = 5.0
"""Robust standard deviations of the colour of the driven ground."""
LEAST_DEVIATION = np.array([6.0, 2.5, 2.5], np.float32)
"""Of CIELAB's L, a, b: no lawn is more even than that."""
SMOOTH_CELLS = 5
MOST_SURE = 253.5 / 255
"""Probabilities are kept in 255ths."""
SURER_SHARE = 0.98
"""Of the driven cells, view by view: "no grass" that is surer than about so many of them counts elsewhere."""
LEAST_PART_M2 = 0.15
"""A smaller doubtful part is a leaf or a shadow."""


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """Mean look of the flat ground in each cell of one view.

    Attributes:
        spec: grid around the view.
        sums: (height, width, 5) float32: pixels, L, a, b, P(obstacle or person), all but the first summed.
    """

    spec: GridSpec
    sums: Float32


def looks_of(frame: Frame, heights: Heights, segmentation: Segmentation, limits: LabelConfig) -> Looks:
    """How the flat ground of a frame looks, cell by cell.

    Args:
        frame: colour.
        heights: of the frame.
        segmentation: of the frame, at its size.
        limits: what is flat.
    """
    import cv2

    lab = cv2.cvtColor(frame.rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    flat = heights.flat(limits)
    cells, shape = heights.cells[flat], heights.spec.shape
    hazard = segmentation.hazard_255[flat] / np.float32(255)
    columns = (None, *(lab[..., c][flat] for c in range(3)), hazard)
    n = shape[0] * shape[1]
    sums = [np.bincount(cells, weights=w, minlength=n) for w in columns]
    return Looks(heights.spec, np.stack(sums, axis=-1).reshape(*shape, 5).astype(np.float32))


@dataclass(frozen=True, slots=True, eq=False)
class Doubt:
    """What the driven ground looks like.

    Attributes:
        cells: (height, width) bool, driven and doubtful.
        grass_share: of the driven cells that the network so far calls grass; None where none was seen.
    """

    cells: Bools
    grass_share: float | None


def find_doubt(looks: Sequence[Looks], driven: Bools, spec: GridSpec) -> Doubt:
    """The driven ground that does not look like most of it.

    Args:
        looks: of the frames that are believed.
        driven: (height, width) bool.
        spec: the grid.
    """
    sums = np.zeros((*spec.shape, 5), np.float32)
    for one in looks:
        own, there = overlap(one.spec, spec)
        sums[there] += one.sums[own]
    seen = driven & (sums[..., 0] >= 3)
    if not seen.any():
        return Doubt(np.zeros(spec.shape, np.bool_), None)
    mean = sums[..., 1:] / np.maximum(sums[..., :1], 1)
    smooth = _smoothed(mean.astype(np.float32), seen)
    grass_share = float((mean[..., 3][seen] < 0.5).mean())
    doubtful = seen & _strange(smooth[..., :3], seen)
    if grass_share >= KNOWN_SHARE:
        doubtful |= seen & (smooth[..., 3] > SURELY_OTHER)
    return Doubt(_large_parts(doubtful, spec), grass_share)


def least_other_of(looks: Sequence[Looks], driven: Bools, spec: GridSpec) -> float:
    """P(obstacle or person) above which "no grass" counts: hardly any driven ground is called that as surely.

    A network may know a lawn badly and its paths well: it is far surer of what is none.

    Args:
        looks: of the frames that are believed.
        driven: (height, width) bool, and not doubtful.
        spec: the grid.

    Returns:
        0 where no driven ground was seen; infinite where nothing can be surer.
    """
    found = []
    for one in looks:
        own, there = overlap(one.spec, spec)
        sums = one.sums[own][driven[there]]
        found.append(sums[sums[:, 0] > 0])
    cells = np.concatenate(found) if found else np.zeros((0, 5), np.float32)
    if not len(cells):
        return 0.0
    return surer_than(cells[:, 4] / cells[:, 0])


def surer_than(hazards: NDArray[np.floating]) -> float:
    """P(obstacle or person) that few of these exceed; infinite where that is as sure as can be told.

    >>> surer_than(np.full(100, 0.25, np.float32))
    0.25
    >>> surer_than(np.ones(100, np.float32))
    inf
    """
    limit = float(np.quantile(hazards, SURER_SHARE))
    return limit if limit < MOST_SURE else float("inf")


def _smoothed(mean: Float32, seen: Bools) -> Float32:
    """Means over a few cells around: a blade is not a lawn."""
    import cv2

    size = (SMOOTH_CELLS, SMOOTH_CELLS)
    weight = cv2.blur(seen.astype(np.float32), size)
    total = cv2.blur(np.where(seen[..., None], mean, 0).astype(np.float32), size)
    return np.asarray(total / np.maximum(weight, 1e-6)[..., None], np.float32)


def _strange(lab: Float32, seen: Bools) -> Bools:
    """Cells whose colour is far from that of most; lightness alone may be a shadow and counts half."""
    values = lab[seen]
    middle = np.median(values, axis=0)
    spread = np.maximum(1.4826 * np.median(np.abs(values - middle), axis=0), LEAST_DEVIATION)
    off: NDArray[np.float32] = (lab - middle) / spread
    away = np.sqrt(np.square(off[..., 0] / 2) + np.square(off[..., 1:]).sum(-1))
    return np.asarray(away > DEVIATIONS)


def _large_parts(cells: Bools, spec: GridSpec) -> Bools:
    from scipy.ndimage import label

    parts, count = label(cells, np.ones((3, 3)))
    sizes = np.bincount(parts.ravel(), minlength=count + 1)
    large = sizes * spec.resolution_m**2 >= LEAST_PART_M2
    large[0] = False
    return np.asarray(large[parts], np.bool_)
