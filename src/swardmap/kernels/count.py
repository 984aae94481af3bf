"""The second pass over the pixels, compiled: what they say of each cell (twin: perception.plain.count).

Row by row: branch-free loops write what each pixel counts as and how it stands to the ground (kernels.depth
says why); then the counters are raised. Float32 in the order of operations of the twin.
"""

import numpy as np

from swardmap.kernels import constants
from swardmap.kernels.compiled import compiled
from swardmap.kernels.depth import how_many

VOID = np.uint8(constants.VOID)
DROPPED = np.int32(constants.DROPPED)


@compiled(inline="never")
def _mask_row(mask, columns, table, told):  # type: ignore[no-untyped-def]
    """What one row of a mask says at the depth image's width: code + 256 * hazard."""
    for u in range(told.shape[0]):
        told[u] = table[mask[columns[u]]]


@compiled(inline="never")
def _hazard_row(hazard, columns, told):  # type: ignore[no-untyped-def]
    """The same with hazards of its own."""
    for u in range(told.shape[0]):
        told[u] = (told[u] & np.int32(255)) | (np.int32(hazard[columns[u]]) << np.int32(8))


@compiled()
def _pair(offset_m, floor_m, pairs):  # type: ignore[no-untyped-def]
    """Both heights of the ground of a cell side by side, so that one reading of memory brings both."""
    for i in range(offset_m.shape[0]):
        pairs[2 * i], pairs[2 * i + 1] = offset_m[i], floor_m[i]


@compiled(inline="never")
def _ground_row(cell, pairs, ground):  # type: ignore[no-untyped-def]
    """The ground under each pixel of a row: what is looked up stands apart, for it does not vectorise.

    Eight bytes a cell, looked up as one number; cell -1 and the like take the first.
    """
    for u in range(cell.shape[0]):
        ground[u] = pairs[np.uint64(max(cell[u], np.int32(0)))]


@compiled(inline="never")
def _stand_row(depth, unit_m, ray_x, tail, up, limits, cell, told, ground, rest, out):  # type: ignore[no-untyped-def]  # fmt: skip
    """What each pixel of a row is counted as, and how it stands to the ground: uint32, one number for both.

    From bit 3 on its counter, 4 * cell + code; or why it is not counted: rest = void, rest + 1 = out of
    height, rest + 2 = no cell. Below 1 above or 2 below the ground, + 4 a little above and doubted.

    Returns:
        Nonzero if any rises or falls.
    """
    lowest, highest, rise_m, doubt_rise_m, hole_m, noise, doubted = limits
    slope, start = up[0], up[3]
    rise_m2, doubt_rise_m2, hole_m2 = rise_m * rise_m, doubt_rise_m * doubt_rise_m, hole_m * hole_m
    void, beyond, nowhere = np.int32(rest), np.int32(rest + 1), np.int32(rest + 2)
    zero, none = np.float32(0), np.int32(0)
    some = np.int32(0)
    for u in range(cell.shape[0]):
        c, code, hazard = cell[u], told[u] & np.int32(255), np.float32(told[u] >> np.int32(8))
        z = np.float32(depth[u]) * unit_m
        q = slope * ray_x[u] + tail
        over = z * q + start
        height, up_m = over - ground[2 * u], over - ground[2 * u + 1]
        i = np.int32(4) * c + code
        i = i if (height >= lowest) & (height <= highest) else beyond
        i = i if code < np.int32(VOID) else void
        i = i if c >= none else nowhere
        noise_m = noise * (z * z) * q
        noise_m2 = noise_m * noise_m
        up_m2 = up_m * up_m
        r = np.int32(2) if (height < zero) & (height * height > hole_m2 + noise_m2) else none
        r = np.int32(1) if (up_m > zero) & (up_m <= highest) & (up_m2 > rise_m2 + noise_m2) else r
        w = np.int32(4) if (up_m2 > doubt_rise_m2 + noise_m2) & (hazard > doubted) else none
        w = w if (up_m > zero) & (up_m <= highest) & (code < np.int32(VOID)) else none
        r = np.int32(r | w) if c >= none else none
        out[u] = (np.uint32(i) << np.uint32(3)) | np.uint32(r)
        some |= r
    return some


