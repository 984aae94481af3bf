"""The ground plane: found in depth, to level a map or to measure how a camera is mounted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Float64Array, Pose, deproject
from swardmap.labels import MapClass
from swardmap.types import Frame

TOLERANCE_M, TOLERANCE_RELATIVE = 0.02, 0.005
"""A point within TOLERANCE_M + TOLERANCE_RELATIVE * range lies on a plane.

Stereo noise grows with the square of the range, but moves a point of the ground along a ray that is the
flatter the farther it reaches: across the ground, noise grows in proportion to the range.
"""
STEP_M = 0.1
"""A plane this far below the best one is another plane: the floor under a table, not its uneven part."""
MIN_POINTS = 500
MAX_POINTS = 20_000
SAMPLE, HYPOTHESES, KEPT = 1_000, 6_000, 500
MIN_SPREAD, MIN_SPREAD_RELATIVE = 3.0, 0.1
"""Narrower side of a patch of ground (standard deviation), in tolerances and in heights of the camera.

A cut through a wall is about 1 tolerance wide; the top of a tree far away is small for its distance.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """The plane `normal @ p = offset_m`, with the normal pointing up.

    Attributes:
        normal: (3,) float64 of length 1.
        offset_m: signed distance of the plane from the origin along the normal.
        inlier_share: share of the points that lie on it, 0..1.
    """

    normal: Float64Array
    offset_m: float
    inlier_share: float

    def __post_init__(self) -> None:
        normal = np.array(self.normal, np.float64)
        if normal.shape != (3,) or not abs(float(np.linalg.norm(normal)) - 1.0) < 1e-6:
            raise InvalidValueError(f"plane: expected a normal of length 1, got {self.normal}")
        if not (np.isfinite(self.offset_m) and 0 <= self.inlier_share <= 1):
            raise InvalidValueError(
                "plane: expected a finite offset and an inlier share in 0..1, "
                f"got {self.offset_m} and {self.inlier_share}"
            )
        normal.flags.writeable = False
        object.__setattr__(self, "normal", normal)

    def height_m(self, xyz: ArrayLike) -> Float64Array:
        """Signed distance (...) of points (..., 3) from the plane, positive above it."""
        heights: Float64Array = np.asarray(xyz, np.float64) @ self.normal - self.offset_m
        return heights


def fit_ground_plane(
    xyz: ArrayLike,
    up_hint: ArrayLike,
    viewpoint: ArrayLike = (0.0, 0.0, 0.0),
    max_tilt_deg: float = 60.0,
    min_share: float = 0.1,
) -> Plane:
    """Find the ground: the lowest plane with enough support, below the camera and not too steep.

    RANSAC with a fixed seed, then least squares on the inliers. Walls are too steep, ceilings are above
    the camera, and a table top or step loses to a floor below it that holds `min_share` of the points.

    Args:
        xyz: (N, 3) metres; rows that are not finite are left out.
        up_hint: (3,) direction that is roughly up, of any length: -y of the optical frame, or from an IMU.
        viewpoint: (3,) or (N, 3) position of the camera that saw the points; the ground is below it.
        max_tilt_deg: largest angle between the hint and the normal; with -y of the optical frame it must
            leave room for the pitch of the camera.
        min_share: share of the points that the ground must hold.

    Raises:
        InputError: if no plane qualifies; the message says why, and what to do.
        InvalidValueError: for arguments of a wrong shape, or a hint without a direction.
    """
    points, views, up = _checked(xyz, up_hint, viewpoint)
    if len(points) < MIN_POINTS:
        raise InputError(f"no ground found: expected at least {MIN_POINTS} depth readings, got {len(points)}")
    rng = np.random.default_rng(0)
    if len(points) > MAX_POINTS:
        chosen = rng.choice(len(points), MAX_POINTS, replace=False)
        points, views = points[chosen], views[chosen]
    centre = points.mean(axis=0)  # far from the origin, differences would drown in rounding
    points, views = points - centre, views - centre
    cone = _Cone(up, float(np.cos(np.deg2rad(max_tilt_deg))), np.unique(views[:SAMPLE], axis=0))
    tolerance = TOLERANCE_M + TOLERANCE_RELATIVE * np.linalg.norm(points - views, axis=1)
    plane = _lowest_plane(points, tolerance, cone, max(min_share * len(points), 3.0), rng)
    if plane is None:
        raise InputError(
            f"no ground found: no plane below the camera and within {max_tilt_deg:g} degrees of the expected "
            f"up holds {min_share:.0%} of the {len(points)} points looked at"
        )
    normal, offset = plane
    share = float(np.mean(np.abs(points @ normal - offset) <= tolerance))
    return Plane(normal, float(offset + normal @ centre), share)


