"""The truth by heights above the true ground: no slope or datum moves it, and what is left out is counted."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.config import Config
from swardmap.errors import InvalidValueError
from swardmap.eval.frame_maps import FrameMaps
from swardmap.eval.maps import compare_frame, spec_of, true_segmentation
from swardmap.eval.safety import unjudged
from swardmap.eval.truth import FEWEST_LAWN_PIXELS, TEXEL_M, dense_map, fitted_ground, true_pixels
from swardmap.geometry import Intrinsics, Pose, deproject, transform_points
from swardmap.grid import classify_cells, count_points
from swardmap.io.sources.truth import FrameTruth, GroundRaster
from swardmap.labels import GRASS, OTHER, MapClass
from swardmap.perception.cloud import crop_height, crop_range, label_cloud
from swardmap.synth.analytic import garden_scene, lane_poses, render
from swardmap.types import Frame

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
FLAT = FrameTruth(ground=GroundRaster((-1.0, -1.0), 1.0, np.zeros((2, 2), np.float32)))


def pose_of(frame: Frame) -> Pose:
    assert frame.T_map_camera is not None
    return frame.T_map_camera


@pytest.fixture(scope="module")
def frame() -> Frame:
    return render(garden_scene(1), SMALL, lane_poses(1)[0], 0, "one")


def moved(frame: Frame, slope_deg: float, datum_m: float) -> Frame:
    """The same view in a world that is tilted about its y axis and lifted."""
    a, T = np.deg2rad(slope_deg), np.eye(4)
    T[:3, :3] = [[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]]
    T[2, 3] = datum_m
    return frame.with_pose(Pose("map", "camera", T @ pose_of(frame).matrix))


def test_the_reference_is_what_the_stages_give_without_any_filter(frame: Frame) -> None:
    config, pose = Config(), pose_of(frame)
    spec = spec_of(frame, pose, config)
    found = dense_map(true_pixels(frame, pose, config, FLAT), true_segmentation(frame), spec)
    depth_m = crop_range(frame.depth_m, config.cloud.min_range_m, config.cloud.max_range_m)
    cloud = label_cloud(frame, true_segmentation(frame), depth_m)
    known = cloud[cloud.label_set.map_class_table[cloud.labels] != MapClass.UNKNOWN]
    in_grid = crop_height(
        known.transformed(spec.T_grid_map @ pose), config.cloud.min_height_m, config.cloud.max_height_m
    )
    expected = classify_cells(count_points(in_grid, spec)[0], 1)
    np.testing.assert_array_equal(found.classes, expected)


@given(st.floats(-15, 15), st.floats(-3, 3))
def test_slope_and_datum_do_not_change_what_stands_there(slope_deg: float, datum_m: float) -> None:
    frame = render(garden_scene(1), SMALL, lane_poses(1)[0], 0, "one")
    level = true_pixels(frame, pose_of(frame), Config())
    tilted = moved(frame, slope_deg, datum_m)
    found = true_pixels(tilted, pose_of(tilted), Config())
    assert found.ground == level.ground == "fitted"
    # vertical against across the slope: cos(15 degrees) of two metres
    assert np.quantile(np.abs(found.height_m - level.height_m), 0.99) < 0.06 + 2 * (1 - 0.966)
    assert (found.judged != level.judged).mean() < 0.01


def test_an_obstacle_on_a_hill_is_in_the_truth(frame: Frame) -> None:
    """By the map's own z a world that is lifted by 3 m would hold no obstacle at all."""
    lifted, config = moved(frame, 0.0, 3.0), Config()
    spec = spec_of(frame, pose_of(frame), config)
    here = dense_map(true_pixels(frame, pose_of(frame), config), true_segmentation(frame), spec)
    there = dense_map(true_pixels(lifted, pose_of(lifted), config), true_segmentation(frame), spec)
    assert here.is_obstacle.sum() > 50
    np.testing.assert_array_equal(there.classes, here.classes)


