"""The height of the ground in each cell, looked up between the middles of the blocks, compiled."""

import numpy as np

from swardmap.kernels.compiled import compiled
from swardmap.kernels.constants import STEP_CELLS


@compiled(inline="never")
def _lowest_of_five(line, out):  # type: ignore[no-untyped-def]
    """Lowest of five cells side by side."""
    for u in range(out.shape[0]):
        a = line[u] if line[u] < line[u + 1] else line[u + 1]
        b = line[u + 2] if line[u + 2] < line[u + 3] else line[u + 3]
        a = a if a < b else b
        out[u] = a if a < line[u + 4] else line[u + 4]


@compiled(inline="never")
def _lowest_of_rows(a, b, c, d, e, out):  # type: ignore[no-untyped-def]
    """Lowest of five cells in a column."""
    for u in range(out.shape[0]):
        p = a[u] if a[u] < b[u] else b[u]
        q = c[u] if c[u] < d[u] else d[u]
        p = p if p < q else q
        out[u] = p if p < e[u] else e[u]


@compiled()
def _between_blocks(n_cells, side, n_blocks, before, behind, share):  # type: ignore[no-untyped-def]
    """Blocks before and behind each cell of an axis, and how far it is from the first to the second."""
    for i in range(n_cells):
        at = (i + 0.5) / side - 0.5
        whole = np.int64(np.floor(at))
        before[i], behind[i] = min(max(whole, 0), n_blocks - 1), min(max(whole + 1, 0), n_blocks - 1)
        share[i] = at - whole


@compiled()
def surface(first, column, mean, known, offsets, side, resolution_m, plane, allowance_m, offset_m, floor_m):  # type: ignore[no-untyped-def]  # fmt: skip
    """Heights of the ground over the plane in the cells that were seen, and what a rise is measured from."""
    height, blocks_high, blocks_wide = first.shape[0] - 1, known.shape[0], known.shape[1]
    width = offset_m.shape[0] // height
    i0, i1, fi = np.empty(height, np.int64), np.empty(height, np.int64), np.empty(height)
    j0, j1, fj = np.empty(width, np.int64), np.empty(width, np.int64), np.empty(width)
    _between_blocks(height, side, blocks_high, i0, i1, fi)
    _between_blocks(width, side, blocks_wide, j0, j1, fj)
    ring, line, around = np.full((5, width), np.inf), np.empty(width + 4), np.empty(width)
    offset_m[:] = np.nan
    floor_m[:] = np.nan
    for iy in range(height + STEP_CELLS):
        ahead = ring[iy % 5]
        if iy < height and first[iy] < first[iy + 1]:
            line[:] = np.inf
            y = (iy + 0.5) * resolution_m
            for k in range(first[iy], first[iy + 1]):
                x = (column[k] + 0.5) * resolution_m
                line[column[k] + 2] = mean[k] - (plane[0] * x + plane[1] * y + plane[2])
            _lowest_of_five(line, ahead)
        else:
            ahead[:] = np.inf
        row = iy - STEP_CELLS
        if row < 0 or first[row] == first[row + 1]:
            continue
        _lowest_of_rows(ring[0], ring[1], ring[2], ring[3], ring[4], around)
        a, b, f = i0[row], i1[row], fi[row]
        for k in range(first[row], first[row + 1]):
            ix = column[k]
            c, d, g = j0[ix], j1[ix], fj[ix]
            s00, s01 = (1 - f) * (1 - g) * known[a, c], (1 - f) * g * known[a, d]
            s10, s11 = f * (1 - g) * known[b, c], f * g * known[b, d]
            total = s00 * offsets[a, c] + s01 * offsets[a, d] + s10 * offsets[b, c] + s11 * offsets[b, d]
            own = total / (s00 + s01 + s10 + s11)
            low = around[ix] + allowance_m
            offset_m[row * width + ix] = own
            floor_m[row * width + ix] = min(own, low)
