"""Teaches a network file to say how unlike the images that it knows an image is: one number more it gives.

The score is the odds that a camera sees its scene badly or not at all, by a logistic regression on what the
encoder computes anyway (familiar_nodes.py). It learns to tell photos that the network knows, in their own and
in harsh light, from the same photos spoilt (unknown.py). The limit is even odds, or more where more than one
known image in 200 exceeds that, of photos that were not learnt from.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.models.network_io import preprocess
from swardmap.models.spec import UNFAMILIAR, NetworkSpec
from swardmap.train.export import INPUT, open_session, read_spec, write_model
from swardmap.train.familiar_nodes import (
    FEATURES,
    Regression,
    add_features,
    add_score,
    score_of,
    standardised,
    strip,
)
from swardmap.train.light import harsh_light
from swardmap.train.photos import Photo
from swardmap.train.recipe import AugmentConfig
from swardmap.train.unknown import KINDS

Image = NDArray[np.uint8]
FloatArray = NDArray[np.float64]
Runner = Callable[[Image], FloatArray]

PENALTY = 0.01
"""Of the weights squared, against the mean log-likelihood of an image."""

KNOWN_SHARE = 0.995
"""Of known images within the limit, at least."""

PER_SET = 60
CHECKED = 8
"""Photos that each kind of damage is done to where a score is carried over."""

SPOILT = 2
"""Spoilt views of each photo."""


def teach_familiar(
    path: Path,
    known: dict[str, list[Photo]],
    held: dict[str, list[Photo]],
    light: AugmentConfig,
    seed: int = 0,
) -> dict[str, Any]:
    """Add the score to a network file, in place.

    Args:
        path: as `swardmap export` writes it; a score that it has is made anew.
        known: photos that the network was trained on, by set; at most 60 of each, evenly taken, count.
        held: photos that it was not trained on, for the limit; each set counts alike. None: the known ones.
        light: the harsh light that it was trained in.
        seed: of light and damage.

    Returns:
        `limit`; `refused`, the share of the held images of each set beyond it; `noticed`, the share of each
        kind of damage done to held images.

    Raises:
        InputError: without any known photo.
        ModelError: for a file whose encoder cannot be found in it.
    """
    import onnx

    if not any(known.values()):
        raise InputError("expected photos that the network knows, got none; are the recipe's sets there?")
    spec, model = read_spec(path), onnx.load(path)
    strip(model.graph)
    add_features(model)
    run = _runner(model, spec)
    rng = np.random.default_rng(seed)
    learnt = [photo for photos in known.values() for photo in _evenly(photos, PER_SET)]
    familiar = np.array([f for photo in learnt for f in _of_known(photo, spec, light, run, rng)])
    spoilt = np.array([f for photo in learnt for f in _of_spoilt(photo, spec, light, run, rng)])
    fit = fitted(familiar, spoilt)
    figures = _figures(fit, held if any(held.values()) else known, spec, light, run, rng)
    add_score(model, fit)
    metrics = {**spec.metrics, UNFAMILIAR: figures}
    write_model(model, replace(spec, unfamiliar_limit=figures["limit"], metrics=metrics), path)
    return figures


def carry_familiar(
    path: Path, source: Path, known: Sequence[Photo], light: AugmentConfig, seed: int = 0
) -> dict[str, Any] | None:
    """Give a network file the score of the file that its training began from, in place.

    What the score weighs was learnt from far more images than a drive has. Each feature of the new encoder
    is moved and scaled to the mean and spread that it had in the old one, on the same images; the limit
    rises, if it must, until they are within it.

    Args:
        path: the .onnx file; a score that it has is replaced.
        source: the file that it began from, of the same architecture.
        known: photos that both see; some dozens.
        light: harsh light that they are seen in, too.
        seed: of light and damage.

    Returns:
        `limit`, its `rise` over the source's, and `noticed`, the share of spoilt views beyond it; None if the
        source has no score, and so the file has none.

    Raises:
        InputError: without any known photo.
        ModelError: for a file whose encoder cannot be found in it.
    """
    import onnx

    spec, old_spec, model, old = read_spec(path), read_spec(source), onnx.load(path), onnx.load(source)
    if old_spec.unfamiliar_limit is None:
        return None
    if not known:
        raise InputError("expected photos that the network knows, got none")
    fit = score_of(old)
    for each in (old, model):
        strip(each.graph)
        add_features(each)
    rng = np.random.default_rng(seed)
    images = [view for p in known for view in _views(_sized(p, spec), light, rng)]
    was, now = (np.array([run(i) for i in images]) for run in (_runner(old, old_spec), _runner(model, spec)))
    fit = matched(fit, was, now)
    within = limit_of([fit.logits(now)])
    limit = max(float(np.log(old_spec.unfamiliar_limit)), within)
    run, noticed = _runner(model, spec), {}
    for kind, spoil in KINDS.items():
        spoilt = [run(spoil(_sized(p, spec), rng)) for p in _evenly(known, CHECKED)]
        noticed[kind] = round(float(np.mean(fit.logits(np.array(spoilt)) > limit)), 4)
    rise = limit - float(np.log(old_spec.unfamiliar_limit))
    odds = float(np.exp(limit))
    figures: dict[str, Any] = {"limit": odds, "rise": round(rise, 4), "noticed": noticed}
    add_score(model, fit)
    metrics = {**spec.metrics, UNFAMILIAR: figures}
    write_model(model, replace(spec, unfamiliar_limit=odds, metrics=metrics), path)
    return figures


def matched(fit: Regression, was: FloatArray, now: FloatArray) -> Regression:
    """The regression for features whose mean and spread changed; a spread by at most twice.

    Args:
        fit: for the features as they were.
        was: (N, n) features of images.
        now: (N, n) features of the same images.

    >>> was = np.array([[0.0], [2.0]])
    >>> new = matched(Regression(np.ones(1), np.ones(1), np.ones(1), 0.0), was, 1.5 * was + 3)
    >>> new.logits(1.5 * was + 3).round(3).tolist()
    [-1.0, 1.0]
    """
    ratio = np.clip((now.std(0) + 1e-6) / (was.std(0) + 1e-6), 0.5, 2.0)
    mean = now.mean(0) + (fit.mean - was.mean(0)) * ratio
    return Regression(mean, fit.scale * ratio, fit.weights, fit.bias)


def fitted(known: FloatArray, strange: FloatArray) -> Regression:
    """Logistic regression by Newton's method, with both classes of the same weight and a ridge.

    Args:
        known: (N, n) features of images that are known.
        strange: (M, n) features of those that are not.
    """
    mean, scale = known.mean(0), known.std(0) + 1e-6
    x = standardised(np.concatenate([known, strange]), mean, scale)
    x = np.concatenate([x, np.ones((len(x), 1))], 1)
    y = np.repeat([0.0, 1.0], [len(known), len(strange)])
    share = np.where(y > 0, len(y) / (2 * len(strange)), len(y) / (2 * len(known)))
    ridge = np.full(x.shape[1], PENALTY * len(x))
    ridge[-1] = 1e-6
    weights = np.zeros(x.shape[1])
    for _ in range(30):
        p = 1 / (1 + np.exp(-np.clip(x @ weights, -30, 30)))
        gradient = x.T @ (share * (p - y)) + ridge * weights
        hessian = (x * (share * p * (1 - p) + 1e-9)[:, None]).T @ x + np.diag(ridge)
        step = np.linalg.solve(hessian, gradient)
        weights -= step
        if np.abs(step).max() < 1e-6:
            break
    return Regression(mean, scale, weights[:-1], float(weights[-1]))


def _runner(model: Any, spec: NetworkSpec) -> Runner:
    """What gives the features of an image of any size."""
    session = open_session(model.SerializeToString())
    buffer = np.zeros((1, 3, spec.height, spec.width), np.float32)

    def run(image: Image) -> FloatArray:
        preprocess(image, spec, buffer)
        features: FloatArray = session.run([FEATURES], {INPUT: buffer})[0][0].astype(np.float64)
        return features

    return run


def _sized(photo: Photo, spec: NetworkSpec) -> Image:
    size = (spec.width, spec.height)
    return np.asarray(cv2.resize(photo.image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _of_known(
    photo: Photo, spec: NetworkSpec, light: AugmentConfig, run: Runner, rng: np.random.Generator
) -> list[FloatArray]:
    """Features of a photo, as it is and in harsh light."""
    return [run(image) for image in _views(_sized(photo, spec), light, rng)]


def _views(image: Image, light: AugmentConfig, rng: np.random.Generator) -> tuple[Image, Image]:
    return image, harsh_light(image, light, rng)


def _of_spoilt(
    photo: Photo, spec: NetworkSpec, light: AugmentConfig, run: Runner, rng: np.random.Generator
) -> list[FloatArray]:
    """Features of some spoilt views, one in three of them in harsh light, too."""
    image, found = _sized(photo, spec), []
    for kind in rng.choice(list(KINDS), SPOILT, replace=False):
        seen = harsh_light(image, light, rng) if rng.random() < 1 / 3 else image
        found.append(run(KINDS[str(kind)](seen, rng)))
    return found


def _figures(
    fit: Regression,
    held: dict[str, list[Photo]],
    spec: NetworkSpec,
    light: AugmentConfig,
    run: Runner,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """The limit, and what it does on photos that were not learnt from."""
    chosen = {name: _evenly(photos, PER_SET) for name, photos in held.items() if photos}
    known = {
        name: fit.logits(np.array([f for p in photos for f in _of_known(p, spec, light, run, rng)]))
        for name, photos in chosen.items()
    }
    limit = limit_of(list(known.values()))
    noticed = {}
    for kind, spoil in KINDS.items():
        images = (_sized(p, spec) for photos in chosen.values() for p in _evenly(photos, PER_SET // 3))
        logits = fit.logits(np.array([run(spoil(image, rng)) for image in images]))
        noticed[kind] = round(float(np.mean(logits > limit)), 4)
    refused = {name: round(float(np.mean(logits > limit)), 4) for name, logits in known.items()}
    return {"limit": float(np.exp(limit)), "refused": refused, "noticed": noticed}


def limit_of(sets: Sequence[FloatArray]) -> float:
    """Even odds, or the logit that all but one in 200 known images stay within, each set counting alike."""
    logits = np.concatenate(sets)
    weights = np.concatenate([np.full(len(s), 1 / (len(s) * len(sets))) for s in sets])
    order = np.argsort(logits)
    within = np.cumsum(weights[order])
    return max(0.0, float(logits[order][np.searchsorted(within, KNOWN_SHARE - 1e-9)]))


def _evenly(photos: Sequence[Photo], most: int) -> list[Photo]:
    """At most so many photos, taken evenly."""
    if len(photos) <= most:
        return list(photos)
    return [photos[i] for i in np.linspace(0, len(photos) - 1, most).round().astype(int)]
