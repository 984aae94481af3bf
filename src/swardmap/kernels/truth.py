"""The places, heights and cells of the truth's pixels, compiled.

Twins, operation by operation: geometry.deproject and transform_points, GroundRaster.at, grid.count_points
and classify_cells.
"""

import numpy as np

from swardmap.kernels.compiled import compiled


@compiled()
def readings(depth_m, near_m, far_m):  # type: ignore[no-untyped-def]
    """Number of readings within the range, and of those nearer or farther; (H, W) float32, NaN = none."""
    within, beyond = 0, 0
    for z in depth_m.ravel():
        has = z > np.float32(0)
        in_range = (z >= near_m) & (z <= far_m)
        within += in_range
        beyond += has & ~in_range
    return within, beyond


@compiled()
def points(depth_m, near_m, far_m, ray_x, ray_y, index, xyz, out_of_range):  # type: ignore[no-untyped-def]
    """Points of the pixels within the range, in the frame of the camera (Eq. 1).

    Args:
        depth_m: (H, W) float32, contiguous, NaN = no reading.
        near_m: float32.
        far_m: float32.
        ray_x: (W,) float32.
        ray_y: (H,) float32.
        index: (N,) int64 flat place in the image, written here; as long as `readings` says.
        xyz: (N, 3) float32, written here.
        out_of_range: (M,) int64, written here.
    """
    n, m, width = 0, 0, depth_m.shape[1]
    for v in range(depth_m.shape[0]):
        for u in range(width):
            z = depth_m[v, u]
            if (z >= near_m) & (z <= far_m):
                index[n] = v * width + u
                xyz[n, 0], xyz[n, 1], xyz[n, 2] = z * ray_x[u], z * ray_y[v], z
                n += 1
            elif z > np.float32(0):
                out_of_range[m] = v * width + u
                m += 1


@compiled()
def _moved(xyz, k, turn, position_m, i):  # type: ignore[no-untyped-def]
    """Coordinate i of point k in the map: turned in float32, then moved in float64."""
    turned = turn[i, 0] * xyz[k, 0] + turn[i, 1] * xyz[k, 1] + turn[i, 2] * xyz[k, 2]
    return np.float64(turned) + position_m[i]


@compiled()
def turn_and_move(xyz, turn, position_m, moved):  # type: ignore[no-untyped-def]
    """(N, 3) float32 points turned by (3, 3) float32, then moved in float64: writes (N, 3) float64."""
    for k in range(xyz.shape[0]):
        for i in range(3):
            moved[k, i] = _moved(xyz, k, turn, position_m, i)


@compiled(error_model="numpy")
def _between(at, origin_m, texel_m, n):  # type: ignore[no-untyped-def]
    place = min(max((at - origin_m) / texel_m - 0.5, 0.0), np.float64(n - 1))
    before = min(np.int64(place), max(n - 2, 0))
    return before, place - before


@compiled(error_model="numpy")
def heights_above(xyz, turn, position_m, heights, origin_m, texel_m, height_m):  # type: ignore[no-untyped-def]
    """Heights of points above a raster of the ground, without their places in the map being kept.

    Args:
        xyz: (N, 3) float32 in the frame of the camera.
        turn: (3, 3) float32 as of `turn_and_move`.
        position_m: (3,) float64 of the camera in the map.
        heights: (ny, nx) float32 at the texels' centres.
        origin_m: (2,) float64 outer corner.
        texel_m: edge.
        height_m: (N,) float64, written here.
    """
    ny, nx = heights.shape
    right, up = int(nx > 1), int(ny > 1)
    for k in range(xyz.shape[0]):
        i, a = _between(_moved(xyz, k, turn, position_m, 0), origin_m[0], texel_m, nx)
        j, b = _between(_moved(xyz, k, turn, position_m, 1), origin_m[1], texel_m, ny)
        lower = np.float64(heights[j, i]) * (1 - a) + np.float64(heights[j, i + right]) * a
        upper = np.float64(heights[j + up, i]) * (1 - a) + np.float64(heights[j + up, i + right]) * a
        height_m[k] = _moved(xyz, k, turn, position_m, 2) - (lower * (1 - b) + upper * b)


@compiled()
def cells_of(xyz, T, per_metre, width, height, cells):  # type: ignore[no-untyped-def]
    """Flat cell of each (N, 3) float32 point by (3, 4) float32 T_grid_camera, -1 beside the grid (Eq. 2)."""
    zero, n_x, n_y = np.float32(0), np.float32(width), np.float32(height)
    t00, t01, t02, t03 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    t10, t11, t12, t13 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    for k in range(xyz.shape[0]):
        x, y, z = xyz[k, 0], xyz[k, 1], xyz[k, 2]
        gx = (t00 * x + t01 * y + t02 * z + t03) * per_metre
        gy = (t10 * x + t11 * y + t12 * z + t13) * per_metre
        inside = (gx >= zero) & (gy >= zero) & (gx < n_x) & (gy < n_y)
        cells[k] = np.int64(gy) * width + np.int64(gx) if inside else -1


@compiled()
def take(labels, index, table, classes):  # type: ignore[no-untyped-def]
    """table[labels[index]] of (H * W,) uint8 ids: writes (N,) uint8."""
    for k in range(index.shape[0]):
        classes[k] = table[labels[index[k]]]


@compiled()
def choose(xyz, classes, wanted, chosen):  # type: ignore[no-untyped-def]
    """The (N, 3) points of one class, in their order: writes (n, 3)."""
    n = 0
    for k in range(xyz.shape[0]):
        if classes[k] == wanted:
            for i in range(3):
                chosen[n, i] = xyz[k, i]
            n += 1


@compiled()
def highest_class(labels, index, table, judged, cells, classes):  # type: ignore[no-untyped-def]
    """The highest MapClass of the judged pixels of each cell: what one point is enough for.

    Args:
        labels: (H * W,) uint8 ids.
        index: (N,) int64 places of the pixels in them.
        table: (256,) uint8 MapClass of each id.
        judged: (N,) bool.
        cells: (N,) int64, -1 = beside the grid.
        classes: (cells,) uint8, zero before, written here.
    """
    for k in range(index.shape[0]):
        if judged[k] & (cells[k] >= 0):
            c = table[labels[index[k]]]
            if c > classes[cells[k]]:
                classes[cells[k]] = c


@compiled()
def column_sums(xyz, sums, low, high):  # type: ignore[no-untyped-def]
    """Sum, smallest and largest of each column of (N, 3) float64, row after row: writes three (3,)."""
    sums[:], low[:], high[:] = 0.0, np.inf, -np.inf
    for k in range(xyz.shape[0]):
        for i in range(3):
            value = xyz[k, i]
            sums[i] += value
            low[i], high[i] = min(low[i], value), max(high[i], value)


@compiled()
def texel_sums(xyz, rest_m, low, texel_m, nx, counts, totals):  # type: ignore[no-untyped-def]
    """Points of each texel and the sum of `rest_m` over them; (N, 3) float64, (N,) float64, (2,) int64."""
    counts[:], totals[:] = 0, 0.0
    for k in range(xyz.shape[0]):
        ix = np.int64(np.floor(xyz[k, 0] / texel_m)) - low[0]
        iy = np.int64(np.floor(xyz[k, 1] / texel_m)) - low[1]
        at = iy * nx + ix
        counts[at] += 1
        totals[at] += rest_m[k]
