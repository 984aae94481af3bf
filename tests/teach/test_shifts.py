"""How a view fits onto the one before: the shift between them is found, and none where there is none."""

from dataclasses import replace

import numpy as np
import pytest

from swardmap.grid import GridSpec
from swardmap.teach.evidence import MOST_AGAINST, contradicted, disagreement, votes_of
from swardmap.teach.shifts import shift_between
from swardmap.teach.views import SeenCells

SPEC = GridSpec(0.05, 80, 60, (1.0, -1.5))


def view(shift: tuple[int, int] = (0, 0), persons: bool = False) -> SeenCells:
    """Some boxes on flat ground, moved by whole cells (x, y)."""
    raised = np.zeros(SPEC.shape, np.bool_)
    for iy, ix in ((20, 20), (40, 35), (30, 60), (45, 55)):
        raised[iy + shift[1] : iy + shift[1] + 5, ix + shift[0] : ix + shift[0] + 5] = True
    nobody = np.zeros(SPEC.shape, np.bool_)
    return SeenCells(SPEC, ~raised, raised, raised if persons else nobody)


@pytest.mark.parametrize("cells", [(6, 0), (0, -8), (5, 7)])
def test_a_view_that_lies_elsewhere_says_by_how_much(cells: tuple[int, int]) -> None:
    shift = shift_between(view(), view(cells))
    assert shift is not None
    assert shift.jumped
    assert shift.xy_m == pytest.approx((-0.05 * cells[0], -0.05 * cells[1]))


def test_the_same_place_is_no_jump_nor_is_one_cell_or_a_person() -> None:
    same, near = shift_between(view(), view()), shift_between(view(), view((1, 1)))
    assert same is not None
    assert near is not None
    assert not same.jumped
    assert not near.jumped
    assert shift_between(view(), view((6, 0), persons=True)) is None


def test_views_count_in_frames_that_lie_elsewhere_in_the_map() -> None:
    moved = replace(SPEC, origin_m=(1.5, -1.5))
    two = replace(view((-10, 0)), spec=moved)  # the same boxes, seen from half a metre on
    shift = shift_between(view(), two)
    assert shift is not None
    assert not shift.jumped


def test_one_frame_against_all_others_is_contradicted_and_they_are_not() -> None:
    seen = [view() for _ in range(6)] + [view((9, 9)), view((9, 9))]
    votes = votes_of(seen, np.ones(8, np.bool_), SPEC)
    values = [disagreement(s, votes, True) for s in seen]
    assert contradicted(values, MOST_AGAINST).tolist() == [False] * 6 + [True] * 2
    assert contradicted([0.0, 0.9, 0.0, None], MOST_AGAINST).tolist() == [False] * 4  # something moved


def test_views_that_have_nothing_standing_in_common_say_nothing() -> None:
    """After a sharp turn: each sees things where the other saw nothing, and some flat ground lies in both."""
    one = view()
    far = replace(SPEC, origin_m=(3.0, -1.5))  # the second begins where no box of the first is seen
    column = np.arange(SPEC.width)
    first = replace(one, flat=one.flat & (column < 50), raised=one.raised & (column < 35))
    second = replace(view(), spec=far)
    assert min(int(s.raised.sum()) for s in (first, second)) >= 25
    assert shift_between(first, second) is None