@compiled(inline="never")
def _raise_rises(cell, out, at, rises):  # type: ignore[no-untyped-def]
    """Count the pixels of a row that rise or fall: first which they are, without a branch, then each.

    rises: (cells * 4,) uint32 points that do neither but are raised, above, below, raised.
    """
    n = np.uint64(0)
    for u in range(cell.shape[0]):
        at[n] = u
        n += np.uint64((out[u] & np.uint32(7)) > np.uint32(0))
    for k in range(n):
        w = np.uint64(at[k])
        c, r = np.uint64(4) * np.uint64(cell[w]), out[w] & np.uint32(7)
        rises[c + np.uint64(r & np.uint32(3))] += np.uint32(1)
        rises[c + np.uint64(3)] += r >> np.uint32(2)


@compiled(inline="never")
def _count_dropped(depth, unit_m, ray_x, tail, up, limits, cell, floor_m, at, dropped):  # type: ignore[no-untyped-def]  # fmt: skip
    """Count the readings of a row that the filter dropped and that stand above the ground."""
    highest, rise_m, noise = limits[1], limits[2], limits[5]
    n = np.uint64(0)
    for u in range(cell.shape[0]):
        at[n] = u
        n += np.uint64(cell[u] <= DROPPED)
    for k in range(n):
        w = np.uint64(at[k])
        i = np.uint64(DROPPED - cell[w])
        z = np.float32(depth[w]) * unit_m
        q = up[0] * ray_x[w] + tail
        rise = (z * q + up[3]) - floor_m[i]
        noise_m = noise * (z * z) * q
        stands = (rise > np.float32(0)) & (rise <= highest)
        dropped[i] += np.uint32(stands & (rise * rise > rise_m * rise_m + noise_m * noise_m))


@compiled(inline="never")
def _weigh_row(told, weights):  # type: ignore[no-untyped-def]
    """What each pixel adds to its counter: one, and its hazard from bit 32 on."""
    for u in range(told.shape[0]):
        weights[u] = (np.uint64(told[u] >> np.int32(8)) << np.uint64(32)) | np.uint64(1)


@compiled(inline="never")
def _raise_points(out, points):  # type: ignore[no-untyped-def]
    """Raise the counter of every pixel of a row, from eight places of it in turn (as _raise_heights)."""
    one, bits, width = np.uint32(1), np.uint32(3), np.uint64(out.shape[0])
    eighth = width // np.uint64(8)
    for i in range(eighth):
        u = np.uint64(i)
        for _ in range(8):
            points[np.uint64(out[u] >> bits)] += one
            u += eighth
    for left in range(np.uint64(8) * eighth, width):
        points[np.uint64(out[left] >> bits)] += one


@compiled(inline="never")
def _raise_tallies(out, weights, tallies):  # type: ignore[no-untyped-def]
    """The same with the hazard of each pixel."""
    bits, width = np.uint32(3), np.uint64(out.shape[0])
    eighth = width // np.uint64(8)
    for i in range(eighth):
        u = np.uint64(i)
        for _ in range(8):
            tallies[np.uint64(out[u] >> bits)] += weights[u]
            u += eighth
    for left in range(np.uint64(8) * eighth, width):
        tallies[np.uint64(out[left] >> bits)] += weights[left]


@compiled(inline="never")
def _of_points(points, seen, doubt):  # type: ignore[no-untyped-def]
    """Points of any class and the sum of their hazard, where the class says the hazard."""
    for i in range(seen.shape[0]):
        hazard = points[4 * i + 2] + points[4 * i + 3]
        seen[i] = points[4 * i] + points[4 * i + 1] + hazard
        doubt[i] = np.uint32(255) * hazard


@compiled(inline="never")
def _of_tallies(tallies, points):  # type: ignore[no-untyped-def]
    for i in range(points.shape[0]):
        points[i] = np.uint32(tallies[i] & np.uint64(0xFFFFFFFF))


@compiled(inline="never")
def _hazards(tallies, points, seen, doubt):  # type: ignore[no-untyped-def]
    """The same where every pixel has a hazard of its own."""
    for i in range(seen.shape[0]):
        seen[i] = points[4 * i] + points[4 * i + 1] + points[4 * i + 2] + points[4 * i + 3]
    for i in range(doubt.shape[0]):
        h = tallies[4 * i] >> np.uint64(32)
        h += tallies[4 * i + 1] >> np.uint64(32)
        h += tallies[4 * i + 2] >> np.uint64(32)
        doubt[i] = np.uint32(h + (tallies[4 * i + 3] >> np.uint64(32)))


