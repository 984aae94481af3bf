"""Compiled twins of the evaluation's hot loops: pair counts, nearest hits, connected obstacles.

All of it is integer arithmetic, so the results are exact and do not depend on the order of the work.
"""

import numpy as np

from swardmap.kernels.compiled import compiled

CODES = 8
"""Ids 0..6 count as they are and everything above as 7; seven classes and void are enough for a map."""

EVERY_BYTE = np.uint64(0x0101010101010101)
ABOVE_GRASS = np.uint64(0xFEFEFEFEFEFEFEFE)


@compiled()
def count_pairs(reference, predicted, counts):  # type: ignore[no-untyped-def]
    """Count how often each pair of ids occurs.

    Masks and maps consist of areas: eight equal neighbours are counted at once. The rest goes to
    eight histograms in turn, so that one increment does not wait for the store of the one before.

    Args:
        reference: (N,) uint8 ids, contiguous; clamped to 0..7.
        predicted: the same.
        counts: (8, 8) int64, [reference, predicted], overwritten.
    """
    lanes = np.zeros((8, 64), np.uint32)
    top, three = np.uint8(7), np.uint8(3)
    n = reference.shape[0]
    words = n // 8
    reference_words = reference[: 8 * words].view(np.uint64)
    predicted_words = predicted[: 8 * words].view(np.uint64)
    for i in range(words):
        r = reference_words[i] & np.uint64(255)
        p = predicted_words[i] & np.uint64(255)
        if (reference_words[i] == r * EVERY_BYTE) & (predicted_words[i] == p * EVERY_BYTE):
            code = (min(r, np.uint64(7)) << np.uint64(3)) | min(p, np.uint64(7))
            lanes[i & 7, code] += np.uint32(8)
        else:
            for k in range(8):
                j = 8 * i + k
                lanes[k, (min(reference[j], top) << three) | min(predicted[j], top)] += np.uint32(1)
    for j in range(8 * words, n):
        lanes[0, (min(reference[j], top) << three) | min(predicted[j], top)] += np.uint32(1)
    for j in range(64):
        total = np.int64(0)
        for k in range(8):
            total += np.int64(lanes[k, j])
        counts[j >> 3, j & 7] = total


@compiled()
def gather_cells(reference, predicted, hazards, misses, hits, person_hits):  # type: ignore[no-untyped-def]
    """Flat indices of the cells that matter, in row-major order.

    Args:
        reference: (N,) uint8 MapClass, contiguous.
        predicted: the same.
        hazards: reference is obstacle or person; exactly as long as there are such cells.
        misses: of these, those predicted grass (FN).
        hits: those predicted obstacle.
        person_hits: those predicted person.
    """
    h = m = o = q = 0
    n = reference.shape[0]
    words = reference[: n // 8 * 8].view(np.uint64)
    i = 0
    while i < n:
        if (i & 7) == 0 and i < n // 8 * 8 and (words[i >> 3] & ABOVE_GRASS) == np.uint64(0):
            i += 8
            continue
        if reference[i] >= 2:
            hazards[h] = i
            h += 1
            c = predicted[i]
            if c == 1:
                misses[m] = i
                m += 1
            elif c == 2:
                hits[o] = i
                o += 1
            elif c == 3:
                person_hits[q] = i
                q += 1
        i += 1


@compiled()
def nearest_squared(misses, hits, width, squared):  # type: ignore[no-untyped-def]
    """Eq. 3 by brute force: squared distance, in cells, of each miss to its nearest hit.

    Args:
        misses: flat indices into a grid `width` cells wide.
        hits: the same.
        width: of the grid.
        squared: (len(misses),) int64, written; -1 where there is no hit.
    """
    n = hits.shape[0]
    hit_x = np.empty(n, np.int32)
    hit_y = np.empty(n, np.int32)
    for k in range(n):
        hit_y[k] = np.int32(hits[k] // width)
        hit_x[k] = np.int32(hits[k] % width)
    for i in range(misses.shape[0]):
        y = np.int32(misses[i] // width)
        x = np.int32(misses[i] % width)
        best = np.int32(2147483647)
        for k in range(n):
            dy = hit_y[k] - y
            dx = hit_x[k] - x
            best = min(best, dx * dx + dy * dy)
        squared[i] = np.int64(best) if n > 0 else np.int64(-1)


@compiled()
def connected_cells(reference, hazards, height, width, component):  # type: ignore[no-untyped-def]
    """Number the 8-connected groups of reference obstacle cells (person included).

    Args:
        reference: (height * width,) uint8 MapClass.
        hazards: flat indices of its obstacle and person cells, ascending.
        height: of the grid.
        width: of the grid.
        component: (len(hazards),) int32, written: 0, 1, ... in order of each group's first cell.

    Returns:
        Number of groups.
    """
    number = np.zeros(height * width, np.int32)  # 0 = not yet reached, else group + 1
    stack = np.empty(hazards.shape[0], np.int64)
    groups = 0
    for i in range(hazards.shape[0]):
        if number[hazards[i]] == 0:
            groups += 1
            number[hazards[i]] = groups
            stack[0] = hazards[i]
            depth = 1
            while depth > 0:
                depth -= 1
                y = stack[depth] // width
                x = stack[depth] % width
                for ny in range(max(0, y - 1), min(height, y + 2)):
                    for nx in range(max(0, x - 1), min(width, x + 2)):
                        cell = ny * width + nx
                        if reference[cell] >= 2 and number[cell] == 0:
                            number[cell] = groups
                            stack[depth] = cell
                            depth += 1
        component[i] = number[hazards[i]] - 1
    return groups
