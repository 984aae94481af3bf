"""The first pass over the pixels, compiled: cells, and the heights of each (twin: perception.plain.place).

Row by row: branch-free loops write what each pixel is (kernels.depth says why); then the sums are raised.
Float32 in the order of operations of the twin.
"""

import numpy as np

from swardmap.kernels import constants
from swardmap.kernels.compiled import compiled
from swardmap.kernels.constants import FAR_AWAY, PER_METRE
from swardmap.kernels.depth import agreeing_row, depth_row

HIGHEST = np.int64(constants.HIGHEST)
NOT_IN_RANGE = np.int32(constants.NOT_IN_RANGE)
NOT_CONSISTENT = np.int32(constants.NOT_CONSISTENT)
OUTSIDE = np.int32(constants.OUTSIDE)
DROPPED = np.int32(constants.DROPPED)


@compiled(inline="never")
def _place_row(z_row, ray_x, ray_y, T, per_metre, keep, width, height, cell, tenths):  # type: ignore[no-untyped-def]
    """Cell of each pixel of a row, or why it has none, and its height: Eq. 1, the pose, Eq. 2."""
    t00, t01, t02, t03 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    t10, t11, t12, t13 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    t20, t21, t22, t23 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    grid_width, n_x, n_y = np.int32(width), np.float32(width), np.float32(height)
    zero, none = np.float32(0), np.int32(0)
    for u in range(cell.shape[0]):
        z = z_row[u + 1]
        x = z * ray_x[u]
        y = z * ray_y
        gx = (t00 * x + t01 * y + t02 * z + t03) * per_metre
        gy = (t10 * x + t11 * y + t12 * z + t13) * per_metre
        up = t20 * x + t21 * y + t22 * z + t23
        inside = (gx >= zero) & (gy >= zero) & (gx < n_x) & (gy < n_y)
        i = np.int32(
            np.int32(np.int32(gy) * grid_width) + np.int32(gx)
        )  # all of 32 bits: one of 64 widens the rest
        dropped = np.int32(DROPPED - i) if inside else NOT_CONSISTENT
        i = i if inside else OUTSIDE
        i = i if keep[u] > np.uint8(0) else dropped
        i = i if z > zero else NOT_IN_RANGE
        cell[u] = i
        tenths[u] = np.int32(np.floor(up * PER_METRE)) if i >= none else none


@compiled(inline="never")
def _slot_row(cell, nowhere, slots):  # type: ignore[no-untyped-def]
    """Row of the sums that each pixel belongs to: that of its cell, or one behind them for each reason."""
    last = np.int32(nowhere)
    for u in range(cell.shape[0]):
        why = np.int32(last - (cell[u] if cell[u] > DROPPED else NOT_CONSISTENT))
        slots[u] = cell[u] if cell[u] >= np.int32(0) else why


@compiled()
def _raise_height(cell, tenths, u, sums):  # type: ignore[no-untyped-def]
    c, t = np.uint64(cell[u]), np.int64(tenths[u])
    sums[c, 0] += t
    sums[c, 1] += 1
    sums[c, 2] = min(sums[c, 2], t)


@compiled(inline="never")
def _raise_heights(cell, tenths, sums):  # type: ignore[no-untyped-def]
    """Add the heights of a row to those of its cells, from eight places of the row in turn.

    One sum then does not wait for the store of the one before. An unsigned index is not asked for its sign.
    """
    eighth = np.uint64(cell.shape[0] // 8)
    for i in range(eighth):
        _raise_height(cell, tenths, i, sums)
        _raise_height(cell, tenths, i + eighth, sums)
        _raise_height(cell, tenths, i + np.uint64(2) * eighth, sums)
        _raise_height(cell, tenths, i + np.uint64(3) * eighth, sums)
        _raise_height(cell, tenths, i + np.uint64(4) * eighth, sums)
        _raise_height(cell, tenths, i + np.uint64(5) * eighth, sums)
        _raise_height(cell, tenths, i + np.uint64(6) * eighth, sums)
        _raise_height(cell, tenths, i + np.uint64(7) * eighth, sums)
    for u in range(np.uint64(8) * eighth, np.uint64(cell.shape[0])):
        _raise_height(cell, tenths, u, sums)


@compiled()
def place(  # type: ignore[no-untyped-def]
    depth, unit_m, ray_x, ray_y, T, limits, needed, width, height, per_metre, cells, sums
):
    """Cell of every pixel, and the sum of heights and number of points of every cell.

    Args:
        depth: (H, W) uint16 or float32.
        unit_m: float32 metres per unit of depth.
        ray_x: (W,) float32, x of K^-1 [u v 1] (Eq. 1).
        ray_y: (H,) float32, y of the same.
        T: (3, 4) float32 T_grid_camera.
        limits: float32 near, far, relative, absolute (metres).
        needed: neighbours that must agree; 0 = no filter.
        width: of the grid in cells.
        height: of the grid in cells.
        per_metre: float32 cells a metre.
        cells: (H, W) int32, written here: as of `perception.passes.Placed`.
        sums: (width * height + 3, 3) int64, written here: sum of heights in 0.1 mm, points, lowest height;
            behind the cells the points out of range, not consistent, outside.

    Returns:
        Number of pixels with any reading.
    """
    H, W = depth.shape
    near, far, relative, absolute_m = limits
    needed = np.int32(needed)
    for i in range(sums.shape[0]):
        sums[i, 0], sums[i, 1], sums[i, 2] = 0, 0, HIGHEST
    nowhere = width * height - 1
    z_rows = np.full((3, W + 2), FAR_AWAY, np.float32)
    keep = np.ones(W, np.uint8)
    tenths, slots = np.empty(W, np.int32), np.empty(W, np.int32)
    readings, ahead = depth_row(depth[0], unit_m, near, far, z_rows[0])
    for v in range(H):
        above, here, below = z_rows[(v + 2) % 3], z_rows[v % 3], z_rows[(v + 1) % 3]
        in_range = ahead
        if v + 1 < H:
            more, ahead = depth_row(depth[v + 1], unit_m, near, far, below)
            readings += more
        else:
            below[:] = FAR_AWAY
        if in_range == 0:
            cells[v] = NOT_IN_RANGE
            sums[nowhere - NOT_IN_RANGE, 1] += W
            continue
        if needed > 0:
            agreeing_row(above, here, below, relative, absolute_m, needed, keep)
        _place_row(here, ray_x, ray_y[v], T, per_metre, keep, width, height, cells[v], tenths)
        _slot_row(cells[v], nowhere, slots)
        _raise_heights(slots, tenths, sums)
    return readings
