"""Costs against Nav2's own numbers, and distances against SciPy."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from swardmap.config import CostmapConfig
from swardmap.errors import ConfigError, InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.kernels import inflation as kernel
from swardmap.labels import MapClass
from swardmap.mapping.costmap import (
    LETHAL,
    NO_INFORMATION,
    build_costmap,
    combine,
    cost_of_squared_distance,
    costs_from_occupancy,
    inflate,
    occupancy_from_costs,
    squared_distances,
)

occupied_arrays = arrays(np.bool_, st.tuples(st.integers(1, 24), st.integers(1, 24)))


@settings(deadline=None)
@given(occupied_arrays, st.integers(0, 9))
def test_distances_are_scipys(occupied: np.ndarray, radius: int) -> None:
    limit = (radius + 1) ** 2
    if occupied.any():
        exact = np.rint(ndimage.distance_transform_edt(~occupied) ** 2).astype(np.int64)
        want = np.minimum(exact, limit)
    else:
        want = np.full(occupied.shape, limit)
    np.testing.assert_array_equal(squared_distances(occupied, radius), want)
    compiled = np.empty(occupied.shape, np.int32)
    kernel.squared_distances(occupied, radius, compiled)
    np.testing.assert_array_equal(compiled, want)


def test_costs_of_nav2_along_a_row() -> None:
    # peers' golden numbers: k = 10, resolution 0.05, inscribed 0.2, radius 0.55
    config = CostmapConfig(inscribed_radius_m=0.2, inflation_radius_m=0.55, cost_scaling_factor=10.0)
    costs = np.zeros((1, 14), np.uint8)
    costs[0, 0] = LETHAL
    row = inflate(costs, GridSpec(0.05, 14, 1), config)[0]
    assert row.tolist() == [254, 253, 253, 253, 253, 152, 92, 56, 34, 20, 12, 7, 0, 0]


def test_cost_function_of_nav2() -> None:
    # inflation_tests.cpp, testCostFunctionCorrectness: k = 1, resolution 1, inscribed radius 5
    config = CostmapConfig(inscribed_radius_m=5.0, inflation_radius_m=10.5, cost_scaling_factor=1.0)
    table = cost_of_squared_distance(1.0, config)
    assert table[0] == 254
    assert [int(table[d * d]) for d in range(1, 6)] == [253] * 5
    assert [int(table[d * d]) for d in range(6, 12)] == [92, 34, 12, 4, 1, 0]


def test_one_obstacle_of_nav2() -> None:
    # inflation_tests.cpp, testInflation3: one obstacle at (5, 5); 29 cells not free, 1 lethal, 4 inscribed
    config = CostmapConfig(inscribed_radius_m=1.0, inflation_radius_m=3.0, cost_scaling_factor=1.0)
    costs = np.zeros((10, 10), np.uint8)
    costs[5, 5] = LETHAL
    inflated = inflate(costs, GridSpec(1.0, 10, 10), config)
    assert [int((inflated == v).sum()) for v in (254, 253)] == [1, 4]
    assert int((inflated > 0).sum()) == 29


@settings(deadline=None, max_examples=60)
@given(
    arrays(np.uint8, (12, 13), elements=st.sampled_from([0, 0, 0, 254, 255, 90])),
    st.floats(0.0, 0.5),
    st.booleans(),
)
def test_inflation_is_what_the_distances_say(costs: np.ndarray, margin_m: float, unknown: bool) -> None:
    config = CostmapConfig(
        inscribed_radius_m=0.15, inflation_radius_m=0.4, cost_scaling_factor=3.0, inflate_unknown=unknown
    )
    inflated = inflate(costs, GridSpec(0.1, 13, 12), config, margin_m)
    lethal = costs == LETHAL
    if not lethal.any():
        np.testing.assert_array_equal(inflated, costs)
        return
    d = ndimage.distance_transform_edt(~lethal)
    beyond = np.maximum(0, d - margin_m / 0.1)
    fall = np.floor(252 * np.exp(-3.0 * (beyond * 0.1 - 0.15)) + 1e-9)
    new = np.where(beyond * 0.1 <= 0.15, 253, np.where(beyond > 4, 0, fall))
    new[d <= margin_m / 0.1 + 1e-9] = 254
    known = costs != NO_INFORMATION
    np.testing.assert_array_equal(inflated[known], np.maximum(costs, new)[known])
    gives_way = (new >= 253) | (unknown & (new > 0))
    np.testing.assert_array_equal(inflated[~known], np.where(gives_way, new, 255)[~known])


def test_a_margin_covers_cells_up_to_its_length_and_no_more() -> None:
    grid = OccupancyGrid(GridSpec(0.1, 21, 1), np.full((1, 21), MapClass.GRASS, np.uint8))
    grid.classes[0, 10] = MapClass.OBSTACLE
    for margin_m, cells in ((0.0, 0), (0.09, 0), (0.1, 1), (0.3, 3), (0.38, 3)):
        costmap = build_costmap(grid, CostmapConfig(margin_m=margin_m))
        assert int((costmap.costs == LETHAL).sum()) == 2 * cells + 1


def test_persons_get_their_own_margin() -> None:
    classes = np.full((1, 41), MapClass.GRASS, np.uint8)
    classes[0, 10], classes[0, 30] = MapClass.OBSTACLE, MapClass.PERSON
    config = CostmapConfig(margin_m=0.1, person_margin_m=0.5)
    costs = build_costmap(OccupancyGrid(GridSpec(0.1, 41, 1), classes), config).costs[0]
    assert (costs[:21] == LETHAL).sum() == 3
    assert (costs[21:] == LETHAL).sum() == 11


def test_unknown_stays_unknown_beside_a_person_margin() -> None:
    classes = np.zeros((1, 61), np.uint8)
    classes[0, 30] = MapClass.PERSON
    costs = build_costmap(
        OccupancyGrid(GridSpec(0.1, 61, 1), classes), CostmapConfig(person_margin_m=0.5)
    ).costs[0]
    assert (costs == LETHAL).sum() == 11
    assert (costs[:15] == NO_INFORMATION).all()
    assert not (costs == 0).any()


def test_costs_to_occupancy_as_nav2_publishes_them() -> None:
    given_costs = np.array([0, 50, 127, 128, 251, 252, 253, 254, 255], np.uint8)
    assert occupancy_from_costs(given_costs).tolist() == [0, 19, 49, 50, 97, 98, 99, 100, -1]


def static_layer_costs(values: np.ndarray, trinary: bool = True) -> np.ndarray:
    """StaticLayer::interpretValue of nav2_costmap_2d, with track_unknown_space."""
    between = np.zeros(101) if trinary else np.trunc(np.arange(101) / 100 * LETHAL)
    between[99], between[100] = 253, LETHAL
    table: np.ndarray = np.append(between, NO_INFORMATION).astype(np.uint8)
    return np.asarray(table[values])


def test_both_rules_from_occupancy_to_costs() -> None:
    values = np.array([-1, 0, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100], np.int8)
    constructor = [255, 0, 25, 51, 76, 102, 127, 152, 178, 203, 229, 254]
    assert costs_from_occupancy(values).tolist() == constructor
    assert static_layer_costs(values).tolist() == [255] + [0] * 10 + [254]
    scaled = static_layer_costs(np.array([10, 50, 98, 99, 100], np.int8), trinary=False)
    assert scaled.tolist() == [25, 127, 248, 253, 254]
    with pytest.raises(InvalidValueError, match=r"-1\.\.100"):
        costs_from_occupancy(np.array([101], np.int8))


def test_combination_rules() -> None:
    below = np.array([0, 100, 255, 254, 0, 255], np.uint8)
    above = np.array([50, 50, 50, 255, 255, 255], np.uint8)
    assert combine(below, above, "overwrite").tolist() == [50, 50, 50, 254, 0, 255]
    assert combine(below, above, "max").tolist() == [50, 100, 50, 254, 0, 255]
    assert combine(below, above, "max_keep_unknown").tolist() == [50, 100, 255, 254, 0, 255]


def test_bad_radii_are_refused() -> None:
    with pytest.raises(ConfigError, match="inscribed_radius_m"):
        CostmapConfig(inscribed_radius_m=1.0, inflation_radius_m=0.5)


def nav2_inflation(costs: np.ndarray, resolution_m: float, config: CostmapConfig) -> np.ndarray:
    """InflationLayer::updateCosts and computeCost written down again, cell by cell, with exact distances."""
    reach, out = math.ceil(config.inflation_radius_m / resolution_m), costs.copy()
    rows, columns = np.nonzero(costs == LETHAL)
    for iy, ix in np.ndindex(*costs.shape):
        distance = math.sqrt(((rows - iy) ** 2 + (columns - ix) ** 2).min(initial=10**6))
        if distance > reach:
            continue
        cost = int(
            252
            * math.exp(-config.cost_scaling_factor * (distance * resolution_m - config.inscribed_radius_m))
        )
        if distance == 0:
            cost = 254
        elif distance * resolution_m <= config.inscribed_radius_m:
            cost = 253
        old = int(costs[iy, ix])
        if old == NO_INFORMATION:
            out[iy, ix] = cost if cost >= (1 if config.inflate_unknown else 253) else old
        else:
            out[iy, ix] = max(old, cost)
    return out


@settings(max_examples=60)
@given(
    arrays(np.uint8, (11, 13), elements=st.sampled_from([0, 0, 0, 0, 0, 100, 253, 254, 255])),
    st.sampled_from([0.03, 0.05, 0.1, 0.2]),
    st.sampled_from([0.0, 0.1, 0.22, 0.3]),
    st.sampled_from([0.0, 0.2, 0.25]),
    st.sampled_from([1.0, 3.0, 10.0]),
    st.booleans(),
)
def test_inflation_is_nav2s_cell_by_cell(
    costs: np.ndarray, resolution_m: float, inscribed_m: float, more_m: float, decay: float, unknown: bool
) -> None:
    config = CostmapConfig(
        inscribed_radius_m=inscribed_m, inflation_radius_m=inscribed_m + more_m,
        cost_scaling_factor=decay, inflate_unknown=unknown,
    )  # fmt: skip
    want = nav2_inflation(costs, resolution_m, config)
    np.testing.assert_array_equal(inflate(costs, GridSpec(resolution_m, 13, 11), config), want)


def test_the_last_bit_of_a_cost_is_cs() -> None:
    # 6 * 0.05 is a little more than 0.3: not inscribed, and exp() of what is left rounds to 1
    config = CostmapConfig(inscribed_radius_m=0.3, inflation_radius_m=0.5, cost_scaling_factor=1.0)
    assert cost_of_squared_distance(0.05, config)[36] == 252
