"""Every published map holds the robot, without a free cell that nobody has seen."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.ros.extent import FARTHEST_M, enlarged, extent_around

places = st.floats(-40.0, 40.0)
specs = st.builds(
    lambda r, w, h, x, y: GridSpec(r, w, h, (x, y)),
    st.sampled_from([0.05, 0.1]), st.integers(1, 80), st.integers(1, 80), places, places,
)  # fmt: skip


@given(specs, places, places, st.floats(0.05, 3.0))
@example(
    GridSpec(0.05, 22, 1, (2.9983244611620776, 0.0)), 1.9983244611620776, 0.0, 2.1
)  # on the edge of a cell
def test_the_robot_lies_inside_and_nothing_else_has_changed(
    spec: GridSpec, x: float, y: float, radius_m: float
) -> None:
    rng = np.random.default_rng(0)
    grid = OccupancyGrid(spec, rng.integers(0, 4, spec.shape).astype(np.uint8), 7)
    wide = enlarged(grid, extent_around(spec, (x, y), radius_m))
    for angle in np.linspace(0, 2 * np.pi, 16):
        point = x + radius_m * np.cos(angle), y + radius_m * np.sin(angle)
        assert wide.spec.contains(wide.spec.cell_of(point))
    ix, iy = spec.offset_in(wide.spec)
    inside = np.zeros(wide.spec.shape, bool)
    inside[iy : iy + spec.height, ix : ix + spec.width] = True
    np.testing.assert_array_equal(wide.classes[inside].reshape(spec.shape), grid.classes)
    assert (wide.classes[~inside] == MapClass.UNKNOWN).all()
    assert wide.stamp_ns == 7


@given(st.lists(st.tuples(places, places), min_size=2, max_size=20))
def test_a_map_does_not_change_its_size_again_and_again(path: list[tuple[float, float]]) -> None:
    """A robot that comes back to where it was finds the extent that it left."""
    spec, last = GridSpec(0.1, 50, 50, (0.0, 0.0)), None
    for xy in path:
        last = extent_around(spec, xy, 1.0, last)
    assert last is not None
    assert extent_around(spec, path[-1], 1.0, last) == last
    assert extent_around(spec, (2.5, 2.5), 1.0, last) == last


def test_a_map_that_grew_is_given_out_whole() -> None:
    small, large = GridSpec(0.1, 50, 50, (0.0, 0.0)), GridSpec(0.1, 400, 50, (-5.0, 0.0))
    last = extent_around(small, (-1.0, 2.0), 1.0)
    grown = extent_around(large, (-1.0, 2.0), 1.0, last)
    assert grown == large


@pytest.mark.parametrize("way", [(FARTHEST_M + 10, 0.0), (0.0, -FARTHEST_M - 10)])
def test_a_jump_of_the_pose_takes_no_memory(way: tuple[float, float]) -> None:
    spec = GridSpec(0.05, 100, 100, (0.0, 0.0))
    assert extent_around(spec, way, 1.0) == spec


def test_a_map_that_is_long_already_does_not_follow_beyond_what_a_grid_may_hold() -> None:
    strip = GridSpec(0.05, 400_000, 150)
    assert extent_around(strip, (100.0, 90.0), 1.0) == strip
