"""The two passes over the pixels of `geometric_obstacles`, compiled (twins: its NumPy functions)."""

import numpy as np

from swardmap.kernels.compiled import compiled
from swardmap.kernels.grid import FAR_AWAY, _agreeing_row, _depth_row

PER_METRE = np.float32(10000)
"""Heights are summed as whole tenths of millimetres: sums in any order are the same to the last digit."""

HIGHEST = np.int64(2**31 - 1)
"""Lowest height of a cell without points."""


@compiled(inline="never")
def _place_row(z_row, ray_x, ray_y, T, per_metre, keep, width, height, cell, tenths):  # type: ignore[no-untyped-def]
    """Cell of each pixel of a row, or -1, and its height; as kernels.grid._index_row does it."""
    t00, t01, t02, t03 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    t10, t11, t12, t13 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    t20, t21, t22, t23 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    grid_width, n_x, n_y = np.int32(width), np.float32(width), np.float32(height)
    zero, none, nowhere = np.float32(0), np.int32(0), np.int32(-1)
    for u in range(cell.shape[0]):
        z = z_row[u + 1]
        x = z * ray_x[u]
        y = z * ray_y
        gx = (t00 * x + t01 * y + t02 * z + t03) * per_metre
        gy = (t10 * x + t11 * y + t12 * z + t13) * per_metre
        up = t20 * x + t21 * y + t22 * z + t23
        inside = (gx >= zero) & (gy >= zero) & (gx < n_x) & (gy < n_y) & (z > zero) & (keep[u] > none)
        cell[u] = np.int32(gy) * grid_width + np.int32(gx) if inside else nowhere
        tenths[u] = np.int32(np.floor(up * PER_METRE)) if inside else none


@compiled()
def sum_heights(  # type: ignore[no-untyped-def]
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
        cells: (H, W) int32, written here: flat index of the cell, -1 = not used.
        sums: (width * height, 3) int64, written here: sum of heights in 0.1 mm, points, lowest height.
    """
    H, W = depth.shape
    near, far, relative, absolute_m = limits
    sums[:, :2] = 0
    sums[:, 2] = HIGHEST
    z_rows = np.full((3, W + 2), FAR_AWAY, np.float32)
    keep = np.ones(W, np.int32)
    tenths = np.empty(W, np.int32)
    _depth_row(depth[0], unit_m, near, far, z_rows[0])
    for v in range(H):
        above, here, below = z_rows[(v + 2) % 3], z_rows[v % 3], z_rows[(v + 1) % 3]
        if v + 1 < H:
            _depth_row(depth[v + 1], unit_m, near, far, below)
        else:
            below[:] = FAR_AWAY
        if needed > 0:
            _agreeing_row(above, here, below, relative, absolute_m, needed, keep)
        row = cells[v]
        _place_row(here, ray_x, ray_y[v], T, per_metre, keep, width, height, row, tenths)
        for u in range(W):
            if row[u] >= 0:
                sums[row[u], 0] += tenths[u]
                sums[row[u], 1] += 1
                sums[row[u], 2] = min(sums[row[u], 2], np.int64(tenths[u]))


@compiled(inline="never")
def _judge_row(depth, unit_m, ray_x, tail, up, limits, cell, floor_m, ground_m, index):  # type: ignore[no-untyped-def]
    """Counter of each pixel of a row: of its cell's points above, or below, or the one for the rest."""
    lowest, highest, hole, noise = limits
    slope, start, zero, rest = up[0], up[3], np.float32(0), np.int32(2 * len(floor_m))
    for u in range(index.shape[0]):
        at = max(cell[u], np.int32(0))
        z = np.float32(depth[u]) * unit_m
        q = slope * ray_x[u] + tail
        over = z * q + start
        doubt = noise * (z * z) * q
        doubt = doubt * doubt
        rise, fall = over - floor_m[at], ground_m[at] - over
        above = (rise > zero) & (rise * rise > lowest * lowest + doubt) & (rise <= highest)
        below = (fall > zero) & (fall * fall > hole * hole + doubt)
        i = np.int32(2) * at
        i = i if above else (i + np.int32(1) if below else rest)
        index[u] = i if cell[u] >= 0 else rest


@compiled()
def count_off_ground(depth, unit_m, ray_x, ray_y, up, limits, cells, floor_m, ground_m, counts):  # type: ignore[no-untyped-def]  # fmt: skip
    """How many points of each cell rise above the ground, and how many lie below it.

    Args:
        depth: (H, W) uint16 or float32.
        unit_m: float32 metres per unit of depth.
        ray_x: (W,) float32, x of K^-1 [u v 1] (Eq. 1).
        ray_y: (H,) float32, y of the same.
        up: (4,) float32, height above the plane = z * (up . ray) + up[3].
        limits: float32 lowest and highest rise, depth of a hole, sigmas times noise at 1 m.
        cells: (H, W) int32 as `sum_heights` writes it.
        floor_m: (cells,) float32 height over the plane that a rise is measured from; NaN = not known.
        ground_m: (cells,) float32 the same for holes.
        counts: (2 * cells + 1,) uint32, written here: for each cell points above, points below; the rest.
    """
    counts[:] = 0
    index = np.empty(depth.shape[1], np.int32)
    rest = np.int32(2 * len(floor_m))
    for v in range(depth.shape[0]):
        tail = up[1] * ray_y[v] + up[2]
        _judge_row(depth[v], unit_m, ray_x, tail, up, limits, cells[v], floor_m, ground_m, index)
        for u in range(index.shape[0]):
            if index[u] != rest:
                counts[index[u]] += np.uint32(1)
