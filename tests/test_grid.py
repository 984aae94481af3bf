"""Eq. 2, the cell rules of Sec. 3.5, and grids that share a lattice."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swardmap.errors import InvalidValueError
from swardmap.grid import (
    GridSpec,
    OccupancyGrid,
    classify_cells,
    count_points,
    overlap,
    update_grid,
)
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.types import LabeledCloud

class_arrays = arrays(np.uint8, (6, 7), elements=st.integers(0, 3))
resolutions = st.floats(0.01, 2.0)


@given(resolutions, st.integers(1, 50), st.integers(1, 50), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_center_of_a_cell_lies_in_that_cell(r: float, w: int, h: int, x: float, y: float) -> None:
    spec = GridSpec(r, w, h, (x, y))
    cells = np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=-1)
    np.testing.assert_array_equal(spec.cell_of(spec.center_of(cells)), cells)
    assert spec.contains(cells).all()
    assert not spec.contains([[-1, 0], [0, -1], [w, 0], [0, h]]).any()


@given(resolutions, st.floats(-100, 100), st.floats(-100, 100), st.floats(-50, 50), st.floats(-50, 50))
def test_equation_2(r: float, ox: float, oy: float, x: float, y: float) -> None:
    cell = GridSpec(r, 10, 10, (ox, oy)).cell_of([x, y])
    x_offset, y_offset = -ox / r, -oy / r
    for got, want in zip(cell, (x / r + x_offset, y / r + y_offset), strict=True):
        assert abs(want - (got + 0.5)) <= 0.5 + 1e-6  # equal but for rounding on a cell's edge


def test_origin_is_the_outer_corner_of_cell_0_0() -> None:
    spec = GridSpec(0.5, 4, 2, (1.0, -1.0))
    assert spec.extent_m == (1.0, 3.0, -1.0, 0.0)
    np.testing.assert_allclose(spec.center_of([0, 0]), [1.25, -0.75])
    assert spec.shape == (2, 4)


@given(st.floats(0.02, 1), st.floats(-50, 50), st.floats(-50, 50), st.floats(0, 20), st.floats(0, 20))
def test_covering_grid_covers_and_is_on_the_lattice(r: float, x: float, y: float, w: float, h: float) -> None:
    spec = GridSpec.covering(r, (x, y), (x + w, y + h))
    x0, x1, y0, y1 = spec.extent_m
    eps = 1e-9 * (1 + abs(x) + abs(y))
    assert x0 <= x + eps
    assert y0 <= y + eps
    assert x1 >= x + w - eps
    assert y1 >= y + h - eps
    assert spec.width <= w / r + 2
    spec.offset_in(GridSpec(r, 1, 1))  # raises if not whole cells apart


def test_histogram_of_numpy_counts_the_same_points() -> None:
    rng = np.random.default_rng(0)
    xyz = rng.uniform(-1, 9, (5000, 3)).astype(np.float32)
    cloud = LabeledCloud(xyz, rng.integers(0, 3, 5000).astype(np.uint8), "grid", GRASS_OBSTACLE_PERSON)
    spec = GridSpec(0.25, 32, 16)
    counts, outside = count_points(cloud, spec)
    edges_y, edges_x = np.arange(17) * 0.25, np.arange(33) * 0.25
    for label, map_class in ((1, MapClass.GRASS), (0, MapClass.OBSTACLE), (2, MapClass.PERSON)):
        chosen = cloud.labels == label
        want, _, _ = np.histogram2d(xyz[chosen, 1], xyz[chosen, 0], bins=(edges_y, edges_x))
        np.testing.assert_array_equal(counts[..., map_class], want)
    assert counts.sum() + outside == 5000


def test_cell_rules() -> None:
    # columns: points of unknown, grass, obstacle, person
    points = np.array(
        [[0, 0, 0, 0], [9, 2, 0, 0], [0, 3, 0, 0], [0, 9, 3, 0], [0, 9, 2, 0], [0, 9, 2, 1], [0, 0, 9, 3],
         [0, 0, 1, 2], [0, 0, 0, 2]], np.uint32,
    )[:, None, :]  # fmt: skip
    u, g, o, p = MapClass
    assert classify_cells(points, 3).ravel().tolist() == [u, u, g, o, g, o, p, p, u]
    # marked by a single point, cleared by three: the defaults, as a miss costs more than a false alarm
    assert classify_cells(points, 1, 3).ravel().tolist() == [u, u, g, o, o, p, p, p, p]


@given(class_arrays, class_arrays)
def test_update_clears_grass_then_marks(before: np.ndarray, seen: np.ndarray) -> None:
    spec = GridSpec(0.1, 7, 6)
    after = update_grid(OccupancyGrid(spec, before), OccupancyGrid(spec, seen)).classes
    np.testing.assert_array_equal(after[seen == MapClass.UNKNOWN], before[seen == MapClass.UNKNOWN])
    assert (after[seen == MapClass.GRASS] == MapClass.GRASS).all()
    hazard = seen >= MapClass.OBSTACLE
    np.testing.assert_array_equal(after[hazard], np.maximum(before, seen)[hazard])
    assert not ((after == MapClass.GRASS) & (before != MapClass.GRASS) & (seen != MapClass.GRASS)).any()


@settings(max_examples=60)
@given(st.integers(-9, 9), st.integers(-9, 9), class_arrays)
def test_update_of_a_shifted_window_touches_only_the_overlap(dx: int, dy: int, seen: np.ndarray) -> None:
    outer, inner = GridSpec(0.1, 8, 8, (1.0, 2.0)), GridSpec(0.1, 7, 6, (1 + dx * 0.1, 2 + dy * 0.1))
    after = update_grid(OccupancyGrid.unknown(outer), OccupancyGrid(inner, seen)).classes
    for iy in range(8):
        for ix in range(8):
            y, x = iy - dy, ix - dx
            want = seen[y, x] if 0 <= y < 6 and 0 <= x < 7 else MapClass.UNKNOWN
            assert after[iy, ix] == want


def test_grids_that_do_not_fit_are_refused() -> None:
    spec = GridSpec(0.1, 5, 5)
    for other in (GridSpec(0.2, 5, 5), GridSpec(0.1, 5, 5, frame_id="odom"), GridSpec(0.1, 5, 5, (0.05, 0))):
        with pytest.raises(InvalidValueError, match="grids do not fit"):
            overlap(other, spec)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [((0.0, 5, 5), "positive resolution"), ((float("nan"), 5, 5), "positive resolution"),
     ((0.1, 0, 5), "cells"), ((0.001, 10**6, 10**6), "unit"),
     ((0.1, 5, 5, (float("nan"), 0)), "finite origin")],
)  # fmt: skip
def test_impossible_grids_are_refused(arguments: tuple[object, ...], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        GridSpec(*arguments)  # type: ignore[arg-type]


def test_nav_values() -> None:
    grid = OccupancyGrid(GridSpec(1.0, 4, 1), np.array([[0, 1, 2, 3]], np.uint8))
    assert grid.nav_values.tolist() == [[-1, 0, 100, 100]]
    assert grid.is_obstacle.tolist() == [[False, False, True, True]]
