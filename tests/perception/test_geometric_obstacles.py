"""Geometry beside semantics: what stands up is found, what slopes is not, and both twins agree."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.config import CloudConfig, Config, GeometryConfig, config_from_dict
from swardmap.errors import ConfigError
from swardmap.eval.maps import compare_frame
from swardmap.geometry import Pose, deproject, mount_pose
from swardmap.grid import GridSpec, overlap
from swardmap.labels import GRASS, GRASS_OBSTACLE_PERSON, VOID_ID, LabelSet, MapClass
from swardmap.perception.geometric_obstacles import with_marks
from swardmap.pipeline import ObstacleMapper, observe, view_spec
from swardmap.synth.analytic import (
    VGA,
    Box,
    Cylinder,
    Ellipsoid,
    Scene,
    garden_scene,
    lane_poses,
    render,
    with_sensor_noise,
)
from swardmap.types import Frame, Segmentation

CLOUD = CloudConfig(min_height_m=-4.0, max_height_m=4.0)
ON = GeometryConfig(enabled=True)
(LANE,) = lane_poses(1)


class AllGrass:
    """A network that sees nothing but grass."""

    name = "all grass"
    label_set: LabelSet = GRASS_OBSTACLE_PERSON

    def __call__(self, frame: Frame) -> Segmentation:
        return Segmentation(np.full((48, 64), GRASS.id, np.uint8), self.label_set)


def turned(slope_deg: float, roll_deg: float = 0.0) -> NDArray[np.float64]:
    """The world tilted: uphill along x, and along y."""
    level = mount_pose(0.0, 0.0).matrix  # body axes of a camera that looks ahead
    return np.asarray(mount_pose(0.0, -slope_deg, roll_deg).matrix @ np.linalg.inv(level))


def seen(scene: Scene, slope_deg: float = 0.0, roll_deg: float = 0.0, pose: Pose = LANE) -> Frame:
    """A noisy frame of a scene in a world that slopes."""
    frame = with_sensor_noise(render(scene, VGA, pose), np.random.default_rng(0))
    return frame.with_pose(Pose("map", "camera", turned(slope_deg, roll_deg) @ pose.matrix))


@dataclass(frozen=True)
class Found:
    """What depth says of a frame to whose network all is grass."""

    marks: NDArray[np.bool_]
    holes: NDArray[np.bool_]
    ground_m: NDArray[np.float32]


def marks(
    frame: Frame, config: GeometryConfig = ON, cloud: CloudConfig = CLOUD, min_points: int = 1
) -> Found:
    assert frame.T_map_camera is not None
    settings = Config(cloud=cloud, geometry=replace(config, min_points=min_points))
    seen = observe(frame, AllGrass()(frame), frame.T_map_camera, view_of(frame, cloud), settings)
    assert seen.geometry is not None
    return Found(seen.geometry.marks, seen.geometry.holes, seen.ground_m)


def view_of(frame: Frame, cloud: CloudConfig = CLOUD) -> GridSpec:
    """All that the camera of a frame can see."""
    assert frame.T_map_camera is not None
    return view_spec(frame.intrinsics, frame.T_map_camera, cloud.max_range_m, 0.05)


def found_near(evidence: Found, spec: GridSpec, x: float, y: float, within_m: float) -> int:
    iy, ix = np.nonzero(evidence.marks)
    centers = spec.center_of(np.stack([ix, iy], axis=1))
    return int((np.hypot(*(centers - (x, y)).T) < within_m).sum())


@pytest.mark.parametrize(
    ("slope_deg", "roll_deg"), [(0, 0), (15, 0), (-15, 0), (20, 0), (-20, 0), (0, 15), (0, -20), (10, 10)]
)
def test_an_empty_slope_has_no_obstacle(slope_deg: float, roll_deg: float) -> None:
    evidence = marks(seen(Scene(), slope_deg, roll_deg))
    assert np.isfinite(evidence.ground_m).sum() > 3000
    assert not evidence.marks.any()


class Truth:
    """True masks."""

    name = "truth"
    label_set: LabelSet = GRASS_OBSTACLE_PERSON

    def __call__(self, frame: Frame) -> Segmentation:
        assert frame.labels is not None
        return Segmentation(frame.labels, self.label_set)


@pytest.mark.parametrize("mode", ["paper", "evidence"])
@pytest.mark.parametrize("backend", ["compiled", "plain"])
@pytest.mark.parametrize(("slope_deg", "roll_deg"), [(15, 0), (-15, 0), (0, 15)])
def test_a_slope_stays_free_with_the_settings_as_shipped(
    slope_deg: float, roll_deg: float, backend: str, mode: str
) -> None:
    """Within the camera's range it rises by 2 m, or falls: far beyond the limits of height in the map."""
    config = config_from_dict({"geometry": {"enabled": True}, "grid": {"mode": mode}, "backend": backend})
    mapper = ObstacleMapper(Truth(), config)
    frame = seen(Scene(), slope_deg, roll_deg)
    for i in range(12):
        step = mapper.step(replace(frame, stamp_ns=i))
    assert mapper.map is not None
    assert not mapper.map.is_obstacle.any()
    assert step.counts.out_of_height < 0.001 * step.counts.used
    assert frame.T_map_camera is not None
    assert frame.labels is not None
    points = frame.T_map_camera.apply(deproject(frame.depth_m, frame.intrinsics).reshape(-1, 3))
    near = np.isfinite(points).all(axis=1) & (frame.depth_m.ravel() < 5) & (frame.labels.ravel() == GRASS.id)
    ix, iy = mapper.map.spec.cell_of(points[near, :2]).T
    assert (mapper.map.classes[iy, ix] == MapClass.GRASS).mean() > 0.99


