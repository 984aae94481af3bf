"""Learning from the labels of a drive with replay, and files to choose from. Needs the extra `train`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import ConfigError, require
from swardmap.labels import GRASS, GRASS_OBSTACLE_PERSON
from swardmap.models.spec import NetworkSpec
from swardmap.teach.light import driven_colours, lit, write_lit
from swardmap.teach.plan import LearnConfig
from swardmap.teach.safety import FRESH, REPLAY
from swardmap.teach.write import HELD, LEARN, SAID
from swardmap.train.recipe import AugmentConfig, DataConfig, NetworkConfig, Recipe, ScheduleConfig

START_SHARES = (0.0, 0.4, 0.7)
"""Of the weights it began with, mixed in: what is tried one after another until the gate lets one pass."""
CALIBRATION_IMAGES = 48
FAMILIAR_IMAGES = 12
"""Of each set, about, by which the score of unfamiliar images is carried over."""
ALL_BLOCKS = 99
"""More than an encoder has: none of it learns."""
DEMO = Path(__file__).parent.parent / "data" / "demo"
MOST_WEIGHT = 50.0
"""Of a driven pixel: one frame of lawn must not outshout all that was known."""
LIT_GARDENS = "lit"
"""Folder: the replayed gardens in the light of the drive."""
HOLD_OUT = 8
"""Every so many of the gardens are not learnt from."""

Float64 = NDArray[np.float64]
Report = Callable[[Mapping[str, Any]], None]


def teach_recipe(
    name: str,
    start: Path,
    licence: str,
    learn: LearnConfig,
    more: Sequence[Path],
    precision: str,
    driven_weight: float = 1.0,
    in_your_light: bool = False,
) -> Recipe:
    """What is learnt and how: half the views are of the drive, half of gardens with exact labels.

    Args:
        name: of the network.
        start: the file it begins from.
        licence: of that file.
        learn: steps and rates.
        more: recordings with true labels to replay beside what is in the package.
        precision: bf16 or fp32.
        driven_weight: of a driven pixel in the loss.
        in_your_light: whether half of the gardens are in the light of the drive, see `write_lit_gardens`.
    """
    n = learn.replay
    data = [
        DataConfig(
            name="drive", folder=LEARN, pseudo=SAID, weight=1 - n, person_boost=2,
            free_weight=driven_weight,
        ),
        *_own_replay(n if not more else n / 2, learn.known_weight, in_your_light),
        *(
            DataConfig(
                name=f"more-{i}", folder=str(m.absolute()), kind="recording", weight=n / 2 / len(more),
                person_boost=3, obstacle_weight=learn.known_weight,
            )
            for i, m in enumerate(more)
        ),
        DataConfig(name="held", folder=HELD, validation=True),
        DataConfig(name="gardens-held", folder=str(REPLAY), validation=True, hold_out=HOLD_OUT),
    ]  # fmt: skip
    schedule = ScheduleConfig(
        steps=learn.steps, batch=learn.batch, crop=0, zoom=1.3, decoder_rate=learn.decoder_rate,
        encoder_rate=learn.encoder_rate, warmup=min(5, learn.steps), averaging=0.95, person_weight=3.0,
        pseudo_weight=0.3, paste_person=0.25, covered=0.02, check_every=learn.check_every,
        precision=precision, frozen_norms=True, kept_batches=0 if learn.encoder_rate else learn.kept_batches,
    )  # fmt: skip
    network = NetworkConfig()
    if learn.encoder_rate == 0:
        network = replace(network, frozen_blocks=ALL_BLOCKS)
    told = f"{licence} Taught by a drive over its owner's lawn.".strip()
    return Recipe(
        name,
        network,
        schedule,
        AugmentConfig(scale=0.5, harsh=0.25),
        tuple(data),
        (),
        told,
        str(start),
    )


def _own_replay(share: float, known_weight: float, in_your_light: bool) -> list[DataConfig]:
    """What the package replays: gardens, perhaps in two lights, and the demo; the share is of all."""
    gardens = {"gardens": str(REPLAY)} | ({"gardens-lit": LIT_GARDENS} if in_your_light else {})
    replayed = [
        DataConfig(
            name=name, folder=folder, weight=0.8 * share / len(gardens), person_boost=3, hold_out=HOLD_OUT,
            obstacle_weight=known_weight,
        )
        for name, folder in gardens.items()
    ]  # fmt: skip
    demo = DataConfig(
        name="demo", folder=str(DEMO), kind="recording", weight=0.2 * share, person_boost=2,
        obstacle_weight=known_weight,
    )  # fmt: skip
    return [*replayed, demo]


def write_lit_gardens(folder: Path) -> Float64:
    """Write the replayed gardens in the light of the drive, if that is known; the colours of its ground."""
    colours = driven_colours(folder / LEARN)
    if len(colours):
        write_lit(REPLAY, folder / LIT_GARDENS, colours)
    return colours


def driven_weight(share: float, wanted: float) -> float:
    """Weight of a driven pixel with which all of them weigh as they should; never below that of others.

    Args:
        share: of the drive's pixels that are labelled as driven.
        wanted: share of the weight, 1 = all pixels of the drive with a weight of 1.

    >>> driven_weight(0.02, 0.3)
    15.0
    >>> driven_weight(0.5, 0.3), driven_weight(0.0, 0.3)
    (1.0, 50.0)
    """
    return float(np.clip(wanted / max(share, 1e-6), 1.0, MOST_WEIGHT))


def check_start(spec: NetworkSpec, path: Path) -> None:
    """Hold that a network can be taught.

    Raises:
        ConfigError: if it tells other classes apart than grass, other and person.
    """
    if spec.label_set != GRASS_OBSTACLE_PERSON or spec.activation != "softmax":
        names = ", ".join(c.name for c in spec.label_set.classes)
        raise ConfigError(f"{path}: expected a network of the classes other, grass and person, got {names}")


def learn_labels(recipe: Recipe, folder: Path, out: Path, report: Report, device: str, threads: int) -> None:
    """Train until the recipe's last step; goes on where it was. `out` is the folder of the checkpoints."""
    torch = require("torch", "train")
    from swardmap.train.loop import train

    if threads:
        torch.set_num_threads(threads)
    train(recipe, folder, out, report, device)


