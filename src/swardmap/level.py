"""Finding the ground: how a camera is mounted, and how a map that is not level must be turned."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Float64Array, Pose, deproject
from swardmap.types import Frame

CAMERA_UP = (0.0, -1.0, 0.0)  # of an optical frame that is held upright (REP-103)
MAX_POINTS = 5000  # enough for a plane; keeps the search at some 50 ms
HYPOTHESES = 400
BELOW_WEIGHT = 2.0  # the ground is the lowest surface: points below a plane count against it
MIN_SHARE = 0.05  # of the tolerance; float32 depth is finer than that
MOUNT_RANGE_M = 15.0  # a mount is measured from what is nearer than this


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane and the side that is up: height of p = normal . p + offset_m.

    Attributes:
        normal: (3,) unit vector that points up.
        offset_m: height of the origin above the plane.
        support: share of the points that lie on it.
    """

    normal: Float64Array
    offset_m: float
    support: float = 1.0

    def height_of(self, xyz: ArrayLike) -> Float64Array:
        """Heights (...) of points (..., 3) above the plane, in metres."""
        heights: Float64Array = np.asarray(xyz, np.float64) @ self.normal + self.offset_m
        return heights


def fit_ground(
    xyz: NDArray[np.floating],
    up_hint: ArrayLike,
    tolerance_m: float | NDArray[np.floating] = 0.03,
    max_tilt_deg: float = 45.0,
    min_support: float = 0.15,
    seed: int = 0,
) -> Plane:
    """The lowest large plane that faces up: RANSAC with a fixed seed, then least squares on its points.

    Args:
        xyz: (N, 3) metres; points that are not finite are left out.
        up_hint: (3,) about where up is.
        tolerance_m: how near a point must be to count as on the plane; one number, or one a point (N,).
        max_tilt_deg: largest angle between the plane's normal and the hint.
        min_support: smallest share of the points on the plane.
        seed: of the search; the same points give the same plane.

    Raises:
        InputError: if there are too few points, or no plane has enough of them, with the reason.
        InvalidValueError: for arrays that do not fit together.
    """
    points, tolerance, up = _checked(xyz, tolerance_m, up_hint)
    rng = np.random.default_rng(seed)
    if len(points) > MAX_POINTS:
        chosen = rng.choice(len(points), MAX_POINTS, replace=False)
        points, tolerance = points[chosen], tolerance[chosen]
    if len(points) < 50:
        raise InputError(f"no ground found: expected at least 50 points with depth, got {len(points)}")
    normals, offsets = _hypotheses(points, up, np.cos(np.deg2rad(max_tilt_deg)), rng)
    if not len(normals):
        raise InputError(
            f"no ground found: no surface faces up within {max_tilt_deg:g} degrees; "
            "is the camera upright, and does it see the ground?"
        )
    heights = points @ normals.T + offsets
    on = np.count_nonzero(np.abs(heights) <= tolerance[:, None], axis=0)
    below = np.count_nonzero(heights < -3 * tolerance[:, None], axis=0)
    best = int(np.argmax(on - BELOW_WEIGHT * below))
    normal, offset = _refined(points, tolerance, normals[best], offsets[best])
    support = float(np.mean(np.abs(points @ normal + offset) <= tolerance))
    if support < min_support or normal @ up < np.cos(np.deg2rad(max_tilt_deg)):
        raise InputError(
            f"no ground found: the best plane holds {100 * support:.0f} % of the points, expected at least "
            f"{100 * min_support:.0f} % within {max_tilt_deg:g} degrees of upright"
        )
    return Plane(normal, float(offset), support)


def level_pose(plane: Plane, parent: str = "map", child: str = "recorded_map") -> Pose:
    """T_level_map: the smallest turn, and the shift along z, that bring a plane to z = 0.

    Args:
        plane: in the frame `child`.
        parent: name of the level frame.
        child: name of the frame that is not level.
    """
    from scipy.spatial.transform import Rotation

    axis = np.cross(plane.normal, [0.0, 0.0, 1.0])
    angle = np.arctan2(np.linalg.norm(axis), plane.normal[2])
    length = float(np.linalg.norm(axis))
    direction = axis / length if length > 1e-12 else np.array([1.0, 0.0, 0.0])
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(angle * direction).as_matrix()
    matrix[2, 3] = plane.offset_m
    return Pose(parent, child, matrix)


