"""The ground of each block of cells, compiled: its low, dents lifted, no steeper than it may be."""

import numpy as np

from swardmap.kernels.compiled import compiled
from swardmap.kernels.constants import DENT_M, LOW_SHARE

CHUNK = 32


@compiled()
def by_block(block, n, starts, order):  # type: ignore[no-untyped-def]
    """Indices of the cells block by block, in each in their order.

    starts: (blocks + 1,) cells of each block behind a zero; then the first of each.
    """
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
        n = np.int32(n + (levels[i] <= level))
    return n


@compiled(inline="never")
def _levels_of(height, level_of):  # type: ignore[no-untyped-def]
    """Heights as levels of 0.1 mm."""
    for i in range(level_of.shape[0]):
        level_of[i] = np.int32(min(max((height[i] + 1000.0) * 10000.0, 0.0), 2147483647.0))


@compiled()
def _take_levels(level_of, order, start, stop, levels):  # type: ignore[no-untyped-def]
    """Levels of one block, filled up to whole chunks; lowest, highest."""
    low, high = np.int32(2**31 - 1), np.int32(0)
    for k in range(start, stop):
        level = level_of[order[k]]
        levels[k - start] = level
        low, high = min(low, level), max(high, level)
    for k in range(stop - start, (stop - start + CHUNK - 1) // CHUNK * CHUNK):
        levels[k] = np.int32(2**31 - 1)
    return low, high


@compiled()
def low_of_each(height, starts, order, level_of, levels, chosen):  # type: ignore[no-untyped-def]
    """chosen[b] = cell at the low quantile of a block's heights, the first among equals; -1 = none seen."""
    _levels_of(height, level_of)
    for b in range(chosen.shape[0]):
        start, stop = starts[b], starts[b + 1]
        chosen[b] = -1
        if start == stop:
            continue
        rank, chunks = np.int64(LOW_SHARE * (stop - start - 1)), (stop - start + CHUNK - 1) // CHUNK
        lowest, highest = _take_levels(level_of, order, start, stop, levels)
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


@compiled()
def without_dents(lows, out):  # type: ignore[no-untyped-def]
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
def envelope(lows, rise_m, rise_across_m, low):  # type: ignore[no-untyped-def]
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
