"""Ways over a costmap: through free cells alone, and as short as there is room."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from swardmap.grid import GridSpec
from swardmap.ros.route import INSCRIBED, route

SPEC = GridSpec(0.1, 60, 40, (-1.0, -2.0))


def test_over_a_free_lawn_it_is_straight() -> None:
    found = route(np.zeros(SPEC.shape, np.int8), SPEC, (0.05, 0.05), (4.05, 0.05))
    assert found is not None
    np.testing.assert_allclose(found.xy_m, [(0.05 + 0.1 * i, 0.05) for i in range(41)])
    assert found.short_m == pytest.approx(0, abs=1e-9)


def test_around_a_bed_it_goes_on_the_side_with_more_room() -> None:
    values = np.zeros(SPEC.shape, np.int8)
    values[8:26, 28:32] = 100  # y from -1.2 to 0.6
    found = route(values, SPEC, (0.0, 0.0), (4.0, 0.0))
    assert found is not None
    assert found.short_m < SPEC.resolution_m
    assert found.xy_m[:, 1].max() == pytest.approx(0.65)
    assert found.xy_m[:, 1].min() > -0.2


def test_dear_cells_are_gone_around_where_there_is_room() -> None:
    values = np.zeros(SPEC.shape, np.int8)
    values[:22, 10:50] = 90
    found = route(values, SPEC, (-0.5, 0.0), (4.5, 0.0))
    assert found is not None
    assert found.xy_m[25:35, 1].min() > 0.2


def test_behind_a_wall_it_ends_at_the_reachable_cell_nearest_to_the_goal() -> None:
    values = np.zeros(SPEC.shape, np.int8)
    values[:, 30] = INSCRIBED
    found = route(values, SPEC, (0.0, 0.0), (4.0, 0.0))
    assert found is not None
    assert found.xy_m[-1] == pytest.approx((1.95, 0.05), abs=0.11)
    assert found.short_m == pytest.approx(2.05, abs=0.02)


@pytest.mark.parametrize("value", [-1, INSCRIBED, 100])
def test_where_nothing_is_free_about_the_robot_there_is_none(value: int) -> None:
    values = np.full(SPEC.shape, value, np.int8)
    assert route(values, SPEC, (0.0, 0.0), (4.0, 0.0)) is None
    values[:, 40:] = 0  # 3 m away
    assert route(values, SPEC, (0.0, 0.0), (4.0, 0.0)) is None


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_it_never_leads_over_a_cell_that_is_unknown_or_blocked_and_reaches_what_can_be_reached(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    values = rng.choice([-1, 0, 0, 0, 0, 50, 99, 100], SPEC.shape).astype(np.int8)
    start, goal = (rng.uniform((-1, -2), (5, 2)) for _ in range(2))
    found = route(values, SPEC, (float(start[0]), float(start[1])), (float(goal[0]), float(goal[1])))
    free = (values >= 0) & (values < INSCRIBED)
    if found is None:
        return
    cells = SPEC.cell_of(found.xy_m)
    assert free[cells[:, 1], cells[:, 0]].all()
    steps = np.abs(np.diff(cells, axis=0))
    assert (steps.max(axis=1) == 1).all() if len(steps) else True
    for (x0, y0), (x1, y1) in pairwise(cells):  # no corner is cut
        assert free[y0, x1]
        assert free[y1, x0]
    parts, _ = ndimage.label(free)  # by sides: a diagonal step needs both corners, so it joins no more
    same = parts == parts[cells[0, 1], cells[0, 0]]
    rows, columns = np.nonzero(same)
    away = np.hypot(*(SPEC.center_of(np.column_stack([columns, rows])) - goal).T)
    assert found.short_m == pytest.approx(away.min())
