"""Depth and mask to point counts per cell in one pass: the fused road of Sec. 3.4-3.5.

Row by row in two phases. First branch-free loops write for every pixel the counter it belongs to,
which vectorise; then the counters are raised from eight places of the row in turn, so that one
increment does not wait for the store of the one before. The phases, not the language, give the speed.

Each row function stays a function of its own: inlined into one body, the compiler would have to
prove that too many arrays do not overlap, and would give up on vectors.
"""

import numpy as np

from swardmap.kernels.compiled import compiled

FAR_AWAY = np.float32(-1e6)

NOT_IN_RANGE, NOT_CONSISTENT, VOID, NOT_IN_HEIGHT, OUTSIDE = range(5)
"""What became of a pixel that is in no cell; counters behind those of the cells."""

REASONS = 8


@compiled(inline="never")
def _depth_row(depth, unit_m, near_m, far_m, row):  # type: ignore[no-untyped-def]
    """One row in metres between two border pixels, FAR_AWAY where there is no reading in range."""
    readings = 0
    for u in range(depth.shape[0]):
        z = np.float32(depth[u]) * unit_m
        readings += (z > np.float32(0)) & (z < np.float32(np.inf))
        row[u + 1] = z if (z >= near_m) & (z <= far_m) & (z > np.float32(0)) else FAR_AWAY
    return readings


@compiled(inline="never")
def _agreeing_row(above, here, below, relative, absolute_m, needed, keep):  # type: ignore[no-untyped-def]
    """keep[u] = 1 if enough of the 8 neighbours have about the same depth (cloud.consistent_depth)."""
    for u in range(keep.shape[0]):
        z = here[u + 1]
        t = z * relative + absolute_m
        n = (
            np.int32(abs(z - above[u]) <= t)
            + np.int32(abs(z - above[u + 1]) <= t)
            + np.int32(abs(z - above[u + 2]) <= t)
            + np.int32(abs(z - here[u]) <= t)
            + np.int32(abs(z - here[u + 2]) <= t)
            + np.int32(abs(z - below[u]) <= t)
            + np.int32(abs(z - below[u + 1]) <= t)
            + np.int32(abs(z - below[u + 2]) <= t)
        )
        keep[u] = np.int32(n >= needed)


@compiled(inline="never")
def _class_row(mask, columns, table, classes):  # type: ignore[no-untyped-def]
    """Map class of each pixel of a row, looked up in the network's smaller mask."""
    for u in range(classes.shape[0]):
        classes[u] = table[mask[columns[u]]]


@compiled(inline="never")
def _index_row(z_row, ray_x, ray_y, T, lowest, highest, per_metre, classes, keep, width, height, index):  # type: ignore[no-untyped-def]  # fmt: skip
    """Counter of each pixel of a row: Eq. 1, the pose, Eq. 2; or the reason why it has no cell."""
    t00, t01, t02, t03 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    t10, t11, t12, t13 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    t20, t21, t22, t23 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    t30, t31, t32, t33 = T[3, 0], T[3, 1], T[3, 2], T[3, 3]
    grid_width, n_x, n_y = np.int32(width), np.float32(width), np.float32(height)
    zero, none = np.float32(0), np.int32(0)
    first = np.int32(width * height * 4)
    not_in_range, not_consistent = np.int32(first + NOT_IN_RANGE), np.int32(first + NOT_CONSISTENT)
    void, not_in_height = np.int32(first + VOID), np.int32(first + NOT_IN_HEIGHT)
    outside = np.int32(first + OUTSIDE)
    for u in range(index.shape[0]):
        z = z_row[u + 1]
        x = z * ray_x[u]
        y = z * ray_y
        gx = (t00 * x + t01 * y + t02 * z + t03) * per_metre
        gy = (t10 * x + t11 * y + t12 * z + t13) * per_metre
        up = t20 * x + t21 * y + t22 * z + t23
        over = t30 * x + t31 * y + t32 * z + t33
        in_height = ((up >= lowest) & (up <= highest)) | ((over >= lowest) & (over <= highest))
        inside = (gx >= zero) & (gy >= zero) & (gx < n_x) & (gy < n_y)
        i = (np.int32(gy) * grid_width + np.int32(gx)) * np.int32(4) + classes[u]
        i = i if inside else outside
        i = i if in_height else not_in_height
        i = i if classes[u] > none else void
        i = i if keep[u] > none else not_consistent
        index[u] = i if z > zero else not_in_range


