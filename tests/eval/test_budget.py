from dataclasses import replace

import numpy as np
import pytest

from swardmap.config import CloudConfig, Config, GeometryConfig, GridConfig
from swardmap.errors import InvalidValueError
from swardmap.eval.budget import (
    ABLATIONS,
    PoseNoise,
    RealAndTrue,
    budget,
    budget_rows,
    missing_stages,
    noisy_pose,
)
from swardmap.eval.frame_maps import FrameMaps
from swardmap.eval.maps import compare_maps, spec_of, true_segmentation
from swardmap.geometry import Pose
from swardmap.grid import OccupancyGrid
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.synth.analytic import (
    AnalyticSource,
    Box,
    Scene,
    StereoNoise,
    Walker,
    lane_poses,
    with_sensor_noise,
)
from swardmap.types import Frame, Segmentation

SMALL = AnalyticSource().intrinsics.scaled_to(320, 240)
R = 0.0625  # a power of two: whole cells stay whole in float32
CONFIG = Config(grid=GridConfig(resolution_m=R), geometry=GeometryConfig(enabled=False))  # the mask alone
SCENE = Scene(
    (Box((2.5, 0.4), (0.5, 0.4, 0.6)), Box((3.5, -0.8), (0.4, 0.4, 0.5))), persons=(Walker((4.0, 0.8)),)
)


def clean_frame() -> Frame:
    (frame,) = AnalyticSource(SCENE, tuple(lane_poses(1)), SMALL, exact=True)
    return frame


def pose(frame: Frame) -> Pose:
    assert frame.T_map_camera is not None
    return frame.T_map_camera


def dense(frame: Frame, config: Config) -> OccupancyGrid:
    """The map of true labels, nothing filtered."""
    spec = spec_of(frame, pose(frame), config)
    return FrameMaps().dense(frame, true_segmentation(frame), pose(frame), config, spec)


def moved(T: Pose, dx_m: float) -> Pose:
    matrix = T.matrix.copy()
    matrix[0, 3] += dx_m
    return Pose(T.parent, T.child, matrix)


def test_with_everything_true_every_stage_is_the_processing_alone() -> None:
    frame = clean_frame()
    tallies = budget(RealAndTrue(frame, true_segmentation(frame), pose(frame), frame, pose(frame)), CONFIG)
    assert tallies.keys() == ABLATIONS.keys()
    assert tallies["truth"].matrix.accuracy == 1
    assert tallies["mask alone"] == tallies["depth alone"] == tallies["pose alone"] == tallies["truth"]
    assert tallies["+ pose"] == tallies["+ depth"] == tallies["+ mask"] == tallies["processing alone"]
    for row in budget_rows(tallies):
        if row.stage in ("+ mask", "+ depth", "+ pose"):
            assert set(row.added.values()) <= {0.0, None}


def test_a_pose_off_by_n_cells_is_blamed_on_the_pose_with_the_figures_of_a_shifted_map() -> None:
    frame, n = clean_frame(), 2
    sides = RealAndTrue(frame, true_segmentation(frame), pose(frame), frame, moved(pose(frame), n * R))
    tallies = budget(sides, CONFIG)
    reference = dense(frame, CONFIG)
    shifted = OccupancyGrid(reference.spec, np.roll(reference.classes, n, axis=1))
    expected = compare_maps(reference, shifted, pose(frame).position_m[:2]).tally
    assert tallies["pose alone"] == expected
    assert expected.matrix.obstacle_called_free.count > 10
    rows = {row.stage: row for row in budget_rows(tallies)}
    assert rows["+ mask"].added["called_free"] == rows["+ depth"].added["called_free"] == 0
    assert (rows["+ pose"].added["called_free"] or 0) > 0.05


def test_a_deleted_obstacle_is_blamed_on_the_mask_and_missed_as_a_whole() -> None:
    frame = clean_frame()
    assert frame.labels is not None
    mask = frame.labels.copy()
    persons = mask == 2
    assert persons.sum() > 100
    mask[persons] = 1
    sides = RealAndTrue(frame, Segmentation(mask, GRASS_OBSTACLE_PERSON), pose(frame), frame, pose(frame))
    tallies = budget(sides, CONFIG)
    rows = {row.stage: row for row in budget_rows(tallies)}
    gone = rows["mask alone"].missed
    assert gone >= 1
    assert all(kind.person for kind in tallies["mask alone"].missed)
    assert tallies["mask alone"].matrix.person_called_free.value == 1
    assert rows["mask alone"].added["missed"] == gone
    assert (rows["+ mask"].added["missed"] or 0) >= gone - rows["processing alone"].missed
    assert rows["+ depth"].added["missed"] == rows["+ pose"].added["missed"] == 0
    # every cell of the person is missed, at its distance to the boxes
    reference = dense(frame, CONFIG)
    assert tallies["mask alone"].distances(person=True).count == (reference.classes == 3).sum()


def test_a_mask_moved_sideways_is_blamed_on_the_mask() -> None:
    frame = clean_frame()
    assert frame.labels is not None
    mask = np.roll(frame.labels, 6, axis=1)
    sides = RealAndTrue(frame, Segmentation(mask, GRASS_OBSTACLE_PERSON), pose(frame), frame, pose(frame))
    rows = {row.stage: row for row in budget_rows(budget(sides, CONFIG))}
    assert (rows["+ mask"].added["called_free"] or 0) > 0.05
    assert rows["+ depth"].added["called_free"] == rows["+ pose"].added["called_free"] == 0
    assert rows["pose alone"].called_free.count == rows["depth alone"].called_free.count == 0


