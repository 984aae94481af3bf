"""Physical things in the truth of a frame: what a safety engineer counts, in place of cells.

A thing rises at least 5 cm above the ground and shows at least 25 pixels within 5 m. Where the data has no
ids of things, connected cells of the reference stand for them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.eval.tally import RANGE_BANDS_M
from swardmap.eval.truth import TruePixels
from swardmap.grid import GridSpec
from swardmap.io.sources.truth import FIRST_AREA, FrameTruth
from swardmap.labels import MapClass
from swardmap.perception.cloud import consistent_depth
from swardmap.types import Frame

NEAR_M = 5.0
"""Things are judged within this distance of the camera."""
LOWEST_M = 0.05
"""What rises less is ground."""
FEWEST_PIXELS = 25
FEWEST_CELLS, FEWEST_POINTS, NEIGHBOURS = 4, 3, 3
"""Of a connected component: cells, points a cell, consistent neighbours a pixel."""
HEIGHTS_M = {"5-20 cm": 0.20, "20-50 cm": 0.50, "over 50 cm": np.inf}
"""Height classes and their upper ends; persons are a class of their own."""
PERSON = "person"
HEIGHT_CLASSES = (*HEIGHTS_M, PERSON)
UNKNOWN_KIND = "unknown"


@dataclass(frozen=True, slots=True, eq=False)
class TrueThing:
    """A thing that is there.

    Attributes:
        kind: shrub, test body, ...; `unknown` where nobody says.
        height: see HEIGHT_CLASSES.
        band: index in RANGE_BANDS_M of its nearest pixel.
        cells: (n,) int64 flat cells that its pixels within NEAR_M fall into.
    """

    kind: str
    height: str
    band: int
    cells: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class TrueThings:
    """What stands and lies in a frame.

    Attributes:
        things: within NEAR_M.
        standing: (height, width) bool, cells with a pixel of something at least LOWEST_M high, near or far.
        water: (height, width) bool, the other cells with a pixel of water.
        has_ids: whether the data says which thing each pixel is.
    """

    things: tuple[TrueThing, ...]
    standing: NDArray[np.bool_]
    water: NDArray[np.bool_]
    has_ids: bool


def find_things(
    frame: Frame,
    pixels: TruePixels,
    cells: NDArray[np.int64],
    spec: GridSpec,
    config: Config,
    truth: FrameTruth | None,
    filtered: Frame | None = None,
) -> TrueThings:
    """The things of a frame, by ids where the data has them.

    Args:
        frame: with true labels, and the depth that `pixels` are of.
        pixels: of the same frame.
        cells: `pixels.cells(spec)`.
        spec: the grid.
        config: tolerances of the consistency filter.
        truth: with ids of things, if there are any.
        filtered: the frame as it was filtered before it was aligned, if it was: afterwards flying pixels
            agree with their own copies, and would be things.
    """
    assert frame.labels is not None  # noqa: S101 - narrows the types
    assert frame.label_set is not None  # noqa: S101
    classes = pixels.classes(frame.labels, frame.label_set)
    hazard = pixels.judged & (cells >= 0) & (classes >= MapClass.OBSTACLE)
    if truth is not None and truth.instances is not None:
        return _by_ids(pixels, truth, classes, cells, hazard, spec)
    used = hazard & _consistent(frame, filtered or frame, pixels, config)
    standing = _covered(cells[hazard & (pixels.height_m >= LOWEST_M)], spec)
    things = tuple(_components(pixels, classes, cells, used, spec))
    return TrueThings(things, standing, np.zeros(spec.shape, np.bool_), False)


def _by_ids(
    pixels: TruePixels,
    truth: FrameTruth,
    classes: NDArray[np.uint8],
    cells: NDArray[np.int64],
    hazard: NDArray[np.bool_],
    spec: GridSpec,
) -> TrueThings:
    assert truth.instances is not None  # noqa: S101 - narrows the type
    at = np.flatnonzero(hazard)
    ids, on = truth.instances.ravel()[pixels.index[at]].astype(np.int64), cells[at]
    high = np.zeros(2**16, np.bool_)
    high[[k for k, t in truth.things.items() if k < FIRST_AREA and t.height_m >= LOWEST_M]] = True
    wet = np.zeros(2**16, np.bool_)
    wet[[k for k, t in truth.things.items() if t.kind == "water"]] = True
    is_high = high[ids]
    standing = _covered(on[is_high], spec)
    water = _covered(on[wet[ids]], spec) & ~standing
    ids, at = ids[is_high], at[is_high]
    away_m = pixels.away_m(at)
    near = away_m <= NEAR_M
    ids, at, away_m = ids[near], at[near], away_m[near]
    found = []
    for key, places in _grouped(ids):
        if len(places) < FEWEST_PIXELS:
            continue
        own, known = at[places], truth.things[key]
        person = bool((classes[own] == MapClass.PERSON).any())
        found.append(_thing(known.kind, known.height_m, person, away_m[places], cells[own]))
    return TrueThings(tuple(found), standing, water, True)


def _components(
    pixels: TruePixels,
    classes: NDArray[np.uint8],
    cells: NDArray[np.int64],
    used: NDArray[np.bool_],
    spec: GridSpec,
) -> Iterator[TrueThing]:
    """Connected cells with enough points of obstacles near the camera; what is flat is no thing."""
    from scipy.ndimage import label

    at = np.flatnonzero(used)
    away_m = pixels.away_m(at)
    at, away_m = at[away_m <= NEAR_M], away_m[away_m <= NEAR_M]
    points = np.bincount(cells[at], minlength=spec.width * spec.height).reshape(spec.shape)
    parts, _ = label(points >= FEWEST_POINTS, np.ones((3, 3), np.bool_))
    for part, places in _grouped(parts.ravel()[cells[at]]):
        pixel = at[places]
        own = np.unique(cells[pixel]) if part else cells[:0]
        if len(pixel) < FEWEST_PIXELS or len(own) < FEWEST_CELLS:
            continue
        height_m = float(np.quantile(pixels.height_m[pixel], 0.98))  # a flying pixel is no height
        person = bool((classes[pixel] == MapClass.PERSON).any())
        if person or height_m >= LOWEST_M:
            yield _thing(UNKNOWN_KIND, height_m, person, away_m[places], own)


def _thing(
    kind: str, height_m: float, person: bool, away_m: NDArray[np.float64], cells: NDArray[np.int64]
) -> TrueThing:
    height = PERSON if person else next(n for n, upper in HEIGHTS_M.items() if height_m < upper)
    band = int(np.searchsorted(RANGE_BANDS_M, away_m.min(), side="right")) - 1
    return TrueThing(kind, height, band, np.unique(cells))


def _grouped(keys: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Every key with the places where it is, by rising keys."""
    if len(keys) == 0:  # nothing near, such as a frame without a reading: np.split would give one empty part
        return
    order = np.argsort(keys, kind="stable")
    values, starts = np.unique(keys[order], return_index=True)
    yield from zip(values.tolist(), np.split(order, starts[1:]), strict=True)


def _covered(cells: NDArray[np.int64], spec: GridSpec) -> NDArray[np.bool_]:
    covered = np.zeros(spec.width * spec.height, np.bool_)
    covered[cells] = True
    return covered.reshape(spec.shape)


def _consistent(frame: Frame, filtered: Frame, pixels: TruePixels, config: Config) -> NDArray[np.bool_]:
    """(N,) pixels that the 3-of-8 filter keeps, and that an earlier one has left as they are."""
    cloud = config.cloud
    kept = consistent_depth(filtered.depth_m, NEIGHBOURS, cloud.consistency_relative, cloud.consistency_m)
    keeps: NDArray[np.bool_] = (kept == frame.depth_m).ravel()[pixels.index]  # NaN is equal to nothing
    return keeps