def estimate_mount(
    frame: Frame, ground: NDArray[np.bool_] | None = None, parent: str = "base", child: str = "camera"
) -> Pose:
    """How the camera is mounted, measured from the ground it sees.

    Args:
        frame: with depth; the camera is held upright and looks down by less than 60 degrees.
        ground: (H, W) bool, pixels that may be ground; None = all.
        parent: name of the frame on the ground under the camera, x forward, z up.
        child: name of the optical frame.

    Returns:
        T_base_camera.

    Raises:
        InputError: if no ground is seen; then give mount.height_m and mount.pitch_deg.
    """
    xyz = deproject(frame.depth_m, frame.intrinsics)
    usable = np.isfinite(xyz[..., 2]) & (xyz[..., 2] < MOUNT_RANGE_M)
    if ground is not None:
        if ground.shape != usable.shape or ground.dtype != np.bool_:
            raise InvalidValueError(
                f"ground: expected bool of shape {usable.shape}, got {ground.dtype} of shape {ground.shape}"
            )
        usable &= ground
    points = xyz[usable].astype(np.float64)
    try:
        plane = fit_ground(points, CAMERA_UP, 0.02 + 0.01 * points[:, 2], max_tilt_deg=60.0)
        if plane.offset_m <= 0:
            raise InputError("no ground found: the plane is above the camera")
    except InputError as error:
        raise InputError(
            f"frame {frame.name or frame.stamp_ns}: {error}. Measure how the camera is mounted, and set "
            "mount.height_m and mount.pitch_deg"
        ) from error
    return mount_over(plane, parent, child)


def mount_over(plane: Plane, parent: str = "base", child: str = "camera") -> Pose:
    """T_base_camera from the ground plane in the optical frame: base under the camera, x forward."""
    up = plane.normal
    forward = np.array([0.0, 0.0, 1.0]) - up[2] * up
    forward /= np.linalg.norm(forward)
    matrix = np.eye(4)
    matrix[:3, :3] = np.vstack((forward, np.cross(up, forward), up))
    matrix[2, 3] = plane.offset_m
    return Pose(parent, child, matrix)


def _checked(
    xyz: NDArray[np.floating], tolerance_m: float | NDArray[np.floating], up_hint: ArrayLike
) -> tuple[Float64Array, Float64Array, Float64Array]:
    points, up = np.asarray(xyz, np.float64), np.asarray(up_hint, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidValueError(f"ground: expected points of shape (N, 3), got {points.shape}")
    if up.shape != (3,) or not np.isfinite(up).all() or not np.linalg.norm(up) > 1e-6:
        raise InvalidValueError(f"ground: expected a direction of three numbers as up_hint, got {up}")
    tolerance = np.broadcast_to(np.asarray(tolerance_m, np.float64), (len(points),))
    finite = np.isfinite(points).all(axis=1)
    return points[finite], tolerance[finite], up / np.linalg.norm(up)


def _hypotheses(
    points: Float64Array, up: Float64Array, min_cosine: float, rng: np.random.Generator
) -> tuple[Float64Array, Float64Array]:
    """Planes (M, 3), (M,) through three points each, turned up; only those within the tilt."""
    a, b, c = points[rng.integers(0, len(points), (3, HYPOTHESES))]
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    wide = length > 1e-6 * np.maximum(np.square(b - a).sum(axis=1), 1e-12)  # not three points in a row
    normals = normals[wide] / length[wide, None]
    normals *= np.where(normals @ up < 0, -1.0, 1.0)[:, None]
    upright = normals @ up >= min_cosine
    return normals[upright], -np.einsum("ij,ij->i", normals[upright], a[wide][upright])


def _refined(
    points: Float64Array, tolerance: Float64Array, normal: Float64Array, offset: float
) -> tuple[Float64Array, float]:
    """Least squares on the points of a plane, repeated; what counts as on it shrinks to their spread."""
    share = 1.0
    for _ in range(10):
        distance = np.abs(points @ normal + offset) / tolerance
        on = distance <= share
        if np.count_nonzero(on) < 3:
            break
        weight = 1 / np.square(tolerance[on])
        middle = weight @ points[on] / weight.sum()
        spread = (points[on] - middle) * np.sqrt(weight)[:, None]
        _, _, axes = np.linalg.svd(spread, full_matrices=False)
        normal = axes[2] if axes[2] @ normal >= 0 else -axes[2]
        offset = float(-normal @ middle)
        # Four robust sigmas: the feet of bushes and walls lie within the tolerance, but not in the spread.
        share = float(np.clip(4 * 1.4826 * np.median(distance[on]), MIN_SHARE, 1.0))
    return normal, offset
