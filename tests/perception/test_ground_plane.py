"""The ground plane: an analytic garden gives the mount back, and nothing but the ground passes for ground."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose, deproject, mount_pose
from swardmap.labels import GRASS, OTHER
from swardmap.perception.ground_plane import Plane, estimate_mount, fit_ground_plane, level_pose
from swardmap.synth.analytic import AnalyticSource, Box, Scene, StereoNoise, garden_scene, lane_poses, render
from swardmap.types import Frame

OPTICAL_UP = (0.0, -1.0, 0.0)
CAMERA = Intrinsics(320, 240, 230.0, 230.0, 159.5, 119.5)


def seen_frame(
    scene: Scene, T_map_camera: Pose, labels: bool = False, noise: StereoNoise | None = None
) -> Frame:
    frame = next(iter(AnalyticSource(scene, (T_map_camera,), CAMERA, noise=noise or StereoNoise())))
    return frame if labels else replace(frame, labels=None, label_set=None)


def mount_errors(T_base_camera: Pose, truth: Pose) -> tuple[float, float]:
    """Of the height in metres, and the angle between the two in degrees."""
    turn = T_base_camera.matrix[:3, :3].T @ truth.matrix[:3, :3]
    angle = np.rad2deg(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    return abs(float(T_base_camera.position_m[2] - truth.position_m[2])), float(angle)


def slab(
    low: tuple[float, float, float], high: tuple[float, float, float], n: int, seed: int = 0
) -> NDArray[np.float64]:
    return np.random.default_rng(seed).uniform(low, high, (n, 3))


@pytest.mark.parametrize("labels", [True, False])
@pytest.mark.parametrize(
    ("height_m", "pitch_deg", "roll_deg"),
    [(0.9, 20, 0), (0.3, 5, 4), (0.5, -5, -3), (1.2, 45, 8), (1.5, 57, 0), (2.0, 10, -10)],
)
def test_the_mount_of_an_analytic_garden_comes_back(
    height_m: float, pitch_deg: float, roll_deg: float, labels: bool
) -> None:
    truth = mount_pose(height_m, pitch_deg, roll_deg)
    seen = seen_frame(garden_scene(1), Pose("map", "camera", truth.matrix), labels)
    T_base_camera = estimate_mount(seen)
    assert (T_base_camera.parent, T_base_camera.child) == ("base", "camera")
    height_error, angle_error = mount_errors(T_base_camera, truth)
    assert height_error < 0.01
    assert angle_error < 0.2
    np.testing.assert_array_equal(T_base_camera.position_m[:2], 0)
    forward = T_base_camera.matrix[:3, 2]
    assert forward[0] > 0
    assert abs(forward[1]) < 1e-12


def test_the_mount_is_the_same_each_time() -> None:
    frame = seen_frame(garden_scene(2), lane_poses(1)[0])
    np.testing.assert_array_equal(estimate_mount(frame).matrix, estimate_mount(frame).matrix)


def test_heading_and_place_do_not_change_the_mount() -> None:
    far = lane_poses(1, start_m=(2.0, 0.4), heading_deg=20.0, height_m=0.7, pitch_deg=15.0)[0]
    height_error, angle_error = mount_errors(
        estimate_mount(seen_frame(garden_scene(), far)), mount_pose(0.7, 15.0)
    )
    assert height_error < 0.01
    assert angle_error < 0.2


@pytest.mark.parametrize("pitch_deg", [-30.0, -40.0, -50.0, -80.0])
@pytest.mark.parametrize("labels", [True, False])
def test_a_camera_that_sees_no_ground_is_refused(pitch_deg: float, labels: bool) -> None:
    pose = lane_poses(1, pitch_deg=pitch_deg)[0]
    with pytest.raises(InputError, match=r"no ground found.*set mount\.height_m"):
        estimate_mount(seen_frame(garden_scene(), pose, labels))


@pytest.mark.parametrize("distance_m", [0.7, 1.5, 4.0])
@pytest.mark.parametrize("pitch_deg", [-20.0, 0.0])
def test_a_wall_is_no_ground(distance_m: float, pitch_deg: float) -> None:
    wall = Scene((Box((distance_m + 0.5, 0.0), (1.0, 80.0, 30.0)),))
    pose = mount_pose(12.0, pitch_deg, parent="map")  # high up: nothing but wall in view
    with pytest.raises(InputError, match="no plane below the camera"):
        estimate_mount(seen_frame(wall, pose))


def test_the_floor_wins_over_a_table_that_fills_the_view() -> None:
    table = Scene((Box((1.3, 0.0), (1.4, 3.0, 0.7)),))
    truth = mount_pose(1.3, 25.0)
    frame = seen_frame(table, Pose("map", "camera", truth.matrix))
    heights = truth.apply(deproject(frame.depth_m, frame.intrinsics)[np.isfinite(frame.depth_m)])[:, 2]
    on_table, on_floor = np.mean(np.abs(heights - 0.7) < 0.05), np.mean(np.abs(heights) < 0.05)
    assert on_table > 1.5 * on_floor, "the test needs a table larger than the floor seen"
    height_error, angle_error = mount_errors(estimate_mount(frame), truth)
    assert height_error < 0.01
    assert angle_error < 0.2


def test_true_labels_say_what_is_ground() -> None:
    """A raised lawn that is labelled as such wins over the bare floor below it."""
    truth = mount_pose(1.3, 25.0, parent="map")
    frame = render(Scene((Box((1.3, 0.0), (1.4, 3.0, 0.7)),)), CAMERA, truth)
    heights = truth.apply(deproject(frame.depth_m, frame.intrinsics))[..., 2]
    assert estimate_mount(replace(frame, labels=None)).position_m[2] == pytest.approx(1.3, abs=0.005)
    labels = np.where(np.abs(heights - 0.7) < 0.02, GRASS.id, OTHER.id).astype(np.uint8)
    assert estimate_mount(replace(frame, labels=labels)).position_m[2] == pytest.approx(0.6, abs=0.005)
    few = np.where(np.arange(240)[:, None] < 1, labels, OTHER.id).astype(np.uint8)
    assert estimate_mount(replace(frame, labels=few)).position_m[2] == pytest.approx(1.3, abs=0.005)


def test_near_ground_counts_more_than_far_ground() -> None:
    """Weights are 1 / tolerance^2: 0.0275 m at a range of 1.5 m and 0.068 m at 9.5 m, so 0.14 of 4 cm."""
    angle = np.linspace(0, 2 * np.pi, 4_000, endpoint=False)
    ring = np.stack((np.cos(angle), np.sin(angle), np.zeros(4_000)), axis=-1)
    points = np.concatenate((1.5 * ring, 9.5 * ring + [0, 0, 0.04]))
    plane = fit_ground_plane(points, (0, 0, 1), viewpoint=(0, 0, 0.3))
    assert plane.offset_m == pytest.approx(0.0057, abs=0.0005)


def test_what_is_too_small_below_the_ground_does_not_win() -> None:
    points = np.concatenate((slab((-2, -2, 0), (2, 2, 0), 9_500), slab((0, 0, -1), (1, 1, -1), 500)))
    plane = fit_ground_plane(points, (0, 0, 1), viewpoint=(0, 0, 1))
    assert plane.offset_m == pytest.approx(0, abs=1e-9)
    assert plane.inlier_share == pytest.approx(0.95)
    deeper = fit_ground_plane(points, (0, 0, 1), viewpoint=(0, 0, 1), min_share=0.04)
    assert deeper.offset_m == pytest.approx(-1, abs=1e-9)


def test_a_ceiling_is_no_ground() -> None:
    ceiling = slab((-2, -2, 2.4), (2, 2, 2.4), 20_000)
    with pytest.raises(InputError, match="no plane below the camera"):
        fit_ground_plane(ceiling, (0, 0, 1), viewpoint=(0, 0, 1))
    both = np.concatenate((ceiling, slab((-2, -2, 0), (2, 2, 0), 4_000)))
    assert fit_ground_plane(both, (0, 0, 1), viewpoint=(0, 0, 1)).offset_m == pytest.approx(0, abs=1e-9)


def test_the_ground_must_be_within_the_angle_of_up() -> None:
    slope = slab((-3, -3, 0), (3, 3, 0), 5_000)
    slope[:, 2] = np.tan(np.deg2rad(30)) * slope[:, 0]
    plane = fit_ground_plane(slope, (0, 0, 2.5), viewpoint=(0, 0, 3), max_tilt_deg=31)
    np.testing.assert_allclose(plane.normal, [-0.5, 0, np.cos(np.deg2rad(30))], atol=1e-9)
    with pytest.raises(InputError, match="within 29 degrees"):
        fit_ground_plane(slope, (0, 0, 1), viewpoint=(0, 0, 3), max_tilt_deg=29)


def test_each_point_may_have_its_own_viewpoint() -> None:
    points = np.concatenate((slab((0, -1, 0), (3, 1, 0), 3_000), slab((100, -1, 0), (103, 1, 0), 3_000)))
    views = np.repeat([[0.0, 0.0, 1.0], [100.0, 0.0, 1.0]], 3_000, axis=0)
    assert fit_ground_plane(points, (0, 0, 1), views).inlier_share == 1.0


def test_the_plane_agrees_with_least_squares_of_numpy() -> None:
    """On exact inliers and one range for all, the plane is the total least squares plane: an SVD."""
    rng = np.random.default_rng(3)
    angle = rng.uniform(0, 2 * np.pi, 4_000)
    points = np.stack((2 * np.cos(angle), 2 * np.sin(angle), rng.normal(0, 0.004, 4_000)), axis=-1)
    expected = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2]
    plane = fit_ground_plane(points, (0, 0, 1), viewpoint=(0, 0, 5))
    np.testing.assert_allclose(plane.normal, expected * np.sign(expected[2]), atol=2e-5)


@pytest.mark.parametrize(
    ("points", "up", "view"),
    [(np.zeros((5, 2)), (0, 0, 1), (0, 0, 0)), (np.zeros((5, 3)), (0, 0, 0), (0, 0, 0)),
     (np.zeros((5, 3)), (0, 0, np.nan), (0, 0, 0)), (np.zeros((5, 3)), (0, 1), (0, 0, 0)),
     (np.zeros((5, 3)), (0, 0, 1), np.zeros((4, 3)))],
)  # fmt: skip
def test_wrong_arguments_are_named(points: NDArray[np.float64], up: object, view: object) -> None:
    with pytest.raises(InvalidValueError, match="ground: expected"):
        fit_ground_plane(points, up, view)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "points",
    [np.zeros((0, 3)), np.full((5_000, 3), np.nan), np.zeros((5_000, 3)),
     np.outer(np.linspace(0, 1, 5_000), [1.0, 2.0, 0.0])],
)  # fmt: skip
def test_points_that_span_no_plane_are_refused(points: NDArray[np.float64]) -> None:
    with pytest.raises(InputError, match="no ground found"):
        fit_ground_plane(points, (0, 0, 1), viewpoint=(0, 0, 1))


unit = st.floats(-1, 1)


@given(st.tuples(unit, unit, unit).filter(lambda v: np.linalg.norm(v) > 0.1), st.floats(-50, 50))
@example((0.0, 1e-06, -1.0), 0.0)  # all but upside down
def test_levelling_puts_the_plane_at_zero_by_the_smallest_turn(
    direction: tuple[float, float, float], offset: float
) -> None:
    normal = np.array(direction) / np.linalg.norm(direction)
    T_level_map = level_pose(Plane(normal, offset, 1.0))
    assert (T_level_map.parent, T_level_map.child) == ("level", "map")
    np.testing.assert_allclose(T_level_map.matrix[:3, :3] @ normal, [0, 0, 1], atol=1e-7)
    points = np.random.default_rng(0).normal(size=(20, 3))
    heights = Plane(normal, offset, 1.0).height_m(points)
    np.testing.assert_allclose(T_level_map.apply(points)[:, 2], heights, atol=1e-6)
    turned = np.arccos(np.clip((np.trace(T_level_map.matrix[:3, :3]) - 1) / 2, -1, 1))
    assert turned == pytest.approx(np.arccos(np.clip(normal[2], -1, 1)), abs=1e-4)


@pytest.mark.parametrize("tilt", [0.0, 1e-12, 1e-6, 1e-5, 1e-4, 1e-3])
def test_levelling_what_is_upside_down(tilt: float) -> None:
    normal = np.array([np.sin(tilt), 0, -np.cos(tilt)])
    T_level_map = level_pose(Plane(normal, 0.5, 1.0))
    np.testing.assert_allclose(T_level_map.matrix[:3, :3] @ normal, [0, 0, 1], atol=1e-4)


def test_a_level_map_stays_as_it_is() -> None:
    np.testing.assert_array_equal(level_pose(Plane(np.array([0.0, 0, 1]), 0.0, 1.0)).matrix, np.eye(4))


@settings(max_examples=10, deadline=None)
@given(st.floats(-170, 170), st.floats(-40, 40), st.floats(-40, 40))
def test_the_ground_turns_with_the_points(yaw: float, pitch: float, roll: float) -> None:
    turn = mount_pose(0.0, pitch, roll, yaw).matrix[:3, :3]
    points = np.concatenate((slab((-2, -2, 0), (2, 2, 0.01), 3_000), slab((2, -2, 0), (2, 2, 2), 3_000)))
    plane = fit_ground_plane(points, (0, 0, 1), (0, 0, 1))
    turned = fit_ground_plane(points @ turn.T, turn @ [0, 0, 1], turn @ [0, 0, 1])
    np.testing.assert_allclose(turned.normal, turn @ plane.normal, atol=1e-3)
    assert turned.offset_m == pytest.approx(plane.offset_m, abs=1e-3)


def test_a_plane_is_checked() -> None:
    for normal, offset, share in (
        ([0, 0, 2], 0.0, 0.5),
        ([0, 0, 1], np.nan, 0.5),
        ([0, 0, 1], 0.0, 1.5),
        ([np.nan, 0, 1], 0.0, 0.5),
    ):
        with pytest.raises(InvalidValueError, match="plane: expected"):
            Plane(np.array(normal, np.float64), offset, share)


def test_ideal_depth_gives_the_mount_to_a_millimetre() -> None:
    truth = mount_pose(0.9, 20.0, parent="map")
    T_base_camera = estimate_mount(render(Scene(), CAMERA, truth, exact=True))
    height_error, angle_error = mount_errors(T_base_camera, truth)
    assert height_error < 1e-4
    assert angle_error < 1e-2
