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


@dataclass(frozen=True, slots=True, eq=False)
class DrivenGround:
    """What the drive says of the cells of the map.

    Attributes:
        spec: the grid.
        driven: (height, width) bool, and not doubtful.
        nothing: (height, width) bool: left out, outside the work area or doubtful; no ground is learnt there.
        silent: (height, width) bool: left out; nor is what stands there.
        trust_other: whether the network's "no grass" about flat ground counts: not where it says so of what
            the robot drove over.
    """

    spec: GridSpec
    driven: Bools
    nothing: Bools
    silent: Bools
    trust_other: bool


@dataclass(frozen=True, slots=True, eq=False)
class FrameLabels:
    """Labels of one frame, in the ids of `GRASS_OBSTACLE_PERSON`, void where nothing is known.

    Attributes:
        sure: (H, W) uint8 by the drive.
        said: (H, W) uint8 the network's word where it counts and the drive says nothing.
    """

    sure: NDArray[np.uint8]
    said: NDArray[np.uint8]


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
    classes = segmentation.map_classes
    confidence = segmentation.confidence
    sure = np.ones(flat.shape, np.bool_) if confidence is None else confidence >= limits.sure
    likely = np.ones(flat.shape, np.bool_) if confidence is None else confidence >= limits.person
    person = classes == MapClass.PERSON
    beside = _grown(raised | person, EDGE_PIXELS) | _beside(raised, heights, limits)
    hole = heights.height_m < -np.hypot(np.float32(limits.hole_m), heights.noise_m)

    labels = np.full(flat.shape, VOID_ID, np.uint8)
    labels[flat & driven & ~nothing & ~beside] = GRASS.id
    labels[raised | hole] = OTHER.id
    labels[raised & person] = np.where(likely, PERSON.id, VOID_ID)[raised & person]

    labels[_of_cells(ground.silent, ground.spec, heights)] = VOID_ID

    said = np.full(flat.shape, VOID_ID, np.uint8)
    quiet = (labels == VOID_ID) & ~nothing & ~driven & sure & ~raised
    said[quiet & flat & ~beside & (classes == MapClass.GRASS)] = GRASS.id
    unseen = np.isnan(heights.height_m)
    if ground.trust_other:
        said[quiet & (flat | unseen) & (classes == MapClass.OBSTACLE)] = OTHER.id
    said[quiet & unseen & person] = PERSON.id
    return FrameLabels(labels, said)


def _of_cells(cells: Bools, spec: GridSpec, heights: Heights) -> Bools:
    """(H, W) bool: pixels in cells of the map that are chosen."""
    local = np.zeros(heights.spec.shape, np.bool_)
    own, there = overlap(heights.spec, spec)
    local[own] = cells[there]
    known = heights.cells >= 0
    return known & local.ravel()[np.where(known, heights.cells, 0)]


def _beside(raised: Bools, heights: Heights, limits: LabelConfig) -> Bools:
    """(H, W) bool: pixels in cells near to one with something raised in view: the foot of what stands."""
    import cv2

    cells = np.zeros(heights.spec.shape, np.uint8)
    cells.ravel()[heights.cells[raised & (heights.cells >= 0)]] = 1
    reach = 1 + 2 * round(limits.beside_m / heights.spec.resolution_m)
    near = cv2.dilate(cells, np.ones((reach, reach), np.uint8)) > 0
    known = heights.cells >= 0
    return np.asarray(known & near.ravel()[np.where(known, heights.cells, 0)])


def _grown(chosen: Bools, edge: int) -> Bools:
    import cv2

    return np.asarray(cv2.dilate(chosen.astype(np.uint8), np.ones((edge, edge), np.uint8)) > 0)
