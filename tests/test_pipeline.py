"""The step: a garden with exact truth in, the right map out; and what must be refused."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swardmap.config import CloudConfig, Config, GridConfig, MountConfig, config_from_dict
from swardmap.errors import ConfigError, InputError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.grid import GridSpec, overlap
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelSet, MapClass
from swardmap.pipeline import ObstacleMapper, StepResult, configured_mount, view_spec
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses, true_map
from swardmap.types import Frame, Segmentation

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)


class Truth:
    """The frame's own labels."""

    name = "truth"
    label_set: LabelSet = GRASS_OBSTACLE_PERSON

    def __call__(self, frame: Frame) -> Segmentation:
        assert frame.labels is not None
        return Segmentation(frame.labels, self.label_set)


def source(n: int = 4) -> AnalyticSource:
    return AnalyticSource(garden_scene(0), tuple(lane_poses(n, step_m=0.5)), SMALL)


def test_the_garden_is_mapped_as_it_is() -> None:
    frames = list(source(5))
    config = config_from_dict({"grid": {"resolution_m": 0.1, "min_points": 2}})
    mapper = ObstacleMapper(Truth(), config)
    steps = list(mapper.run(frames))
    grid = mapper.map
    assert grid is not None
    truth = true_map(source().scene, grid.spec)
    seen = grid.classes != MapClass.UNKNOWN
    agree = (grid.is_obstacle == truth.is_obstacle)[seen].mean()
    assert agree > 0.95
    assert grid.count(MapClass.OBSTACLE) > 50
    assert [step.frame.name for step in steps] == [frame.name for frame in frames]


def test_every_obstacle_cell_lies_within_one_cell_of_a_true_one() -> None:
    from scipy import ndimage

    frame = next(iter(replace(source(1), exact=True)))
    config = config_from_dict({"grid": {"resolution_m": 0.1, "min_points": 1}})
    seen = ObstacleMapper(Truth(), config).step(frame).seen
    truth = true_map(source().scene, seen.spec)
    distance = ndimage.distance_transform_edt(~truth.is_obstacle)
    assert distance[seen.is_obstacle].max() <= np.sqrt(2) + 1e-9


def test_both_roads_map_a_sequence_alike() -> None:
    frames = list(source(3))
    maps = []
    for backend in ("compiled", "plain"):
        mapper = ObstacleMapper(Truth(), config_from_dict({"backend": backend}))
        for _ in mapper.run(frames):
            pass
        maps.append(mapper.map)
    assert maps[0] is not None
    assert maps[1] is not None
    assert maps[0].spec == maps[1].spec
    np.testing.assert_array_equal(maps[0].classes, maps[1].classes)


def test_the_map_does_not_depend_on_how_the_grid_was_given() -> None:
    frames = list(source(3))
    grown, fixed = (
        ObstacleMapper(Truth(), Config(grid=grid))
        for grid in (GridConfig(), GridConfig(origin_m=(-2.0, -15.0), size_m=(30.0, 30.0)))
    )
    for frame in frames:
        grown.step(frame)
        fixed.step(frame)
    assert grown.map is not None
    assert fixed.map is not None
    here, there = overlap(grown.map.spec, fixed.map.spec)
    # float32 begins at each window's corner: a point on the edge of two cells may fall to either
    assert (grown.map.classes[here] != fixed.map.classes[there]).mean() < 1e-4


def test_points_beside_a_fixed_grid_are_counted() -> None:
    frame = next(iter(source(1)))
    config = Config(grid=GridConfig(origin_m=(100.0, 100.0), size_m=(1.0, 1.0)))
    step = ObstacleMapper(Truth(), config).step(frame)
    assert step.counts.used == 0
    assert step.counts.outside_grid > 1000


def test_frames_without_a_pose_are_mapped_by_the_mount() -> None:
    frame = replace(next(iter(source(1))), T_map_camera=None)
    mount = MountConfig(height_m=0.9, pitch_deg=20.0)
    mapper = ObstacleMapper(Truth(), Config(mount=mount))
    step = mapper.step(frame)
    assert step.T_map_camera.parent == step.seen.spec.frame_id == "base"
    assert step.seen.count(MapClass.GRASS) > 100
    assert mapper.map is None
    assert mapper.costmap() is None
    with pytest.raises(InputError, match=r"no pose and the mount is not known.*mount\.height_m"):
        ObstacleMapper(Truth()).step(frame)
    with pytest.raises(InvalidValueError, match="together"):
        configured_mount(MountConfig(height_m=1.0))


def test_a_clock_that_goes_back_is_refused() -> None:
    first, second = source(2)
    mapper = ObstacleMapper(Truth())
    mapper.step(second)
    with pytest.raises(InputError, match=r"clock went back by 0\.200 s"):
        mapper.step(first)


