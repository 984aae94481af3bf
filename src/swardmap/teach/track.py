"""The way of the robot over the ground: poses in time, jumps, the cells its footprint covered."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from swardmap.config import MountConfig
from swardmap.geometry import Pose
from swardmap.grid import GridSpec
from swardmap.mapping.polygons import cells_inside
from swardmap.teach.plan import Corners

FASTEST_MPS, FASTER = 2.0, 4.0
"""Faster than both, the latter in medians of the drive, no mower drives: the pose has jumped."""
JUMP_M = 0.3
"""A smaller step is no jump, however short the time."""
TURN_RAD_S, TURN_RAD = 6.0, 0.7
LONGEST_STEP_M, LONGEST_STEP_S = 1.5, 4.0
"""Between poses that are farther apart nobody knows where the wheels went."""
STEP_RAD = 0.2

Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Where the robot's base was.

    Attributes:
        stamps_ns: (N,) int64, rising.
        xy_m: (N, 2) float64 in the map.
        yaw_rad: (N,) float64 of its x axis.
    """

    stamps_ns: NDArray[np.int64]
    xy_m: NDArray[np.float64]
    yaw_rad: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def seconds(self) -> NDArray[np.float64]:
        """(N,) after the first pose."""
        return np.asarray((self.stamps_ns - self.stamps_ns[:1]) * 1e-9, np.float64)


def base_of(T_map_camera: Pose, mount: MountConfig) -> tuple[float, float, float]:
    """x, y and heading of the robot's base on the ground, from the pose of its camera.

    Args:
        T_map_camera: of the optical frame.
        mount: where the camera sits on the robot; x_m, y_m and yaw_deg count.
    """
    ahead = T_map_camera.matrix[:2, 2]
    if np.hypot(*ahead) < 0.2:  # it looks down: the upper edge of the image is ahead
        ahead = -T_map_camera.matrix[:2, 1]
    yaw = float(np.arctan2(ahead[1], ahead[0])) - np.deg2rad(mount.yaw_deg)
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = T_map_camera.position_m[:2] - np.array([[c, -s], [s, c]]) @ [mount.x_m, mount.y_m]
    return float(x), float(y), yaw


def in_spans(seconds: NDArray[np.float64], spans: tuple[tuple[float, float], ...]) -> Bools:
    """(N,) which times lie in one of some time spans."""
    inside = np.zeros(len(seconds), np.bool_)
    for begin, end in spans:
        inside |= (seconds >= begin) & (seconds <= end)
    return inside


def steady(track: Track, cuts: Sequence[int] = ()) -> Bools:
    """(N,) poses of the longest chain that a robot can have driven; where one jumps, one side is wrong.

    The drive is cut where it jumps. Of the pieces those are kept that hold most poses and of which each can
    be reached from the one before in the time between; two neighbours never are.

    Args:
        track: the poses.
        cuts: indices of poses before which a jump is known otherwise.
    """
    n = len(track)
    if n < 2:
        return np.ones(n, np.bool_)
    step_m = np.hypot(*np.diff(track.xy_m, axis=0).T)
    step_s = np.maximum(np.diff(track.seconds), 1e-3)
    turn = np.abs(np.angle(np.exp(1j * np.diff(track.yaw_rad))))
    fastest = max(FASTEST_MPS, FASTER * float(np.median(step_m / step_s)))
    jumps = (step_m > JUMP_M) & (step_m / step_s > fastest)
    jumps |= (turn > TURN_RAD) & (turn / step_s > TURN_RAD_S)
    jumps[[c - 1 for c in cuts]] = True
    ends = [0, *(np.flatnonzero(jumps) + 1).tolist(), n]
    pieces = list(pairwise(ends))
    best: list[tuple[int, int]] = []  # poses of the best chain that ends with a piece, and the piece before
    for k, (begin, end) in enumerate(pieces):
        before = [
            (best[j][0], j) for j in range(k - 1) if _reachable(track, pieces[j][1] - 1, begin, fastest)
        ]
        most, j = max(before, default=(0, -1))
        best.append((most + end - begin, j))
    kept, k = np.zeros(n, np.bool_), max(range(len(best)), key=lambda i: best[i][0])
    while k >= 0:
        kept[slice(*pieces[k])] = True
        k = best[k][1]
    return kept


def _reachable(track: Track, i: int, j: int, fastest_mps: float) -> bool:
    way_m = float(np.hypot(*(track.xy_m[j] - track.xy_m[i])))
    return way_m <= JUMP_M or way_m <= fastest_mps * float(track.seconds[j] - track.seconds[i])


def driven_cells(track: Track, kept: Bools, footprint_m: Corners, spec: GridSpec) -> NDArray[np.int32]:
    """How many poses drove over each cell of a grid, by the outline of the robot between one and the next.

    Args:
        track: the poses.
        kept: (N,) those that are believed.
        footprint_m: (M, 2) outline in the base frame, convex.
        spec: the grid, in the frame of the poses.

    Returns:
        (height, width) int32.
    """
    counts = np.zeros(spec.shape, np.int32)
    for i in np.flatnonzero(kept).tolist():
        together = i + 1 < len(track) and kept[i + 1] and _joined(track, i)
        for ring in _swept(track, i, footprint_m) if together else [_placed(track, i, 0.0, footprint_m)]:
            part = spec.part_within(GridSpec.covering(spec.resolution_m, *_bounds(ring), spec.frame_id))
            x, y = part.offset_in(spec)
            counts[y : y + part.height, x : x + part.width] += cells_inside(part, ring)
    return counts


def _joined(track: Track, i: int) -> bool:
    way_m = float(np.hypot(*(track.xy_m[i + 1] - track.xy_m[i])))
    return way_m <= LONGEST_STEP_M and float(track.seconds[i + 1] - track.seconds[i]) <= LONGEST_STEP_S


def _swept(track: Track, i: int, footprint_m: Corners) -> list[Corners]:
    """Outlines that together cover what the robot covers from a pose to the next."""
    import cv2

    turn = abs(float(np.angle(np.exp(1j * (track.yaw_rad[i + 1] - track.yaw_rad[i])))))
    parts = max(1, int(np.ceil(turn / STEP_RAD)))
    places = [_placed(track, i, k / parts, footprint_m) for k in range(parts + 1)]
    hulls = []
    for one, two in pairwise(places):
        middle = one.mean(0)  # OpenCV counts in float32
        hull = cv2.convexHull((np.vstack([one, two]) - middle).astype(np.float32))
        hulls.append(hull.reshape(-1, 2).astype(np.float64) + middle)
    return hulls


def _placed(track: Track, i: int, share: float, footprint_m: Corners) -> Corners:
    """The footprint at a share of the way from a pose to the next."""
    xy, yaw = track.xy_m[i], float(track.yaw_rad[i])
    if share:
        xy = xy + share * (track.xy_m[i + 1] - xy)
        yaw += share * float(np.angle(np.exp(1j * (track.yaw_rad[i + 1] - track.yaw_rad[i]))))
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(footprint_m @ np.array([[c, s], [-s, c]]) + xy, np.float64)


def _bounds(ring: Corners) -> tuple[tuple[float, float], tuple[float, float]]:
    low, high = ring.min(0).tolist(), ring.max(0).tolist()
    return (low[0], low[1]), (high[0], high[1])
