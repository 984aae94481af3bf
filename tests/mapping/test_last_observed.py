"""When a cell was last seen: never from unknown to free, never from obstacle to anything."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swardmap.grid import GridSpec
from swardmap.labels import MapClass
from swardmap.mapping.last_observed import NEVER, LastObserved
from swardmap.mapping.tiles import TILE
from swardmap.perception.observation import Observation
from tests.observations import observation

R = 0.1
CORNER = GridSpec(R, 1, 1)


def grid_at(ix: int, iy: int, classes: np.ndarray, stamp_ns: int = 0) -> Observation:
    spec = GridSpec(R, classes.shape[1], classes.shape[0], (round(ix * R, 9), round(iy * R, 9)))
    return observation(spec, classes.astype(np.uint8), stamp_ns=stamp_ns)


def random_grid(rng: np.random.Generator) -> Observation:
    shape = rng.integers(1, 60, 2)
    ix, iy = rng.integers(-200, 200, 2).tolist()
    return grid_at(ix, iy, rng.integers(0, 4, shape), int(rng.integers(0, 100)))


@given(st.integers(0, 2**32 - 1))
def test_stamps_are_those_of_a_dictionary_of_cells(seed: int) -> None:
    rng = np.random.default_rng(seed)
    freshness, oracle = LastObserved(CORNER), dict[tuple[int, int], int]()
    for _ in range(4):
        seen = random_grid(rng)
        freshness.integrate(seen)
        x, y = np.round(np.array(seen.spec.origin_m) / R).astype(int).tolist()
        for iy, ix in np.argwhere(seen.classes > 0).tolist():
            cell = x + ix, y + iy
            oracle[cell] = max(oracle.get(cell, 0), seen.stamp_ns)
    whole = GridSpec(R, 600, 600, (-30.0, -30.0))
    expected = np.full(whole.shape, NEVER)
    for (ix, iy), stamp_ns in oracle.items():
        if -300 <= ix < 300 and -300 <= iy < 300:
            expected[iy + 300, ix + 300] = stamp_ns
    np.testing.assert_array_equal(freshness.last_seen_ns(whole), expected)


@given(st.integers(0, 2**32 - 1), st.integers(-10, 110))
def test_forgetting_only_ever_turns_free_into_unknown(seed: int, before_ns: int) -> None:
    rng = np.random.default_rng(seed)
    freshness = LastObserved(CORNER)
    for _ in range(3):
        freshness.integrate(random_grid(rng))
    grid = random_grid(rng).grid
    kept = grid.classes.copy()
    forgotten = freshness.forget_stale(grid, before_ns)
    np.testing.assert_array_equal(grid.classes, kept)
    changed = forgotten.classes != grid.classes
    assert (grid.classes[changed] == MapClass.GRASS).all()
    assert (forgotten.classes[changed] == MapClass.UNKNOWN).all()
    stale = freshness.last_seen_ns(grid.spec) < before_ns
    np.testing.assert_array_equal(changed, stale & (grid.classes == MapClass.GRASS))
    later = freshness.forget_stale(grid, before_ns + 5)  # the later, the more is forgotten
    assert not (later.classes[changed] == MapClass.GRASS).any()


def test_nothing_is_forgotten_without_a_time_and_all_that_was_never_seen_with_one() -> None:
    grid = grid_at(0, 0, np.full((5, 5), MapClass.GRASS)).grid
    assert LastObserved(CORNER).forget_stale(grid, None) is grid
    assert not LastObserved(CORNER).forget_stale(grid, 0).classes.any()  # a map that was loaded


def test_memory_follows_the_area_and_a_window_bounds_it() -> None:
    freshness = LastObserved(CORNER)
    patch = np.full((10, 10), MapClass.GRASS)
    for i in range(200):
        freshness.integrate(grid_at(10, 10, patch, i))
    assert freshness.nbytes == TILE * TILE * 8
    freshness.integrate(grid_at(10_000, 0, patch, 7))
    freshness.integrate(grid_at(5_000, 0, 0 * patch, 7))
    assert freshness.nbytes == 2 * TILE * TILE * 8
    near = replace(CORNER, width=100, height=100)
    freshness.keep_within(near)
    assert freshness.nbytes == TILE * TILE * 8
    assert freshness.last_seen_ns(near).max() == 199
