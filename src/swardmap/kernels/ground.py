"""The ground of one frame, compiled (twin: swardmap.perception.ground_surface.fit_ground).

Float64 in the order of operations of the twin.
"""

import numpy as np

from swardmap.kernels.blocks import by_block, envelope, low_of_each, without_dents
from swardmap.kernels.compiled import compiled
from swardmap.kernels.constants import FEWEST_CELLS, LANES, LOW_SHARE, LOWEST_PART_M, PER_METRE, STEP_CELLS
from swardmap.kernels.ground_heights import surface
from swardmap.kernels.robust_plane import fill_up, robust_plane

TENTHS = np.float64(PER_METRE)


@compiled()
def _take_cells(  # type: ignore[no-untyped-def]
    sums, width, side, blocks_wide, mid, resolution_m, first, column, block, starts, mean, points
):
    """The cells that were seen, in order; first[iy] is the first of a row. Returns their number."""
    n = 0
    starts[:] = 0
    for iy in range(first.shape[0] - 1):
        first[iy] = n
        y = (iy + 0.5) * resolution_m - mid[1]
        row_of_blocks = (iy // side) * blocks_wide
        for ix in range(width):
            i = iy * width + ix
            seen = sums[i, 1]
            if seen > 0:
                m = sums[i, 0] / (seen * TENTHS)
                low = sums[i, 2] / TENTHS + LOWEST_PART_M
                column[n], block[n] = ix, row_of_blocks + ix // side
                starts[block[n] + 1] += 1
                mean[n] = m
                points[0, n], points[1, n] = (ix + 0.5) * resolution_m - mid[0], y
                points[2, n] = min(m, low)
                n += 1
    first[-1] = n
    return n


@compiled()
def _plane_of_lows(points, chosen, plane, near_m):  # type: ignore[no-untyped-def]
    """The plane through the lows of the blocks, from level."""
    lows = np.empty((3, chosen.shape[0] + LANES))
    n = 0
    for i in chosen:
        if i >= 0:
            lows[0, n], lows[1, n], lows[2, n] = points[0, i], points[1, i], points[2, i]
            n += 1
    plane[0], plane[1], plane[2] = 0.0, 0.0, np.sort(lows[2, :n])[np.int64(LOW_SHARE * (n - 1))]
    fill_up(lows, n)
    robust_plane(lows, n, plane, near_m)


@compiled()
def fit(  # type: ignore[no-untyped-def]
    sums, width, height, resolution_m, side, steepest, bend, near_m, plane, offset_m, floor_m
):
    """The ground under the cells that were seen.

    Args:
        sums: (cells, 3) int64 sum of heights in 0.1 mm, points, and lowest height of each cell.
        width: of the grid in cells.
        height: of the grid in cells.
        resolution_m: edge of a cell.
        side: of a block in cells.
        steepest: slope (tangent) that is no ground any more.
        bend: how much steeper the ground may get from block to block.
        near_m: (rounds,) how near to the plane counts; the last two are those of all cells.
        plane: (3,) float64, written here: a, b, c of z = a x + b y + c.
        offset_m: (cells,) float32, written here: height of the ground over the plane; NaN where not seen.
        floor_m: (cells,) float32, written here: the same, lower beside a step down.

    Returns:
        Whether there is one.
    """
    full = width * height + LANES
    first = np.empty(height + 1, np.int64)
    column, block, order = np.empty(full, np.int32), np.empty(full, np.int32), np.empty(full, np.int32)
    mean, points = np.empty(full), np.empty((3, full))
    heights = points[2]
    high, wide = (height - 1) // side + 1, (width - 1) // side + 1
    mid = (0.5 * width * resolution_m, 0.5 * height * resolution_m)
    starts, chosen = np.empty(high * wide + 1, np.int64), np.empty(high * wide, np.int64)
    n = _take_cells(sums, width, side, wide, mid, resolution_m, first, column, block, starts, mean, points)
    if n < FEWEST_CELLS:
        return False
    level_of, levels = np.empty(n, np.int32), np.empty(full, np.int32)
    by_block(block, n, starts, order)
    low_of_each(heights, starts, order, level_of, levels, chosen)
    _plane_of_lows(points, chosen, plane, near_m)
    fill_up(points, n)
    robust_plane(points, n, plane, near_m[-2:])
    plane[2] -= plane[0] * mid[0] + plane[1] * mid[1]
    if plane[0] * plane[0] + plane[1] * plane[1] > steepest * steepest:
        return False

    for iy in range(height):
        y = (iy + 0.5) * resolution_m
        for k in range(first[iy], first[iy + 1]):
            x = (column[k] + 0.5) * resolution_m
            heights[k] -= plane[0] * x + plane[1] * y + plane[2]
    low_of_each(heights, starts, order, level_of, levels, chosen)
    lows, lifted, low = np.empty((high, wide)), np.empty((high, wide)), np.empty((high + 2, wide + 2))
    for b in range(high * wide):
        lows[b // wide, b % wide] = heights[chosen[b]] if chosen[b] >= 0 else np.nan
    without_dents(lows, lifted)
    rise_m = bend * side * resolution_m
    envelope(lifted, rise_m, rise_m * np.sqrt(2.0), low)
    known = np.empty((high, wide))
    for i in range(high):
        for j in range(wide):
            seen = lows[i, j] == lows[i, j]
            known[i, j] = 1.0 if seen else 0.0
            lows[i, j] = low[i + 1, j + 1] if seen else 0.0
    allowance_m = bend * STEP_CELLS * resolution_m
    surface(
        first, column, mean, known, lows, side, resolution_m, plane, allowance_m, offset_m, floor_m
    )  # fmt: skip
    return True
