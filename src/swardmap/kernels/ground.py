"""The ground of one frame, compiled (twin: swardmap.perception.ground_surface.fit_ground).

Float64 in the order of operations of the twin. Sums run in LANES lanes, so that they vectorise in both.
"""

import numpy as np

from swardmap.kernels.compiled import compiled
from swardmap.kernels.passes import PER_METRE

LANES = 64
CHUNK = 32
SUMS = 9
FAR_OFF = 1e30
"""Height of what fills up the last lanes: it weighs nothing."""

LOW_SHARE, LOWEST_PART_M, STEP_CELLS, DENT_M, FEWEST_CELLS = 0.3, 0.05, 2, 0.05, 12
TENTHS = np.float64(PER_METRE)


@compiled()
def _take_cells(  # type: ignore[no-untyped-def]
    sums, width, side, blocks_wide, mid, resolution_m, first, column, block, mean, height, dx, dy
):
    """The cells that were seen, in order; first[iy] is the first of a row. Returns their number."""
    n = 0
    for iy in range(first.shape[0] - 1):
        first[iy] = n
        y = (iy + 0.5) * resolution_m - mid[1]
        row_of_blocks = (iy // side) * blocks_wide
        for ix in range(width):
            i = iy * width + ix
            points = sums[i, 1]
            if points > 0:
                m = sums[i, 0] / (points * TENTHS)
                low = sums[i, 2] / TENTHS + LOWEST_PART_M
                column[n], block[n] = ix, row_of_blocks + ix // side
                mean[n], height[n] = m, min(m, low)
                dx[n], dy[n] = (ix + 0.5) * resolution_m - mid[0], y
                n += 1
    first[-1] = n
    return n


@compiled()
def _by_block(block, n, starts, order):  # type: ignore[no-untyped-def]
    """Indices of the cells block by block, in each in their order; starts[b] is the first of a block."""
    starts[:] = 0
    for i in range(n):
        starts[block[i] + 1] += 1
    for b in range(starts.shape[0] - 1):
        starts[b + 1] += starts[b]
    at = starts[:-1].copy()
    for i in range(n):
        order[at[block[i]]] = i
        at[block[i]] += 1


@compiled(inline="never")
def _up_to(levels, chunks, level):  # type: ignore[no-untyped-def]
    """How many levels of so many whole chunks are no higher."""
    n = np.int32(0)
    for i in range(chunks * CHUNK):
        n += np.int32(levels[i] <= level)
    return n


@compiled()
def _take_levels(height, order, start, stop, levels):  # type: ignore[no-untyped-def]
    """Heights of one block as levels of 0.1 mm, filled up to whole chunks; lowest, highest."""
    low, high = np.int32(2**31 - 1), np.int32(0)
    for k in range(start, stop):
        level = np.int32(min(max((height[order[k]] + 1000.0) * 10000.0, 0.0), 2147483647.0))
        levels[k - start] = level
        low, high = min(low, level), max(high, level)
    for k in range(stop - start, (stop - start + CHUNK - 1) // CHUNK * CHUNK):
        levels[k] = np.int32(2**31 - 1)
    return low, high


@compiled()
def _low_of_each(height, starts, order, levels, chosen):  # type: ignore[no-untyped-def]
    """chosen[b] = cell at the low quantile of a block's heights, the first among equals; -1 = none seen."""
    for b in range(chosen.shape[0]):
        start, stop = starts[b], starts[b + 1]
        chosen[b] = -1
        if start == stop:
            continue
        rank, chunks = np.int64(LOW_SHARE * (stop - start - 1)), (stop - start + CHUNK - 1) // CHUNK
        lowest, highest = _take_levels(height, order, start, stop, levels)
        low, high = np.int64(lowest), np.int64(highest)
        while low < high:
            middle = (low + high) // 2
            if _up_to(levels, chunks, np.int32(middle)) > rank:
                high = middle
            else:
                low = middle + 1
        left = rank - (_up_to(levels, chunks, np.int32(low - 1)) if low > lowest else 0)
        for k in range(stop - start):
            if levels[k] == low:
                if left == 0:
                    chosen[b] = order[start + k]
                    break
                left -= 1


@compiled(inline="never")
def _sum_round(dx, dy, z, at, a, b, c, near, lanes):  # type: ignore[no-untyped-def]
    """Add the weighted sums of LANES points to `lanes`: Tukey's biweight, and the normal equations."""
    for i in range(LANES):
        x, y = dx[at + i], dy[at + i]
        off = z[at + i] - (a * x + b * y + c)
        t = off * near
        w = 1.0 - t * t
        w = w if w > 0.0 else 0.0
        w = w * w
        wx, wy, wo = w * x, w * y, w * off
        lanes[i] += wx * x
        lanes[LANES + i] += wx * y
        lanes[2 * LANES + i] += wy * y
        lanes[3 * LANES + i] += wx
        lanes[4 * LANES + i] += wy
        lanes[5 * LANES + i] += w
        lanes[6 * LANES + i] += wo * x
        lanes[7 * LANES + i] += wo * y
        lanes[8 * LANES + i] += wo


@compiled()
def _robust_plane(dx, dy, z, n, plane, near_m):  # type: ignore[no-untyped-def]
    """Plane through most points, round by round; arrays filled up to whole lanes."""
    lanes, s = np.empty(SUMS * LANES), np.empty(SUMS)
    for r in range(near_m.shape[0]):
        lanes[:] = 0.0
        for at in range(0, n, LANES):
            _sum_round(dx, dy, z, at, plane[0], plane[1], plane[2], 1.0 / (3.0 * near_m[r]), lanes)
        for k in range(SUMS):
            total = 0.0
            for i in range(LANES):
                total += lanes[k * LANES + i]
            s[k] = total
        ridge = 1e-6 * n
        xx, xy, yy, wx, wy, w = s[0] + ridge, s[1], s[2] + ridge, s[3], s[4], s[5] + ridge
        l1, l2 = xy / xx, wx / xx
        yy2, wy2 = yy - l1 * xy, wy - l1 * wx
        l3 = wy2 / yy2
        right2 = s[7] - l1 * s[6]
        up = (s[8] - l2 * s[6] - l3 * right2) / (w - l2 * wx - l3 * wy2)
        along = (right2 - wy2 * up) / yy2
        plane[0] += (s[6] - xy * along - wx * up) / xx
        plane[1] += along
        plane[2] += up


@compiled()
def _fill_up(dx, dy, z, n):  # type: ignore[no-untyped-def]
    for i in range(n, (n + LANES - 1) // LANES * LANES):
        dx[i], dy[i], z[i] = 0.0, 0.0, FAR_OFF


@compiled()
def _plane_of_lows(dx, dy, height, chosen, plane, near_m):  # type: ignore[no-untyped-def]
    """The plane through the lows of the blocks, from level."""
    full = chosen.shape[0] + LANES
    x, y, z = np.empty(full), np.empty(full), np.empty(full)
    n = 0
    for i in chosen:
        if i >= 0:
            x[n], y[n], z[n] = dx[i], dy[i], height[i]
            n += 1
    plane[0], plane[1], plane[2] = 0.0, 0.0, np.sort(z[:n])[np.int64(LOW_SHARE * (n - 1))]
    _fill_up(x, y, z, n)
    _robust_plane(x, y, z, n, plane, near_m)


@compiled()
def _without_dents(lows, out):  # type: ignore[no-untyped-def]
    """Blocks that lie below the median of those around them are lifted to it: a hole is no ground."""
    h, w = lows.shape
    around = np.empty(25)
    for i in range(h):
        for j in range(w):
            low = lows[i, j]
            out[i, j] = low
            if np.isnan(low):
                continue
            known, higher = 0, 0
            for a in range(max(i - 2, 0), min(i + 3, h)):
                for b in range(max(j - 2, 0), min(j + 3, w)):
                    value = lows[a, b]
                    if value == value:  # not NaN
                        around[known] = value
                        known += 1
                        higher += value - DENT_M > low
            if known >= 4 and higher >= known - (known - 1) // 2:  # so is the median
                out[i, j] = np.sort(around[:known])[(known - 1) // 2] - DENT_M


@compiled()
def _envelope(lows, rise_m, rise_across_m, low):  # type: ignore[no-untyped-def]
    """The highest surface below all blocks that rises by at most so much; low has a border of inf."""
    h, w = lows.shape
    low[:] = np.inf
    for i in range(h):
        for j in range(w):
            if lows[i, j] == lows[i, j]:
                low[i + 1, j + 1] = lows[i, j]
    changed = True
    while changed:
        changed = False
        for i in range(1, h + 1):  # from what lies before, to and fro
            for j in range(1, w + 1):
                v = min(low[i, j], low[i - 1, j - 1] + rise_across_m, low[i - 1, j + 1] + rise_across_m,
                        low[i - 1, j] + rise_m, low[i, j - 1] + rise_m)  # fmt: skip
                changed |= v < low[i, j]
                low[i, j] = v
        for i in range(h, 0, -1):
            for j in range(w, 0, -1):
                v = min(low[i, j], low[i + 1, j + 1] + rise_across_m, low[i + 1, j - 1] + rise_across_m,
                        low[i + 1, j] + rise_m, low[i, j + 1] + rise_m)  # fmt: skip
                changed |= v < low[i, j]
                low[i, j] = v


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
def _surface(first, column, mean, known, offsets, side, resolution_m, plane, allowance_m, offset_m, floor_m):  # type: ignore[no-untyped-def]  # fmt: skip
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
    mean, heights, dx, dy = np.empty(full), np.empty(full), np.empty(full), np.empty(full)
    high, wide = (height - 1) // side + 1, (width - 1) // side + 1
    mid = (0.5 * width * resolution_m, 0.5 * height * resolution_m)
    n = _take_cells(
        sums, width, side, wide, mid, resolution_m, first, column, block, mean, heights, dx, dy
    )  # fmt: skip
    if n < FEWEST_CELLS:
        return False
    starts, chosen = np.empty(high * wide + 1, np.int64), np.empty(high * wide, np.int64)
    levels = np.empty(full, np.int32)
    _by_block(block, n, starts, order)
    _low_of_each(heights, starts, order, levels, chosen)
    _plane_of_lows(dx, dy, heights, chosen, plane, near_m)
    _fill_up(dx, dy, heights, n)
    _robust_plane(dx, dy, heights, n, plane, near_m[-2:])
    plane[2] -= plane[0] * mid[0] + plane[1] * mid[1]
    if plane[0] * plane[0] + plane[1] * plane[1] > steepest * steepest:
        return False

    for iy in range(height):
        y = (iy + 0.5) * resolution_m
        for k in range(first[iy], first[iy + 1]):
            x = (column[k] + 0.5) * resolution_m
            heights[k] -= plane[0] * x + plane[1] * y + plane[2]
    _low_of_each(heights, starts, order, levels, chosen)
    lows, lifted, low = np.empty((high, wide)), np.empty((high, wide)), np.empty((high + 2, wide + 2))
    for b in range(high * wide):
        lows[b // wide, b % wide] = heights[chosen[b]] if chosen[b] >= 0 else np.nan
    _without_dents(lows, lifted)
    rise_m = bend * side * resolution_m
    _envelope(lifted, rise_m, rise_m * np.sqrt(2.0), low)
    known = np.empty((high, wide))
    for i in range(high):
        for j in range(wide):
            seen = lows[i, j] == lows[i, j]
            known[i, j] = 1.0 if seen else 0.0
            lows[i, j] = low[i + 1, j + 1] if seen else 0.0
    allowance_m = bend * STEP_CELLS * resolution_m
    _surface(
        first, column, mean, known, lows, side, resolution_m, plane, allowance_m, offset_m, floor_m
    )  # fmt: skip
    return True
