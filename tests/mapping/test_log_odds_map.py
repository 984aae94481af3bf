"""The living map: tiles, window and memory; and on gardens with exact truth, better than the last frame."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.config import Config, EvidenceConfig, GeometryConfig, GridConfig, config_from_dict
from swardmap.errors import InvalidValueError
from swardmap.geometry import Intrinsics, Pose
from swardmap.grid import GridSpec, OccupancyGrid, classify_cells, overlap
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelSet, MapClass
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.mapping.sensor_model import Cells
from swardmap.mapping.tiles import TILE
from swardmap.perception.observation import Observation
from swardmap.pipeline import ObstacleMapper
from swardmap.synth.analytic import (
    AnalyticSource,
    Scene,
    StereoNoise,
    Walker,
    garden_scene,
    lane_poses,
    sphere,
    true_map,
)
from swardmap.types import Frame, Segmentation
from tests.observations import observation

R = 0.1
CAMERA = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
EXTENT = {"origin_m": [-2.0, -8.0], "size_m": [16.0, 16.0], "resolution_m": 0.1, "min_grass_points": 2}


def seen(points: NDArray[np.uint32], ix: int, iy: int, origin_m: tuple[float, float] = (0, 0)) -> Observation:
    corner = origin_m[0] + ix * R, origin_m[1] + iy * R
    spec = GridSpec(R, points.shape[1], points.shape[0], corner)
    eye = (corner[0] + 0.33, corner[1] + 0.21, 0.9)
    rules = GridConfig()
    classes = classify_cells(points, rules.min_points, rules.min_grass_points)
    return observation(spec, classes, points, eye, 7)


def random_points(rng: np.random.Generator) -> NDArray[np.uint32]:
    return rng.choice([0, 0, 2, 3, 9], (int(rng.integers(1, 40)), int(rng.integers(1, 40)), 4)).astype(
        np.uint32
    )


class Mask:
    """True labels, changed by a function of the frame's number and the labels."""

    name = "mask"
    label_set: LabelSet = GRASS_OBSTACLE_PERSON

    def __init__(self, change: Callable[[int, NDArray[np.uint8]], None] = lambda i, labels: None) -> None:
        self._change, self._count = change, 0

    def __call__(self, frame: Frame) -> Segmentation:
        assert frame.labels is not None
        labels = frame.labels.copy()
        self._change(self._count, labels)
        self._count += 1
        return Segmentation(labels, self.label_set)


def config_of(mode: str, **evidence: object) -> Config:
    return config_from_dict({"grid": {**EXTENT, "mode": mode, "min_points": 2}, "evidence": evidence})


def cell_at(grid: OccupancyGrid | None, x: float, y: float) -> MapClass:
    assert grid is not None
    ix, iy = grid.spec.cell_of([x, y])
    return MapClass(int(grid.classes[iy, ix]))