def test_obstacles_on_a_slope_are_not_cropped_and_crowns_above_it_are_driven_under() -> None:
    post, crown = Box((4.0, 0.5), (0.3, 0.3, 1.5)), Ellipsoid((5.0, -1.5, 3.2), (0.8, 0.8, 0.4))
    config = config_from_dict({"geometry": {"enabled": True}})
    (up,) = lane_poses(1, pitch_deg=0.0)
    step = ObstacleMapper(Truth(), config).step(seen(Scene((post, crown)), 15.0, pose=up))
    x, y, _ = turned(15.0)[:3, :3] @ [4.0, 0.5, 0.0]
    iy, ix = np.nonzero(step.seen.is_obstacle)
    centers = step.seen.spec.center_of(np.stack([ix, iy], axis=1))
    assert len(centers)
    assert np.hypot(*(centers - (x, y)).T).max() < 1.0  # it leans by 15 degrees; nothing of the crown
    np.testing.assert_allclose(step.cloud(config).xyz[:, 2].max(), 2.6, atol=0.4)  # pictures show the same


@pytest.mark.parametrize("pitch_deg", [5.0, 20.0, 35.0])
@pytest.mark.parametrize("height_m", [0.4, 1.2])
def test_a_pitching_robot_sees_no_obstacle_on_the_lawn(pitch_deg: float, height_m: float) -> None:
    (pose,) = lane_poses(1, pitch_deg=pitch_deg, height_m=height_m)
    frame = seen(Scene(), pose=pose)
    # the pose that is believed is 5 degrees off, as on a robot that brakes
    assert not marks(frame.with_pose(Pose("map", "camera", turned(5.0) @ pose.matrix))).marks.any()


@pytest.mark.parametrize("slope_deg", [-15.0, 0.0, 15.0])
@pytest.mark.parametrize(
    ("solid", "center", "cells"),
    [
        (Box((2.6, 0.4), (0.2, 0.2, 0.2)), (2.6, 0.4), 5),
        (Box((4.5, -0.6), (0.2, 0.2, 0.2)), (4.5, -0.6), 5),
        (Ellipsoid((3.2, 0.2, 0.11), (0.3, 0.85, 0.14)), (3.2, 0.2), 100),  # somebody who lies there
        (Ellipsoid((5.0, 0.2, 0.11), (0.85, 0.3, 0.14)), (5.0, 0.2), 40),
        (Cylinder((4.0, 0.3), 0.04, 0.8), (4.0, 0.3), 2),
        (Box((2.5, 0.0), (0.2, 6.0, 0.2)), (2.5, 0.0), 10),  # a kerb
        (Box((4.0, 0.0), (2.0, 8.0, 0.3)), (3.0, 0.0), 5),  # the edge of a terrace
    ],
)
def test_what_stands_up_is_marked(
    solid: Box | Ellipsoid | Cylinder, center: tuple[float, float], cells: int, slope_deg: float
) -> None:
    frame = seen(Scene((solid,)), slope_deg)
    evidence = marks(frame)
    x, y = (turned(slope_deg)[:3, :3] @ [*center, 0.0])[:2]
    size = solid.bounds()[1] - solid.bounds()[0]
    leaning = size[2] * abs(np.sin(np.deg2rad(slope_deg)))  # it stands upright on the slope
    near = max(size[:2]) / 2 + leaning + 0.15
    assert found_near(evidence, view_of(frame), float(x), float(y), near) >= cells
    assert found_near(evidence, view_of(frame), float(x), float(y), near) == int(evidence.marks.sum())


