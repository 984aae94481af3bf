"""The bias of grass after learning: as daring as before, whatever learning did to it."""

import numpy as np
import pytest

pytest.importorskip("torch")

from swardmap.teach.sureness import STEP, bias_as_daring, daring
from swardmap.train.calibrate import LabelledLogits

GRASS = 1


def logits_of(shift: float = 0.0, better: float = 0.0, n: int = 20_000) -> LabelledLogits:
    """What a network says that errs: grass shifted, and the classes farther apart by `better`."""
    rng = np.random.default_rng(0)
    truth = rng.integers(0, 3, n)
    logits = rng.normal(0, 1.5, (n, 3))
    logits[np.arange(n), truth] += 2.5 + better
    logits[:, GRASS] += shift
    return LabelledLogits(logits, truth, np.full(n, 1 / n))


@pytest.mark.parametrize("shift", [-0.8, 0.0, 1.3])
def test_what_learning_added_to_grass_is_taken_back(shift: float) -> None:
    bias = bias_as_daring(logits_of(), logits_of(shift), GRASS, (1.0, 1.0))
    assert bias == pytest.approx(-shift, abs=STEP)


def test_a_better_network_may_say_grass_more_readily_and_is_no_more_daring() -> None:
    old, new = logits_of(), logits_of(better=1.0)
    bias = bias_as_daring(old, new, GRASS, (1.07, 1.07))
    assert bias > 0.3
    allowed = daring(old, GRASS, 1.07, 0.0)
    assert (daring(new, GRASS, 1.07, bias) <= allowed).all()
    assert (daring(new, GRASS, 1.07, bias + 2 * STEP) > allowed).any()


def test_sure_pixels_are_those_that_would_clear_a_cell() -> None:
    logits = np.log(np.array([[0.04, 0.96, 0.0], [0.06, 0.94, 0.0], [0.6, 0.4, 0.0], [0.1, 0.9, 0.0]]) + 1e-9)
    found = LabelledLogits(logits, np.array([0, 2, 0, 1]), np.full(4, 0.25))
    np.testing.assert_allclose(daring(found, GRASS, 1.0, 0.0), [2 / 3, 1 / 3])