@compiled(inline="never")
def _raise_counters(index, counts):  # type: ignore[no-untyped-def]
    """Add one to the counter of every pixel, from eight places of the row in turn."""
    one = np.uint32(1)
    q = index.shape[0] // 8
    for i in range(q):
        counts[index[i]] += one
        counts[index[i + q]] += one
        counts[index[i + 2 * q]] += one
        counts[index[i + 3 * q]] += one
        counts[index[i + 4 * q]] += one
        counts[index[i + 5 * q]] += one
        counts[index[i + 6 * q]] += one
        counts[index[i + 7 * q]] += one
    for i in range(8 * q, index.shape[0]):
        counts[index[i]] += one


@compiled()
def count_pixels(  # type: ignore[no-untyped-def]
    depth, unit_m, mask, rows, columns, table, ray_x, ray_y, T, limits, needed, width, height, per_metre,
    counts,
):  # fmt: skip
    """Count the pixels of each map class in each cell.

    Args:
        depth: (H, W) uint16 or float32.
        unit_m: float32 metres per unit of depth.
        mask: (h, w) uint8 class ids.
        rows: (H,) row of the mask for each row of the depth.
        columns: (W,) column of the mask for each column of the depth.
        table: (256,) int32 mask id -> MapClass.
        ray_x: (W,) float32, x of K^-1 [u v 1] (Eq. 1).
        ray_y: (H,) float32, y of the same.
        T: (4, 4) float32, three rows of T_grid_camera, and one that gives the height above the lawn.
        limits: float32 near, far, lowest, highest (of either height), relative, absolute (metres).
        needed: neighbours that must agree; 0 = no filter.
        width: of the grid in cells.
        height: of the grid in cells.
        per_metre: float32 cells a metre.
        counts: (width * height * 4 + REASONS,) uint32, zeroed here.

    Returns:
        Number of pixels with any reading.
    """
    H, W = depth.shape
    near, far, lowest, highest, relative, absolute_m = limits
    counts[:] = 0
    z_rows = np.full((3, W + 2), FAR_AWAY, np.float32)
    keep = np.ones(W, np.int32)
    classes = np.zeros(W, np.int32)
    index = np.empty(W, np.int32)
    mask_row = -1
    readings = _depth_row(depth[0], unit_m, near, far, z_rows[0])
    for v in range(H):
        above, here, below = z_rows[(v + 2) % 3], z_rows[v % 3], z_rows[(v + 1) % 3]
        if v + 1 < H:
            readings += _depth_row(depth[v + 1], unit_m, near, far, below)
        else:
            below[:] = FAR_AWAY
        if needed > 0:
            _agreeing_row(above, here, below, relative, absolute_m, needed, keep)
        if rows[v] != mask_row:
            mask_row = rows[v]
            _class_row(mask[mask_row], columns, table, classes)
        _index_row(here, ray_x, ray_y[v], T, lowest, highest, per_metre, classes, keep, width, height, index)
        _raise_counters(index, counts)
    return readings


@compiled()
def classify(counts, min_points, min_grass_points, classes):  # type: ignore[no-untyped-def]
    """grid.classify_cells on the flat counters; writes (height * width,) uint8 MapClass."""
    for i in range(classes.shape[0]):
        grass, obstacle, person = counts[4 * i + 1], counts[4 * i + 2], counts[4 * i + 3]
        c = np.uint8(1) if grass >= min_grass_points else np.uint8(0)
        if obstacle + person >= min_points:
            c = np.uint8(3) if (person >= min_points) | (person >= obstacle) else np.uint8(2)
        classes[i] = c


@compiled()
def merge(news, cells, grass_in_a_row, frames_to_clear):  # type: ignore[no-untyped-def]
    """Clear what was seen as grass often enough, then mark (twin: grid.update_grid for one frame).

    Args:
        news: (h, w) uint8 MapClass, one frame's grid.
        cells: (h, w) uint8 MapClass, the map's window; changed here.
        grass_in_a_row: (h, w) uint8 frames that saw grass since the last hazard; changed here.
        frames_to_clear: (4,) uint8 by MapClass of the cell.
    """
    for y in range(news.shape[0]):
        for x in range(news.shape[1]):
            new = news[y, x]
            if new == 1:
                seen = min(grass_in_a_row[y, x] + 1, 255)
                grass_in_a_row[y, x] = seen
                if seen >= frames_to_clear[cells[y, x]]:
                    cells[y, x] = 1
            elif new > 1:
                grass_in_a_row[y, x] = 0
                cells[y, x] = max(cells[y, x], new)  # a person stays one until grass is seen
