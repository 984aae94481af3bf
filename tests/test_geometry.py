"""Poses and the pinhole camera, against OpenCV and SciPy."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from swardmap.errors import FrameMismatchError, InvalidValueError
from swardmap.geometry import (
    Intrinsics,
    Pose,
    deproject,
    interpolate_pose,
    mount_pose,
    project,
    rotation_from_quaternion,
    transform_points,
)

seeds = st.integers(0, 2**32 - 1)


def random_pose(seed: int, parent: str = "map", child: str = "camera") -> Pose:
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    matrix[:3, 3] = rng.uniform(-10, 10, 3)
    return Pose(parent, child, matrix)


@given(seeds)
def test_pose_and_inverse_cancel(seed: int) -> None:
    T = random_pose(seed)
    np.testing.assert_allclose((T @ T.inverse()).matrix, np.eye(4), atol=1e-12)
    points = np.random.default_rng(seed).uniform(-5, 5, (7, 3))
    np.testing.assert_allclose(T.inverse().apply(T.apply(points)), points, atol=1e-12)


@given(seeds)
def test_float32_transform_is_the_float64_one_rounded(seed: int) -> None:
    T = random_pose(seed)
    points = np.random.default_rng(seed).uniform(-8, 8, (50, 3)).astype(np.float32)
    np.testing.assert_allclose(transform_points(points, T), T.apply(points), atol=1e-5)


def test_only_frames_that_meet_are_chained() -> None:
    T_map_base, T_odom_camera = random_pose(0, "map", "base"), random_pose(1, "odom", "camera")
    with pytest.raises(FrameMismatchError, match="expected the second to start at 'base'"):
        T_map_base @ T_odom_camera
    chained = T_map_base @ random_pose(2, "base", "camera")
    assert (chained.parent, chained.child) == ("map", "camera")


@pytest.mark.parametrize(
    ("matrix", "match"),
    [(np.eye(3), "4x4"), (np.full((4, 4), np.nan), "NaN"), (2 * np.eye(4), "rotation"),
     (np.diag([1, 1, -1, 1]), "determinant"), (np.ones((4, 4)) * np.inf, "infinity")],
)  # fmt: skip
def test_impossible_poses_are_refused(matrix: np.ndarray, match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        Pose("map", "camera", matrix)


def test_last_row_is_checked() -> None:
    matrix = np.eye(4)
    matrix[3, 0] = 0.1
    with pytest.raises(InvalidValueError, match="last row"):
        Pose("map", "camera", matrix)


@given(seeds)
def test_quaternions_are_scipys_and_q_equals_minus_q(seed: int) -> None:
    rotation = Rotation.random(random_state=seed)
    q = rotation.as_quat()
    np.testing.assert_allclose(rotation_from_quaternion(q), rotation.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rotation_from_quaternion(-q), rotation.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("q", [[0, 0, 0, 0], [0, 0, 0, 2], [float("nan"), 0, 0, 1], [0, 0, 1]])
def test_quaternions_that_are_not_rotations_are_refused(q: list[float]) -> None:
    with pytest.raises(InvalidValueError, match="quaternion"):
        Pose.from_quaternion("map", "base", (0, 0, 0), q)


@given(seeds, st.floats(0, 1))
def test_interpolation_is_scipys_slerp(seed: int, fraction: float) -> None:
    a, b = random_pose(seed), random_pose(seed + 1)
    turn = Rotation.from_matrix(a.matrix[:3, :3]).inv() * Rotation.from_matrix(b.matrix[:3, :3])
    if turn.magnitude() > 3.1:  # both ways round are equally short
        return
    between = interpolate_pose(a, b, fraction)
    slerp = Slerp([0, 1], Rotation.from_matrix([a.matrix[:3, :3], b.matrix[:3, :3]]))
    np.testing.assert_allclose(between.matrix[:3, :3], slerp(fraction).as_matrix(), atol=1e-9)
    np.testing.assert_allclose(between.position_m, (1 - fraction) * a.position_m + fraction * b.position_m)


def test_interpolation_of_other_frames_is_refused() -> None:
    with pytest.raises(FrameMismatchError, match="cannot interpolate"):
        interpolate_pose(random_pose(0), random_pose(1, "odom"), 0.5)


@settings(deadline=None)
@given(seeds)
def test_projection_is_opencvs_and_undoes_deprojection(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = Intrinsics(31, 23, *rng.uniform(10, 500, 2), *rng.uniform(0, 30, 2))
    depth = rng.uniform(0.3, 9, (23, 31)).astype(np.float32)
    xyz = deproject(depth, camera)
    uv, z = project(xyz, camera)
    v, u = np.mgrid[:23, :31]
    np.testing.assert_allclose(uv[..., 0], u, atol=2e-3)
    np.testing.assert_allclose(uv[..., 1], v, atol=2e-3)
    np.testing.assert_array_equal(z, depth)
    want, _ = cv2.projectPoints(
        xyz.reshape(-1, 1, 3).astype(np.float64), np.zeros(3), np.zeros(3), camera.matrix, np.zeros(4)
    )
    np.testing.assert_allclose(uv.reshape(-1, 2), want.reshape(-1, 2), atol=1e-6)


def test_equation_1_for_one_pixel() -> None:
    camera = Intrinsics(640, 480, 600.0, 500.0, 320.0, 240.0)
    depth = np.full((480, 640), np.nan, np.float32)
    depth[340, 620] = 2.0
    np.testing.assert_allclose(deproject(depth, camera)[340, 620], [1.0, 0.4, 2.0], rtol=1e-6)
    assert np.isnan(deproject(depth, camera)[0, 0, 2])


def test_points_behind_the_camera_are_not_in_the_image() -> None:
    uv, z = project(np.array([[0.1, 0.2, -1.0], [0, 0, 0]]), Intrinsics(4, 4, 1.0, 1.0, 0.0, 0.0))
    assert np.isnan(uv).all()
    assert z.tolist() == [-1, 0]


@pytest.mark.parametrize(
    ("values", "match"),
    [((0, 480, 600, 600, 320, 240), "positive size"), ((640, 480, 0, 600, 320, 240), "focal"),
     ((640, 480, 600, -1, 320, 240), "focal"), ((640, 480, float("nan"), 600, 320, 240), "finite")],
)  # fmt: skip
def test_impossible_cameras_are_refused(values: tuple[float, ...], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        Intrinsics(*values)  # type: ignore[arg-type]


def test_scaling_keeps_the_corners_of_the_image() -> None:
    camera = Intrinsics(640, 480, 600.0, 610.0, 321.0, 239.0)
    half = camera.scaled_to(320, 240)
    for u, u_half in ((-0.5, -0.5), (639.5, 319.5)):
        assert (u - camera.cx) / camera.fx == pytest.approx((u_half - half.cx) / half.fx)
    back = half.scaled_to(640, 480)
    assert (back.cx, back.cy, back.fx) == pytest.approx((camera.cx, camera.cy, camera.fx))


def test_mount_looks_where_it_says() -> None:
    T = mount_pose(0.9, 20.0)
    np.testing.assert_allclose(
        T.apply([0, 0, 1]), [np.cos(np.deg2rad(20)), 0, 0.9 - np.sin(np.deg2rad(20))], atol=1e-12
    )
    right = T.apply([1, 0, 0]) - T.position_m
    np.testing.assert_allclose(right, [0, -1, 0], atol=1e-12)  # y is left
    to_the_left = mount_pose(0.9, 0.0, yaw_deg=90.0)
    np.testing.assert_allclose(to_the_left.apply([0, 0, 1]), [0, 1, 0.9], atol=1e-12)
    right_side_down = mount_pose(0.9, 0.0, roll_deg=10.0)
    assert right_side_down.apply([1, 0, 0])[2] < 0.9