def test_the_fitted_ground_follows_a_slope_with_a_bump() -> None:
    rng = np.random.default_rng(0)
    xy = rng.uniform((0, -3), (6, 3), (20_000, 2))
    z = 0.2 * xy[:, 0] - 0.1 * xy[:, 1] + 0.1 * np.exp(-((xy[:, 0] - 3) ** 2 + xy[:, 1] ** 2))
    ground = fitted_ground(np.column_stack((xy, z)))
    assert ground is not None
    assert np.abs(ground.at(xy[:, 0], xy[:, 1]) - z).max() < 0.03
    assert abs(float(ground.at(7.0, 0.0)) - 1.4) < 0.06  # a metre beyond what was seen
    assert fitted_ground(np.zeros((10, 3))) is None
    with pytest.raises(InvalidValueError, match="expected finite points of lawn"):
        fitted_ground(np.where(xy[:, :1] == xy[7, 0], np.nan, np.column_stack((xy, z))))


def test_what_the_limits_leave_out_is_counted(frame: Frame) -> None:
    assert frame.labels is not None
    assert frame.label_set is not None
    base = Config()
    low = replace(base, cloud=replace(base.cloud, max_height_m=0.3, max_range_m=4.0))
    spec = spec_of(frame, pose_of(frame), base)
    labels, label_set = frame.labels, frame.label_set
    whole, part = (true_pixels(frame, pose_of(frame), config, FLAT) for config in (base, low))
    all_in, cut = (unjudged(p, p.cells(spec), labels, label_set) for p in (whole, part))
    assert cut["unjudged_above"] > all_in["unjudged_above"]
    assert cut["unjudged_out_of_range"] > all_in["unjudged_out_of_range"]
    assert cut["frames_ground_recorded"] == 1
    names = ("judged_pixels", "unjudged_above", "unjudged_below", "unjudged_out_of_range")
    assert sum(all_in[n] for n in names) == sum(cut[n] for n in names)


@pytest.mark.parametrize("datum_m", [-3.0, 0.0, 3.0])
def test_where_nobody_knows_the_ground_the_maps_z_leaves_nothing_out(frame: Frame, datum_m: float) -> None:
    """A view without lawn, such as of a yard; with z for heights one lifted by 3 m held no obstacle."""
    assert frame.labels is not None
    yard = replace(frame, labels=np.where(frame.labels == GRASS.id, OTHER.id, frame.labels))
    here, there = (true_pixels(each, pose_of(each), Config()) for each in (yard, moved(yard, 0.0, datum_m)))
    assert here.ground == there.ground == "unknown"
    assert there.judged.all()
    np.testing.assert_allclose(there.height_m, here.height_m, atol=1e-5)
    assert np.abs(np.quantile(there.height_m, 0.3)) < 0.05  # the lowest of this view is its ground


def test_a_view_without_any_reading_has_no_pixels(frame: Frame) -> None:
    blind = replace(frame, depth=np.zeros_like(frame.depth), labels=None)
    found = true_pixels(blind, pose_of(blind), Config())
    assert len(found.index) == len(found.height_m) == len(found.judged) == 0


def test_true_masks_and_depth_have_no_miss_wherever_the_ground_lies(frame: Frame) -> None:
    lifted = moved(frame, 5.0, -2.0)
    found = compare_frame(
        lifted, true_segmentation(lifted), pose_of(lifted), Config(), "dense", maps=FrameMaps()
    )
    assert found.tally.matrix.obstacle_called_free.of > 50


