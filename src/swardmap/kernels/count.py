"""The second pass over the pixels, compiled: what they say of each cell (twin: perception.plain.count).

Row by row: branch-free loops write what each pixel counts as and how it stands to the ground (kernels.depth
says why). Most are plain lawn, of which `place` has counted how many fall into each cell; the counters are
raised for all others. Float32 in the order of operations of the twin.
"""

import numpy as np

from swardmap.kernels import constants
from swardmap.kernels.compiled import compiled

GRASS, VOID, BEYOND = np.int32(constants.GRASS), np.int32(constants.VOID), np.int32(constants.VOID + 1)
"""What a pixel counts as, beside unsure, obstacle and person: BEYOND = out of height."""
DROPPED = np.int32(constants.DROPPED)
ABOVE, BELOW, GONE, RAISED = (np.int32(1 << bit) for bit in range(4))
"""How a pixel stands to the ground: above or below it; above, but dropped; a little above and doubted."""
KIND, UNCOUNTED = np.int32(7 << 4), np.int32(4 << 4)
"""In one byte with it: what the pixel counts as, GRASS as 0; one bit tells void and BEYOND from the rest."""
SAID_VOID, SAID_BEYOND = np.int32((VOID ^ GRASS) << 4), np.int32((BEYOND ^ GRASS) << 4)


@compiled()
def _bytes_of(table, doubted):  # type: ignore[no-untyped-def]
    """What an id says of its pixels: what they count as, and whether they are RAISED where they rise."""
    said = np.empty(256, np.uint8)
    for i in range(256):
        code = table[i] & np.int32(7)
        raised = (np.float32(table[i] >> np.int32(8)) > doubted) & (code != VOID)
        said[i] = ((code ^ GRASS) << 4) | (RAISED if raised else 0)
    return said


@compiled(inline="never")
def _mask_row(mask, columns, table, told):  # type: ignore[no-untyped-def]
    """What one row of a mask says at the depth image's width."""
    for u in range(told.shape[0]):
        told[u] = table[mask[columns[u]]]


@compiled(inline="never")
def _hazard_row(hazard, columns, doubted, told, hazards):  # type: ignore[no-untyped-def]
    """The same with hazards of its own."""
    for u in range(hazards.shape[0]):
        hazards[u] = hazard[columns[u]]
    for u in range(told.shape[0]):
        kind = np.int32(told[u] & KIND)
        over = (np.float32(hazards[u]) > doubted) & (kind != SAID_VOID)
        told[u] = np.int32(kind | (RAISED if over else np.int32(0)))


@compiled(inline="never")
def _in_cells(cell):  # type: ignore[no-untyped-def]
    """Pixels of a row that fall into a cell, consistent or not: rows of sky need no further work."""
    n = np.int32(0)
    for u in range(cell.shape[0]):
        n = np.int32(n + ((cell[u] >= np.int32(0)) | (cell[u] <= DROPPED)))
    return n


@compiled()
def _pair(offset_m, floor_m, pairs):  # type: ignore[no-untyped-def]
    """Both heights of the ground of a cell side by side, so that one reading of memory brings both."""
    for i in range(offset_m.shape[0]):
        pairs[2 * i], pairs[2 * i + 1] = offset_m[i], floor_m[i]


@compiled(inline="never")
def _cell_row(cell, own):  # type: ignore[no-untyped-def]
    """The cell of each pixel of a row, dropped or not; those without one take the first."""
    for u in range(cell.shape[0]):
        own[u] = max(max(cell[u], np.int32(DROPPED - cell[u])), np.int32(0))


@compiled(inline="never")
def _ground_row(own, pairs, ground):  # type: ignore[no-untyped-def]
    """The ground under each pixel of a row, eight bytes looked up as one number; this does not vectorise."""
    for u in range(own.shape[0]):
        ground[u] = pairs[np.uint64(own[u])]


