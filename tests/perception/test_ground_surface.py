"""Heights are above the local ground, wherever the map's zero lies and however the lawn slopes."""

from dataclasses import replace

import numpy as np
import pytest

from swardmap.config import Config, config_from_dict
from swardmap.geometry import Pose, deproject, mount_pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import GRASS, GRASS_OBSTACLE_PERSON, LabelSet, MapClass
from swardmap.perception.ground_surface import GroundPlane
from swardmap.pipeline import ObstacleMapper, observe, view_spec
from swardmap.synth.analytic import VGA, Box, Scene, Walker, lane_poses, render, with_sensor_noise
from swardmap.types import Frame, Segmentation

SMALL = VGA.scaled_to(320, 240)


class Truth:
    """True masks."""

    name = "truth"
    label_set: LabelSet = GRASS_OBSTACLE_PERSON

    def __call__(self, frame: Frame) -> Segmentation:
        assert frame.labels is not None
        return Segmentation(frame.labels, self.label_set)


def tilted(slope_deg: float, datum_m: float = 0.0) -> np.ndarray:
    """The world turned uphill along x about the map's origin, and lifted."""
    turn = mount_pose(0.0, -slope_deg).matrix @ np.linalg.inv(mount_pose(0.0, 0.0).matrix)
    turn[2, 3] += datum_m
    return turn


def frame_after(scene: Scene, metres: float, slope_deg: float, datum_m: float = 0.0) -> Frame:
    """A noisy frame from a robot that has driven so far along x over a lawn that slopes."""
    (pose,) = lane_poses(1, start_m=(metres, 0.0))
    frame = with_sensor_noise(render(scene, SMALL, pose), np.random.default_rng(0))
    return frame.with_pose(Pose("map", "camera", tilted(slope_deg, datum_m) @ pose.matrix))


def lawn_left_unknown(frame: Frame, grid: OccupancyGrid, within_m: float = 3.0) -> float:
    """Share of the points of true lawn within a depth whose cells are not free."""
    assert frame.T_map_camera is not None
    assert frame.labels is not None
    xyz = frame.T_map_camera.apply(deproject(frame.depth_m, frame.intrinsics).reshape(-1, 3))
    lawn = (
        np.isfinite(xyz).all(axis=1) & (frame.labels.ravel() == GRASS.id) & (frame.depth_m.ravel() < within_m)
    )
    ix, iy = grid.spec.cell_of(xyz[lawn, :2]).T
    return float((grid.classes[iy, ix] != MapClass.GRASS).mean())


@pytest.mark.parametrize("mode", ["last_seen", "log_odds"])
@pytest.mark.parametrize("metres", [0.0, 3.0, 6.0, 10.0, 20.0])
@pytest.mark.parametrize("slope_deg", [-15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0])
def test_lawn_is_free_however_it_slopes_and_wherever_the_robot_is(
    slope_deg: float, metres: float, mode: str
) -> None:
    frame = frame_after(Scene(), metres, slope_deg)
    mapper = ObstacleMapper(Truth(), config_from_dict({"grid": {"mode": mode}}))
    for i in range(8):
        mapper.step(replace(frame, stamp_ns=i))
    assert mapper.map is not None
    assert not mapper.map.is_obstacle.any()
    assert lawn_left_unknown(frame, mapper.map) <= 0.02


@pytest.mark.parametrize("datum_m", [-3.0, -1.8, 0.0, 1.8, 3.0, 130.0])
def test_people_and_boxes_are_marked_wherever_the_maps_zero_lies(datum_m: float) -> None:
    scene = Scene((Box((2.6, -0.6), (0.3, 0.3, 0.3)),), persons=(Walker((3.0, 0.6)),))
    level, lifted = (
        ObstacleMapper(Truth()).step(frame_after(scene, 0.0, 0.0, d)).seen for d in (0.0, datum_m)
    )
    assert level.count(MapClass.PERSON) > 10
    np.testing.assert_array_equal(lifted.spec.shape, level.spec.shape)
    assert (lifted.classes != level.classes).mean() < 1e-3  # float32 rounds the heights differently
    assert lifted.count(MapClass.PERSON) == pytest.approx(level.count(MapClass.PERSON), abs=1)


def wall_ahead(pose: Pose) -> Frame:
    """Nothing but a wall half a metre ahead."""
    rgb, labels = np.zeros((240, 320, 3), np.uint8), np.ones((240, 320), np.uint8)
    depth = np.full((240, 320), 500, np.uint16)
    return Frame(1, SMALL, rgb, depth, T_map_camera=pose, labels=labels, label_set=GRASS_OBSTACLE_PERSON)


def test_where_no_ground_is_known_nothing_is_free_and_obstacles_are_marked() -> None:
    (pose,) = lane_poses(1, pitch_deg=-20.0)
    frame = wall_ahead(pose)
    assert frame.labels is not None
    spec = view_spec(SMALL, pose, 8.0, 0.05)
    grass = observe(frame, Segmentation(frame.labels, GRASS_OBSTACLE_PERSON), pose, spec, Config())
    assert grass.ground is None
    assert grass.camera_height_m is None
    assert not (grass.classes == MapClass.GRASS).any()
    assert not grass.points[..., MapClass.GRASS].any()
    other = observe(frame, Segmentation(0 * frame.labels, GRASS_OBSTACLE_PERSON), pose, spec, Config())
    assert (other.classes == MapClass.OBSTACLE).any()