def dug(frame: Frame, deep_m: float) -> Frame:
    """A pit of 0.8 m x 0.8 m, 2.5 m ahead: its floor, or its far or side walls."""
    ray_x, ray_y = frame.intrinsics.ray_tables()
    assert frame.T_map_camera is not None
    R, origin = frame.T_map_camera.matrix[:3, :3], frame.T_map_camera.position_m
    rays = ray_x[None, :, None] * R[:, 0] + ray_y[:, None, None] * R[:, 1] + R[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = origin[:2] + rays[..., :2] * (-origin[2] / rays[..., 2])[..., None]
        walls = [(2.9 - origin[0]) / rays[..., 0], *((s - origin[1]) / rays[..., 1] for s in (-0.4, 0.4))]
        t = np.minimum.reduce(
            [np.where(w > 0, w, np.inf) for w in (*walls, (-origin[2] - deep_m) / rays[..., 2])]
        )
    inside = (np.abs(at - (2.5, 0.0)) < 0.4).all(axis=-1) & (rays[..., 2] < 0)
    return replace(frame, depth=np.where(inside, np.rint(t * 1000), frame.depth).astype(np.uint16))


def test_a_pit_is_a_hole_and_a_dent_is_none() -> None:
    exact = render(Scene(), VGA, LANE)
    deep = marks(with_sensor_noise(dug(exact, 0.4), np.random.default_rng(0)))
    frame = dug(exact, 0.4)
    assert frame.T_map_camera is not None
    points = frame.T_map_camera.apply(deproject(frame.depth_m, frame.intrinsics)).reshape(-1, 3)
    ix, iy = view_of(frame).cell_of(points[points[:, 2] < -0.2, :2]).T  # mostly the far wall is seen
    assert deep.holes[iy, ix].mean() > 0.8
    iy, ix = np.nonzero(deep.holes)
    centers = view_of(frame).center_of(np.stack([ix, iy], axis=1))
    assert (np.abs(centers - (2.5, 0.0)) < 0.4 + 0.1).all()
    assert deep.marks[deep.holes].all()
    shallow = marks(with_sensor_noise(dug(exact, 0.06), np.random.default_rng(0)))
    assert not shallow.marks.any()


def test_a_hole_that_is_not_seen_is_not_reported() -> None:
    exact = render(Scene(), VGA, LANE)
    difference = dug(exact, 0.4).depth != exact.depth
    blind = replace(exact, depth=np.where(difference, 0, exact.depth).astype(np.uint16))
    evidence = marks(blind)
    assert not evidence.marks.any()
    assert np.isnan(evidence.ground_m[len(evidence.ground_m) // 2]).any()


@pytest.mark.parametrize("blades_m", [0.04, 0.08])
def test_grass_of_a_few_centimetres_is_no_obstacle(blades_m: float) -> None:
    rng = np.random.default_rng(1)
    frame = render(Scene(), VGA, LANE)
    ray_y = frame.intrinsics.ray_tables()[1]
    down = -(ray_y[:, None] * LANE.matrix[2, 1] + LANE.matrix[2, 2])  # by how much a ray falls at depth 1
    blades = rng.random(frame.depth.shape) * blades_m
    lifted = frame.depth_m - np.where(down > 0.05, blades / np.maximum(down, 0.05), 0)
    grown = replace(frame, depth=np.nan_to_num(lifted).astype(np.float32))
    assert not marks(with_sensor_noise(grown, rng)).marks.any()


def test_the_threshold_grows_with_the_noise() -> None:
    """Ten times the noise: hardly a false mark, where a constant threshold gives hundreds."""
    noisy = render(Scene(), VGA, LANE)
    depth_m = noisy.depth_m.astype(np.float64)
    rng = np.random.default_rng(3)
    depth_m += 0.02 * depth_m**2 * rng.standard_normal(depth_m.shape)
    noisy = replace(noisy, depth=np.nan_to_num(depth_m.clip(0)).astype(np.float32))
    unfiltered = replace(CLOUD, consistent_neighbours=0)
    told = replace(ON, noise_m_at_1m=0.02, noise_sigmas=4.0)
    constant = replace(ON, noise_sigmas=0.0)
    false_marks = marks(noisy, constant, unfiltered, min_points=3).marks.sum()
    assert false_marks > 200
    assert marks(noisy, told, unfiltered, min_points=3).marks.sum() < 0.02 * false_marks


def test_what_hangs_high_above_the_local_ground_is_driven_under() -> None:
    roof = Scene((Box((4.0, 0.0), (2.0, 2.0, 0.2), base_m=1.9),))
    (pose,) = lane_poses(1, pitch_deg=0.0)
    cloud = replace(CLOUD, max_height_m=1.4)
    assert marks(seen(roof, 10.0, pose=pose), cloud=cloud).marks.sum() == 0
    assert marks(seen(roof, 10.0, pose=pose)).marks.sum() > 10


def test_the_frame_may_lie_anywhere_in_the_world() -> None:
    frame = seen(garden_scene(1), 7.0)
    assert frame.T_map_camera is not None
    here = marks(frame).marks
    matrix = frame.T_map_camera.matrix.copy()
    matrix[:3, 3] += (450_000.0, -5_000.0, 130.0)
    there = marks(frame.with_pose(Pose("map", "camera", matrix))).marks
    assert here.shape == there.shape
    assert (here != there).mean() < 1e-3  # lattice and heights round differently


@pytest.mark.parametrize("reading", [0, 65535])
def test_a_blind_camera_marks_nothing(reading: int) -> None:
    frame = render(Scene(), VGA, LANE)
    evidence = marks(replace(frame, depth=np.full(frame.depth.shape, reading, np.uint16)))
    assert not evidence.marks.any()
    assert np.isnan(evidence.ground_m).all()


@pytest.mark.parametrize("backend", ["compiled", "plain"])
def test_obstacles_called_grass_end_up_in_the_map(backend: str) -> None:
    config = config_from_dict({"backend": backend, "geometry": {"enabled": True}})
    frame = seen(Scene((Box((2.6, 0.4), (0.2, 0.2, 0.2)),)))
    mapper = ObstacleMapper(AllGrass(), config)
    step = mapper.step(frame)
    assert step.observation.geometry is not None
    assert step.observation.by_geometry is not None
    assert not step.observation.semantic_grid.is_obstacle.any()
    marked = step.observation.geometry.marks
    assert marked.sum() >= 5
    np.testing.assert_array_equal(step.seen.is_obstacle, marked)
    np.testing.assert_array_equal(step.observation.by_geometry, marked)
    grid = mapper.map
    assert grid is not None
    assert grid.count(MapClass.OBSTACLE) == marked.sum()
    # geometry clears nothing: what is free is what the network calls grass
    assert (
        step.observation.semantic_grid.classes[step.seen.classes == MapClass.GRASS] == MapClass.GRASS
    ).all()


def test_each_kind_of_evidence_can_be_switched_off() -> None:
    frame = seen(garden_scene(0))
    off = ObstacleMapper(AllGrass(), config_from_dict({"geometry": {"enabled": False}})).step(frame)
    assert off.observation.geometry is None
    assert off.observation.by_geometry is None
    assert not off.seen.is_obstacle.any()
    alone = ObstacleMapper(
        AllGrass(), config_from_dict({"geometry": {"enabled": True, "semantics": False}})
    ).step(frame)
    assert alone.seen.is_obstacle.any()
    assert alone.seen.count(MapClass.GRASS) == 0
    living = ObstacleMapper(
        AllGrass(),
        config_from_dict({"geometry": {"enabled": True, "semantics": False}, "grid": {"mode": "evidence"}}),
    )
    living.step(frame)
    assert living.map is not None
    assert living.map.is_obstacle.any()
    assert living.map.count(MapClass.GRASS) == 0
    with pytest.raises(ConfigError, match="enabled or semantics"):
        config_from_dict({"geometry": {"enabled": False, "semantics": False}})


def test_points_on_a_mark_speak_for_an_obstacle_and_never_for_grass() -> None:
    points = np.array([[[0, 5, 0, 0], [0, 5, 1, 0], [0, 0, 2, 0], [0, 3, 0, 4]]], np.uint32)
    classes = np.array([[1, 2, 2, 3]], np.uint8)
    marks = np.array([[True, True, True, True]])
    told, marked = with_marks(points, classes, marks)
    assert not told[..., MapClass.GRASS].any()
    assert (told[..., MapClass.OBSTACLE] > 1000).all()
    assert told[..., MapClass.PERSON].tolist() == [[0, 0, 0, 4]]
    assert marked.tolist() == [[2, 2, 2, 3]]  # a person stays a person
    same, unmarked = with_marks(points, classes, ~marks)
    np.testing.assert_array_equal(same, points)
    np.testing.assert_array_equal(unmarked, classes)
    alone, _ = with_marks(points, classes, ~marks, semantics=False)
    assert not alone.any()


@pytest.mark.parametrize("slope_deg", [0.0, 10.0])
def test_both_together_miss_less_than_each_alone(slope_deg: float) -> None:
    """A network to which everything on the left is grass; geometry that cannot see flat paths."""
    exact = render(garden_scene(0), VGA, LANE)
    frame = seen(garden_scene(0), slope_deg)
    assert exact.labels is not None
    assert frame.T_map_camera is not None
    labels = exact.labels.copy()
    labels[:, :320] = np.where(labels[:, :320] == VOID_ID, VOID_ID, GRASS.id)
    mask = Segmentation(labels, GRASS_OBSTACLE_PERSON)
    config = Config(cloud=CLOUD, geometry=replace(ON, enabled=False))
    both = replace(config, geometry=ON)
    compared = [
        compare_frame(frame, mask, frame.T_map_camera, c, clean=exact.with_pose(frame.T_map_camera))
        for c in (config, both)
    ]
    semantic, fused = (c.misses for c in compared)
    assert len(fused.cells) < 0.4 * len(semantic.cells)
    assert fused.d_min_m(0.05).sum() < semantic.d_min_m(0.05).sum()
    truth = compared[0].reference.is_obstacle
    alone = marks(frame, min_points=ON.min_points).marks
    known = compared[0].predicted.classes > 0
    assert (truth & known & ~alone).sum() > len(fused.cells)


def test_the_living_map_takes_a_geometric_mark_for_an_obstacle() -> None:
    frame = seen(garden_scene(0), 0.0)
    assert frame.T_map_camera is not None
    grass = Segmentation(np.full((1, 1), GRASS.id, np.uint8), GRASS_OBSTACLE_PERSON)
    config = config_from_dict({"geometry": {"enabled": True}, "grid": {"mode": "evidence"}})

    class AllGrass:
        name = "all grass"
        label_set = GRASS_OBSTACLE_PERSON

        def __call__(self, frame: Frame) -> Segmentation:
            return grass

    mapper = ObstacleMapper(AllGrass(), config)
    step = mapper.step(frame)
    assert step.observation.geometry is not None
    assert mapper.map is not None
    here, there = overlap(step.seen.spec, mapper.map.spec)
    marked, living = step.observation.geometry.marks[here], mapper.map.is_obstacle[there]
    columns, rows = (np.arange(n) for n in step.seen.spec.shape[::-1])
    near = step.seen.spec.center_of(np.stack(np.meshgrid(columns, rows), axis=-1))
    close = (np.linalg.norm(near - frame.T_map_camera.position_m[:2], axis=-1) < 4.0)[here]
    assert (marked & close).sum() > 20
    assert living[marked & close].all()  # far marks need a second look, as every sighting does
    assert not living[~marked].any()


@pytest.mark.parametrize("mode", ["last_seen", "log_odds"])
@pytest.mark.parametrize("away_m", [2.5, 4.0, 6.0])
def test_what_is_called_grass_up_on_a_thing_frees_no_cell_of_it(away_m: float, mode: str) -> None:
    """Three points of grass half a metre up once cleared a cell: fewer than the five that mark one."""
    box = Scene((Box((away_m, 0.0), (0.4, 0.4, 0.5)),))
    mapper = ObstacleMapper(AllGrass(), config_from_dict({"grid": {"mode": mode}}))
    frame = seen(box)
    for i in range(6):
        mapper.step(replace(frame, stamp_ns=i))
    assert mapper.map is not None
    low, high = mapper.map.spec.cell_of([[away_m - 0.2, -0.2], [away_m + 0.2, 0.2]])
    on_it = mapper.map.classes[low[1] + 1 : high[1], low[0] + 1 : high[0]]
    assert (on_it >= MapClass.OBSTACLE).sum() > 5
    assert not (on_it == MapClass.GRASS).any()
