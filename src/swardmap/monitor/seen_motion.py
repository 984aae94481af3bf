"""How a camera moved between two frames by what it sees: points of known depth, followed from image to image.

Corners of the first image have a place in space by its depth. Where they are found in the second image says
where the camera went: the pose that puts them there, found by Gauss-Newton with bisquare-like weights that
leave out what moves by itself. What the poses say is where the search begins, no more.
"""

from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Intrinsics, Pose
from swardmap.types import Frame, depth_in_metres

WIDTH, LEAST_WIDTH = 320, 240
"""Images are made about this wide; by narrower ones than the second, motion looks too short."""

TILES = (3, 4)
"""Corners are looked for in each part of the image by itself: a shadow's edges are not all there is."""
CORNERS = 16
"""In each tile, at most."""

FARTHEST_M = 12.0
EVEN = 0.15
"""Depth around a corner that differs by less than this share: it lies on one surface."""
BACK_PX = 0.5
"""A corner that was followed there and back is no farther than this from where it began."""
FITS_PX = 1.5
FEWEST, LEAST_SHARE = 20, 0.6
"""Points that fit the motion found, and their share of those followed; with less nothing is said."""
ROUNDS, LOOSE_ROUNDS = 12, 4
"""Of Gauss-Newton; in the first ones no point is left out."""

