"""Depth to colour: the compiled twin of `align.align_depth_reference`."""

import numpy as np

from swardmap.kernels.compiled import compiled


@compiled()
def _landing(x, y, z, R, t, camera):  # type: ignore[no-untyped-def]
    """Column, row and depth in the colour image of the point z * (x, y, 1); depth 0 if not before it."""
    px, py = z * x, z * y
    qz = R[2, 0] * px + (R[2, 1] * py + (R[2, 2] * z + t[2]))
    if not qz > np.float32(0):
        return np.float32(0), np.float32(0), np.float32(0)
    qx = R[0, 0] * px + (R[0, 1] * py + (R[0, 2] * z + t[0]))
    qy = R[1, 0] * px + (R[1, 1] * py + (R[1, 2] * z + t[1]))
    u = qx / qz * camera[0] + camera[2]
    v = qy / qz * camera[1] + camera[3]
    return np.trunc(u + np.float32(0.5)), np.trunc(v + np.float32(0.5)), qz


@compiled()
def _span(a, b, size):  # type: ignore[no-untyped-def]
    """First pixel and end of the pixels between a and b that lie in an image side; clipped as floats."""
    first, last = min(a, b), max(a, b)
    if not (last >= np.float32(0) and first < np.float32(size)):
        return 0, 0
    return int(max(first, np.float32(0))), int(min(last, np.float32(size - 1))) + 1


@compiled()
def _write_nearest(reading, u0, v0, u1, v1, out):  # type: ignore[no-untyped-def]
    """Write a reading to the pixels between two corners that hold nothing nearer."""
    first_u, end_u = _span(u0, u1, out.shape[1])
    first_v, end_v = _span(v0, v1, out.shape[0])
    for v in range(first_v, end_v):
        for u in range(first_u, end_u):
            if out[v, u] == 0 or reading < out[v, u]:
                out[v, u] = reading


@compiled()
def _in_units(z, unit_m, largest):  # type: ignore[no-untyped-def]
    """A distance in metres in the units of the image, rounded half up where it holds whole numbers."""
    reading = z / unit_m
    return np.floor(reading + np.float32(0.5)) if largest < np.float32(np.inf) else reading


@compiled()
def align_depth(depth, unit_m, rays, R, t, camera, whole_footprint, in_color_frame, largest, out):  # type: ignore[no-untyped-def]  # fmt: skip
    """Write each reading to the pixels of `out` (zeros) it covers; the nearest reading wins.

    Args:
        depth: (h, w) uint16 or float32.
        unit_m: metres per unit, float32.
        rays: x of the left and right edge of each column, y of the upper and lower edge of each row,
            at depth 1: four float32 arrays.
        R: (3, 3) float32 rotation to the colour frame.
        t: (3,) float32 translation to the colour frame.
        camera: (4,) float32 fx, fy, cx, cy of the colour image.
        whole_footprint: write all pixels between both corners, else the one of the upper left corner.
        in_color_frame: write the distance from the colour camera, else the number as it was read.
        largest: largest number that `out` can hold, float32; infinity for float32 images.
        out: (H, W) of the type of `depth`.
    """
    left, right, upper, lower = rays
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            reading = np.float32(depth[row, column])
            z = reading * unit_m
            if not (z > np.float32(0) and z < np.float32(np.inf)):
                continue
            u0, v0, qz = _landing(left[column], upper[row], z, R, t, camera)
            u1, v1, other_qz = u0, v0, qz
            if whole_footprint:
                u1, v1, other_qz = _landing(right[column], lower[row], z, R, t, camera)
            if in_color_frame:
                reading = _in_units((qz + other_qz) * np.float32(0.5), unit_m, largest)
            if min(qz, other_qz) > np.float32(0) and np.float32(0) < reading <= largest:
                _write_nearest(reading, u0, v0, u1, v1, out)