def test_depth_noise_is_blamed_on_the_depth_and_grows_with_its_sigma() -> None:
    frame = clean_frame()
    false_alarms, deltas = [], []
    for sigma_m in (0.0, 0.002, 0.01, 0.05):
        noise = StereoNoise(sigma_m, dropout=0, flying=0)
        noisy = with_sensor_noise(frame, np.random.default_rng(0), noise)
        sides = RealAndTrue(noisy, true_segmentation(frame), pose(frame), frame, pose(frame))
        rows = {row.stage: row for row in budget_rows(budget(sides, CONFIG))}
        false_alarms.append(rows["depth alone"].false_alarm.value or 0)
        deltas.append(rows["+ depth"].added["false_alarm"])
        assert rows["+ mask"].added["false_alarm"] == rows["+ pose"].added["false_alarm"] == 0
        assert rows["mask alone"].false_alarm.count == 0
    assert false_alarms == sorted(false_alarms)
    assert (false_alarms[0], deltas[0]) == (0, 0)
    assert false_alarms[-1] > 0.05


def test_a_wall_measured_too_far_has_the_distance_of_arithmetic() -> None:
    """A level camera sees a wall 3 m ahead; depth too large by 2 cells moves its cells by 2 cells."""
    scene = Scene((Box((3.25, 0.0), (0.5, 6.0, 1.5)),))
    (frame,) = AnalyticSource(scene, tuple(lane_poses(1, pitch_deg=0.0)), SMALL, exact=True)
    assert frame.labels is not None
    late = np.where((frame.labels == 0) & (frame.depth > 0), frame.depth + np.float32(2 * R), frame.depth)
    config = replace(CONFIG, cloud=CloudConfig(max_range_m=5.0, max_height_m=1.4))
    late_frame = replace(frame, depth=late.astype(np.float32))
    sides = RealAndTrue(late_frame, true_segmentation(frame), pose(frame), frame)
    tally = budget(sides, config)["depth alone"]
    seen_wall = int(tally.matrix.scores("obstacle").support)
    assert seen_wall > 50
    assert tally.matrix.obstacle_not_seen.count == seen_wall  # nobody sees the lawn under a wall
    reference = dense(frame, config)
    predicted = dense(late_frame, config)
    columns = [np.unique(np.nonzero(grid.classes >= 2)[1]).tolist() for grid in (reference, predicted)]
    assert [c + 2 for c in columns[0]] == columns[1]


def test_without_clean_depth_the_stages_that_need_it_are_left_out_and_named() -> None:
    frame = clean_frame()
    tallies = budget(RealAndTrue(frame, true_segmentation(frame), pose(frame), None, pose(frame)), CONFIG)
    assert "+ depth" not in tallies
    assert "depth alone" not in tallies
    assert "+ pose" in tallies
    assert [row.stage for row in budget_rows(tallies)][:4] == ["truth", "+ processing", "+ mask", "+ pose"]
    assert missing_stages(False, True).keys() == {"depth"}
    assert missing_stages(True, False).keys() == {"pose"}
    bare = budget(RealAndTrue(frame, true_segmentation(frame), pose(frame)), CONFIG)
    assert bare.keys() == {"truth", "+ processing", "+ mask", "processing alone", "mask alone"}


def test_pose_noise_has_its_sigma_and_depends_on_seed_and_index_only() -> None:
    T = lane_poses(1)[0]
    noise = PoseNoise(0.02, 0.5, 0.3)
    drawn = [noisy_pose(T, noise, 0, i) for i in range(2000)]
    offsets = np.array([p.position_m - T.position_m for p in drawn])
    assert np.allclose(offsets[:, :2].std(axis=0), 0.02, rtol=0.08)
    assert (offsets[:, 2] == 0).all()
    turns = np.array([p.matrix[:3, :3] @ T.matrix[:3, :3].T for p in drawn])
    assert np.rad2deg(np.arctan2(turns[:, 1, 0], turns[:, 0, 0])).std() == pytest.approx(0.5, rel=0.08)
    assert np.rad2deg(np.arcsin(turns[:, 2, 1])).std() == pytest.approx(0.3, rel=0.08)
    assert np.array_equal(noisy_pose(T, noise, 0, 7).matrix, drawn[7].matrix)
    assert not np.array_equal(noisy_pose(T, noise, 1, 7).matrix, drawn[7].matrix)
    assert np.array_equal(noisy_pose(T, PoseNoise(0, 0, 0), 0, 7).matrix, T.matrix)


def test_what_does_not_fit_is_refused() -> None:
    frame = clean_frame()
    (other,) = AnalyticSource(SCENE, tuple(lane_poses(1)), SMALL.scaled_to(160, 120))
    with pytest.raises(InvalidValueError, match="clean depth"):
        RealAndTrue(frame, true_segmentation(frame), pose(frame), other)
    with pytest.raises(InvalidValueError, match="pose noise"):
        PoseNoise(-1)
