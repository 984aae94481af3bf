"""Which cells of a grid triangles stand on or hang over, as arrays: clipping, overlap, inside or outside."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec
from swardmap.synth.model import Float64Array

BoolArray = NDArray[np.bool_]

PAIRS_AT_ONCE = 2_000_000
TOUCH_CELLS = 1e-4
"""Overlap up to this share of a cell is a touch: vertices are float32, and walls stand on borders."""
EDGES = ((0, 1), (1, 2), (2, 0))


def clipped(
    corners: Float64Array, height: Float64Array, low_m: float, high_m: float
) -> tuple[Float64Array, BoolArray]:
    """Triangles cut to a slab of heights: the ends of their cut edges, whose hull is the cut triangle.

    Returns:
        (m, 7, 2): six points on the ground plane and the direction of the level lines; and which are left.
    """
    m = len(corners)
    points = np.full((m, 7, 2), np.nan)
    for k, (i, j) in enumerate(EDGES):
        a, b = corners[:, i, :2], corners[:, j, :2]
        ha, hb = height[:, i], height[:, j]
        rise = hb - ha
        with np.errstate(divide="ignore", invalid="ignore"):
            t_low, t_high = (low_m - ha) / rise, (high_m - ha) / rise
        level = np.abs(rise) < 1e-12
        within = (ha >= low_m) & (ha <= high_m)
        t0 = np.where(level, 0, np.clip(np.fmin(t_low, t_high), 0, 1))
        t1 = np.where(level, 1, np.clip(np.fmax(t_low, t_high), 0, 1))
        there = np.where(level, within, (np.maximum(ha, hb) >= low_m) & (np.minimum(ha, hb) <= high_m))
        for end, t in enumerate((t0, t1)):
            points[there, 2 * k + end] = (a + t[:, None] * (b - a))[there]
    left = ~np.isnan(points[:, :6, 0]).all(axis=1)
    first = np.argmax(~np.isnan(points[:, :6, 0]), axis=1)
    filler = points[np.arange(m), first]
    points[:, :6] = np.where(np.isnan(points[:, :6]), filler[:, None], points[:, :6])
    points[:, 6] = _level_direction(corners, height)
    return points, left


def _level_direction(corners: Float64Array, height: Float64Array) -> Float64Array:
    """(m, 2) a vector on the ground along which a triangle's height does not change; 0 where all is level."""
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    rise_b, rise_c = height[:, 1] - height[:, 0], height[:, 2] - height[:, 0]
    along: Float64Array = ab[:, :2] * rise_c[:, None] - ac[:, :2] * rise_b[:, None]
    return along


def to_cells(xy: Float64Array, spec: GridSpec) -> Float64Array:
    """Points (m, k, 2) in units of cells; a seventh row is a direction and only scaled."""
    cells = (xy - np.asarray(spec.origin_m)) / spec.resolution_m
    if xy.shape[1] == 7:
        cells[:, 6] = xy[:, 6]
    return np.asarray(cells)


def touch(touched: BoolArray, cut: Float64Array) -> None:
    """Mark the cells whose inside the hulls of six points meet (separating axes; a touch is none)."""
    if not len(cut):
        return
    hull, level = cut[:, :6], cut[:, 6]
    first, last = _cell_range(hull.min(axis=1), hull.max(axis=1), touched.shape)
    single = (first == last).all(axis=1)
    touched[first[single, 1], first[single, 0]] = True
    many = np.nonzero(~single & (last >= first).all(axis=1))[0]
    directions = np.stack([hull[:, 2 * k + 1] - hull[:, 2 * k] for k in range(3)] + [level], axis=1)
    for which, ix, iy in _pairs(first[many], last[many]):
        index = many[which]
        meets = np.ones(len(index), bool)
        for k in range(4):
            normal = directions[index, k][:, ::-1] * [-1.0, 1.0]
            length = np.linalg.norm(normal, axis=1)
            normal = normal / np.maximum(length, 1e-12)[:, None]
            along = np.einsum("nkd,nd->nk", hull[index], normal)
            centre = (ix + 0.5) * normal[:, 0] + (iy + 0.5) * normal[:, 1]
            reach = np.abs(normal).sum(axis=1) / 2 - TOUCH_CELLS
            apart = (along.min(axis=1) >= centre + reach) | (along.max(axis=1) <= centre - reach)
            meets &= ~apart | (length < 1e-9)
        touched[iy[meets], ix[meets]] = True