@pytest.mark.parametrize("backend", ["compiled", "plain"])
@pytest.mark.parametrize("datum_m", [-130.0, -3.0, 3.0, 130.0])
def test_where_no_ground_is_known_the_maps_zero_takes_no_mark_away(datum_m: float, backend: str) -> None:
    config = Config(backend=backend)
    (pose,) = lane_poses(1, pitch_deg=-20.0)
    seen = []
    for lift_m in (0.0, datum_m):
        there = Pose("map", "camera", tilted(0.0, lift_m) @ pose.matrix)
        frame, spec = wall_ahead(there), view_spec(SMALL, there, 8.0, 0.05)
        assert frame.labels is not None
        seen.append(
            observe(frame, Segmentation(0 * frame.labels, GRASS_OBSTACLE_PERSON), there, spec, config)
        )
    level, lifted = seen
    assert level.ground is lifted.ground is None
    assert lifted.counts.out_of_height == 0
    np.testing.assert_array_equal(lifted.classes, level.classes)


def test_the_ground_of_an_earlier_view_serves_one_that_shows_none() -> None:
    mapper = ObstacleMapper(Truth())
    first = mapper.step(frame_after(Scene(), 0.0, 8.0, 2.0))
    assert first.observation.ground is not None
    assert not first.observation.ground.carried
    (up,) = lane_poses(1, start_m=(0.3, 0.0), pitch_deg=-20.0)
    second = mapper.step(wall_ahead(Pose("map", "camera", tilted(8.0, 2.0) @ up.matrix)))
    assert second.observation.ground is not None
    assert second.observation.ground.carried
    far = lane_poses(1, start_m=(30.0, 0.0), pitch_deg=-20.0)[0]
    third = mapper.step(replace(wall_ahead(Pose("map", "camera", tilted(8.0, 2.0) @ far.matrix)), stamp_ns=2))
    assert third.observation.ground is None


def test_without_poses_no_view_takes_the_ground_of_an_earlier_one() -> None:
    """Nobody knows how far the robot has gone: each of them has the same place in `base`."""
    lawn = frame_after(Scene(), 0.0, 0.0, 0.0)
    (up,) = lane_poses(1, pitch_deg=-20.0)
    wall = wall_ahead(up)
    mapper = ObstacleMapper(Truth(), T_base_camera=mount_pose(0.9, 20.0))
    seen = []
    for i, frame in enumerate((lawn, wall, lawn, wall)):
        step = mapper.step(replace(frame, T_map_camera=None, stamp_ns=i))
        seen.append(step.observation.ground is not None)
        assert step.observation.ground is None or not step.observation.ground.carried
    assert seen == [True, False, True, False]
    posed = mapper.step(replace(wall, stamp_ns=9))  # and one with a pose takes none of theirs
    assert posed.observation.ground is None


def test_a_plane_is_the_same_in_every_grid_of_the_map() -> None:
    plane = GroundPlane((0.1, -0.2), (10.0, 20.0, 3.0))
    for origin in ((0.0, 0.0), (-500_000.0, 4.25)):
        a, b, c = plane.in_grid(GridSpec(0.05, 10, 10, origin))
        x, y = 12.0 - origin[0], 19.0 - origin[1]
        assert a * x + b * y + c == pytest.approx(3.0 + 0.1 * 2 - 0.2 * -1, abs=1e-6)


def test_a_robot_that_pitches_over_a_kerb_keeps_its_lawn() -> None:
    """The camera nods by 12 degrees for one frame; its pose says so."""
    mapper = ObstacleMapper(Truth())
    for i, pitch_deg in enumerate((20.0, 32.0, 8.0, 20.0)):
        (pose,) = lane_poses(1, start_m=(0.05 * i, 0.0), pitch_deg=pitch_deg)
        frame = with_sensor_noise(render(Scene(), SMALL, pose), np.random.default_rng(i))
        step = mapper.step(replace(frame, stamp_ns=i))
        assert lawn_left_unknown(step.frame, step.seen) <= 0.02
    assert mapper.map is not None
    assert not mapper.map.is_obstacle.any()


@pytest.mark.parametrize("step_m", [0.1, 0.2, 0.4])
def test_both_levels_of_a_terrace_are_lawn_and_its_edge_is_marked(step_m: float) -> None:
    terrace = Scene((Box((4.5, 0.0), (3.0, 12.0, step_m)),))
    (pose,) = lane_poses(1)
    frame = with_sensor_noise(render(terrace, SMALL, pose), np.random.default_rng(0))
    assert frame.labels is not None
    all_grass = replace(frame, labels=np.where(frame.labels == 255, 255, 1).astype(np.uint8))
    seen = ObstacleMapper(Truth()).step(all_grass).seen
    columns = seen.spec.cell_of([[2.9, 0.0], [3.1, 0.0]])[:, 0]
    edge = seen.is_obstacle[:, columns[0] : columns[1] + 1]
    if step_m > 0.12:  # lower steps are for the network
        assert edge.any(axis=1).sum() > 20
    before = seen.classes[:, : columns[0] - 2]
    assert (before == MapClass.GRASS).sum() > 500
    assert not (before >= MapClass.OBSTACLE).any()
