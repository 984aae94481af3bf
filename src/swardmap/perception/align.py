"""Depth in the pixels of the colour image, for cameras that do not sit in the same place."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.geometry import Float32Array, Intrinsics, Pose

DepthImage = NDArray[np.uint16] | NDArray[np.float32]


def align_depth_to_color(
    depth: DepthImage,
    depth_unit_m: float,
    depth_intrinsics: Intrinsics,
    color_intrinsics: Intrinsics,
    T_color_depth: Pose,
    like_sdk: bool = False,
) -> DepthImage:
    """Render a depth image in the colour camera: the nearest reading wins, gaps between readings close.

    Where the colour image is the finer one, each reading covers the pixels between its own upper left
    and lower right corner, seen from the colour camera, else one pixel. The rule and the order of
    operations are those of librealsense (src/proc/sse/sse-align.cpp).

    Args:
        depth: (h, w) uint16 in units of `depth_unit_m`, or float32 metres; 0, NaN, infinity: no reading.
        depth_unit_m: metres per unit; 1 for float32.
        depth_intrinsics: of the depth image.
        color_intrinsics: of the colour image, without distortion.
        T_color_depth: p_color = T_color_depth @ p_depth, optical frames.
        like_sdk: bit for bit what `rs.align` gives, which differs in two points. It keeps the numbers as
            measured from the depth camera; otherwise they become distances along the colour camera's
            axis (REP-118). And where a reading covers one pixel it takes the one under the reading's
            corner, which rounding throws back and forth; otherwise the one under its centre.

    Returns:
        (H, W) of the colour image, dtype of `depth`; 0 = no reading.

    Raises:
        InvalidValueError: if the image is not of the size in its intrinsics.
    """
    from swardmap.kernels.align import align_depth

    args = _prepared(depth, depth_unit_m, depth_intrinsics, color_intrinsics, T_color_depth, like_sdk)
    out = np.zeros((color_intrinsics.height, color_intrinsics.width), depth.dtype)
    align_depth(np.ascontiguousarray(depth), *args[:-1], not like_sdk, args[-1], out)
    return out


def align_depth_reference(
    depth: DepthImage,
    depth_unit_m: float,
    depth_intrinsics: Intrinsics,
    color_intrinsics: Intrinsics,
    T_color_depth: Pose,
    like_sdk: bool = False,
) -> DepthImage:
    """`align_depth_to_color` in NumPy: slow, plain, and equal to it in every pixel."""
    unit_m, rays, R, t, camera, whole_footprint, largest = _prepared(
        depth, depth_unit_m, depth_intrinsics, color_intrinsics, T_color_depth, like_sdk
    )
    z = depth.astype(np.float32) * unit_m
    left, right, upper, lower = rays
    u0, v0, qz = _landing(left[None, :], upper[:, None], z, R, t, camera)
    u1, v1, other_qz = u0, v0, qz
    if whole_footprint:
        u1, v1, other_qz = _landing(right[None, :], lower[:, None], z, R, t, camera)
    readings = depth.astype(np.float32)
    if not like_sdk:
        readings = (qz + other_qz) * np.float32(0.5) / unit_m
        readings = np.floor(readings + np.float32(0.5)) if np.isfinite(largest) else readings
    with np.errstate(invalid="ignore"):
        good = (z > 0) & np.isfinite(z) & (qz > 0) & (other_qz > 0) & (readings > 0) & (readings <= largest)
    height, width = color_intrinsics.height, color_intrinsics.width
    out = np.full((height, width), np.inf, np.float32)
    for index in np.flatnonzero(good):
        u, v = (np.sort([a.flat[index], b.flat[index]]) for a, b in ((u0, u1), (v0, v1)))
        if u[1] < 0 or v[1] < 0 or u[0] >= width or v[0] >= height:
            continue
        rows = slice(int(max(v[0], 0)), int(min(v[1], height - 1)) + 1)
        columns = slice(int(max(u[0], 0)), int(min(u[1], width - 1)) + 1)
        out[rows, columns] = np.minimum(out[rows, columns], readings.flat[index])
    out[np.isinf(out)] = 0
    return out.astype(np.uint16) if depth.dtype == np.uint16 else out


def _prepared(
    depth: DepthImage,
    depth_unit_m: float,
    camera_d: Intrinsics,
    camera_c: Intrinsics,
    T_color_depth: Pose,
    like_sdk: bool,
) -> tuple[Any, ...]:
    """What both twins need, in float32: unit, rays, rotation, translation, camera, footprint, largest."""
    if depth.shape != (camera_d.height, camera_d.width) or depth.dtype not in (np.uint16, np.float32):
        raise InvalidValueError(
            f"depth image: expected uint16 or float32 of shape {(camera_d.height, camera_d.width)} as in "
            f"its intrinsics, got {depth.dtype} of shape {depth.shape}"
        )
    if not (math.isfinite(depth_unit_m) and depth_unit_m > 0):
        raise InvalidValueError(f"expected a positive depth unit in metres, got {depth_unit_m}")
    matrix = T_color_depth.matrix.astype(np.float32)
    unit_m = np.float32(depth_unit_m if depth.dtype == np.uint16 else 1)
    largest = np.float32(np.iinfo(np.uint16).max if depth.dtype == np.uint16 else np.inf)
    camera = np.array([camera_c.fx, camera_c.fy, camera_c.cx, camera_c.cy], np.float32)
    R, t = np.ascontiguousarray(matrix[:3, :3]), np.ascontiguousarray(matrix[:3, 3])
    finer = _is_finer(camera_c, camera_d)
    rays = _edge_rays(camera_d, (-0.5, 0.5) if finer or like_sdk else (0.0, 0.0))
    return unit_m, rays, R, t, camera, finer, largest


def _edge_rays(
    camera: Intrinsics, offsets: tuple[float, float]
) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array]:
    """Left, right, upper and lower edges of the pixels at depth 1, each step rounded to float32."""
    sides = ((camera.width, camera.cx, camera.fx), (camera.height, camera.cy, camera.fy))
    edges = [
        (np.arange(size, dtype=np.float32) + np.float32(offset) - np.float32(center)) / np.float32(focal)
        for size, center, focal in sides
        for offset in offsets
    ]
    return edges[0], edges[1], edges[2], edges[3]


def _is_finer(color: Intrinsics, depth: Intrinsics) -> bool:
    """Whether the colour image has more pixels to the degree: then one reading covers several."""
    sizes = (depth.width, depth.height, color.width, color.height)
    if sizes in ((640, 240, 320, 180), (640, 480, 640, 360)):
        return True  # librealsense's two exceptions: cropped images of the same sensor
    return any(d < c for d, c in zip(_pixels_per_degree(depth), _pixels_per_degree(color), strict=True))


def _pixels_per_degree(camera: Intrinsics) -> list[np.float32]:
    sides = ((camera.width, camera.cx, camera.fx), (camera.height, camera.cy, camera.fy))
    f = np.float32
    out = []
    for size, center, focal in sides:
        middle = f(center) + f(0.5)
        angle = f(math.atan2(middle, f(focal))) + f(math.atan2(f(size) - middle, f(focal)))
        out.append(f(size) / (angle * f(57.2957795)))
    return out


def _landing(
    x: Float32Array, y: Float32Array, z: Float32Array, R: Float32Array, t: Float32Array, camera: Float32Array
) -> tuple[Float32Array, Float32Array, Float32Array]:
    with np.errstate(all="ignore"):
        px, py = z * x, z * y
        qx, qy, qz = (R[i, 0] * px + (R[i, 1] * py + (R[i, 2] * z + t[i])) for i in range(3))
        u = qx / qz * camera[0] + camera[2]
        v = qy / qz * camera[1] + camera[3]
        return np.trunc(u + np.float32(0.5)), np.trunc(v + np.float32(0.5)), qz