def _cell_range(
    low: Float64Array, high: Float64Array, shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last cell, x and y, whose inside a box meets; last < first where there is none."""
    limit = np.array(shape[::-1]) - 1
    first = np.floor(low + TOUCH_CELLS).astype(np.int64)
    last = np.ceil(high - TOUCH_CELLS).astype(np.int64) - 1
    flat = last < first  # on a border between cells, of hardly any extent
    outside = (last < 0) | (first > limit) | flat
    first, last = np.clip(first, 0, limit), np.clip(last, 0, limit)
    return first, np.where(outside.any(axis=1, keepdims=True), first - 1, last)


def _pairs(
    first: NDArray[np.int64], last: NDArray[np.int64]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]]:
    """Every cell of every range, some millions at a time: index of the range, ix, iy."""
    size = last - first + 1
    count = size[:, 0] * size[:, 1]
    begin = 0
    while begin < len(count):
        ends = np.cumsum(count[begin:])
        stop = begin + max(1, int(np.searchsorted(ends, PAIRS_AT_ONCE, "right")))
        which = np.repeat(np.arange(begin, stop), count[begin:stop])
        starts = np.concatenate(([0], np.cumsum(count[begin:stop])[:-1]))
        at = np.arange(len(which)) - np.repeat(starts, count[begin:stop])
        width = size[which, 0]
        yield which, first[which, 0] + at % width, first[which, 1] + at // width
        begin = stop


def cross(inside: NDArray[np.int32], xy: Float64Array, height: Float64Array, low_m: float) -> None:
    """Add +1 to each centre under an upward triangle that lies above the ground there, -1 under a downward.

    The sum is positive inside a closed surface whose faces look outward.
    """
    limit = np.array(inside.shape[::-1]) - 1
    first = np.maximum(np.ceil(xy.min(axis=1) - 0.5), 0).astype(np.int64)
    last = np.minimum(np.floor(xy.max(axis=1) - 0.5), limit).astype(np.int64)
    some = np.nonzero((last >= first).all(axis=1) & (height.max(axis=1) > low_m))[0]
    for which, ix, iy in _pairs(first[some], last[some]):
        a, b, c = (xy[some[which], k] for k in range(3))
        centre = np.stack((ix + 0.5, iy + 0.5), axis=1)
        wa, wb = _cross_2d(b - centre, c - centre), _cross_2d(c - centre, a - centre)
        wc, area = _cross_2d(a - centre, b - centre), _cross_2d(b - a, c - a)
        sign = np.sign(area)
        # an edge that two triangles share belongs to one of them: >= on one side, > on the other
        hit = np.ones(len(which), bool)
        for w, p, q in ((wa, b, c), (wb, c, a), (wc, a, b)):
            d = (q - p) * sign[:, None]
            owns = (d[:, 1] < 0) | ((d[:, 1] == 0) & (d[:, 0] > 0))
            hit &= (w * sign > 0) | ((w == 0) & owns)
        hit &= area != 0
        with np.errstate(divide="ignore", invalid="ignore"):
            h = height[some[which]]
            z = (wa * h[:, 0] + wb * h[:, 1] + wc * h[:, 2]) / area
        hit &= z > low_m
        np.add.at(inside, (iy[hit], ix[hit]), sign[hit].astype(np.int32))


def _cross_2d(a: Float64Array, b: Float64Array) -> Float64Array:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