@compiled(inline="never")
def _stand_row(depth, unit_m, ray_x, tail, up, limits, cell, told, ground, out):  # type: ignore[no-untyped-def]
    """One byte for each pixel of a row: what it counts as, how it stands to the ground; 0 = plain lawn.

    Every number of the loop is cast to 32 bits, or it would be widened to 64.
    """
    lowest, highest, rise_m, doubt_rise_m, hole_m, noise, _ = limits
    slope, start = up[0], up[3]
    rise_m2, doubt_rise_m2, hole_m2 = rise_m * rise_m, doubt_rise_m * doubt_rise_m, hole_m * hole_m
    zero, none = np.float32(0), np.int32(0)
    for u in range(cell.shape[0]):
        c, said = cell[u], np.int32(told[u])
        z = np.float32(depth[u]) * unit_m
        q = slope * ray_x[u] + tail
        over = z * q + start
        height, up_m = over - ground[2 * u], over - ground[2 * u + 1]
        noise_m = noise * (z * z) * q
        noise_m2, up_m2 = noise_m * noise_m, up_m * up_m
        stands = (up_m > zero) & (up_m <= highest)
        above = stands & (up_m2 > rise_m2 + noise_m2)
        r = BELOW if (height < zero) & (height * height > hole_m2 + noise_m2) else none
        r = ABOVE if above else r
        w = np.int32(said & RAISED) if stands & (up_m2 > doubt_rise_m2 + noise_m2) else none
        kind = np.int32(said & KIND)
        in_height = (height >= lowest) & (height <= highest)
        kind = kind if in_height | (kind == SAID_VOID) else SAID_BEYOND
        gone = GONE if above & (c <= DROPPED) else none
        out[u] = np.int32(np.int32(r | w) | kind) if c >= none else gone


@compiled(inline="never")
def _chosen_of_row(out, eights, at):  # type: ignore[no-untyped-def]
    """Where a row's pixels are not plain: eight at a time are looked at, then each. Returns their number."""
    n = np.uint64(0)
    for k in range(eights.shape[0]):
        if eights[k] != np.uint64(0):
            for u in range(8 * k, 8 * k + 8):
                at[n] = u
                n += np.uint64(out[u] != np.uint8(0))
    return n


@compiled(inline="never")
def _raise_chosen(own, out, at, n, points, per_cell):  # type: ignore[no-untyped-def]
    """Take pixels from the grass of their cells, and count them as what they are."""
    one, rest = np.uint32(1), np.uint64(4 * per_cell.shape[1])
    for k in range(n):
        u = np.uint64(at[k])
        c, o = np.uint64(own[u]), np.int32(out[u])
        kind = np.uint64(((o & KIND) >> 4) ^ GRASS)
        counted = kind < np.uint64(VOID)
        points[np.uint64(4) * c + np.uint64(GRASS)] -= one
        points[(np.uint64(4) * c if counted else rest) + kind] += one
        if o & (ABOVE | BELOW | GONE | RAISED) != 0:
            per_cell[2, c] += np.uint32(o & ABOVE)
            per_cell[3, c] += np.uint32((o & BELOW) >> 1)
            per_cell[4, c] += np.uint32((o & RAISED) >> 3)
            per_cell[5, c] += np.uint32((o & GONE) >> 2)


@compiled(inline="never")
def _raise_doubt(cell, own, out, hazards, weights, doubt):  # type: ignore[no-untyped-def]
    """Add the hazard of every pixel of a row that counts, from eight places of it in turn.

    As place._raise_heights does.
    """
    for at in range(weights.shape[0]):
        counts = (cell[at] >= np.int32(0)) & ((np.int32(out[at]) & UNCOUNTED) == np.int32(0))
        weights[at] = np.uint32(hazards[at]) if counts else np.uint32(0)
    width = np.uint64(weights.shape[0])
    eighth = width // np.uint64(8)
    for i in range(eighth):
        u = np.uint64(i)
        for _ in range(8):
            doubt[np.uint64(own[u])] += weights[u]
            u += eighth
    for left in range(np.uint64(8) * eighth, width):
        doubt[np.uint64(own[left])] += weights[left]


@compiled(inline="never")
def _all_grass(sums, points):  # type: ignore[no-untyped-def]
    """Counters as if all that fell into a cell were grass."""
    for i in range(sums.shape[0]):
        points[4 * i], points[4 * i + 1] = np.uint32(0), np.uint32(sums[i, 1])
        points[4 * i + 2], points[4 * i + 3] = np.uint32(0), np.uint32(0)


