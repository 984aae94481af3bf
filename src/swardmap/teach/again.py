"""The second round: what the network of the first is sure of, where the drive says nothing.

A robot covers a strip of what it sees, and of far lawn next to nothing. The network that learnt the strip
knows the rest: flat ground that it surely calls grass counts as driven ground does, and its "no grass" counts
now, too, for it knows this lawn. Where it contradicts what was learnt in the first round, nobody knows.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.io.files import write_bytes
from swardmap.io.images import encode_png, read_color, read_mask
from swardmap.labels import GRASS, OTHER, VOID_ID
from swardmap.teach.labels import said_of
from swardmap.teach.plan import LabelConfig, LearnConfig
from swardmap.teach.write import LEARN, OPEN, SAID
from swardmap.train.recipe import Recipe
from swardmap.types import Segmentation

AGAIN, SAID_AGAIN = "again", "said-again"
"""Folders, of labels as `LEARN/labels` and `SAID` are."""
Mask = NDArray[np.uint8]


def label_again(folder: Path, checkpoint: Path, limits: LabelConfig) -> float:
    """Write the labels of the second round; returns the share of the pixels that count as driven ground.

    Args:
        folder: of labels, as `write_labels` leaves it.
        checkpoint: of the first round.
        limits: how sure the network must be, and how many pixels of a cell are learnt from.
    """
    from swardmap.train.checkpoint import load_network
    from swardmap.train.loop import predict
    from swardmap.train.photos import Photo

    network, recipe, _ = load_network(checkpoint)
    device = next(network.parameters()).device
    for part in (folder / LEARN / AGAIN, folder / SAID_AGAIN):
        part.mkdir(parents=True, exist_ok=True)
    grass = pixels = 0
    for number, image in enumerate(sorted((folder / LEARN / "images").iterdir())):
        name, rgb = f"{image.stem}.png", read_color(image)
        sure, open_ground, before = (read_mask(folder / p / name) for p in (f"{LEARN}/labels", OPEN, SAID))
        found = predict(network, recipe, Photo(rgb, sure, sure, image.stem), device)
        sure, said = labels_again(sure, open_ground, before, found, limits, number)
        write_bytes(folder / LEARN / AGAIN / name, encode_png(sure), durable=False)
        write_bytes(folder / SAID_AGAIN / name, encode_png(said), durable=False)
        grass, pixels = grass + int((sure == GRASS.id).sum()), pixels + sure.size
    return grass / max(1, pixels)


def labels_again(
    sure: Mask, open_ground: Mask, before: Mask, found: Segmentation, limits: LabelConfig, seed: int
) -> tuple[Mask, Mask]:
    """Labels of a frame with what a network that knows the lawn says of the rest of the ground.

    Args:
        sure: (H, W) by the drive.
        open_ground: (H, W) where its word may count, see `FrameLabels`.
        before: (H, W) what counted of the word of the network that was there before the drive.
        found: its word.
        limits: see `label_again`.
        seed: of which pixels of a cell stay.

    Returns:
        (H, W) labels in which some pixels of each cell of grass are added, and (H, W) the rest of its word.
    """
    said = said_of(open_ground, found, limits, least_other=0.0)
    said[(before == OTHER.id) & (said == GRASS.id)] = VOID_ID
    grass = said == GRASS.id
    chance = limits.cell_pixels / np.maximum(open_ground, limits.cell_pixels)
    stays = np.random.default_rng(seed).random(said.shape) < chance
    return (
        np.where(grass & stays, np.uint8(GRASS.id), sure),
        np.where(grass, np.uint8(VOID_ID), said),
    )


def second_recipe(recipe: Recipe, learn: LearnConfig, checkpoint: Path, driven_weight: float) -> Recipe:
    """The recipe of the second round: it goes on from the first, by its labels.

    Args:
        recipe: of the first.
        learn: how many steps.
        checkpoint: of the first.
        driven_weight: of a pixel of driven ground, and of what counts as such.
    """
    drive, *rest = recipe.data
    drive = replace(drive, labels=AGAIN, pseudo=SAID_AGAIN, free_weight=driven_weight)
    schedule = replace(recipe.schedule, steps=learn.again_steps, warmup=min(5, learn.again_steps))
    return replace(recipe, schedule=schedule, data=(drive, *rest), start=str(checkpoint.absolute()))
