"""How sure the new network may be, and how readily it may say grass: no more daringly than the old one.

Learning moves the bias of grass against all else. It is set anew, on gardens that were not learnt from, to
the largest with which no more of what is no lawn is called grass, nor surely so, than by the old network: in
the light that this one knows, and in the drive's, in which the new one will drive.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.labels import GRASS
from swardmap.teach.faults import CLEARS_255
from swardmap.train.calibrate import LabelledLogits, fit_temperature, labelled_logits
from swardmap.train.export import read_spec, shift_grass, with_spec
from swardmap.train.photos import Photo

MOST_BIAS = 2.0
"""Of the logit of grass, up or down."""
STEP = 0.05
AS_DARING, IN_YOUR_LIGHT = (1.0, 1.0), (1.0, 0.7)
"""Of the old network's wrong grass, and wrong sure grass, that the new one may have, there and in the drive's
light; if the old one was more daring in that light, as much as it was. On a lawn that was not known nothing
was free, and nothing wrong; now some is."""


def set_temperature(path: Path, start: Path, held: Mapping[str, Sequence[Photo]]) -> float:
    """Set the temperature of a network file: as fitted, but never below that of the start; returns it.

    Args:
        path: as `export_candidate` writes it.
        start: the file that it began from.
        held: photos that it did not learn from.
    """
    temperature = max(read_spec(start).temperature, fit_temperature(path, held))
    with_spec(path, temperature=temperature)
    return temperature


def set_bias(
    path: Path,
    start: Path,
    held: Mapping[str, Sequence[Photo]],
    in_your_light: Mapping[str, Sequence[Photo]],
) -> float:
    """Set the bias of grass in a network file; returns what was added.

    Args:
        path: INT8 file, as `export_candidate` writes it.
        start: the file that it began from.
        held: photos that it did not learn from.
        in_your_light: the same in the light of the drive; none, if that is not known.
    """
    spec = read_spec(path)
    grass = list(spec.channel_ids).index(GRASS.id)

    def of_old(photos: Mapping[str, Sequence[Photo]]) -> NDArray[np.float64]:
        return daring(labelled_logits(start, photos), grass, read_spec(start).temperature, 0.0)

    allowed = of_old(held)
    if in_your_light:
        there = np.maximum(np.array(IN_YOUR_LIGHT) * allowed, of_old(in_your_light))
        limits = [
            (labelled_logits(path, held), np.array(AS_DARING) * allowed),
            (labelled_logits(path, in_your_light), there),
        ]
    else:
        limits = [(labelled_logits(path, held), np.array(IN_YOUR_LIGHT) * allowed)]
    bias = bias_as_daring(limits, grass, spec.temperature)
    shift_grass(path, bias)
    return bias


def bias_as_daring(
    limits: Sequence[tuple[LabelledLogits, NDArray[np.float64]]], grass: int, temperature: float
) -> float:
    """The largest bias of grass with which a network is no more daring than it may be.

    Args:
        limits: its logits of some pixels, and (2,) what it may wrongly call grass there, and surely so.
        grass: its channel.
        temperature: by which its probabilities are made.
    """
    biases = np.arange(MOST_BIAS, -MOST_BIAS - STEP / 2, -STEP)
    fits = (
        float(bias)
        for bias in biases
        if all((daring(found, grass, temperature, bias) <= allowed).all() for found, allowed in limits)
    )
    return round(next(fits, -MOST_BIAS), 2) + 0.0  # no minus zero


def daring(found: LabelledLogits, grass: int, temperature: float, bias: float) -> NDArray[np.float64]:
    """(2,) share of the pixels that are no grass which are called grass, and which are surely so."""
    wrong = found.truth != grass
    logits, weights = found.logits[wrong].copy(), found.weights[wrong]
    logits[:, grass] += bias
    called = logits.argmax(1) == grass
    shares = np.exp((logits - logits.max(1, keepdims=True)) / temperature)
    clears = called & (255 * (1 - shares[:, grass] / shares.sum(1)) <= CLEARS_255)
    total = max(float(weights.sum()), 1e-12)
    return np.array([weights @ called, weights @ clears]) / total
