"""How good a network file is on labelled photos, and how honest its confidence. Needs no torch."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.labels import VOID_ID
from swardmap.models.onnx import OnnxSegmenter
from swardmap.train.photos import Photo
from swardmap.train.score import Score
from swardmap.types import Segmentation


@dataclass(frozen=True)
class Evaluation:
    """Figures of one network file on labelled photos.

    Attributes:
        score: confusion at the photos' own size.
        bins: (10, 3) float64: number of pixels, sum of confidence, number right, by confidence.
    """

    score: Score
    bins: NDArray[np.float64]

    @property
    def calibration_error(self) -> float:
        """Expected calibration error: mean distance of confidence from the share that is right."""
        filled = self.bins[self.bins[:, 0] > 0]
        return float(np.abs(filled[:, 1] - filled[:, 2]).sum() / filled[:, 0].sum())


def evaluate_network(path: Path, photos: Iterable[Photo], threads: int = 0) -> Evaluation:
    """Figures of a network file on labelled photos."""
    segmenter = OnnxSegmenter(path, threads)
    spec = segmenter.spec
    ids = np.full(256, VOID_ID, np.uint8)
    ids[: len(spec.channel_ids)] = spec.channel_ids
    score, bins = Score.empty(spec.channel_ids, spec.label_set), np.zeros((10, 3))
    for photo in photos:
        labels, confidence = segmenter.segment(photo.image)
        truth = ids[photo.codes]
        mask = Segmentation(labels, spec.label_set, confidence).resized_to(*truth.shape)
        score = score.plus(truth, mask.labels)
        assert mask.confidence is not None  # noqa: S101 - a network always has one
        bins += reliability_bins(mask.confidence[truth != VOID_ID], (mask.labels == truth)[truth != VOID_ID])
    return Evaluation(score, bins)


def reliability_bins(confidence: NDArray[np.float32], right: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(10, 3): number of pixels, sum of confidence, number right, in tenths of confidence."""
    index = np.clip((confidence * 10).astype(np.int64), 0, 9)
    columns = (None, confidence.astype(np.float64), right.astype(np.float64))
    return np.stack([np.bincount(index, weights=w, minlength=10) for w in columns], axis=1).astype(np.float64)
