"""Labels of a frame from the drive: what the robot drove over is grass, what rises is not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec, overlap
from swardmap.labels import GRASS, OTHER, PERSON, VOID_ID, MapClass
from swardmap.teach.plan import LabelConfig
from swardmap.teach.views import Bools, Heights
from swardmap.types import Segmentation

EDGE_PIXELS = 5
"""Edge of the square around what rises in which no pixel is grass: colour and depth are not quite aligned."""
SETTLED, BESIDE, UNSEEN = 0, 254, 255
MOST_IN_CELL = 253
"""See `FrameLabels.open_ground`."""


@dataclass(frozen=True, slots=True, eq=False)
class DrivenGround:
    """What the drive says of the cells of the map.

    Attributes:
        spec: the grid.
        driven: (height, width) bool, and not doubtful.
        nothing: (height, width) bool: left out, outside the work area or doubtful; no ground is learnt there.
        silent: (height, width) bool: left out; nor is what stands there.
        stands: (height, width) bool: something stands there in most views.
        least_other: P(obstacle or person) above which the network's "no grass" about flat ground counts:
            what it says as surely of ground that the robot drove over is no evidence (see `least_other_of`).
    """

    spec: GridSpec
    driven: Bools
    nothing: Bools
    silent: Bools
    stands: Bools
    least_other: float


@dataclass(frozen=True, slots=True, eq=False)
class FrameLabels:
    """Labels of one frame, in the ids of `GRASS_OBSTACLE_PERSON`, void where nothing is known.

    Attributes:
        sure: (H, W) uint8 by the drive.
        said: (H, W) uint8 the network's word where it counts and the drive says nothing.
        open_ground: (H, W) uint8 where a network's word may count: SETTLED = nowhere; on flat ground the
            number of such pixels in the cell, at most MOST_IN_CELL; BESIDE what stands its "no grass"
            alone; UNSEEN by the depth that and "person".
    """

    sure: NDArray[np.uint8]
    said: NDArray[np.uint8]
    open_ground: NDArray[np.uint8]


def label_frame(
    heights: Heights, segmentation: Segmentation, ground: DrivenGround, limits: LabelConfig
) -> FrameLabels:
    """Label the pixels of a frame.

    Grass: on the ground, near, in a cell that the robot drove over, nothing raised beside it; so only what
    the camera sees, never through an obstacle. Raised: person where the network is sure of one,
    else other; between ground and raised nothing. In a hole: other. A person is never grass.

    Args:
        heights: of the frame.
        segmentation: of the frame, at its size.
        ground: what the drive says.
        limits: see there.
    """
    driven = _of_cells(ground.driven, ground.spec, heights)
    nothing = _of_cells(ground.nothing, ground.spec, heights)
    limit_m = np.where(driven, np.float32(limits.raised_driven_m), np.float32(limits.raised_m))
    raised, flat = heights.raised(limit_m), heights.flat(limits)
    person = segmentation.map_classes == MapClass.PERSON
    likely = _as_sure(segmentation, limits.person)
    beside = _grown(raised | person, EDGE_PIXELS) | _beside(raised, heights, limits.beside_m)
    hole = heights.height_m < -np.hypot(np.float32(limits.hole_m), heights.noise_m)

    labels = np.full(flat.shape, VOID_ID, np.uint8)
    labels[flat & driven & ~nothing & ~beside] = GRASS.id
    labels[raised | hole] = OTHER.id
    labels[raised & person] = np.where(likely, PERSON.id, VOID_ID)[raised & person]
    labels[_of_cells(ground.silent, ground.spec, heights)] = VOID_ID

    quiet = (labels == VOID_ID) & ~nothing & ~driven & ~raised
    open_ground = np.full(flat.shape, SETTLED, np.uint8)
    open_ground[quiet & np.isnan(heights.height_m)] = UNSEEN
    open_ground[quiet & flat] = BESIDE
    stands = raised | _of_cells(ground.stands, ground.spec, heights)
    free = quiet & flat & ~beside & ~_beside(stands, heights, limits.open_beside_m)
    open_ground[free] = in_cells(free, heights.cells)[free]
    return FrameLabels(labels, said_of(open_ground, segmentation, limits, ground.least_other), open_ground)


def said_of(
    open_ground: NDArray[np.uint8], segmentation: Segmentation, limits: LabelConfig, least_other: float
) -> NDArray[np.uint8]:
    """A network's word where it counts.

    Args:
        open_ground: (H, W) where, see `FrameLabels`.
        segmentation: what it says, at that size.
        limits: how sure it must be.
        least_other: P(obstacle or person) above which "no grass" counts; infinite = nowhere.

    Returns:
        (H, W) uint8 ids, void where it does not count.
    """
    classes, sure = segmentation.map_classes, _as_sure(segmentation, limits.sure)
    person = classes == MapClass.PERSON
    flat = (open_ground != SETTLED) & (open_ground <= MOST_IN_CELL)
    said = np.full(open_ground.shape, VOID_ID, np.uint8)
    said[flat & sure & (classes == MapClass.GRASS) & ~_grown(person, EDGE_PIXELS)] = GRASS.id
    other = sure & (classes == MapClass.OBSTACLE) & (segmentation.hazard_255 > 255 * least_other)
    said[(open_ground != SETTLED) & other] = OTHER.id
    said[(open_ground == UNSEEN) & sure & person] = PERSON.id
    return said


def _as_sure(segmentation: Segmentation, least: float) -> Bools:
    """(H, W) bool: pixels of which a network is so sure; all of one that does not say."""
    confidence = segmentation.confidence
    return np.ones(segmentation.labels.shape, np.bool_) if confidence is None else confidence >= least


def in_cells(chosen: Bools, cells: NDArray[np.integer]) -> NDArray[np.uint8]:
    """(H, W) how many of the chosen pixels the cell of each of them has, at most MOST_IN_CELL."""
    counts = np.bincount(cells[chosen], minlength=1)
    found = np.zeros(chosen.shape, np.uint8)
    found[chosen] = np.minimum(counts[cells[chosen]], MOST_IN_CELL)
    return found


def _of_cells(cells: Bools, spec: GridSpec, heights: Heights) -> Bools:
    """(H, W) bool: pixels in cells of the map that are chosen."""
    local = np.zeros(heights.spec.shape, np.bool_)
    own, there = overlap(heights.spec, spec)
    local[own] = cells[there]
    known = heights.cells >= 0
    return known & local.ravel()[np.where(known, heights.cells, 0)]


def _beside(raised: Bools, heights: Heights, reach_m: float) -> Bools:
    """(H, W) bool: pixels in cells near to one with something raised in view: the foot of what stands."""
    import cv2

    cells = np.zeros(heights.spec.shape, np.uint8)
    cells.ravel()[heights.cells[raised & (heights.cells >= 0)]] = 1
    reach = 1 + 2 * round(reach_m / heights.spec.resolution_m)
    near = cv2.dilate(cells, np.ones((reach, reach), np.uint8)) > 0
    known = heights.cells >= 0
    return np.asarray(known & near.ravel()[np.where(known, heights.cells, 0)])


def _grown(chosen: Bools, edge: int) -> Bools:
    import cv2

    return np.asarray(cv2.dilate(chosen.astype(np.uint8), np.ones((edge, edge), np.uint8)) > 0)
