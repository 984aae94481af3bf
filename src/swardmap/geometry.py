"""Frames, poses and the pinhole camera. Conventions: docs/conventions.md (REP-103, REP-105, REP-118)."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.errors import FrameMismatchError, InvalidValueError

Float64Array = NDArray[np.float64]
Float32Array = NDArray[np.float32]

LENGTH_TOLERANCE, ANGLE_TOLERANCE = 1.1e-4, 1e-4
"""How far a rotation times its transpose may be off the identity: poses from text files pass."""

R_BODY_OPTICAL: Float64Array = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""Rotation of an optical frame (z forward, x right, y down) seen from its body frame (x forward, z up)."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Rigid transform `T_parent_child`: p_parent = T_parent_child @ p_child.

    Attributes:
        parent, child: frame names, such as `map` and `camera`.
        matrix: (4, 4) float64; rotation checked to 1e-4, so that poses from text files pass.
    """

    parent: str
    child: str
    matrix: Float64Array

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, np.float64)
        object.__setattr__(self, "matrix", matrix)
        name = f"pose {self.parent} <- {self.child}"
        if matrix.shape != (4, 4):
            raise InvalidValueError(f"{name}: expected a 4x4 matrix, got shape {matrix.shape}")
        rows = matrix.tolist()  # sixteen numbers: plain Python is faster than arrays
        if not all(map(math.isfinite, matrix.ravel().tolist())):
            raise InvalidValueError(f"{name}: expected finite numbers, got NaN or infinity")
        (a, b, c, _), (d, e, f, _), (g, h, i, _), last = rows
        lengths = a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i
        angles = a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i
        determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        if (
            any(abs(length - 1) > LENGTH_TOLERANCE for length in lengths)
            or any(abs(angle) > ANGLE_TOLERANCE for angle in angles)
            or determinant < 0
        ):
            raise InvalidValueError(
                f"{name}: expected a rotation in the upper left 3x3 (orthonormal, determinant +1), "
                f"got\n{matrix[:3, :3]}"
            )
        if last != [0, 0, 0, 1]:
            raise InvalidValueError(f"{name}: expected the last row 0 0 0 1, got {matrix[3]}")
        matrix.flags.writeable = False

    @classmethod
    def identity(cls, parent: str, child: str) -> "Pose":
        """The pose of two frames that coincide."""
        return cls(parent, child, np.eye(4))

    @classmethod
    def from_quaternion(
        cls, parent: str, child: str, translation_m: ArrayLike, quaternion_xyzw: ArrayLike
    ) -> "Pose":
        """Pose from a translation in metres and a quaternion in ROS order (x, y, z, w).

        Raises:
            InvalidValueError: for a quaternion whose length is not 1 within 1 %.
        """
        matrix = np.eye(4)
        matrix[:3, :3] = rotation_from_quaternion(quaternion_xyzw)
        matrix[:3, 3] = translation_m
        return cls(parent, child, matrix)

    def __matmul__(self, other: "Pose") -> "Pose":
        """Chain two poses: T_a_b @ T_b_c = T_a_c.

        Raises:
            FrameMismatchError: if the inner frames differ.
        """
        if self.child != other.parent:
            raise FrameMismatchError(
                f"cannot chain {self.parent} <- {self.child} with {other.parent} <- {other.child}: "
                f"expected the second to start at '{self.child}'"
            )
        return Pose(self.parent, other.child, self.matrix @ other.matrix)

    def inverse(self) -> "Pose":
        """T_child_parent."""
        rotation, translation = self.matrix[:3, :3], self.matrix[:3, 3]
        matrix = np.eye(4)
        matrix[:3, :3] = rotation.T
        matrix[:3, 3] = -rotation.T @ translation
        return Pose(self.child, self.parent, matrix)

    def of_child(self, child: str) -> "Pose":
        """The same pose of a frame that is named otherwise, such as the optical frame in a bag."""
        return Pose(self.parent, child, self.matrix)

    def apply(self, xyz: ArrayLike) -> Float64Array:
        """Points of the child frame, expressed in the parent frame.

        Args:
            xyz: (..., 3) metres.

        Returns:
            (..., 3) float64.
        """
        points = np.asarray(xyz, np.float64)
        moved: Float64Array = points @ self.matrix[:3, :3].T + self.matrix[:3, 3]
        return moved

    @property
    def position_m(self) -> Float64Array:
        """(3,) origin of the child frame in the parent frame."""
        return self.matrix[:3, 3]

    @property
    def yaw_rad(self) -> float:
        """Heading of the child's x axis in the parent's x-y plane."""
        return float(np.arctan2(self.matrix[1, 0], self.matrix[0, 0]))


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Pinhole camera in pixels; (0, 0) is the centre of the top left pixel.

    Attributes:
        width, height: image size in pixels.
        fx, fy: focal lengths in pixels, positive.
        cx, cy: principal point in pixels.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if self.width <= 0 or self.height <= 0:
            raise InvalidValueError(f"intrinsics: expected a positive size, got {self.width} x {self.height}")
        if not np.isfinite([self.fx, self.fy, self.cx, self.cy]).all():
            raise InvalidValueError(f"intrinsics: expected finite numbers, got {self}")
        if self.fx <= 0 or self.fy <= 0:
            raise InvalidValueError(
                f"intrinsics: expected positive focal lengths, got fx={self.fx}, fy={self.fy} "
                "(CameraInfo with K all zero means the camera is not calibrated)"
            )

    @classmethod
    def from_matrix(cls, K: ArrayLike, width: int, height: int) -> "Intrinsics":
        """Intrinsics from a 3x3 (or 3x4) camera matrix without skew."""
        k = np.asarray(K, np.float64)
        if k.ndim != 2 or k.shape[0] != 3 or k.shape[1] not in (3, 4):
            raise InvalidValueError(f"camera matrix: expected 3x3 or 3x4, got shape {k.shape}")
        return cls(width, height, float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]))

    def centered(self, advice: str = "these intrinsics are of another image size") -> "Intrinsics":
        """The same, held to look through its own image; numbers of another size do not.

        Raises:
            InvalidValueError: if the principal point lies outside the image; `advice` says what to do.
        """
        if not (0 <= self.cx < self.width and 0 <= self.cy < self.height):
            raise InvalidValueError(
                f"expected a principal point inside the image of {self.width} x {self.height} pixels, "
                f"got {self.cx:g}, {self.cy:g}: {advice}"
            )
        return self

    @property
    def matrix(self) -> Float64Array:
        """K, (3, 3) float64."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])

    def scaled_to(self, width: int, height: int) -> "Intrinsics":
        """Intrinsics of the same camera for an image resampled to another size (keeps pixel centres)."""
        sx, sy = width / self.width, height / self.height
        return Intrinsics(
            width,
            height,
            self.fx * sx,
            self.fy * sy,
            (self.cx + 0.5) * sx - 0.5,
            (self.cy + 0.5) * sy - 0.5,
        )

    def ray_tables(self) -> tuple[Float32Array, Float32Array]:
        """K^-1 [u v 1] at depth 1 (Eq. 1), split: (width,) x per column and (height,) y per row, float32."""
        return _ray_tables(self)


@lru_cache(maxsize=16)  # of a camera it is asked for with every frame
def _ray_tables(intrinsics: Intrinsics) -> tuple[Float32Array, Float32Array]:
    k = intrinsics
    x = ((np.arange(k.width) - k.cx) / k.fx).astype(np.float32)
    y = ((np.arange(k.height) - k.cy) / k.fy).astype(np.float32)
    x.flags.writeable = y.flags.writeable = False
    return x, y


def deproject(depth_m: NDArray[np.floating], intrinsics: Intrinsics) -> Float32Array:
    """Back-project a depth image: Eq. 1, [x y z] = D(u, v) K^-1 [u v 1].

    Args:
        depth_m: (H, W) depth along the optical axis in metres (REP-118); NaN stays NaN.
        intrinsics: of the depth image.

    Returns:
        (H, W, 3) float32 in the camera's optical frame.
    """
    if depth_m.shape != (intrinsics.height, intrinsics.width):
        raise InvalidValueError(
            f"depth image: expected {intrinsics.height} x {intrinsics.width} as in the intrinsics, "
            f"got {depth_m.shape}"
        )
    x, y = intrinsics.ray_tables()
    z = depth_m.astype(np.float32, copy=False)
    return np.stack((z * x[None, :], z * y[:, None], z), axis=-1)


def transform_points(xyz: Float32Array, T_parent_child: Pose) -> Float32Array:
    """Move points to the parent frame in float32, one rounding after each operation.

    The order of operations is fixed, and the compiled kernel has the same, so that both roads from
    depth to grid agree bit for bit; `Pose.apply` is the float64 form.

    Args:
        xyz: (..., 3) float32 in the child frame.
        T_parent_child: the pose.

    Returns:
        (..., 3) float32.
    """
    T = T_parent_child.matrix.astype(np.float32)
    x, y, z = xyz[..., 0], xyz[..., 1], xyz[..., 2]
    return np.stack([T[i, 0] * x + T[i, 1] * y + T[i, 2] * z + T[i, 3] for i in range(3)], axis=-1)


def project(xyz: ArrayLike, intrinsics: Intrinsics) -> tuple[Float64Array, Float64Array]:
    """Project points of the optical frame into the image.

    Args:
        xyz: (..., 3) metres.
        intrinsics: of the image.

    Returns:
        uv (..., 2) in pixels, NaN for points that are not in front of the camera, and their depth
        (...) in metres. Pixels outside the image are returned as they fall.
    """
    points = np.asarray(xyz, np.float64)
    z = points[..., 2]
    safe_z = np.where(z > 0, z, np.nan)
    u = intrinsics.fx * points[..., 0] / safe_z + intrinsics.cx
    v = intrinsics.fy * points[..., 1] / safe_z + intrinsics.cy
    return np.stack((u, v), axis=-1), z


def rotation_from_quaternion(quaternion_xyzw: ArrayLike) -> Float64Array:
    """(3, 3) rotation from a quaternion in ROS order (x, y, z, w), normalised first.

    Raises:
        InvalidValueError: if its length is not 1 within 1 % (an all-zero quaternion is a common fault).
    """
    q = np.asarray(quaternion_xyzw, np.float64)
    length = math.hypot(*q.ravel())  # without the overflow warning of np.linalg.norm
    if q.shape != (4,) or not abs(length - 1.0) < 0.01:
        raise InvalidValueError(f"quaternion: expected four numbers of length 1, got {q}")
    x, y, z, w = q / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def mount_pose(
    height_m: float,
    pitch_deg: float,
    roll_deg: float = 0.0,
    yaw_deg: float = 0.0,
    xy_m: tuple[float, float] = (0.0, 0.0),
    parent: str = "base",
    child: str = "camera",
) -> Pose:
    """Pose of a camera's optical frame on a robot, from what one measures with a tape and a level.

    Args:
        height_m: of the camera above the ground.
        pitch_deg: how far the camera looks down (positive) from the horizontal.
        roll_deg: about the viewing direction, positive right side down.
        yaw_deg: of the viewing direction, positive to the left of forward.
        xy_m: position forward and left of the base.
        parent: name of the robot's frame.
        child: name of the optical frame.
    """
    roll, pitch, yaw = np.deg2rad([roll_deg, pitch_deg, yaw_deg])
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    matrix = np.eye(4)
    matrix[:3, :3] = rz @ ry @ rx @ R_BODY_OPTICAL
    matrix[:3, 3] = (*xy_m, height_m)
    return Pose(parent, child, matrix)


def interpolate_pose(before: Pose, after: Pose, fraction: float) -> Pose:
    """Pose between two poses of the same frames: linear in position, shortest arc in rotation.

    Args:
        before: pose at fraction 0.
        after: pose at fraction 1, of the same two frames.
        fraction: share of the way, 0..1.
    """
    if (before.parent, before.child) != (after.parent, after.child):
        raise FrameMismatchError(
            f"cannot interpolate {before.parent} <- {before.child} towards {after.parent} <- {after.child}"
        )
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(before.matrix[:3, :3].T @ after.matrix[:3, :3]).as_rotvec()
    matrix = np.eye(4)
    matrix[:3, :3] = before.matrix[:3, :3] @ Rotation.from_rotvec(fraction * turn).as_matrix()
    matrix[:3, 3] = (1 - fraction) * before.position_m + fraction * after.position_m
    return Pose(before.parent, before.child, matrix)
