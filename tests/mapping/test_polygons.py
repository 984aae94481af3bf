"""The one polygon fill, against shapely and OpenCV; and what it costs."""

import time
from itertools import pairwise

import cv2
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.grid import GridSpec
from swardmap.mapping import polygons
from swardmap.mapping.polygons import cells_inside, points_inside

SPEC = GridSpec(0.37, 40, 37, (-2.03, -2.07))
floats = st.floats(-3, 13, allow_nan=False).map(lambda v: round(v, 3))


def centres(spec: GridSpec) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    iy, ix = np.indices(spec.shape)
    x, y = np.moveaxis(spec.center_of(np.stack([ix, iy], axis=-1).reshape(-1, 2)), -1, 0)
    return x.reshape(spec.shape), y.reshape(spec.shape)


def by_even_odd(spec: GridSpec, corners: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Inside by counting crossings of a ray with shapely, and which centres are sure (not on an edge)."""
    x, y = centres(spec)
    edges = shapely.linestrings(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    points = shapely.points(x, y)
    sure = shapely.distance(points[..., None], edges).min(axis=-1) > 1e-9
    low, high = corners[:, 1].min(), corners[:, 1].max()
    # a ray that is nearly level meets no corner of three decimals
    ends = np.stack([np.full_like(x, 1e3), y + 1.234567e-5 * (1e3 - x)], axis=-1)
    rays = shapely.linestrings(np.stack([np.stack([x, y], axis=-1), ends], axis=-2))
    count = shapely.intersects(rays[..., None], edges).sum(axis=-1)
    near_corner = shapely.distance(rays[..., None], shapely.points(corners)).min(axis=-1) < 1e-9
    return (count % 2 == 1) & (low <= y) & (y <= high), sure & ~near_corner


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(floats, floats), min_size=3, max_size=9, unique=True))
def test_any_ring_is_filled_as_rays_of_shapely_say(corners: list[tuple[float, float]]) -> None:
    ring = np.array(corners)
    want, sure = by_even_odd(SPEC, ring)
    np.testing.assert_array_equal(cells_inside(SPEC, ring)[sure], want[sure])


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(floats, floats), min_size=3, max_size=9, unique=True))
def test_a_simple_ring_is_filled_as_shapely_contains(corners: list[tuple[float, float]]) -> None:
    shape = shapely.Polygon(corners)
    if not shape.is_valid:
        return
    x, y = centres(SPEC)
    sure = shapely.distance(shape.exterior, shapely.points(x, y)) > 1e-9
    np.testing.assert_array_equal(cells_inside(SPEC, corners)[sure], shapely.contains_xy(shape, x, y)[sure])


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(-2, 12), st.integers(-2, 12)), min_size=3, max_size=7, unique=True))
def test_a_simple_ring_is_filled_as_opencv_says(corners: list[tuple[int, int]]) -> None:
    if not shapely.Polygon(corners).is_valid:
        return
    inside = cells_inside(SPEC, corners)
    ring = np.array(corners, np.float32).reshape(-1, 1, 2)
    for iy in range(0, SPEC.height, 3):
        for ix in range(0, SPEC.width, 3):
            x, y = SPEC.center_of([ix, iy])
            distance = cv2.pointPolygonTest(ring, (float(x), float(y)), True)
            if abs(distance) > 1e-3:
                assert inside[iy, ix] == (distance > 0)


@given(st.lists(st.integers(0, 6), min_size=2, max_size=5, unique=True), st.integers(0, 6), st.integers(0, 6))
def test_neighbours_share_no_point_and_leave_none_out(cuts: list[int], low: int, high: int) -> None:
    """On points that lie on the edges themselves."""
    if low == high:
        return
    lattice = np.arange(-1.0, 8.0)
    bounds = sorted(cuts)
    total = np.zeros((9, 9), int)
    for left, right in pairwise(bounds):
        total += points_inside(lattice, lattice, [(left, low), (right, low), (right, high), (left, high)])
    whole = [(bounds[0], low), (bounds[-1], low), (bounds[-1], high), (bounds[0], high)]
    np.testing.assert_array_equal(total, points_inside(lattice, lattice, whole))
    assert total.max() == 1


def test_parts_of_any_size_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    ring = np.random.default_rng(5).uniform(-2, 11, (50, 2))
    whole = cells_inside(SPEC, ring)
    monkeypatch.setattr(polygons, "CHUNK", 7)
    np.testing.assert_array_equal(cells_inside(SPEC, ring), whole)


def test_an_outline_of_200_000_corners_takes_no_seconds() -> None:
    angles = np.linspace(0, 2 * np.pi, 200_000, endpoint=False)
    radii = 400 + 20 * np.sin(3000 * angles)
    ring = np.stack([500 + radii * np.cos(angles), 500 + radii * np.sin(angles)], axis=-1)
    lattice = np.arange(1000) + 0.5
    started = time.process_time()
    inside = points_inside(lattice, lattice, ring)
    assert time.process_time() - started < 2
    assert inside.sum() == pytest.approx(shapely.Polygon(ring).area, rel=1e-3)


def test_edges_without_end_are_refused_at_once() -> None:
    zigzag = np.stack([np.arange(200_000) % 997, np.arange(200_000) % 2 * 1000.0], axis=-1)
    lattice = np.arange(1000) + 0.5
    with pytest.raises(InvalidValueError, match="simplify"):
        points_inside(lattice, lattice, zigzag)


@pytest.mark.parametrize("corners", [np.zeros((2, 2)), [(0, 0), (1, np.nan), (2, 2)], np.zeros(3), []])
def test_what_is_no_ring_is_refused(corners: NDArray[np.float64]) -> None:
    with pytest.raises(InvalidValueError, match="three finite corners"):
        cells_inside(SPEC, corners)


def test_what_lies_beside_the_lattice_is_empty() -> None:
    far = np.array([(100.0, 100.0), (110.0, 100.0), (105.0, 110.0)])
    assert not cells_inside(SPEC, far).any()
    around = np.array([(-100.0, -100.0), (100.0, -100.0), (100.0, 100.0), (-100.0, 100.0)])
    assert cells_inside(SPEC, around).all()
