"""How readily the new network may say grass: as readily as is no more daring than the old one.

Learning moves the bias of grass against all else. It is set anew, on gardens that were not learnt from, to
the largest with which no more of what is no lawn is called grass, nor surely so, than by the old network.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.labels import GRASS
from swardmap.teach.gate import CLEARS_255
from swardmap.train.calibrate import LabelledLogits, labelled_logits
from swardmap.train.export import read_spec, shift_grass
from swardmap.train.photos import Photo

MOST_BIAS = 2.0
"""Of the logit of grass, up or down."""
STEP = 0.05


def set_bias(path: Path, start: Path, held: Mapping[str, Sequence[Photo]]) -> float:
    """Set the bias of grass in a network file; returns what was added.

    Args:
        path: INT8 file, as `export_candidate` writes it.
        start: the file that it began from.
        held: photos that it did not learn from.
    """
    (old, old_temperature), (new, temperature) = (
        (labelled_logits(p, held), read_spec(p).temperature) for p in (start, path)
    )
    grass = list(read_spec(path).channel_ids).index(GRASS.id)
    bias = bias_as_daring(old, new, grass, (old_temperature, temperature))
    shift_grass(path, bias)
    return bias


def bias_as_daring(
    old: LabelledLogits, new: LabelledLogits, grass: int, temperatures: tuple[float, float]
) -> float:
    """The largest bias of grass with which the new network is no more daring than the old one.

    Args:
        old: logits of the old network.
        new: of the new one, of the same pixels.
        grass: its channel.
        temperatures: of both.
    """
    allowed = daring(old, grass, temperatures[0], 0.0)
    biases = np.arange(MOST_BIAS, -MOST_BIAS - STEP / 2, -STEP)
    fits = (float(b) for b in biases if (daring(new, grass, temperatures[1], b) <= allowed).all())
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