@settings(max_examples=40, deadline=None)
@example(82360)
@given(st.integers(0, 2**32 - 1))
def test_tiles_are_invisible_and_cells_never_drift(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = [(random_points(rng), *rng.integers(-300, 300, 2).tolist()) for _ in range(5)]
    here = LogOddsMap(GridConfig(resolution_m=R))
    dx, dy = rng.integers(-(10**6), 10**6, 2).tolist()  # up to 100 km away, to any place in a tile
    there = LogOddsMap(GridConfig(resolution_m=R))
    for points, ix, iy in frames:
        here.integrate(seen(points, ix, iy))
        there.integrate(seen(points, ix + dx, iy + dy))
    one, two = here.grid, there.grid
    if one is None or two is None:
        assert one is None
        assert two is None
        return
    moved = GridSpec(
        R, one.spec.width, one.spec.height, (one.spec.origin_m[0] + dx * R, one.spec.origin_m[1] + dy * R)
    )
    a, b = overlap(moved, two.spec)
    np.testing.assert_array_equal(one.classes[a], two.classes[b])
    assert np.count_nonzero(one.classes) == np.count_nonzero(one.classes[a]) == np.count_nonzero(two.classes)


def test_only_what_was_seen_takes_memory() -> None:
    living = LogOddsMap(GridConfig(resolution_m=R))
    assert living.grid is None
    living.integrate(seen(np.zeros((50, 50, 4), np.uint32), 0, 0))
    assert living.nbytes == 0
    points = np.full((4, 4, 4), 9, np.uint32)
    for _ in range(100):
        living.integrate(seen(points, 10, 10))
        living.integrate(seen(points, 100_000, 0))  # 10 km away
    assert living.nbytes == 2 * TILE * TILE * 5


def test_the_window_follows_the_camera_and_forgets_what_it_left() -> None:
    living = LogOddsMap(GridConfig(resolution_m=R), EvidenceConfig(window_m=4.0))
    points = np.zeros((10, 10, 4), np.uint32)
    points[..., MapClass.OBSTACLE] = 9
    sizes, specs = [], []
    for step in range(400):
        living.integrate(seen(points, 8 * step, -3 * step))
        grid = living.grid
        assert grid is not None
        sizes.append(living.nbytes)
        specs.append(grid.spec)
        camera = grid.spec.cell_of([0.8 * step + 0.33, -0.3 * step + 0.21])
        assert camera.tolist() == [20, 20]  # the middle of 41 x 41 cells
        assert cell_at(grid, 0.8 * step + 0.33, -0.3 * step + 0.21) == MapClass.OBSTACLE
        assert grid.spec.offset_in(GridSpec(R, 1, 1)) is not None
    assert {spec.shape for spec in specs} == {(41, 41)}
    assert max(sizes) <= 4 * TILE * TILE * 5
    living.integrate(seen(points, 0, 0))
    assert living.grid is not None
    assert (
        living.grid.count(MapClass.OBSTACLE) == 100
    )  # nothing is left of the first visit but what is seen now


def test_a_copy_stays_as_it_is_while_the_map_goes_on() -> None:
    points = np.full((8, 8, 4), 9, np.uint32)
    living = LogOddsMap(GridConfig(resolution_m=R))
    living.integrate(seen(points, 0, 0))
    kept, before = living.copy(), {key: tile.evidence.copy() for key, tile in living.tiles.items()}
    living.integrate(seen(points, 4, 4))
    living.integrate(seen(points, 200, 0))
    assert set(kept.tiles) == set(before) < set(living.tiles)
    for key, evidence in before.items():
        np.testing.assert_array_equal(kept.tiles[key].evidence, evidence)
        assert not np.array_equal(living.tiles[key].evidence, evidence)


def test_what_lies_on_another_lattice_is_refused() -> None:
    living = LogOddsMap(GridConfig(resolution_m=R))
    with pytest.raises(InvalidValueError, match="whole cells apart"):
        living.integrate(seen(np.full((3, 3, 4), 9, np.uint32), 0, 0, origin_m=(0.03, 0.0)))
    with pytest.raises(InvalidValueError, match="expected 128 x 128"):
        living.restore({(0, 0): Cells.unknown(3, 3)}, 0)


def test_the_papers_mode_stays_the_default() -> None:
    mapper = ObstacleMapper(Mask())
    mapper.step(next(iter(AnalyticSource(garden_scene(0), tuple(lane_poses(1)), CAMERA))))
    assert mapper.log_odds is None
    assert mapper.map is not None


def test_both_roads_give_the_same_living_map() -> None:
    frames = list(AnalyticSource(garden_scene(0), tuple(lane_poses(3, step_m=0.4)), CAMERA))
    maps = []
    for backend in ("compiled", "plain"):
        mapper = ObstacleMapper(Mask(), replace(config_of("evidence"), backend=backend))
        for frame in frames:
            mapper.step(frame)
        assert mapper.map is not None
        maps.append(mapper.map.classes)
    np.testing.assert_array_equal(maps[0], maps[1])


def blobs(i: int, labels: NDArray[np.uint8]) -> None:
    """Two wrong blobs a frame, of grass, obstacle or person."""
    rng = np.random.default_rng([5, i])
    v, u = np.ogrid[: labels.shape[0], : labels.shape[1]]
    for _ in range(2):
        cu, cv, a, b = rng.uniform(0, 160), rng.uniform(30, 120), *rng.uniform(3, 13, 2)
        labels[((u - cu) / a) ** 2 + ((v - cv) / b) ** 2 <= 1] = rng.integers(0, 3)


def rates(grid: OccupancyGrid, truth: OccupancyGrid, observed: NDArray[np.bool_]) -> tuple[float, float, int]:
    from scipy import ndimage

    hazard, lawn = observed & truth.is_obstacle, observed & ~truth.is_obstacle
    missed = (grid.classes == MapClass.GRASS)[hazard].mean()
    false = grid.is_obstacle[lawn].mean()
    away = ndimage.distance_transform_edt(~truth.is_obstacle) * grid.spec.resolution_m
    return float(missed), float(false), int((grid.is_obstacle & observed & (away > 0.15)).sum())


@pytest.mark.parametrize("seed", [2, 3])
def test_on_a_garden_with_noise_and_wrong_masks_evidence_beats_the_last_frame(seed: int) -> None:
    scene = garden_scene(seed)
    source = AnalyticSource(scene, tuple(lane_poses(40, step_m=0.1)), CAMERA, noise=StereoNoise(), seed=seed)
    paper, living = (ObstacleMapper(Mask(blobs), config_of(mode)) for mode in ("paper", "evidence"))
    observed: NDArray[np.bool_] = np.zeros((160, 160), np.bool_)
    sums = {"paper": np.zeros(3), "evidence": np.zeros(3)}
    for i, frame in enumerate(source):
        step = paper.step(frame)
        living.step(frame)
        assert paper.map is not None
        assert living.map is not None
        here, there = overlap(step.seen.spec, paper.map.spec)
        observed[there] |= step.seen.classes[here] != MapClass.UNKNOWN
        if i % 5 == 4:
            truth = true_map(scene, paper.map.spec, frame.stamp_ns)
            sums["paper"] += rates(paper.map, truth, observed)
            sums["evidence"] += rates(living.map, truth, observed)
    missed, false, ghosts = sums["evidence"] / sums["paper"]
    assert missed < 0.95
    assert false < 0.95
    assert ghosts < 0.85


def test_a_person_is_followed_and_leaves_nothing_behind_once_the_lawn_was_seen_five_times() -> None:
    """With the settings as shipped, within 5 m: one second at 5 frames a second."""
    scene = Scene(persons=(Walker((3.5, -4.0), (0.0, 0.8)),), name="crossing")
    intrinsics = Intrinsics(320, 240, 230.0, 230.0, 159.5, 119.5)
    source = AnalyticSource(scene, tuple(lane_poses(58, step_m=0.0)), intrinsics, noise=StereoNoise())
    spec = GridSpec(0.05, 320, 320, (-2.0, -8.0))
    extent = {"origin_m": [-2.0, -8.0], "size_m": [16.0, 16.0]}
    mapper = ObstacleMapper(Mask(), config_from_dict({"grid": {"mode": "evidence", **extent}}))
    grass_since: NDArray[np.int64] = np.zeros(spec.shape, np.int64)
    iy, ix = np.indices(spec.shape)
    near = np.hypot(*np.moveaxis(spec.center_of(np.stack((ix, iy), -1)), -1, 0)) < 5.0
    ever = 0
    for frame in source:
        step = mapper.step(frame)
        grid = mapper.map
        assert grid is not None
        here, there = overlap(step.seen.spec, spec)
        now = np.zeros(spec.shape, np.uint8)
        now[there] = step.seen.classes[here]
        truth = true_map(scene, spec, frame.stamp_ns)
        followed = (grid.classes == MapClass.PERSON)[(now == MapClass.PERSON) & truth.is_obstacle & near]
        assert followed.all()
        ever = max(ever, len(followed))
        grass_since[now == MapClass.GRASS] += 1
        grass_since[now >= MapClass.OBSTACLE] = 0
        assert not (grid.is_obstacle & near & (grass_since >= 5)).any()
    assert ever > 20


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_nothing_is_ever_free_that_was_not_seen_as_grass(seed: int) -> None:
    """Whatever comes, in whatever order, through tiles, window and a saved map."""
    rng = np.random.default_rng(seed)
    window = None if rng.random() < 0.5 else float(rng.uniform(1, 20))
    living = LogOddsMap(GridConfig(resolution_m=R), EvidenceConfig(window_m=window))
    k = GridConfig().min_grass_points
    ever_grass: set[tuple[int, int]] = set()
    for _ in range(12):
        points = random_points(rng)
        left, low = (int(v) for v in rng.integers(-60, 60, 2))
        living.integrate(seen(points, left, low))
        hazard = points[..., 2].astype(int) + points[..., 3] >= GridConfig().min_points
        rows, columns = np.nonzero((points[..., 1] >= k) & ~hazard)
        ever_grass |= {(left + int(c), low + int(r)) for r, c in zip(rows, columns, strict=True)}
        if rng.random() < 0.2:
            saved = living.tiles
            living = LogOddsMap(GridConfig(resolution_m=R), EvidenceConfig(window_m=window))
            living.restore(saved, 0)
        grid = living.grid
        if grid is None:
            continue
        x, y = grid.spec.offset_in(GridSpec(R, 1, 1))
        free = {(x + int(c), y + int(r)) for r, c in zip(*np.nonzero(grid.classes == 1), strict=True)}
        assert free <= ever_grass


def test_an_obstacle_in_the_blind_zone_is_remembered() -> None:
    """The camera drives over a ball to its side and on; the lowest rays pass it long before that."""
    ball = Scene((sphere((2.0, 0.0, 0.15), 0.15),), name="ball")
    frames = list(AnalyticSource(ball, tuple(lane_poses(30, step_m=0.1)), CAMERA))
    mapper = ObstacleMapper(Mask(), config_of("evidence"))
    for frame in frames:
        mapper.step(frame)
    assert cell_at(mapper.map, 1.95, 0.0) == MapClass.OBSTACLE  # camera at 2.9 m, ball under and behind it


def test_one_frame_that_calls_an_obstacle_grass_does_not_erase_it() -> None:
    ball = Scene((sphere((2.5, 0.0, 0.2), 0.2),), name="ball")
    frame = next(iter(AnalyticSource(ball, tuple(lane_poses(1)), CAMERA)))

    def blind(i: int, labels: NDArray[np.uint8]) -> None:
        if i % 6 == 5:
            labels[:] = 1

    after: dict[str, MapClass] = {}
    for mode in ("paper", "evidence"):
        alone = replace(config_of(mode), geometry=GeometryConfig(enabled=False))
        mapper = ObstacleMapper(Mask(blind), alone)
        for i in range(12):
            mapper.step(replace(frame, stamp_ns=i))
        after[mode] = cell_at(mapper.map, 2.35, 0.0)
    assert after == {"paper": MapClass.GRASS, "evidence": MapClass.OBSTACLE}


def test_an_invalid_reading_clears_nothing_and_frees_nothing() -> None:
    frame = next(iter(AnalyticSource(garden_scene(0), tuple(lane_poses(1)), CAMERA)))
    mapper = ObstacleMapper(Mask(), config_of("evidence"))
    for i in range(5):
        mapper.step(replace(frame, stamp_ns=i))
    before = mapper.map
    for i in range(5, 40):
        mapper.step(replace(frame, depth=np.zeros_like(frame.depth), stamp_ns=i))
    assert before is not None
    assert mapper.map is not None
    np.testing.assert_array_equal(before.classes, mapper.map.classes)


@pytest.mark.slow
def test_hours_on_one_lawn_keep_memory_flat_and_every_cell_in_its_place() -> None:
    tiny = Intrinsics(64, 48, 46.0, 46.0, 31.5, 23.5)
    poses = tuple(lane_poses(20, step_m=0.2))
    lap = list(AnalyticSource(garden_scene(0), poses, tiny, exact=True))
    config = config_from_dict({"grid": {"mode": "evidence", "resolution_m": 0.1, "min_points": 1}})
    mapper, far = ObstacleMapper(Mask(), config), ObstacleMapper(Mask(), config)
    marks = []
    for i in range(6_000):
        frame = lap[i % 20]
        assert frame.T_map_camera is not None
        matrix = frame.T_map_camera.matrix.copy()
        matrix[:2, 3] += 12.8 * 1000, -12.8 * 400  # the same lawn, kilometres away
        mapper.step(replace(frame, stamp_ns=i))
        far.step(replace(frame, T_map_camera=Pose("map", "camera", matrix), stamp_ns=i))
        assert mapper.log_odds is not None
        if i % 1000 == 999:
            marks.append((mapper.log_odds.nbytes, mapper.map))
    assert len({size for size, _ in marks}) == 1
    first, last = marks[0][1], marks[-1][1]
    assert first is not None
    assert last is not None
    hazards = (first.is_obstacle == last.is_obstacle)[first.classes > 0]
    assert hazards.mean() > 0.999  # the persons of the garden are still in every lap: nothing else may move
    assert far.map is not None
    assert far.map.spec.origin_m == pytest.approx(np.add(last.spec.origin_m, (12_800.0, -5_120.0)))
    # a point on the edge of two cells may fall to either, by the rounding of the pose far away
    assert (far.map.classes != last.classes).mean() < 2e-3
