"""What goes into a network and what its answer means: an image to its input, logits to classes.

Measured choices: pre-processing by OpenCV into a kept buffer, argmax by comparison.
"""

import numpy as np
from numpy.typing import NDArray

from swardmap.labels import VOID_ID, MapClass
from swardmap.models.spec import NetworkSpec
from swardmap.types import Segmentation

Float32Array = NDArray[np.float32]


def preprocess(rgb: NDArray[np.uint8], spec: NetworkSpec, buffer: Float32Array) -> None:
    """Stretch and normalise an image into the network's input.

    Args:
        rgb: (H, W, 3) uint8.
        spec: of the network.
        buffer: (1, 3, h, w) float32, written in place.
    """
    import cv2

    size = (spec.width, spec.height)
    coarse = rgb.shape[1] > 2 * spec.width or rgb.shape[0] > 2 * spec.height
    if rgb.shape[1::-1] != size:  # linear skips pixels when it shrinks by more than two
        rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA if coarse else cv2.INTER_LINEAR)
    planes = cv2.split(rgb)
    if spec.colour_order == "bgr":
        planes = planes[::-1]
    for channel, plane in enumerate(planes):
        scale = 1 / (255 * spec.std[channel])
        shift = -spec.mean[channel] / spec.std[channel]
        cv2.addWeighted(plane, scale, plane, 0, shift, dst=buffer[0, channel], dtype=cv2.CV_32F)


def decide(logits: Float32Array, spec: NetworkSpec) -> tuple[NDArray[np.uint8], Float32Array]:
    """Most probable class and its calibrated probability.

    Args:
        logits: (1, C, h, w) float32.
        spec: of the network.

    Returns:
        (h, w) uint8 class ids, void where a logit is not a number, and (h, w) float32 probabilities.
    """
    found = segmentation_of(logits, spec)
    assert found.confidence is not None  # noqa: S101 - narrows the type
    return found.labels, found.confidence


def segmentation_of(logits: Float32Array, spec: NetworkSpec) -> Segmentation:
    """Most probable class, its calibrated probability, and P(obstacle or person).

    Args:
        logits: (1, C, h, w) float32.
        spec: of the network.
    """
    ids = np.array(spec.channel_ids, np.uint8)
    if spec.activation == "sigmoid":
        second = logits[0, 0]
        labels = np.where(second > 0, ids[1], ids[0])
        others = np.exp(-np.abs(second) / np.float32(spec.temperature))
        labels, confidence = _void_where_nan(labels, 1 / (1 + others))
        return Segmentation(labels, spec.label_set, confidence)  # of two classes one says it all
    planes = logits[0]
    best, labels = planes[0].copy(), np.full(planes.shape[1:], ids[0], np.uint8)
    for channel in range(1, len(planes)):  # numpy's argmax takes 8 times as long
        np.copyto(labels, ids[channel], where=planes[channel] > best)
        np.maximum(best, planes[channel], out=best)
    shares = planes - best  # and then in place: new arrays of this size cost as much as what is done to them
    shares /= np.float32(spec.temperature)
    np.exp(shares, out=shares)
    total = shares.sum(0)
    hazardous = spec.label_set.map_class_table[ids] >= MapClass.OBSTACLE
    hazard = shares[hazardous].sum(0)
    hazard /= total
    if np.isnan(total.min()):  # min passes NaN on
        hazard = np.nan_to_num(hazard, nan=1.0)
    hazard *= np.float32(255)
    hazard += np.float32(0.5)
    labels, confidence = _void_where_nan(labels, np.divide(1, total, out=total))
    return Segmentation(labels, spec.label_set, confidence, hazard.astype(np.uint8))


def _void_where_nan(
    labels: NDArray[np.uint8], confidence: Float32Array
) -> tuple[NDArray[np.uint8], Float32Array]:
    if not np.isfinite(confidence.min()):  # min passes NaN on
        lost = ~np.isfinite(confidence)
        labels = np.where(lost, np.uint8(VOID_ID), labels)
        confidence = np.where(lost, np.float32(0), confidence)
    return labels, confidence.astype(np.float32, copy=False)
