"""The tailor's tools, against NumPy and against areas and volumes in closed form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swardmap.errors import InvalidValueError
from swardmap.synth.people.body import Shell
from swardmap.synth.people.shell import (
    border,
    clipped,
    finer,
    hemmed,
    lined,
    normals_of,
    smoothed,
    summed,
    unique_rows,
)
from swardmap.synth.shapes import sphere

Q = np.arange(16).reshape(4, 4)


def sheet() -> Shell:
    """A flat square of 3 m x 3 m in 18 triangles; `along` and `mean` are the coordinates themselves."""
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0))
    xyz = np.stack((x.ravel(), y.ravel(), np.zeros(16)), axis=1)
    a, b, c, d = Q[:-1, :-1].ravel(), Q[:-1, 1:].ravel(), Q[1:, 1:].ravel(), Q[1:, :-1].ravel()
    faces = np.concatenate([np.stack((a, b, c), 1), np.stack((a, c, d), 1)])
    return Shell(xyz, np.ones((16, 1)), np.tile(xyz[:, :1], (1, 4)), xyz, faces)


def area_m2(shell: Shell) -> float:
    a, b, c = np.moveaxis(shell.xyz[shell.faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@given(arrays(np.int64, st.tuples(st.integers(1, 40), st.integers(1, 3)), elements=st.integers(-5, 5)))
def test_unique_rows_are_those_of_numpy(rows: np.ndarray) -> None:
    first, number, count = unique_rows(rows)
    _, its_first, its_number, its_count = np.unique(
        rows, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    assert np.array_equal(first, its_first)
    assert np.array_equal(number, its_number.reshape(-1))
    assert np.array_equal(count, its_count)


def test_rows_that_cannot_be_packed_are_one_clear_error() -> None:
    with pytest.raises(InvalidValueError, match="span too much"):
        unique_rows(np.array([[0, 0], [2**40, 2**40]]))


def test_sums_are_those_of_numpy() -> None:
    rng = np.random.default_rng(0)
    values, at = rng.normal(size=(50, 3)), rng.integers(0, 7, 50)
    truth = np.zeros((7, 3))
    np.add.at(truth, at, values)
    assert np.allclose(summed(values, at, 7), truth)


@given(st.floats(0.05, 2.95))
def test_a_cut_is_straight_and_takes_its_share(at: float) -> None:
    cut = clipped(sheet(), lambda s: at - s.xyz[:, 0])
    assert area_m2(cut) == pytest.approx(3 * at, abs=1e-4)
    assert cut.xyz[:, 0].max() == pytest.approx(at, abs=1e-5)
    assert np.allclose(cut.along[:, 0], cut.xyz[:, 0])
    assert np.allclose(normals_of(cut.xyz, cut.faces, np.arange(len(cut.xyz))), [0, 0, 1])


def test_finer_is_the_same_surface_in_four_times_the_faces() -> None:
    fine = finer(sheet())
    assert len(fine.faces) == 4 * 18
    assert area_m2(fine) == pytest.approx(9)
    assert len(border(sheet())) * 2 == len(border(fine)) == 24


def test_hems_and_linings_turn_in_by_their_depth() -> None:
    hem = hemmed(sheet(), 0.1)
    assert area_m2(hem) == pytest.approx(9 + 12 * 0.1)
    lining = lined(sheet(), 0.2)
    assert area_m2(lining) == pytest.approx(18)
    assert lining.xyz[:, 2].min() == pytest.approx(-0.2)


def test_smoothing_keeps_what_is_even_and_shrinks_noise_and_a_border_sees_only_itself() -> None:
    shell, rng = sheet(), np.random.default_rng(1)
    assert np.allclose(smoothed(np.full((16, 2), 3.0), shell, 5), 3.0)
    inside = np.setdiff1d(np.arange(16), border(shell))
    spikes = np.zeros((16, 1))
    spikes[inside] = 1.0
    once = smoothed(spikes, shell, 1)
    assert np.array_equal(np.flatnonzero(once[:, 0]), inside)
    assert (once[inside] < 1).all()
    ball = sphere(1.0)
    noise = rng.normal(0, 1, (len(ball.xyz), 1))
    closed = Shell(ball.xyz.astype(np.float64), noise, noise, ball.xyz.astype(np.float64),
                   ball.faces.astype(np.int64))  # fmt: skip
    assert smoothed(noise, closed, 4).std() < 0.6 * noise.std()
