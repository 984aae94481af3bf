"""Calibration of a network's probabilities on labelled photos that it has not learnt from.

A temperature makes the confidence as large as the share that is right. A bias for each class makes the
probability of each class as large as its share: after training with classes or sets drawn more often than
they occur, it is not. Both are fitted by maximum likelihood (Guo et al., On calibration of modern neural
networks, ICML 2017).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.models.network_io import preprocess
from swardmap.train.export import INPUT, open_session, read_spec
from swardmap.train.photos import Photo
from swardmap.types import nearest_indices

EVERY = 29
"""Every so many-th labelled pixel counts; neighbours say the same."""

ROUNDS = 5
"""Of the search along one parameter after the other; a few suffice."""


@dataclass(frozen=True, eq=False)
class LabelledLogits:
    """Logits of labelled pixels.

    Attributes:
        logits: (n, C) float64; of a sigmoid the first is 0.
        truth: (n,) int64, index of the true class.
        weights: (n,) float64, of a pixel; they sum to 1.
    """

    logits: NDArray[np.float64]
    truth: NDArray[np.int64]
    weights: NDArray[np.float64]


def labelled_logits(path: Path, sets: Mapping[str, Sequence[Photo]]) -> LabelledLogits:
    """What a network file says of labelled photos. Each set counts alike, however many pixels it has."""
    spec = read_spec(path)
    session = open_session(path)
    buffer = np.zeros((1, 3, spec.height, spec.width), np.float32)
    logits, truths, weights = [], [], []
    for photos in sets.values():
        found = []
        for photo in photos:
            preprocess(photo.image, spec, buffer)
            found.append(_of_photo(session.run(None, {INPUT: buffer})[0][0], photo))
        logits += [z for z, _ in found]
        truths += [t for _, t in found]
        count = sum(len(t) for _, t in found)
        weights.append(np.full(count, 1 / (max(count, 1) * len(sets))))
    return LabelledLogits(
        np.concatenate(logits).astype(np.float64),
        np.concatenate(truths).astype(np.int64),
        np.concatenate(weights),
    )


def fit_temperature(path: Path, sets: Mapping[str, Sequence[Photo]]) -> float:
    """Temperature that makes the confidence most likely (one number, no class changes)."""
    found = labelled_logits(path, sets)
    return float(np.exp(minimise(lambda t: _cost(found, t, np.zeros(found.logits.shape[1])), -2.0, 2.5)))


def fit_class_biases(found: LabelledLogits) -> tuple[float, NDArray[np.float64]]:
    """Temperature and biases that make the truth most likely.

    Returns:
        The temperature, and (C,) float64 to add to the logits before they are divided by it; the first is 0.
    """
    parameters = np.zeros(found.logits.shape[1])  # log temperature, then the biases but the first
    for _ in range(ROUNDS):
        for index in range(len(parameters)):
            parameters[index] = _best_along(found, parameters, index)
    return float(np.exp(parameters[0])), np.array([0.0, *parameters[1:]])


def _best_along(found: LabelledLogits, parameters: NDArray[np.float64], index: int) -> float:
    """The most likely value of one parameter, the others as they are."""

    def cost(value: float) -> float:
        log_temperature, *biases = (value if i == index else float(p) for i, p in enumerate(parameters))
        return _cost(found, log_temperature, np.array([0.0, *biases]))

    return minimise(cost, -4.0, 4.0)


def minimise(cost: Callable[[float], float], low: float, high: float) -> float:
    """Golden-section search of a function with one minimum."""
    ratio = (np.sqrt(5) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    fa, fb = cost(a), cost(b)
    while high - low > 1e-3:
        if fa < fb:
            high, b, fb = b, a, fa
            a = high - ratio * (high - low)
            fa = cost(a)
        else:
            low, a, fa = a, b, fb
            b = low + ratio * (high - low)
            fb = cost(b)
    return (low + high) / 2


def _of_photo(logits: NDArray[np.float32], photo: Photo) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    if len(logits) == 1:
        logits = np.concatenate([np.zeros_like(logits), logits])
    rows, columns = (nearest_indices(a, b) for a, b in zip(logits.shape[1:], photo.codes.shape, strict=True))
    truth = photo.codes[rows[:, None], columns[None, :]]
    known = truth < len(logits)
    return logits[:, known].T[::EVERY], truth[known][::EVERY]


def _cost(found: LabelledLogits, log_temperature: float, biases: NDArray[np.float64]) -> float:
    """Mean negative log-likelihood."""
    scaled = (found.logits + biases) / np.exp(log_temperature)
    scaled -= scaled.max(1, keepdims=True)
    right = scaled[np.arange(len(found.truth)), found.truth]
    return float(found.weights @ (np.log(np.exp(scaled).sum(1)) - right))