def level_pose(plane: Plane, parent: str = "level", child: str = "map") -> Pose:
    """T_level_map: turns the plane's normal to +z and puts the plane at z = 0.

    The turn is the smallest that does so: nothing turns about the vertical, so headings are kept as far
    as they can be.

    Args:
        plane: in the frame `child`.
        parent: name of the levelled frame.
        child: name of the frame to level.
    """
    nx, ny, nz = plane.normal
    sine_squared = nx**2 + ny**2
    if nz < 0 and sine_squared < 1e-24:
        rotation = np.diag([1.0, -1.0, -1.0])  # upside down: any half turn about a level axis will do
    else:
        axis = np.array([[0, 0, -nx], [0, 0, -ny], [nx, ny, 0]])  # of normal x z, as a matrix
        share = 1 / (1 + nz) if nz >= 0 else (1 - nz) / sine_squared  # equal; neither cancels digits
        rotation = np.eye(3) + axis + axis @ axis * share
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[2, 3] = -plane.offset_m
    return Pose(parent, child, matrix)


def estimate_mount(frame: Frame) -> Pose:
    """T_base_camera from the ground that one frame sees: height, pitch and roll of the camera.

    The base lies on the ground under the camera, x along the viewing direction. Where the frame has true
    labels only what may be driven on is looked at.

    Raises:
        InputError: if no ground is seen.
    """
    xyz = deproject(frame.depth_m, frame.intrinsics)
    try:
        plane = fit_ground_plane(_ground_points(frame, xyz), up_hint=(0.0, -1.0, 0.0))
    except InputError as error:
        raise InputError(
            f"frame {frame.name or frame.stamp_ns}: {error}. Point the camera lower, or set mount.height_m "
            "and mount.pitch_deg"
        ) from error
    return _mount_above(plane)