@compiled(inline="never")
def _of_points(points, seen, doubt, hazardous):  # type: ignore[no-untyped-def]
    """Points of any class, and the sum of their hazard where the class says it."""
    for i in range(seen.shape[0]):
        seen[i] = np.uint32(points[4 * i] + points[4 * i + 1] + points[4 * i + 2] + points[4 * i + 3])
    if not hazardous:
        for i in range(doubt.shape[0]):
            doubt[i] = np.uint32(255) * np.uint32(points[4 * i + 2] + points[4 * i + 3])


@compiled()
def count(  # type: ignore[no-untyped-def]
    depth, unit_m, ray_x, ray_y, cells, sums, mask, table, hazard, hazardous, rows, columns, up, limits,
    grounded, offset_m, floor_m, points, per_cell,
):  # fmt: skip
    """Count the pixels of each class in each cell, their doubt, and those off the ground.

    Args:
        depth: (H, W) uint16 or float32.
        unit_m: float32 metres per unit of depth.
        ray_x: (W,) float32, x of K^-1 [u v 1] (Eq. 1).
        ray_y: (H,) float32, y of the same.
        cells: (H, W) int32 as `place` writes it.
        sums: (cells, 3) int64 as `place` writes it.
        mask: (h, w) uint8 ids.
        table: (256,) int32 what an id counts as: 0..3, 4 = void; + 256 times its hazard.
        hazard: (h, w) uint8 P(obstacle or person) in 255ths.
        hazardous: every pixel has such a hazard; else it is that of the table, 255 for obstacle and person,
            else 0.
        rows: (H,) row of the mask for each row of the depth.
        columns: (W,) column of the mask for each column of the depth.
        up: (4,) float32, height above the plane of the ground = z * (up . ray) + up[3].
        limits: float32 lowest, highest, rise, doubted rise, hole, noise, doubted.
        grounded: whether the ground is known; else nothing is above or below it.
        offset_m: (cells,) float32 height of the ground over its plane.
        floor_m: (cells,) float32 height over the plane that a rise is measured from.
        points: (cells * 4 + 6,) uint32, written here: points by MapClass; behind the cells, at VOID and
            BEYOND, the pixels that are void, out of height.
        per_cell: (6, cells) uint32, written here: points of any class, the sum of their hazard, points above,
            below, a little above and doubted; readings above that the filter dropped.
    """
    H, W = depth.shape
    n = per_cell.shape[1]
    points[4 * n :] = np.uint32(0)
    _all_grass(sums, points)
    per_cell[1:] = np.uint32(0)
    pairs = np.empty(2 * n, np.float32)
    _pair(offset_m, floor_m, pairs)
    said, limits = _bytes_of(table, limits[6]), limits.copy()
    if not grounded:
        limits[5] = np.inf  # nothing stands out of so much noise
    eights = np.zeros((W + 7) // 8, np.uint64)
    out, at = eights.view(np.uint8), np.empty(8 * eights.shape[0] + 1, np.int32)
    told, hazards, own = np.empty(W, np.uint8), np.empty(W, np.uint8), np.empty(W, np.int32)
    ground, weights = np.empty(2 * W, np.float32), np.empty(W, np.uint32)
    mask_row = -1
    for v in range(H):
        if _in_cells(cells[v]) == 0:
            continue
        if rows[v] != mask_row:
            mask_row = rows[v]
            _mask_row(mask[mask_row], columns, said, told)
            if hazardous:
                _hazard_row(hazard[mask_row], columns, limits[6], told, hazards)
        _cell_row(cells[v], own)
        _ground_row(own, pairs.view(np.uint64), ground.view(np.uint64))
        tail = up[1] * ray_y[v] + up[2]
        _stand_row(depth[v], unit_m, ray_x, tail, up, limits, cells[v], told, ground, out[:W])
        chosen = _chosen_of_row(out, eights, at)
        _raise_chosen(own, out, at, chosen, points, per_cell)
        if hazardous:
            _raise_doubt(cells[v], own, out, hazards, weights, per_cell[1])
    _of_points(points, per_cell[0], per_cell[1], hazardous)
