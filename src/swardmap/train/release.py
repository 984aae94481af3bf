"""The whole way from a checkpoint to a file one can ship: export, quantise, calibrate, measure."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import torch

from swardmap.labels import Role
from swardmap.models.spec import NetworkSpec
from swardmap.train.build import BIASES, HEAD, add_biases, export_shift, network_spec
from swardmap.train.calibrate import fit_class_biases, fit_temperature, labelled_logits
from swardmap.train.checkpoint import blended, load_network
from swardmap.train.data import load_photos
from swardmap.train.evaluate import evaluate_network
from swardmap.train.export import export_onnx, quantise, read_spec, with_spec
from swardmap.train.familiar import teach_familiar
from swardmap.train.networks import DeepLabV3Plus
from swardmap.train.photos import Photo
from swardmap.train.recipe import Recipe


def release(
    checkpoint: Path,
    root: Path,
    out: Path,
    int8: bool = True,
    images: int = 64,
    size: tuple[int, int] | None = None,
    grass_bias: float = 0.0,
    blend: Sequence[tuple[Path, float]] = (),
    calibrate_classes: bool = False,
    familiar: bool = True,
    biases_of: Path | None = None,
    figures: bool = True,
    person_bias: float = 0.0,
) -> dict[str, Any]:
    """Write `out`, and say what it costs and how good it is on the recipe's validation data.

    Args:
        checkpoint: of `train`.
        root: folder the recipe's data folders are in.
        out: the .onnx file, written in steps: give a new name, and rename it when all is done.
        int8: quantise, calibrated on training images.
        images: how many of those.
        size: width and height of the input, if not the recipe's.
        grass_bias: added to the logit of classes that may be driven on, to trade grass missed for
            obstacles called grass; choose it on validation data.
        blend: other checkpoints and their shares of the weights, mixed in one after another; see `blended`.
        calibrate_classes: fit a bias for each class on the validation data, before `grass_bias` and
            `person_bias` are added.
        familiar: teach the file which images it knows; see `make_familiar`.
        biases_of: a network file whose class biases are added as they are: the one that the training began
            from, which took them away.
        figures: measure both precisions; False where somebody else does.
        person_bias: added to the logit of persons, to trade persons called other for other things called
            persons; both are obstacles.

    Returns:
        Figures of both precisions, the INT8 loss in points of grass IoU, temperature, size, and what
            `make_familiar` gives.
    """
    network, recipe, state = load_network(checkpoint)
    for other, share in blend:
        blended(network, other, share)
    spec = network_spec(recipe)
    if size is not None:
        spec = replace(spec, width=size[0], height=size[1])
    shifts = {Role.FREE: grass_bias, Role.PERSON: person_bias}
    training = _told(recipe, state["step"], shifts, [share for _, share in blend])
    plain = out.with_suffix(".float32.onnx") if int8 else out
    held = {s.config.name: s.photos for s in load_photos(recipe, root, validation=True)}
    if calibrate_classes and held:
        training["class_biases"] = _calibrate_classes(network, spec, held, plain)
    if biases_of is not None:
        training |= _add_biases_of(network, biases_of)
    spec = replace(spec, training=training)
    add_biases(network, spec, shifts)
    difference = export_onnx(network, spec, plain)
    result: dict[str, Any] = {"file": str(out), "difference": difference}
    try:
        if held and figures:
            result["float32"] = measured(plain, held)
        if int8:
            photos = [photo.image for photo in _spread(recipe, root, images)]
            quantise(plain, out, photos)
            result["int8"] = measured(out, held) if held and figures else None
    finally:
        if int8:
            plain.unlink(missing_ok=True)
    temperature = fit_temperature(out, held) if held else 1.0
    metrics = {k: result[k] for k in ("float32", "int8") if result.get(k)}
    with_spec(out, temperature=temperature, metrics=metrics)
    if familiar:
        result["unfamiliar"] = make_familiar(out, recipe, root)
    result.update(temperature=temperature, bytes=out.stat().st_size, int8_loss_points=_loss(result))
    return result


def _told(
    recipe: Recipe, steps: int, shifts: Mapping[Role, float], shares: Sequence[float]
) -> dict[str, Any]:
    """What a file says of its training: recipe, data, biases, and what it is a mean of."""
    sets = [{"name": d.name, "folder": d.folder, "weight": d.weight} for d in recipe.data if not d.validation]
    biases = {BIASES[role]: bias for role, bias in shifts.items()}
    told: dict[str, Any] = {"recipe": recipe.name, "steps": steps, "data": sets, **biases}
    return told | ({"blend_shares": list(shares)} if shares else {})


def make_familiar(path: Path, recipe: Recipe, root: Path) -> dict[str, Any]:
    """Teach a network file which images it knows, by the recipe's sets; what else stands in it stays.

    Sets of which only some classes are known show all kinds of places, and are left out.

    Args:
        path: the .onnx file; replaced whole.
        recipe: that it was trained by.
        root: folder the recipe's data folders are in.

    Returns:
        What `teach_familiar` gives.
    """
    known, held = (
        {s.config.name: s.photos for s in load_photos(recipe, root, validation) if not s.config.void_means}
        for validation in (False, True)
    )
    return teach_familiar(path, known, held, recipe.augment)


@torch.no_grad()
def _add_biases_of(network: DeepLabV3Plus, path: Path) -> dict[str, Any]:
    """Add to the head what another file of the same classes says was added to its own, and return that."""
    source = read_spec(path)
    shift = export_shift(source)
    network.get_parameter(HEAD[1]).add_(shift)
    return {"class_biases": [round(float(b), 4) for b in shift]}


@torch.no_grad()
def _calibrate_classes(
    network: DeepLabV3Plus, spec: NetworkSpec, held: Mapping[str, list[Photo]], scratch: Path
) -> list[float]:
    """Add to the head what makes the probability of each class most likely; returns what was added."""
    export_onnx(network, spec, scratch)
    biases = fit_class_biases(labelled_logits(scratch, held))[1]
    network.get_parameter(HEAD[1]).add_(torch.from_numpy(biases[-spec.channels :]).float())
    return [round(float(b), 4) for b in biases]


def _spread(recipe: Any, root: Path, count: int) -> list[Photo]:
    """Training photos, taken evenly from all sets."""
    photos = [photo for s in load_photos(recipe, root, validation=False) for photo in s.photos]
    return list(islice(photos[:: max(1, len(photos) // count)], count))


def measured(path: Path, held: Mapping[str, list[Photo]]) -> dict[str, float | None]:
    """Figures of all photos together and, if there are several sets, of each."""
    scores = {name: evaluate_network(path, photos).score for name, photos in held.items()}
    first, *rest = scores.values()
    together = replace(first, counts=sum((s.counts for s in rest), first.counts))
    figures = dict(together.figures())
    if rest:
        figures |= {f"{name}.{k}": v for name, score in scores.items() for k, v in score.figures().items()}
    return figures


def _loss(result: dict[str, Any]) -> float | None:
    before, after = ((result.get(k) or {}).get("grass_iou") for k in ("float32", "int8"))
    return None if before is None or after is None else 100 * (before - after)