Float64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A frame with a pose, made small.

    Attributes:
        grey: (h, w) uint8.
        depth_m: (h, w) float32, NaN = no reading.
        intrinsics: of the small images.
        T_map_camera: as the pose says.
        stamp_ns: of the frame.
    """

    grey: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    intrinsics: Intrinsics
    T_map_camera: Pose
    stamp_ns: int


def view_of(frame: Frame) -> View | None:
    """A frame made small; None without a pose, or if it is too small to tell motion by."""
    import cv2

    h, w = frame.depth.shape
    if frame.T_map_camera is None or w < LEAST_WIDTH:
        return None
    step = max(1, round(w / WIDTH))
    size = w // step, h // step
    cut = np.ascontiguousarray(frame.rgb[: size[1] * step, : size[0] * step])
    grey = cv2.resize(cv2.cvtColor(cut, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA)
    half = step // 2
    depth = frame.depth[half::step, half::step][: size[1], : size[0]]
    lens, off = frame.intrinsics, (step - 1) / 2
    small = Intrinsics(*size, lens.fx / step, lens.fy / step, (lens.cx - off) / step, (lens.cy - off) / step)
    return View(
        np.asarray(grey, np.uint8), depth_in_metres(depth, frame.depth_unit_m), small, frame.T_map_camera,
        frame.stamp_ns,
    )  # fmt: skip


def seen_motion(before: View, now: View) -> Float64 | None:
    """Where the camera of the second view is, by what it saw.

    Args:
        before: the first view.
        now: the second, of the same size.

    Returns:
        (4, 4) pose of the second view in the map, if that of the first holds; None where too little can be
        followed to tell.
    """
    pixels, points = _corners(before)
    T = now.T_map_camera.inverse().matrix @ before.T_map_camera.matrix
    if len(pixels) < FEWEST:
        return None
    guess, ahead = _projected(points @ T[:3, :3].T + T[:3, 3], now.intrinsics)
    h, w = now.grey.shape
    inside = ahead & ((guess > 0) & (guess < (w - 1, h - 1))).all(axis=1)
    points, found = _followed(before, now, points[inside], pixels[inside], guess[inside])
    if len(points) < FEWEST:
        return None
    R, t, fits = _fitted(points, found, now.intrinsics, T[:3, :3].copy(), T[:3, 3].copy())
    if fits < max(FEWEST, LEAST_SHARE * len(points)):
        return None
    T_before_now = np.eye(4)
    T_before_now[:3, :3], T_before_now[:3, 3] = R.T, -R.T @ t
    return np.asarray(before.T_map_camera.matrix @ T_before_now, np.float64)


def _corners(view: View) -> tuple[Float64, Float64]:
    """(n, 2) pixels of corners on even depth, and their (n, 3) points in the camera."""
    import cv2

    h, w = view.grey.shape
    found = [np.empty((0, 2))]
    rows, columns = (np.linspace(0, n, parts + 1).astype(int) for n, parts in zip((h, w), TILES, strict=True))
    for (top, bottom), (left, right) in product(pairwise(rows), pairwise(columns)):
        tile = np.ascontiguousarray(view.grey[top:bottom, left:right])
        corners = cv2.goodFeaturesToTrack(tile, CORNERS, 0.05, 5)
        if corners is not None:
            found.append(corners[:, 0] + (left, top))
    pixels = np.concatenate(found)
    u, v = np.rint(pixels).astype(int).T
    inner = (u > 0) & (v > 0) & (u < w - 1) & (v < h - 1)
    pixels, u, v = pixels[inner], u[inner], v[inner]
    around = np.stack([view.depth_m[v + y, u + x] for y in (-1, 0, 1) for x in (-1, 0, 1)])
    depth_m = around[4]
    even = np.ptp(around, axis=0) < EVEN * np.minimum(depth_m, FARTHEST_M)  # NaN compares false
    even &= depth_m < FARTHEST_M
    pixels, depth_m = pixels[even], depth_m[even].astype(np.float64)
    lens = view.intrinsics
    ray = (pixels - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    return pixels, np.column_stack((ray * depth_m[:, None], depth_m))


def _projected(points: Float64, lens: Intrinsics) -> tuple[Float64, NDArray[np.bool_]]:
    """(n, 2) pixels of points in the camera, and whether each lies ahead of it."""
    depth_m = np.maximum(points[:, 2], 0.05)
    return points[:, :2] / depth_m[:, None] * (lens.fx, lens.fy) + (lens.cx, lens.cy), points[:, 2] > 0.1


def _followed(
    before: View, now: View, points: Float64, pixels: Float64, guess: Float64
) -> tuple[Float64, Float64]:
    """Points whose corners are found in the second image, and from there again in the first; their pixels."""
    import cv2

    if len(points) < FEWEST:
        return points[:0], pixels[:0]
    start, there = (np.ascontiguousarray(a, np.float32).reshape(-1, 1, 2) for a in (pixels, guess))
    how = {
        "winSize": (15, 15), "maxLevel": 3, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
        "criteria": (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.03),
    }  # fmt: skip
    there, was_found, _ = cv2.calcOpticalFlowPyrLK(before.grey, now.grey, start, there, **how)  # type: ignore[call-overload]
    back, is_back, _ = cv2.calcOpticalFlowPyrLK(now.grey, before.grey, there, start.copy(), **how)  # type: ignore[call-overload]
    good = (was_found[:, 0] == 1) & (is_back[:, 0] == 1)
    good &= np.hypot(*(back - start)[:, 0].T) < BACK_PX
    return points[good], there[good, 0].astype(np.float64)


def _fitted(
    points: Float64, found: Float64, lens: Intrinsics, R: Float64, t: Float64
) -> tuple[Float64, Float64, int]:
    """Rotation and shift that put points at the pixels where they were found, and how many fit."""
    import cv2

    for done in range(ROUNDS):
        moved = points @ R.T + t
        off = _projected(moved, lens)[0] - found
        away = np.hypot(*off.T)
        scale = max(1.0, 1.5 * float(np.median(away)))
        weights = 1 / np.maximum(1, away / scale)
        if done >= LOOSE_ROUNDS:
            weights[away > 2 * scale] = 0
        slope = _slopes(moved, lens)
        normal = np.einsum("n,nij,nik->jk", weights, slope, slope) + 1e-6 * np.eye(6)
        step = -np.linalg.solve(normal, np.einsum("n,nij,ni->j", weights, slope, off))
        turn = cv2.Rodrigues(step[3:])[0]
        R, t = turn @ R, turn @ t + step[:3]
    away = np.hypot(*(_projected(points @ R.T + t, lens)[0] - found).T)
    return R, t, int((away < FITS_PX).sum())


def _slopes(points: Float64, lens: Intrinsics) -> Float64:
    """(n, 2, 6) change of the pixels of points by a shift and by a small turn of them about the camera."""
    x, y, z = points[:, 0], points[:, 1], np.maximum(points[:, 2], 0.05)
    slope = np.zeros((len(points), 2, 6))
    slope[:, 0, 0], slope[:, 0, 2] = lens.fx / z, -lens.fx * x / z**2
    slope[:, 1, 1], slope[:, 1, 2] = lens.fy / z, -lens.fy * y / z**2
    turns = np.zeros((len(points), 3, 3))
    turns[:, 0, 1], turns[:, 0, 2], turns[:, 1, 2] = z, -y, x
    turns[:, 1, 0], turns[:, 2, 0], turns[:, 2, 1] = -z, y, -x
    slope[:, :, 3:] = slope[:, :, :3] @ turns
    return slope
