import math
from pathlib import Path

import numpy as np
import pytest
import scipy.ndimage as nd
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.errors import InputError, InvalidValueError
from swardmap.eval.cost import reachable_areas, squared_distance
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.maps.area_files import read_metric_area
from swardmap.labels import MapClass
from swardmap.mapping.polygons import cells_inside

R = 0.1
EVERYTHING = [(-1, -1), (100, -1), (100, 100), (-1, 100)]


def disc(radius: float) -> NDArray[np.bool_]:
    n = math.ceil(radius)
    y, x = np.mgrid[-n : n + 1, -n : n + 1]
    return np.asarray(x * x + y * y <= radius * radius + 1e-9)


@given(st.integers(0, 2**32), st.integers(8, 30), st.integers(8, 30), st.floats(1.0, 4.0), st.floats(0, 0.5))
@settings(deadline=None, max_examples=60)
def test_the_area_is_that_of_growing_and_opening_by_discs(
    seed: int, height: int, width: int, half_cells: float, margin_m: float
) -> None:
    rng = np.random.default_rng(seed)
    classes = rng.choice([0, 1, 2, 3], (height, width), p=[0.01, 0.97, 0.01, 0.01]).astype(np.uint8)
    grid = OccupancyGrid(GridSpec(R, width, height), classes)
    (point,) = reachable_areas(grid, EVERYTHING, 2 * half_cells * R, [margin_m])
    obstacle = classes >= 2
    y, x = np.indices(classes.shape)
    near = np.zeros_like(obstacle)
    for oy, ox in np.argwhere(obstacle):
        near |= np.hypot(x - ox, y - oy) * R <= margin_m
    free = (classes == MapClass.GRASS) & ~near
    centers = nd.binary_erosion(free, disc(half_cells), border_value=0)
    parts, n = nd.label(centers, np.ones((3, 3)))
    sizes = [nd.binary_dilation(parts == k, disc(half_cells)).sum() for k in range(1, n + 1)]
    assert point.reachable_m2 == pytest.approx(max(sizes, default=0) * R * R)


def test_an_empty_square_is_reached_but_for_its_corners() -> None:
    grid = OccupancyGrid(GridSpec(0.01, 400, 400), np.ones((400, 400), np.uint8))
    (point,) = reachable_areas(grid, [(0, 0), (4, 0), (4, 4), (0, 4)], 1.0, [0.0])
    assert point.reachable_m2 == pytest.approx(16 - (4 - math.pi) * 0.25, rel=2e-3)


def test_more_margin_reaches_less_and_a_gap_closes_when_it_must() -> None:
    """Two rooms joined by a gap of 1.5 m; a mower of 1 m passes until the margin eats the gap."""
    classes = np.ones((60, 120), np.uint8)
    classes[:, 60] = MapClass.OBSTACLE
    classes[22:37, 60] = MapClass.GRASS
    grid = OccupancyGrid(GridSpec(R, 120, 60), classes)
    points = reachable_areas(grid, EVERYTHING, 1.0, [0.0, 0.1, 0.2, 0.3, 0.4, 1.0], start_m=(1.0, 3.0))
    areas = [p.reachable_m2 for p in points]
    assert areas == sorted(areas, reverse=True)
    assert areas[0] > 60
    assert areas[-1] < 36
    (far,) = reachable_areas(grid, EVERYTHING, 1.0, [1.0], start_m=(11.0, 3.0))
    assert far.reachable_m2 == pytest.approx(areas[-1], rel=0.03)  # the other room is a column narrower
    blocked = reachable_areas(grid, EVERYTHING, 1.0, [0.0], start_m=(6.05, 0.05))
    assert blocked[0].reachable_m2 == 0


def test_unknown_and_outside_cannot_be_entered() -> None:
    classes = np.ones((50, 50), np.uint8)
    classes[:, 25:] = MapClass.UNKNOWN
    grid = OccupancyGrid(GridSpec(R, 50, 50), classes)
    everything = reachable_areas(grid, EVERYTHING, 0.4, [0])[0].reachable_m2
    half = reachable_areas(grid, [(0, 0), (5, 0), (5, 2.5), (0, 2.5)], 0.4, [0])[0].reachable_m2
    assert everything <= 12.5
    assert half == pytest.approx(everything / 2, rel=0.03)
    nothing = reachable_areas(OccupancyGrid.unknown(grid.spec), EVERYTHING, 0.4, [0.0])[0]
    assert (nothing.reachable_m2, nothing.share) == (0, None)


@given(st.integers(0, 2**32))
@settings(deadline=None, max_examples=30)
def test_a_polygon_is_that_of_a_half_plane_test_for_triangles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, c = corners = rng.uniform(0, 3, (3, 2))
    spec = GridSpec(R, 30, 30)
    iy, ix = np.indices(spec.shape)
    p = spec.center_of(np.stack((ix, iy), axis=-1))

    def side(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray((v[0] - u[0]) * (p[..., 1] - u[1]) - (v[1] - u[1]) * (p[..., 0] - u[0]))

    sides = np.stack((side(a, b), side(b, c), side(c, a)))
    expected = (sides > 0).all(axis=0) | (sides < 0).all(axis=0)
    assert np.array_equal(cells_inside(spec, corners), expected)


@given(st.integers(0, 2**32))
@settings(deadline=None, max_examples=30)
def test_squared_distances_are_exact(seed: int) -> None:
    cells = np.random.default_rng(seed).random((13, 17)) < 0.05
    squared = squared_distance(cells)
    y, x = np.indices(cells.shape)
    if not cells.any():
        assert squared.min() > 12**2 + 16**2
        return
    brute = np.min([(y - oy) ** 2 + (x - ox) ** 2 for oy, ox in np.argwhere(cells)], axis=0)
    assert np.array_equal(squared, brute)


def test_work_area_file(tmp_path: Path) -> None:
    file = tmp_path / "area.yaml"
    file.write_text("polygon_m: [[0, 0], [4, 0], [4, 3.5]]\n")
    assert read_metric_area(file).polygons[0].rings[0].tolist() == [[0, 0], [4, 0], [4, 3.5]]
    for text in (
        "",
        "polygon_m: [[0, 0], [1, 1]]",
        "polygon_m: [a]",
        "[",
        "polygon_m: [[0, 0], [1, .nan], [2, 2]]",
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=r"area\.yaml"):
            read_metric_area(file)
    grid = OccupancyGrid.unknown(GridSpec(R, 5, 5))
    with pytest.raises(InvalidValueError, match="positive width"):
        reachable_areas(grid, EVERYTHING, 0, [0])
    with pytest.raises(InvalidValueError, match="three finite corners"):
        reachable_areas(grid, [(0, 0)], 1, [0])
    with pytest.raises(InvalidValueError, match="point of the map"):
        reachable_areas(grid, EVERYTHING, 1, [0], start_m=(9, 9))
