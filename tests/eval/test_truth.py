"""The truth by heights above the true ground: no slope or datum moves it, and what is left out is counted."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.config import Config
from swardmap.eval.maps import FrameMaps, compare_frame, spec_of, true_segmentation
from swardmap.eval.safety import unjudged
from swardmap.eval.truth import dense_map, fitted_ground, true_pixels
from swardmap.geometry import Intrinsics, Pose
from swardmap.grid import classify_cells, count_points
from swardmap.io.sources.truth import FrameTruth, GroundRaster
from swardmap.labels import MapClass
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


def test_true_masks_and_depth_have_no_miss_wherever_the_ground_lies(frame: Frame) -> None:
    lifted = moved(frame, 5.0, -2.0)
    found = compare_frame(
        lifted, true_segmentation(lifted), pose_of(lifted), Config(), "dense", maps=FrameMaps()
    )
    assert found.tally.matrix.obstacle_called_free.of > 50
