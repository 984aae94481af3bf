"""Fitted temperatures and biases are the most likely ones: SciPy finds no better, known ones come back."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import log_softmax, softmax

from swardmap.train.calibrate import LabelledLogits, fit_class_biases, minimise


def drawn(temperature: float, biases: list[float], count: int = 40_000, seed: int = 0) -> LabelledLogits:
    """Pixels whose true class has the probabilities that these would give."""
    rng = np.random.default_rng(seed)
    logits = rng.normal(0, 3, (count, len(biases)))
    chances = softmax((logits + np.array(biases)) / temperature, axis=1).cumsum(1)
    truth = (rng.random((count, 1)) > chances).sum(1).clip(max=len(biases) - 1)
    return LabelledLogits(logits, truth.astype(np.int64), np.full(count, 1 / count))


@pytest.mark.parametrize(
    ("temperature", "biases"), [(1.0, [0, 0, 0]), (2.0, [0, -1.0, 0.5]), (0.6, [0, 0.8])]
)
def test_known_temperature_and_biases_come_back(temperature: float, biases: list[float]) -> None:
    found_temperature, found = fit_class_biases(drawn(temperature, biases))
    assert found_temperature == pytest.approx(temperature, rel=0.05)
    np.testing.assert_allclose(found, biases, atol=0.1)
    assert found[0] == 0


def test_scipy_finds_nothing_more_likely() -> None:
    sample = drawn(1.5, [0, -0.7, 0.4], count=4000, seed=3)

    def cost(x: np.ndarray) -> float:
        logits = (sample.logits + np.array([0, x[1], x[2]])) / np.exp(x[0])
        return float(-log_softmax(logits, axis=1)[np.arange(len(sample.truth)), sample.truth].mean())

    temperature, biases = fit_class_biases(sample)
    best = minimize(cost, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-7})
    assert cost(np.array([np.log(temperature), *biases[1:]])) == pytest.approx(best.fun, abs=2e-4)


def test_a_set_counts_by_its_weight_and_not_by_its_pixels() -> None:
    many, few = drawn(1.0, [0, 1.0], count=30_000), drawn(1.0, [0, -1.0], count=3_000, seed=1)
    both = LabelledLogits(
        np.concatenate([many.logits, few.logits]),
        np.concatenate([many.truth, few.truth]),
        np.concatenate([many.weights, few.weights]) / 2,
    )
    assert abs(fit_class_biases(both)[1][1]) < 0.15  # half way, not at 1


def test_the_search_finds_the_minimum() -> None:
    assert minimise(lambda x: (x - 0.3) ** 2, -2, 2) == pytest.approx(0.3, abs=1e-3)
