"""Layers and masks: what each value means, against the rules of Nav2's filters."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.config import AreaConfig, EvidenceConfig
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.mapping.work_area import AreaRole, Polygon, WorkArea
from swardmap.perception.ground_surface import Ground
from swardmap.perception.observation import Observation, PixelCounts
from swardmap.ros.ground_heights import GroundHeights
from swardmap.ros.layers import class_values, evidence_values, keepout_mask, speed_mask
from tests.ros.test_live_pipeline import one_robot

SPEC = GridSpec(0.1, 60, 40, (-3.0, -2.0))


def random_grid(seed: int) -> OccupancyGrid:
    return OccupancyGrid(SPEC, np.random.default_rng(seed).integers(0, 4, SPEC.shape).astype(np.uint8))


def test_classes_can_be_told_apart() -> None:
    grid = random_grid(0)
    values = class_values(grid)
    for kind, value in ((0, -1), (1, 0), (2, 50), (3, 100)):
        assert (values[grid.classes == kind] == value).all()


@given(st.integers(0, 50), st.floats(0.1, 4.0), st.floats(1, 100))
def test_slow_near_persons_and_nowhere_unknown(seed: int, radius_m: float, percent: float) -> None:
    """SpeedFilter: 0 is no limit, -1 an error (speed_filter.cpp, process)."""
    rng = np.random.default_rng(seed)
    grid = OccupancyGrid(SPEC, rng.choice(np.array([0, 1, 2], np.uint8), SPEC.shape))
    persons = rng.integers(0, (40, 60), (rng.integers(0, 4), 2))
    grid.classes[tuple(persons.T)] = MapClass.PERSON
    mask = speed_mask(grid, radius_m, percent)
    iy, ix = np.indices(SPEC.shape)
    centres = SPEC.center_of(np.stack([ix, iy], axis=-1))
    near = np.zeros(SPEC.shape, bool)
    for y, x in persons.tolist():
        near |= np.hypot(*np.moveaxis(centres - SPEC.center_of([x, y]), -1, 0)) <= radius_m
    assert (mask[near] >= 1).all()
    wider = np.zeros(SPEC.shape, bool)
    for y, x in persons.tolist():
        wider |= np.hypot(*np.moveaxis(centres - SPEC.center_of([x, y]), -1, 0)) <= radius_m + 1e-6
    assert (mask[~wider] == 0).all()
    assert set(np.unique(mask).tolist()) <= {0, round(percent)}


def test_out_of_the_work_area_is_kept_out_of() -> None:
    ring = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    area = WorkArea((Polygon(AreaRole.BOUNDARY, (ring,)),), "map", AreaConfig().keep_out_cost)
    mask = keepout_mask(SPEC, area)
    iy, ix = np.indices(SPEC.shape)
    x, y = np.moveaxis(SPEC.center_of(np.stack([ix, iy], axis=-1)), -1, 0)
    np.testing.assert_array_equal(mask == 100, (np.abs(x) > 1) | (np.abs(y) > 1))
    assert (keepout_mask(SPEC, None) == 0).all()


def test_evidence_is_the_probability_of_the_log_odds() -> None:
    robot = one_robot({"grid": {"mode": "log_odds"}})
    for i in range(6):
        robot.step(i, 0.1 * i)
    grid = robot.pipeline.mapper.snapshot(None)
    assert grid is not None
    values = robot.pipeline.mapper.evidence(grid.spec)
    assert values is not None
    evidence, lawn = EvidenceConfig(), values[grid.classes == MapClass.GRASS]
    # between the two thresholds a cell stays what it was
    assert values[grid.is_obstacle].min() >= 100 / (1 + np.exp(evidence.clear_at)) - 1
    assert lawn.max() <= 100 / (1 + np.exp(-evidence.mark_at)) + 1
    assert lawn.min() >= 0
    assert lawn.mean() < 45 < 55 < values[grid.is_obstacle].mean()
    assert (values == -1).any()
    # by hand, of one cell
    log_odds = robot.pipeline.mapper._mapper.log_odds
    assert isinstance(log_odds, LogOddsMap)
    row, column = np.argwhere(grid.is_obstacle)[0].tolist()
    ix, iy = (np.array([column, row]) + grid.spec.offset_in(log_odds.corner_cell)).tolist()
    tile = log_odds.tiles[ix // 128, iy // 128]
    nats = tile.evidence[iy % 128, ix % 128] / 1000
    assert values[row, column] == pytest.approx(100 / (1 + np.exp(-nats)), abs=0.51)
    np.testing.assert_array_equal(evidence_values(log_odds, grid.spec), values)


def test_a_map_of_the_last_frame_has_no_evidence() -> None:
    robot = one_robot()
    robot.step(0, 0.0)
    assert robot.pipeline.mapper.evidence(SPEC) is None


def test_height_is_that_of_the_ground_against_the_base() -> None:
    """A ramp by hand, given as two frames; the later one wins where both see."""
    spec = GridSpec(0.5, 8, 4, (-2.0, -1.0))
    heights = GroundHeights(spec)
    heights.integrate(seen_ground(spec, slope=0.1, c_m=120.0))
    values = heights.values(spec, 120.19)
    x = 0.5 * (np.arange(8) + 0.5)  # from the grid's corner
    np.testing.assert_array_equal(values, np.tile(np.round((0.1 * x - 0.19) / 0.05) + 50, (4, 1)))
    heights.integrate(seen_ground(spec, slope=0.0, c_m=121.0, carried=True))
    np.testing.assert_array_equal(heights.values(spec, 120.19), values)  # a ground carried over was not seen
    heights.integrate(seen_ground(spec, slope=0.0, c_m=125.0))
    assert (heights.values(spec, 120.2) == 100).all()
    beside = GridSpec(0.5, 8, 4, (50.0, -1.0))
    assert (heights.values(beside, 120.2) == -1).all()


def seen_ground(spec: GridSpec, slope: float, c_m: float, carried: bool = False) -> Observation:
    cells = spec.width * spec.height
    offset = np.zeros(cells, np.float32)
    ground = Ground(np.array([slope, 0.0, c_m]), offset, offset, carried)
    classes, points = np.ones(spec.shape, np.uint8), np.zeros((*spec.shape, 4), np.uint32)
    counts = PixelCounts(*[0] * 9)
    return Observation(spec, classes, points, (0.0, 0.0, c_m + 1), 1, counts, classes, ground)


def test_the_node_has_heights_of_the_lawn_it_saw() -> None:
    robot = one_robot()
    for i in range(4):
        robot.step(i, 0.1 * i)
    grid = robot.pipeline.mapper.snapshot(None)
    assert grid is not None
    values = robot.pipeline.mapper.heights(grid.spec, 0.0)
    assert values is not None
    lawn = values[grid.classes == MapClass.GRASS]
    assert (lawn >= 0).mean() > 0.95
    assert np.abs(lawn[lawn >= 0].astype(int) - 50).max() <= 2  # level within 10 cm
