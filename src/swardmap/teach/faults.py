"""What a network gets wrong on the safety set, on it in the drive's light, and on the part held out.

Counted per garden (of the safety set) or group of frames (of the drive's part held out): pixels, and things,
that it calls grass, and pixels that it is so sure of that they would clear a cell of the map
(`grid.clear_below`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.config import GridConfig
from swardmap.eval.things import HEIGHTS_M
from swardmap.io.images import read_color, read_mask
from swardmap.io.sources.truth import FIRST_AREA
from swardmap.labels import GRASS, OTHER, PERSON, MapClass
from swardmap.models.network_io import segmentation_of
from swardmap.models.onnx import OnnxSegmenter
from swardmap.teach.light import lit_frames
from swardmap.teach.safety import SafetyFrame, safety_frames
from swardmap.teach.write import SAID

FEWEST_PIXELS = 20
"""Of a thing, to count."""
GONE_SHARE = 0.5
"""A thing of which more than this is called grass is overlooked."""
HELD_GROUP = 4
"""Frames of the drive that follow each other count as one case."""
CLEARS_255 = 255 * GridConfig().clear_below
"""P(obstacle or person) in 255ths up to which a pixel that is called grass helps to clear a cell."""
PIXEL_FIGURES = {"obstacle": OTHER.id, "person": PERSON.id, "grass": GRASS.id}
LIT = "lit_"
"""Begins the names of figures of the safety set in the drive's light."""
Key = tuple[str, str]
Bools = NDArray[np.bool_]
Float64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Said:
    """What a network says of the pixels of a frame.

    Attributes:
        grass: (H, W) bool that it calls grass.
        clears: (H, W) bool of these, where it is sure enough to clear a cell.
    """

    grass: Bools
    clears: Bools

    @property
    def named(self) -> tuple[tuple[str, Bools], ...]:
        """Both, by the ends of the figures' names."""
        return ("called_grass", self.grass), ("clears", self.clears)


@dataclass(eq=False)
class Counts:
    """Hits and cases of each figure by garden or group; what a network is judged by."""

    hits: dict[Key, int] = field(default_factory=dict)
    of: dict[Key, int] = field(default_factory=dict)

    def add(self, figure: str, unit: str, hits: int, of: int) -> None:
        """Count cases of a garden or group."""
        if of:
            key = (figure, unit)
            self.hits[key] = self.hits.get(key, 0) + int(hits)
            self.of[key] = self.of.get(key, 0) + int(of)

    def cases(self, figure: str) -> tuple[list[int], list[int]]:
        """Hits and cases of a figure, one a unit."""
        keys = sorted(k for k in self.of if k[0] == figure)
        return [self.hits[k] for k in keys], [self.of[k] for k in keys]

    def share(self, figure: str) -> float | None:
        """Of all cases; None without any."""
        hits, of = self.cases(figure)
        return sum(hits) / sum(of) if of else None


def measure(network: Path, held: Path, colours: Float64, threads: int = 0) -> Counts:
    """Count a network's faults on the safety set, in the drive's light too, and on the part held out.

    Args:
        network: .onnx file.
        held: folder with images and labels of that part.
        colours: (N, 3) of the driven ground, see `driven_colours`; none = the drive's light is not known.
        threads: of the network.
    """
    segmenter, counts = OnnxSegmenter(network, threads), Counts()
    for frame in safety_frames():
        count_frame(counts, frame, _said(segmenter, frame.rgb))
    for frame in lit_frames(safety_frames(), colours):
        count_pixels(counts, frame, _said(segmenter, frame.rgb), LIT)
    for number, image in enumerate(sorted((held / "images").glob("*.jpg"))):
        labels = read_mask(held / "labels" / f"{image.stem}.png")
        before = read_mask(held / SAID / f"{image.stem}.png")
        count_held(counts, f"{number // HELD_GROUP}", labels, before, _said(segmenter, read_color(image)))
    return counts


def count_pixels(counts: Counts, frame: SafetyFrame, said: Said, begins: str = "") -> None:
    """Count the pixels of one frame of the safety set.

    Args:
        counts: is added to.
        frame: with its truth.
        said: by the network.
        begins: the names of the figures.
    """
    masks = {name: frame.labels == class_id for name, class_id in PIXEL_FIGURES.items()}
    masks["bare"] = (frame.instances >= FIRST_AREA) & masks["obstacle"]
    _count(counts, frame.garden, {begins + name: mask for name, mask in masks.items()}, said)


def count_frame(counts: Counts, frame: SafetyFrame, said: Said) -> None:
    """Count the pixels and the things of one frame of the safety set; see `count_pixels`."""
    count_pixels(counts, frame, said)
    unit = frame.garden
    pixels = np.bincount(frame.instances.ravel(), minlength=FIRST_AREA)
    called = np.bincount(frame.instances.ravel(), weights=said.grass.ravel(), minlength=FIRST_AREA)
    persons = np.bincount(
        frame.instances.ravel(), weights=(frame.labels == PERSON.id).ravel(), minlength=FIRST_AREA
    )
    lawn = np.bincount(
        frame.instances.ravel(), weights=(frame.labels == GRASS.id).ravel(), minlength=FIRST_AREA
    )
    for key, (_, height_m) in frame.things.items():
        if key >= FIRST_AREA or pixels[key] < FEWEST_PIXELS or lawn[key] > 0.5 * pixels[key]:
            continue
        name = "persons" if persons[key] > 0 else f"things_{_height_class(height_m)}"
        counts.add(name, unit, int(called[key] > GONE_SHARE * pixels[key]), 1)


def count_held(
    counts: Counts, unit: str, labels: NDArray[np.uint8], before: NDArray[np.uint8], said: Said
) -> None:
    """Count one frame of the part of the drive that was held out.

    Args:
        counts: is added to.
        unit: group of frames.
        labels: (H, W) by the drive.
        before: (H, W) what counted of the word of the network before the drive, where the drive says nothing.
        said: by the network that is measured.
    """
    stands = (labels == OTHER.id) | (labels == PERSON.id)
    masks = {"held_driven": labels == GRASS.id, "held_stands": stands, "held_ground": before == OTHER.id}
    _count(counts, unit, masks, said)


def _count(counts: Counts, unit: str, masks: Mapping[str, Bools], said: Said) -> None:
    for name, there in masks.items():
        for end, hit in said.named:
            counts.add(f"{name}_{end}", unit, int((hit & there).sum()), int(there.sum()))


def _height_class(height_m: float) -> str:
    return next(name for name, upper in HEIGHTS_M.items() if height_m < upper)


def _said(segmenter: OnnxSegmenter, rgb: NDArray[np.uint8]) -> Said:
    found = segmentation_of(segmenter.logits(rgb), segmenter.spec).resized_to(*rgb.shape[:2])
    grass = found.map_classes == MapClass.GRASS
    return Said(grass, grass & (found.hazard_255 <= CLEARS_255))
