import numpy as np
import pytest
import scipy.ndimage as nd
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from swardmap.errors import InvalidValueError
from swardmap.eval import dmin
from swardmap.eval.dmin import d_min_obst, find_misses, nearest_hits
from swardmap.labels import MapClass

Map = NDArray[np.uint8]
EIGHT = np.ones((3, 3), bool)


@st.composite
def map_pairs(draw: st.DrawFn) -> tuple[Map, Map]:
    """Random maps, from one cell up, some of them all unknown, without FN or without TP."""
    shape = draw(hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=25))
    weights = draw(st.sampled_from([(0, 1, 2, 3), (0, 1, 1, 1, 2), (0,), (1, 2), (0, 1), (2, 3)]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    r, p = (rng.choice(weights, shape).astype(np.uint8) for _ in range(2))
    if draw(st.booleans()):  # areas instead of salt
        r = np.kron(r, np.ones((3, 3), np.uint8))
        p = np.roll(r, draw(st.integers(-3, 3)), axis=1)
    return r, p


@given(map_pairs())
@settings(deadline=None, max_examples=150)
def test_distances_are_those_of_a_kd_tree_and_of_a_distance_transform(pair: tuple[Map, Map]) -> None:
    reference, predicted = pair
    ours = d_min_obst(reference, predicted, 0.05)
    tp = (reference >= 2) & (predicted >= 2)
    fn = (reference >= 2) & (predicted == 1)
    assert len(ours) == fn.sum()
    if not tp.any():
        assert np.isinf(ours).all()
        return
    tree, _ = cKDTree(np.argwhere(tp)).query(np.argwhere(fn))
    np.testing.assert_allclose(ours, tree * 0.05, rtol=1e-14)
    np.testing.assert_allclose(ours, nd.distance_transform_edt(~tp)[fn] * 0.05, rtol=1e-14)


@given(map_pairs())
@settings(deadline=None, max_examples=150)
def test_missed_obstacles_are_the_labelled_components_without_a_hit(pair: tuple[Map, Map]) -> None:
    reference, predicted = pair
    misses = find_misses(reference, predicted)
    labels, n = nd.label(reference >= 2, EIGHT)
    hit = predicted >= 2
    lost = [k for k in range(1, n + 1) if not hit[labels == k].any()]
    expected = []
    for k in lost:
        iy, ix = np.nonzero(labels == k)
        free = int((predicted[labels == k] == 1).sum())
        person = bool((reference[labels == k] == 3).any())
        expected.append((len(iy), free, person, (ix.mean() + 0.5, iy.mean() + 0.5)))
    found = [(m.cells, m.called_free, m.person, m.center) for m in misses.missed]
    assert misses.obstacles == n
    assert [e[:3] for e in expected] == [f[:3] for f in found]
    np.testing.assert_allclose([e[3] for e in expected], [f[3] for f in found])
    ix, iy = misses.cells.T
    assert np.array_equal(misses.found, ~np.isin(labels[iy, ix], lost))
    assert np.array_equal(misses.person, reference[iy, ix] == 3)
    assert misses.hits == ((reference >= 2) & hit).sum()


@given(map_pairs())
@settings(deadline=None, max_examples=80)
def test_the_nearest_hit_and_its_class(pair: tuple[Map, Map]) -> None:
    reference, predicted = pair
    misses = find_misses(reference, predicted)
    if misses.hits == 0 or len(misses.cells) == 0:
        return
    nearest = nearest_hits(reference, predicted, misses.cells)
    assert np.array_equal(((nearest - misses.cells) ** 2).sum(axis=1), misses.squared)
    is_hit = (reference >= 2) & (predicted >= 2)
    assert is_hit[nearest[:, 1], nearest[:, 0]].all()
    for cell, squared, from_person in zip(misses.cells, misses.squared, misses.from_person, strict=True):
        iy, ix = np.nonzero(is_hit)
        distance = (ix - cell[0]) ** 2 + (iy - cell[1]) ** 2
        classes = predicted[iy, ix][distance == squared]
        assert from_person == (classes == MapClass.PERSON).all()


@given(map_pairs(), st.integers(0, 5), st.integers(0, 5))
@settings(deadline=None, max_examples=60)
def test_distances_do_not_change_with_the_place_or_by_a_mirror(
    pair: tuple[Map, Map], dx: int, dy: int
) -> None:
    before = np.sort(find_misses(*pair).squared)
    padded = [np.pad(m, ((dy, 2), (dx, 1))) for m in pair]
    assert np.array_equal(np.sort(find_misses(*padded).squared), before)
    mirrored = [np.ascontiguousarray(m[::-1].T) for m in pair]
    assert np.array_equal(np.sort(find_misses(*mirrored).squared), before)


def test_very_large_sets_take_the_transform_and_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    reference = (rng.random((120, 90)) < 0.2).astype(np.uint8) * 2 + 1
    predicted = np.where(rng.random((120, 90)) < 0.5, np.minimum(reference, 2), 1).astype(np.uint8)
    brute = find_misses(reference, predicted)
    monkeypatch.setattr(dmin, "PAIRS_BY_BRUTE_FORCE", 0)
    assert np.array_equal(find_misses(reference, predicted).squared, brute.squared)
    assert brute.squared.max() > 1


def test_a_shifted_obstacle_has_the_distances_of_arithmetic() -> None:
    """A 10 x 10 block seen n cells too far to the right: its first n columns are missed, at 1..n cells."""
    for n in (1, 4, 9):
        reference = np.full((40, 40), MapClass.GRASS, np.uint8)
        reference[10:20, 10:20] = MapClass.OBSTACLE
        predicted = np.roll(reference, n, axis=1)
        distances = np.sort(d_min_obst(reference, predicted, 0.1))
        np.testing.assert_allclose(distances, np.repeat(np.arange(1, n + 1), 10) * 0.1)


def test_a_deleted_obstacle_is_counted_as_missed_with_size_and_place() -> None:
    reference = np.full((30, 30), MapClass.GRASS, np.uint8)
    reference[2:5, 2:5] = MapClass.OBSTACLE
    reference[20:24, 10:12] = MapClass.PERSON
    predicted = reference.copy()
    predicted[20:24, 10:12] = MapClass.GRASS
    predicted[20, 10] = MapClass.UNKNOWN
    misses = find_misses(reference, predicted)
    assert misses.obstacles == 2
    (missed,) = misses.missed
    assert (missed.cells, missed.called_free, missed.person, missed.center) == (8, 7, True, (11, 22))
    assert not misses.found.any()
    assert misses.person.all()
    assert np.isfinite(misses.d_min_m(0.05)).all()


def test_maps_of_different_size_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="one shape"):
        find_misses(np.zeros((2, 2), np.uint8), np.zeros((2, 3), np.uint8))
    with pytest.raises(InvalidValueError, match="with a TP cell"):
        nearest_hits(np.zeros((2, 2), np.uint8), np.zeros((2, 2), np.uint8), np.zeros((1, 2), np.int64))