@given(
    st.floats(-0.4, 0.4), st.floats(-40, 40), st.floats(-40, 40), st.integers(1, 4), st.integers(1, 4),
    st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_places_heights_and_cells_are_those_of_plain_numpy(
    tilt: float, x_m: float, y_m: float, nx: int, ny: int, seed: int
) -> None:
    """To the last digit, without readings, out of range, beside the ground's raster and beside the grid."""
    rng = np.random.default_rng(seed)
    frame = render(garden_scene(1), SMALL, lane_poses(1)[0], 0, "one")
    depth_m = frame.depth_m * rng.choice(np.array([0, 0.02, 1, 1, 1, 3], np.float32), frame.depth.shape)
    frame = replace(frame, depth=depth_m, depth_unit_m=1.0)
    turned = moved(frame, float(np.rad2deg(tilt)), 0.3)
    matrix = pose_of(turned).matrix.copy()
    matrix[:2, 3] += x_m, y_m
    pose, config = Pose("map", "camera", matrix), Config()
    raster = GroundRaster((x_m - 1, y_m - 1), 0.7, rng.normal(0, 0.2, (ny, nx)).astype(np.float32))
    found = true_pixels(frame, pose, config, FrameTruth(ground=raster))

    kept = crop_range(frame.depth_m, config.cloud.min_range_m, config.cloud.max_range_m)
    index = np.flatnonzero(np.isfinite(kept))
    xyz = deproject(frame.depth_m, frame.intrinsics).reshape(-1, 3)[index]
    turn = np.eye(4)
    turn[:3, :3] = matrix[:3, :3]
    x, y, z = transform_points(xyz, Pose("map", "camera", turn)).astype(np.float64).T + matrix[:3, 3, None]
    np.testing.assert_array_equal(found.index, index)
    np.testing.assert_array_equal(found.xyz_m, xyz)
    np.testing.assert_array_equal(found.height_m, z - raster.at(x, y))
    some = np.flatnonzero(rng.random(len(index)) < 0.1)
    away_m = np.hypot(x - matrix[0, 3], y - matrix[1, 3])[some]
    np.testing.assert_array_equal(found.away_m(some), away_m)
    beyond = np.flatnonzero((frame.depth_m > 0) & np.isnan(kept))
    np.testing.assert_array_equal(found.out_of_range, beyond)

    spec = replace(spec_of(frame, pose, config), width=50, height=40)
    in_grid = transform_points(xyz, spec.T_grid_map @ pose)[:, :2] * np.float32(1 / spec.resolution_m)
    size = np.array(spec.shape[::-1], np.float32)
    inside = np.asarray(((in_grid >= 0) & (in_grid < size)).all(axis=1))
    ix, iy = np.where(inside[:, None], in_grid, 0).astype(np.int64).T
    np.testing.assert_array_equal(found.cells(spec), np.where(inside, iy * spec.width + ix, -1))


def test_another_pose_moves_the_pixels_and_not_their_heights(frame: Frame) -> None:
    pose, config, made = pose_of(frame), Config(), FrameMaps(FLAT)
    other = Pose("map", "camera", moved(frame, 2.0, 0.4).T_map_camera.matrix)  # type: ignore[union-attr]
    spec = spec_of(frame, pose, config)
    placed, here, there = (
        made.pixels(frame, pose, config, other),
        made.pixels(frame, pose, config),
        true_pixels(frame, other, config, FLAT),
    )
    np.testing.assert_array_equal(placed.height_m, here.height_m)
    np.testing.assert_array_equal(made.cells(placed, spec), there.cells(spec))
    assert (made.cells(placed, spec) != made.cells(here, spec)).any()
    every = np.arange(len(there.index))
    np.testing.assert_array_equal(placed.away_m(every), there.away_m(every))


@given(st.integers(FEWEST_LAWN_PIXELS, 3000), st.integers(0, 2**32 - 1))
def test_the_fitted_ground_is_that_of_plain_numpy(n: int, seed: int) -> None:
    """Means, texels and their sums to the last digit."""
    from scipy.ndimage import distance_transform_edt

    rng = np.random.default_rng(seed)
    xyz = rng.normal((30, -20, 1), (2, 3, 0.2), (n, 3))
    middle = np.cumsum(xyz, axis=0)[-1] / n
    design = np.column_stack((xyz[:, :2] - middle[:2], np.ones(n)))
    plane, *_ = np.linalg.lstsq(design, xyz[:, 2], rcond=None)
    at = np.floor(xyz[:, :2] / TEXEL_M).astype(np.int64)
    low, (nx, ny) = at.min(axis=0) - 8, np.ptp(at, axis=0) + 17
    flat = (at - low) @ (1, nx)
    counts = np.bincount(flat, minlength=nx * ny)
    rest = np.bincount(flat, xyz[:, 2] - design @ plane, nx * ny) / np.maximum(counts, 1)
    near = distance_transform_edt(counts.reshape(ny, nx) < 3, return_distances=False, return_indices=True)
    x, y = ((low[i] + np.arange(m) + 0.5) * TEXEL_M - middle[i] for i, m in enumerate((nx, ny)))
    level = plane[0] * x + plane[1] * y[:, None] + plane[2]
    found = fitted_ground(xyz)
    assert found is not None
    assert found.origin_m == tuple((low * TEXEL_M).tolist())
    expected = (level + rest.reshape(ny, nx)[tuple(near)]).astype(np.float32)
    np.testing.assert_array_equal(found.height_m, expected)
