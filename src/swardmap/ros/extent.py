"""How far a published map reaches: what was seen, and always the robot.

A planner whose robot stands outside of the map throws ("Robot is out of bounds of the costmap"), and tiles
cover only what was seen: a robot in its own blind zone stands beside them.
"""

import math
from dataclasses import replace

import numpy as np

from swardmap.grid import MAX_CELLS, GridSpec, OccupancyGrid, overlap
from swardmap.labels import MapClass

GROWTH_M = 8.0
"""A map is enlarged in steps, since Nav2 lays its costmap out anew each time."""

DIGITS = 9
"""Of an origin in metres."""

FARTHEST_M = 100.0
"""A robot farther from its map than this is a jump of the pose; the map does not follow."""


def extent_around(
    spec: GridSpec, xy_m: tuple[float, float], radius_m: float, last: GridSpec | None = None
) -> GridSpec:
    """A grid enlarged, on its own lattice, so that a circle lies inside.

    Args:
        spec: of what was seen.
        xy_m: centre of the circle, in the grid's frame.
        radius_m: of the circle.
        last: what was given out before; it stays where it still holds both, so that a map does not change its
            size each time that the robot leaves it and comes back.

    Returns:
        The enlarged grid; `spec` itself where the circle lies inside, or farther away than `FARTHEST_M`, or
        where no grid may be so large.
    """
    reach_m = radius_m + 10.0**-DIGITS  # the origin is rounded below
    low = spec.cell_of(np.asarray(xy_m) - reach_m)
    high = spec.cell_of(np.asarray(xy_m) + reach_m)
    size = np.array([spec.width, spec.height])
    if max(*(-low), *(high - size)) * spec.resolution_m > FARTHEST_M:
        return spec
    if (
        last is not None
        and _holds(last, spec)
        and bool(last.contains(last.cell_of(_corners(xy_m, radius_m))).all())
    ):
        return last
    step = math.ceil(GROWTH_M / spec.resolution_m)
    before = np.where(low < 0, step - low, 0)
    after = np.where(high >= size, high - size + 1 + step, 0)
    width, height = (size + before + after).tolist()
    if width * height > MAX_CELLS:
        return spec
    x, y = (
        round(o - n * spec.resolution_m, DIGITS) for o, n in zip(spec.origin_m, before.tolist(), strict=True)
    )
    return replace(spec, width=width, height=height, origin_m=(x, y)) if (before + after).any() else spec


def enlarged(grid: OccupancyGrid, spec: GridSpec) -> OccupancyGrid:
    """The same map on a grid that holds it; what is new is unknown."""
    if spec == grid.spec:
        return grid
    classes = np.full(spec.shape, MapClass.UNKNOWN, np.uint8)
    here, there = overlap(grid.spec, spec)
    classes[there] = grid.classes[here]
    return OccupancyGrid(spec, classes, grid.stamp_ns)


def _corners(xy_m: tuple[float, float], radius_m: float) -> list[tuple[float, float]]:
    x, y = xy_m
    return [(x - radius_m, y - radius_m), (x + radius_m, y + radius_m)]


def _holds(outer: GridSpec, inner: GridSpec) -> bool:
    """Whether a grid lies in another, on one lattice."""
    if outer.frame_id != inner.frame_id or outer.resolution_m != inner.resolution_m:
        return False
    steps = (np.asarray(inner.origin_m) - np.asarray(outer.origin_m)) / inner.resolution_m
    ix, iy = np.round(steps).tolist()
    aligned = bool(np.allclose(steps, (ix, iy), atol=1e-3))
    inside = ix >= 0 and iy >= 0 and ix + inner.width <= outer.width and iy + inner.height <= outer.height
    return aligned and bool(inside)