def device_and_precision(device: str) -> tuple[str, str]:
    """The device that `auto` means, and the precision it is quick in."""
    torch = require("torch", "train")
    from swardmap.train.loop import quick_precision

    chosen = ("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else device
    return chosen, quick_precision(chosen)


def export_candidate(
    learnt: Path, begun: Path, folder: Path, out: Path, start: Path, spec: NetworkSpec, share: float
) -> None:
    """Write a network with a share of the weights it began with: INT8, size and biases as the start has them.

    Args:
        learnt: checkpoint of what was learnt.
        begun: of what it began from.
        folder: the data root.
        out: the .onnx file.
        start: the file that it began from.
        spec: of that file.
        share: of the start's weights.
    """
    from swardmap.train.release import release

    blend = ((begun, share),) if share > 0 else ()
    release(
        learnt, folder, out, images=CALIBRATION_IMAGES, size=(spec.width, spec.height), blend=blend,
        familiar=False, biases_of=start, figures=False,
    )  # fmt: skip


def refit_sureness(path: Path, start: Path, colours: Float64) -> float:
    """Let the new network be as sure, and say grass as readily, as is no more daring than the start.

    By gardens with exact labels alone: what stands by the drive's labels may be long grass, and a network
    that knows it for lawn would be made unsure of everything. The gate sees it. And by gardens that are not
    replayed: the network in the package has learnt those, and is seldom wrong in them.

    Args:
        path: of the new network.
        start: the file that it began from.
        colours: (N, 3) of the driven ground, see `driven_colours`; none = its light is not known.

    Returns:
        What was added to the bias of grass.
    """
    from swardmap.teach.sureness import set_bias, set_temperature
    from swardmap.train.photos import read_photos

    fresh = DataConfig(name="fresh", folder=str(FRESH), validation=True)
    photos = read_photos(fresh, 0, NetworkConfig(), Path())
    gardens = {fresh.name: photos}
    set_temperature(path, start, gardens)
    images = lit([(photo.image, photo.codes == GRASS.id) for photo in photos], colours)
    relit = [replace(photo, image=image) for photo, image in zip(photos, images, strict=False)]
    return set_bias(path, start, gardens, {"lit": relit} if relit else {})


def know_images(path: Path, start: Path, recipe: Recipe, folder: Path) -> None:
    """Carry over what the start says of images that it does not know; nothing, if it says nothing.

    Fitted anew it would take minutes, and know no lawn but this one.
    """
    from swardmap.train.data import load_photos
    from swardmap.train.familiar import carry_familiar

    sets = {s.config.name: s.photos for s in load_photos(recipe, folder, validation=False)}
    known = [p for photos in sets.values() for p in photos[:: max(1, len(photos) // FAMILIAR_IMAGES)]]
    carry_familiar(path, start, known, recipe.augment)


def read_network(path: Path) -> NetworkSpec:
    """What a network file says about itself, without torch."""
    from swardmap.models.onnx import OnnxSegmenter

    return OnnxSegmenter(path, 1).spec


def tell(path: Path, taught: Mapping[str, Any]) -> NetworkSpec:
    """Put what was measured into the file."""
    from swardmap.train.export import with_spec

    spec = read_network(path)
    return with_spec(path, training={**spec.training, "taught": dict(taught)})
