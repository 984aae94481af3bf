"""The safety set in the package: gardens with exact labels, never learnt from, that the gate measures on."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.door import reading
from swardmap.io.files import read_bytes
from swardmap.io.images import decode, read_color, read_mask

FOLDER = Path(__file__).parent.parent / "data" / "teach"
SAFETY, REPLAY, FRESH = FOLDER / "safety", FOLDER / "replay", FOLDER / "fresh"
"""What the gate measures on, what is learnt from, and by what a taught network's bias is set: gardens that
neither it nor the network in the package has learnt from."""


@dataclass(frozen=True, slots=True, eq=False)
class SafetyFrame:
    """One frame of the set.

    Attributes:
        garden: number of the garden it is of.
        rgb: (H, W, 3) uint8.
        labels: (H, W) uint8 in ids of `GRASS_OBSTACLE_PERSON`.
        instances: (H, W) uint16 thing or bare ground that each pixel within 5 m shows, 0 = neither.
        things: id -> kind and height above the ground in metres.
    """

    garden: str
    rgb: NDArray[np.uint8]
    labels: NDArray[np.uint8]
    instances: NDArray[np.uint16]
    things: dict[int, tuple[str, float]]


def safety_frames(folder: Path = SAFETY) -> Iterator[SafetyFrame]:
    """The frames of a set, in the order of their names.

    Raises:
        InputError: if a file is missing or damaged.
    """
    table = folder / "things.json"
    with reading(table, "the table of things of a safety set"):
        told = json.loads(read_bytes(table))
        things = {
            str(name): {int(k): (str(kind), float(height)) for k, (kind, height) in found.items()}
            for name, found in told.items()
        }
    for name in sorted(things):
        instances = decode(read_bytes(folder / "instances" / f"{name}.png"), name)
        rgb = read_color(folder / "images" / f"{name}.jpg")
        labels = read_mask(folder / "labels" / f"{name}.png")
        if not instances.shape == labels.shape == rgb.shape[:2]:
            raise InputError(f"{folder}: {name}: expected images of one size")
        yield SafetyFrame(name.split("_")[0], rgb, labels, instances.astype(np.uint16), things[name])