def test_below_the_confidence_grass_clears_nothing() -> None:
    frame = next(iter(source(1)))

    class Unsure(Truth):
        def __call__(self, frame: Frame) -> Segmentation:
            sure = super().__call__(frame)
            return replace(sure, confidence=np.full(sure.labels.shape, 0.4, np.float32))

    config = config_from_dict({"segmenter": {"min_confidence": 0.5}})
    step = ObstacleMapper(Unsure(), config).step(frame)
    sure = ObstacleMapper(Truth()).step(frame)
    assert sure.seen.count(MapClass.GRASS) > 100
    assert step.seen.count(MapClass.GRASS) == 0
    np.testing.assert_array_equal(step.seen.is_obstacle, sure.seen.is_obstacle)
    assert step.observation.points[..., MapClass.UNKNOWN].sum() > 1000


def test_cloud_of_a_step_lies_in_the_map_frame() -> None:
    frame = next(iter(source(1)))
    step: StepResult = ObstacleMapper(Truth()).step(frame)
    cloud = step.cloud(Config())
    assert cloud.frame_id == "map"
    grass = cloud.xyz[cloud.labels == 1]
    assert np.abs(grass[:, 2]).max() < 0.02  # the lawn is z = 0, depth is rounded to millimetres


@pytest.mark.parametrize("pitch_deg", [-30.0, 0.0, 20.0, 60.0, 90.0])
def test_the_window_holds_everything_in_view(pitch_deg: float) -> None:
    rng = np.random.default_rng(0)
    T = Pose("map", "camera", mount_pose(1.0, pitch_deg, 5.0, 33.0, (400_000.0, -5.0)).matrix)
    spec = view_spec(SMALL, T, 8.0, 0.05)
    u, v, z = rng.uniform(0, 159, 4000), rng.uniform(0, 119, 4000), rng.uniform(0, 8, 4000)
    points = np.stack([z * (u - SMALL.cx) / SMALL.fx, z * (v - SMALL.cy) / SMALL.fy, z], axis=1)
    assert spec.contains(spec.cell_of(T.apply(points)[:, :2])).all()
    corner_in_cells = np.asarray(spec.origin_m) / 0.05
    np.testing.assert_allclose(corner_in_cells, np.round(corner_in_cells), atol=1e-4)
    assert spec.offset_in(GridSpec(0.05, 1, 1)) == tuple(np.round(corner_in_cells).astype(int))


def test_costmap_of_the_map() -> None:
    mapper = ObstacleMapper(Truth(), config_from_dict({"costmap": {"margin_m": 0.2}}))
    mapper.step(next(iter(source(1))))
    costmap, grid = mapper.costmap(), mapper.map
    assert costmap is not None
    assert grid is not None
    assert (costmap.costs[grid.is_obstacle] == 254).all()
    assert int((costmap.costs == 254).sum()) > int(grid.is_obstacle.sum())


@pytest.mark.parametrize("spoil", [lambda d: d * 0, lambda d: d + 65535])
def test_a_blind_or_saturated_camera_maps_nothing(spoil: Callable[[np.ndarray], np.ndarray]) -> None:
    frame = next(iter(source(1)))
    blind = replace(frame, depth=np.clip(spoil(frame.depth.astype(np.int64)), 0, 65535).astype(np.uint16))
    mapper = ObstacleMapper(Truth(), Config(cloud=CloudConfig(max_range_m=8.0)))
    step = mapper.step(blind)
    assert step.counts.used == 0
    assert mapper.map is None
    assert step.seen.count(MapClass.GRASS) == 0


class Painted:
    """All of one class."""

    name = "painted"
    label_set: LabelSet = GRASS_OBSTACLE_PERSON

    def __init__(self) -> None:
        self.label = 0

    def __call__(self, frame: Frame) -> Segmentation:
        return Segmentation(np.full(frame.depth.shape, self.label, np.uint8), self.label_set)


@pytest.mark.parametrize(("before", "after"), [(1, 200), (200, 1)])
def test_frames_to_clear_take_effect_when_they_change(before: int, after: int) -> None:
    config = config_from_dict({"grid": {"obstacle_clear_frames": before}, "geometry": {"enabled": False}})
    painted, frames = Painted(), list(source(2))
    mapper = ObstacleMapper(painted, config)
    mapper.step(frames[0])
    mapper.reconfigure(replace(config, grid=replace(config.grid, obstacle_clear_frames=after)))
    painted.label = 1
    seen = mapper.step(replace(frames[0], stamp_ns=frames[1].stamp_ns)).seen
    assert mapper.map is not None
    here, there = overlap(seen.spec, mapper.map.spec)
    cleared = mapper.map.classes[there][seen.classes[here] == MapClass.GRASS] == MapClass.GRASS
    assert cleared.size > 100
    assert cleared.all() if after == 1 else not cleared.any()


@pytest.mark.parametrize(
    "settings",
    [{"grid": {"min_grass_points": 3}}, {"evidence": {"mark_at": 0.3}}, {"cloud": {"min_height_m": -0.4}}],
)
def test_what_the_evidence_is_built_on_is_refused(settings: dict[str, Any]) -> None:
    mode: dict[str, Any] = {"grid": {"mode": "log_odds"}}
    mapper = ObstacleMapper(Truth(), config_from_dict(mode))
    grid = {**mode["grid"], **settings.get("grid", {})}
    with pytest.raises(ConfigError, match="clear the map first"):
        mapper.reconfigure(config_from_dict({**settings, "grid": grid}))