@compiled(inline="never")
def _split(rises, above, below, raised):  # type: ignore[no-untyped-def]
    for i in range(above.shape[0]):
        above[i], below[i], raised[i] = rises[4 * i + 1], rises[4 * i + 2], rises[4 * i + 3]


@compiled()
def count(  # type: ignore[no-untyped-def]
    depth, unit_m, ray_x, ray_y, cells, mask, table, hazard, hard, rows, columns, up, limits, grounded,
    offset_m, floor_m, points, per_cell,
):  # fmt: skip
    """Count the pixels of each class in each cell, their doubt, and those off the ground.

    Args:
        depth: (H, W) uint16 or float32.
        unit_m: float32 metres per unit of depth.
        ray_x: (W,) float32, x of K^-1 [u v 1] (Eq. 1).
        ray_y: (H,) float32, y of the same.
        cells: (H, W) int32 as `place` writes it.
        mask: (h, w) uint8 ids.
        table: (256,) int32 what an id counts as: 0..3, 4 = void; + 256 times its hazard.
        hazard: (h, w) uint8 P(obstacle or person) in 255ths.
        hard: the hazard is that of the table, 255 for obstacle and person and else 0.
        rows: (H,) row of the mask for each row of the depth.
        columns: (W,) column of the mask for each column of the depth.
        up: (4,) float32, height above the plane of the ground = z * (up . ray) + up[3].
        limits: float32 lowest, highest, rise, doubted rise, hole, noise, doubted.
        grounded: whether the ground is known; else nothing is above or below it.
        offset_m: (cells,) float32 height of the ground over its plane.
        floor_m: (cells,) float32 height over the plane that a rise is measured from.
        points: (cells * 4 + 3,) uint32, written here: points by MapClass; behind the cells the pixels that
            are void, out of height; and some without a cell.
        per_cell: (6, cells) uint32, written here: points of any class, the sum of their hazard, points above,
            below, a little above and doubted; readings above that the filter dropped.
    """
    H, W = depth.shape
    n = per_cell.shape[1]
    points[:] = np.uint32(0)
    tallies = np.zeros(1 if hard else points.shape[0], np.uint64)
    rises = np.zeros(4 * n if grounded else 0, np.uint32)
    pairs = np.empty(2 * n, np.float32)
    _pair(offset_m, floor_m, pairs)
    told, at, out = np.empty(W, np.int32), np.empty(W + 1, np.int32), np.empty(W, np.uint32)
    ground, weights = np.empty(2 * W, np.float32), np.empty(W, np.uint64)
    mask_row, rest = -1, 4 * n
    per_cell[5] = np.uint32(0)
    for v in range(H):
        tail = up[1] * ray_y[v] + up[2]
        if grounded:
            _count_dropped(depth[v], unit_m, ray_x, tail, up, limits, cells[v], floor_m, at, per_cell[5])
        if how_many(cells[v], np.int32(-1)) == 0:
            continue
        if rows[v] != mask_row:
            mask_row = rows[v]
            _mask_row(mask[mask_row], columns, table, told)
            if not hard:
                _hazard_row(hazard[mask_row], columns, told)
                _weigh_row(told, weights)
        _ground_row(cells[v], pairs.view(np.uint64), ground.view(np.uint64))
        some = _stand_row(depth[v], unit_m, ray_x, tail, up, limits, cells[v], told, ground, rest, out)
        if hard:
            _raise_points(out, points)
        else:
            _raise_tallies(out, weights, tallies)
        if grounded and some != 0:
            _raise_rises(cells[v], out, at, rises)
    if hard:
        _of_points(points, per_cell[0], per_cell[1])
    else:
        _of_tallies(tallies, points)
        _hazards(tallies, points, per_cell[0], per_cell[1])
    if grounded:
        _split(rises, per_cell[2], per_cell[3], per_cell[4])
    else:
        per_cell[2:5] = np.uint32(0)