def _ground_points(frame: Frame, xyz: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N, 3) valid points: those that are labelled free if there are enough, else all."""
    valid = np.isfinite(xyz[..., 2])
    if frame.labels is not None and frame.label_set is not None:
        free = valid & (frame.label_set.map_class_table[frame.labels] == MapClass.GRASS)
        if np.count_nonzero(free) >= MIN_POINTS:
            valid = free
    return xyz[valid]


def _mount_above(plane: Plane) -> Pose:
    """T_base_camera of a camera that sees the ground as `plane`."""
    up = plane.normal
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    if np.linalg.norm(ahead) < 1e-6:  # straight down: the top of the image is ahead
        ahead = np.array([0.0, -1.0, 0.0]) + up[1] * up
    ahead /= np.linalg.norm(ahead)
    matrix = np.eye(4)
    matrix[:3, :3] = (ahead, np.cross(up, ahead), up)
    matrix[2, 3] = -plane.offset_m
    return Pose("base", "camera", matrix)


@dataclass(frozen=True, slots=True)
class _Cone:
    """What a ground plane may be: within an angle of up, and below every viewpoint."""

    up: Float64Array
    cos_tilt: float
    views: Float64Array

    def holds(self, normals: Float64Array, offsets: Float64Array) -> NDArray[np.bool_]:
        """Which planes (M, 3), (M,) qualify."""
        upright = normals @ self.up >= self.cos_tilt
        below: NDArray[np.bool_] = (normals @ self.views.T).min(axis=1) > offsets
        return upright & below


def _checked(
    xyz: ArrayLike, up_hint: ArrayLike, viewpoint: ArrayLike
) -> tuple[Float64Array, Float64Array, Float64Array]:
    points, up = np.asarray(xyz, np.float64), np.asarray(up_hint, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidValueError(f"ground: expected points of shape (N, 3), got {points.shape}")
    length = float(np.linalg.norm(up))
    if up.shape != (3,) or not (np.isfinite(length) and length > 0):
        raise InvalidValueError(f"ground: expected a direction of three numbers for up, got {up}")
    try:
        views = np.broadcast_to(np.asarray(viewpoint, np.float64), points.shape)
    except ValueError as error:
        raise InvalidValueError(f"ground: expected a viewpoint of shape (3,) or {points.shape}") from error
    finite = np.isfinite(points).all(axis=1)
    return points[finite], views[finite], up / length


def _lowest_plane(
    points: Float64Array, tolerance: Float64Array, cone: _Cone, least: float, rng: np.random.Generator
) -> tuple[Float64Array, float] | None:
    """The best plane, or a well-supported one below it, as long as there is one."""
    plane = _best_plane(points, tolerance, cone, least, rng)
    while plane is not None:
        below = points @ plane[0] - plane[1] < -(STEP_M + tolerance)
        if np.count_nonzero(below) < least:
            return plane
        points, tolerance = points[below], tolerance[below]  # fewer each time: this ends
        lower = _best_plane(points, tolerance, cone, least, rng)
        if lower is None:
            return plane
        plane = lower
    return None


def _best_plane(
    points: Float64Array, tolerance: Float64Array, cone: _Cone, least: float, rng: np.random.Generator
) -> tuple[Float64Array, float] | None:
    """The plane with the most inliers, refined; None if none has `least` of them."""
    normals, offsets = _hypotheses(points, cone, rng)
    sample = rng.integers(0, len(points), SAMPLE)
    planes = np.column_stack((normals, -offsets)).astype(np.float32)
    sampled = np.column_stack((points[sample], np.ones(SAMPLE))).astype(np.float32)
    inliers = np.abs(planes @ sampled.T) <= tolerance[sample].astype(np.float32)
    best = np.argsort(-np.count_nonzero(inliers, axis=1), kind="stable")[:KEPT]
    normals, offsets, inliers = normals[best], offsets[best], inliers[best]
    while len(normals):
        refined = _refined(normals[0], offsets[0], points, tolerance, cone, least)
        if refined is not None:
            return refined
        # this one is a cut through a wall or has too few points, and so are those that share its points
        shared = np.count_nonzero(inliers & inliers[0], axis=1)
        other = shared < 0.5 * np.count_nonzero(inliers[0])
        normals, offsets, inliers = normals[other], offsets[other], inliers[other]
    return None


def _hypotheses(
    points: Float64Array, cone: _Cone, rng: np.random.Generator
) -> tuple[Float64Array, Float64Array]:
    """Planes (M, 3), (M,) through random triples of points, those that may be ground."""
    a, b, c = (points[i] for i in rng.integers(0, len(points), (3, HYPOTHESES)))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    real = length > 1e-12  # two points the same, or three in a line
    normals = normals[real] / length[real, None]
    normals[normals @ cone.up < 0] *= -1
    offsets = np.einsum("ij,ij->i", normals, a[real])
    may_be = cone.holds(normals, offsets)
    return normals[may_be], offsets[may_be]


def _refined(
    normal: Float64Array,
    offset: float,
    points: Float64Array,
    tolerance: Float64Array,
    cone: _Cone,
    least: float,
) -> tuple[Float64Array, float] | None:
    """Least-squares plane of the inliers, near points counting more; None if it is no ground after all."""
    for _ in range(6):
        on = np.abs(points @ normal - offset) <= tolerance
        if np.count_nonzero(on) < least:
            return None
        weights = tolerance[on] ** -2
        weights /= weights.sum()
        mean = weights @ points[on]
        apart = points[on] - mean
        variances, axes = np.linalg.eigh((apart * weights[:, None]).T @ apart)  # smallest first
        normal = np.copysign(1.0, axes[:, 0] @ cone.up) * axes[:, 0]
        offset = float(normal @ mean)
        if not cone.holds(normal[None], np.array([offset]))[0]:
            return None
    spread, height = np.sqrt(np.maximum(variances[1], 0.0)), np.mean(cone.views @ normal) - offset
    wide = spread >= max(MIN_SPREAD * np.median(tolerance[on]), MIN_SPREAD_RELATIVE * height)
    return (normal, offset) if wide else None
