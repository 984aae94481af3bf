"""The accumulated map: growth, clearing and the memory of persons."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swardmap.config import GridConfig
from swardmap.grid import GridSpec, OccupancyGrid, overlap, update_grid
from swardmap.labels import MapClass
from swardmap.mapping.last_seen_map import LastSeenMap
from swardmap.perception.ground_surface import Ground
from swardmap.perception.observation import Observation
from tests.observations import observation

R = 0.1
windows = st.lists(
    st.tuples(
        st.integers(-300, 300), st.integers(-300, 300), arrays(np.uint8, (5, 6), elements=st.integers(0, 3))
    ),
    min_size=1,
    max_size=6,
)


def seen(classes: object, ix: int = 0, iy: int = 0, stamp_ns: int = 0) -> Observation:
    array = np.asarray(classes, np.uint8)
    spec = GridSpec(R, array.shape[1], array.shape[0], (ix * R, iy * R))
    return observation(spec, array, stamp_ns=stamp_ns)


@settings(max_examples=60, deadline=None)
@example([(0, 0, np.full((5, 6), 3, np.uint8)), (0, 0, np.full((5, 6), 2, np.uint8))])
@given(windows)
def test_growing_map_equals_the_papers_update_on_one_large_grid(
    updates: list[tuple[int, int, np.ndarray]],
) -> None:
    mapper = LastSeenMap(GridConfig(resolution_m=R, person_clear_frames=1))
    large = OccupancyGrid.unknown(GridSpec(R, 700, 700, (-350 * R, -350 * R)))
    for ix, iy, classes in updates:
        mapper.integrate(seen(classes, ix, iy))
        large = update_grid(large, seen(classes, ix, iy).grid)
    grid = mapper.grid
    if grid is None:
        assert not large.classes.any()
        return
    here, there = overlap(grid.spec, large.spec)
    rest = large.classes.copy()
    mine = grid.classes.copy()
    np.testing.assert_array_equal(mine[here], large.classes[there])
    rest[there] = mine[here] = MapClass.UNKNOWN
    assert not rest.any()
    assert not mine.any()


def test_what_was_free_and_is_doubted_is_unknown_and_marks_stay() -> None:
    def doubted(points: int, grounded: bool) -> Observation:
        one = seen(np.zeros((1, 2)))
        told = np.zeros((1, 2, 4), np.uint32)
        told[..., MapClass.UNKNOWN] = points
        ground = Ground(np.zeros(3), np.zeros(2, np.float32), np.zeros(2, np.float32))
        return replace(one, points=told, ground=ground if grounded else None)

    for points, grounded, left in (
        (3, True, MapClass.UNKNOWN),
        (2, True, MapClass.GRASS),
        (9, False, MapClass.GRASS),
    ):
        mapper = LastSeenMap(
            GridConfig(resolution_m=R, origin_m=(0, 0), size_m=(2 * R, R), min_grass_points=3)
        )
        mapper.integrate(seen([[MapClass.GRASS, MapClass.OBSTACLE]]))
        mapper.integrate(doubted(points, grounded))
        assert mapper.grid is not None
        assert mapper.grid.classes.tolist() == [[left, MapClass.OBSTACLE]]


def test_nothing_seen_makes_no_map() -> None:
    mapper = LastSeenMap(GridConfig(resolution_m=R))
    mapper.integrate(seen(np.zeros((3, 3))))
    assert mapper.grid is None


def test_a_person_needs_more_evidence_to_clear_than_to_mark() -> None:
    mapper = LastSeenMap(GridConfig(resolution_m=R, obstacle_clear_frames=1, person_clear_frames=3))
    mapper.integrate(seen([[MapClass.PERSON, MapClass.OBSTACLE]]))

    def step(left: MapClass, right: MapClass) -> list[int]:
        mapper.integrate(seen([[left, right]]))
        assert mapper.grid is not None
        (ix, iy) = GridSpec(R, 1, 1).offset_in(mapper.grid.spec)
        return [int(c) for c in mapper.grid.classes[iy, ix : ix + 2]]

    grass, person, obstacle, unknown = MapClass.GRASS, MapClass.PERSON, MapClass.OBSTACLE, MapClass.UNKNOWN
    assert step(grass, grass) == [person, grass]
    assert step(unknown, unknown) == [person, grass]  # not seeing a cell says nothing
    assert step(grass, grass) == [person, grass]
    assert step(obstacle, grass) == [
        person,
        grass,
    ]  # seen again: the count begins anew, and it stays a person
    assert step(grass, grass) == step(grass, grass) == [person, grass]
    assert step(grass, grass) == [grass, grass]
    assert step(person, obstacle) == [person, obstacle]


def test_fixed_extent_leaves_out_what_falls_beside_it() -> None:
    mapper = LastSeenMap(GridConfig(resolution_m=R, origin_m=(0.0, 0.0), size_m=(1.0, 0.5)))
    grid = mapper.grid
    assert grid is not None
    assert grid.classes.shape == (5, 10)
    assert not grid.classes.any()
    mapper.integrate(seen(np.full((3, 3), MapClass.GRASS), ix=-2, iy=4, stamp_ns=5))
    grid = mapper.grid
    assert grid is not None
    assert (grid.count(MapClass.GRASS), grid.stamp_ns) == (1, 5)


def test_the_map_given_out_is_a_copy() -> None:
    mapper = LastSeenMap(GridConfig(resolution_m=R))
    mapper.integrate(seen([[MapClass.OBSTACLE]]))
    first, second = mapper.grid, mapper.grid
    assert first is not None
    assert second is not None
    first.classes[:] = MapClass.GRASS
    assert second.count(MapClass.OBSTACLE) == 1


@pytest.mark.parametrize(
    ("before", "after", "doubtful", "left"),
    [(8, 2, 2, MapClass.UNKNOWN), (2, 8, 2, MapClass.GRASS), (8, 2, 1, MapClass.GRASS)],
)
def test_points_of_doubt_follow_the_points_that_clear(
    before: int, after: int, doubtful: int, left: MapClass
) -> None:
    grid = GridConfig(resolution_m=R, origin_m=(0, 0), size_m=(R, R), min_grass_points=before)
    mapper = LastSeenMap(grid)
    mapper.integrate(seen([[MapClass.GRASS]]))
    mapper.reconfigure(replace(grid, min_grass_points=after))
    points = np.zeros((1, 1, 4), np.uint32)
    points[..., MapClass.UNKNOWN] = doubtful
    ground = Ground(np.zeros(3), np.zeros(2, np.float32), np.zeros(2, np.float32))
    mapper.integrate(replace(seen([[0]]), points=points, ground=ground))
    assert mapper.grid is not None
    assert mapper.grid.classes.tolist() == [[left]]
