"""Depth and mask to the points of a cloud message in one pass (twin: ros.clouds.frame_points)."""

import numpy as np

from swardmap.kernels.compiled import compiled
from swardmap.kernels.constants import FAR_AWAY
from swardmap.kernels.depth import agreeing_row, depth_row


@compiled(inline="never")
def _class_row(mask, columns, table, classes):  # type: ignore[no-untyped-def]
    """Map class of each pixel of a row, looked up in the network's smaller mask."""
    for u in range(classes.shape[0]):
        classes[u] = table[mask[columns[u]]]


@compiled()
def _in_cells(x, y, z, T, per_metre, allowed):  # type: ignore[no-untyped-def]
    """Whether a point of the camera falls into one of some cells; found as `kernels.place` finds them."""
    gx = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) * per_metre
    gy = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) * per_metre
    zero, n_x, n_y = np.float32(0), np.float32(allowed.shape[1]), np.float32(allowed.shape[0])
    inside = (gx >= zero) & (gy >= zero) & (gx < n_x) & (gy < n_y)
    return inside and allowed[np.int32(gy), np.int32(gx)]


@compiled()
def collect_points(  # type: ignore[no-untyped-def]
    depth,
    unit_m,
    mask,
    rows,
    columns,
    table,
    ray_x,
    ray_y,
    up,
    limits,
    needed,
    lowest,
    stride,
    T,
    per_metre,
    allowed,
    xyz,
    labels,
):
    """Write the pixels that count, one after another.

    Args:
        depth: (H, W) uint16 or float32.
        unit_m: float32 metres per unit of depth.
        mask: (h, w) uint8 class ids.
        rows: (H,) row of the mask for each row of the depth.
        columns: (W,) column of the mask for each column of the depth.
        table: (256,) int32 mask id -> MapClass.
        ray_x: (W,) float32, x of K^-1 [u v 1] (Eq. 1).
        ray_y: (H,) float32, y of the same.
        up: (4,) float32, third row of T_map_camera.
        limits: float32 near, far, lowest, highest, relative, absolute (metres).
        needed: neighbours that must agree; 0 = no filter.
        lowest: pixels of a smaller MapClass are left out.
        stride: only every n-th row and column.
        T: (2, 4) float32, first rows of T_grid_camera; as `kernels.place` finds the cell of a pixel.
        per_metre: float32 cells a metre.
        allowed: (height, width) bool, cells whose pixels are taken; of no size: all are, wherever they fall.
        xyz: (N, 3) float32, N large enough; gets x, y, z in the optical frame.
        labels: (N,) uint32; gets mask ids.

    Returns:
        How many were written.
    """
    H, W = depth.shape
    near, far, floor_m, ceiling_m, relative, absolute_m = limits
    z_rows = np.full((3, W + 2), FAR_AWAY, np.float32)
    keep = np.ones(W, np.int32)
    classes = np.zeros(W, np.int32)
    mask_row, count = -1, 0
    by_cell = allowed.size > 0
    depth_row(depth[0], unit_m, near, far, z_rows[0])
    for v in range(H):
        above, here, below = z_rows[(v + 2) % 3], z_rows[v % 3], z_rows[(v + 1) % 3]
        if v + 1 < H:
            depth_row(depth[v + 1], unit_m, near, far, below)
        else:
            below[:] = FAR_AWAY
        if needed > 0:
            agreeing_row(above, here, below, relative, absolute_m, np.int32(needed), keep)
        if rows[v] != mask_row:
            mask_row = rows[v]
            _class_row(mask[mask_row], columns, table, classes)
        if v % stride:
            continue
        for u in range(0, W, stride):
            z = here[u + 1]
            if (z > np.float32(0)) & (keep[u] > 0) & (classes[u] >= lowest):
                x, y = z * ray_x[u], z * ray_y[v]
                height = up[0] * x + up[1] * y + up[2] * z + up[3]
                if (height >= floor_m) & (height <= ceiling_m):
                    if by_cell and not _in_cells(x, y, z, T, per_metre, allowed):
                        continue
                    xyz[count, 0], xyz[count, 1], xyz[count, 2] = x, y, z
                    labels[count] = mask[mask_row, columns[u]]
                    count += 1
    return count
