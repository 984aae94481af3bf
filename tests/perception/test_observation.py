"""Cells that clear together with their neighbours."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.ndimage import convolve, maximum_filter

from swardmap.labels import MapClass
from swardmap.perception.observation import clear_together

class_arrays = arrays(np.uint8, (6, 7), elements=st.integers(0, 3))


@given(class_arrays, arrays(np.uint32, (6, 7, 2), elements=st.integers(0, 4)), st.integers(1, 6))
def test_few_points_clear_with_their_neighbours(classes: np.ndarray, few: np.ndarray, enough: int) -> None:
    points = np.zeros((6, 7, 4), np.uint32)
    points[..., 0], points[..., 1] = few[..., 0] // 4, few[..., 1]
    cleared, told = clear_together(classes, points, enough)
    grass = convolve(points[..., 1].astype(int), np.ones((3, 3), int), mode="constant")  # SciPy's
    doubt = maximum_filter(points[..., 0], 3, mode="constant")
    near = maximum_filter(classes, 7, mode="constant")
    may = (classes == MapClass.UNKNOWN) & (points[..., 1] > 0) & (points[..., 1] < enough)
    want = may & (grass >= enough) & (doubt == 0) & (near < MapClass.OBSTACLE)
    np.testing.assert_array_equal(cleared == MapClass.GRASS, want | (classes == MapClass.GRASS))
    np.testing.assert_array_equal(cleared[~want], classes[~want])
    np.testing.assert_array_equal(told[..., 1], np.where(want, enough, points[..., 1]))
    np.testing.assert_array_equal(told[..., [0, 2, 3]], points[..., [0, 2, 3]])


def test_a_cell_without_a_point_of_its_own_stays_unknown() -> None:
    classes, points = np.ones((5, 5), np.uint8), np.zeros((5, 5, 4), np.uint32)
    points[..., 1] = 9
    classes[2, 2], points[2, 2] = 0, 0  # a thin post without a reading would lie here
    assert clear_together(classes, points, 3)[0][2, 2] == MapClass.UNKNOWN
