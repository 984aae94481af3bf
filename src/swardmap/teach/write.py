"""The labels of a drive as a folder that a recipe reads: images and masks to learn from and to measure on."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.grid import GridSpec, overlap
from swardmap.io.files import write_bytes, write_text
from swardmap.io.images import encode_jpeg, encode_png
from swardmap.labels import GRASS, OTHER, PERSON, VOID_ID, MapClass
from swardmap.mapping.work_area import WorkArea
from swardmap.segmenter import Segmenter
from swardmap.teach.doubt import Doubt, find_doubt, least_other_of
from swardmap.teach.drive import Drive, driven_again, raised_cells
from swardmap.teach.labels import (
    MOST_IN_CELL,
    SETTLED,
    DrivenGround,
    FrameLabels,
    in_cells,
    label_frame,
)
from swardmap.teach.plan import TeachPlan
from swardmap.teach.views import Bools, Heights
from swardmap.types import Frame, Segmentation

Cells = NDArray[np.integer]

LEARN, HELD, SAID, OPEN = "learn", "held", "said", "open"
"""Folders: to learn from, to measure on, what the network said where the drive says nothing, where it may."""
MOST_EDGE = 640
GAP_FRAMES = 2
"""Between what is learnt from and what is measured on."""
LEAST_APART = 0.4
"""Share of the driven cells held out that must be new, for these alone to count."""
CLASS_NAMES = {OTHER.id: "other", GRASS.id: "grass", PERSON.id: "person", VOID_ID: "void"}
MAP_CLASS_NAMES = {
    MapClass.UNKNOWN: "void", MapClass.GRASS: "grass", MapClass.OBSTACLE: "other", MapClass.PERSON: "person"
}  # fmt: skip


@dataclass(eq=False)
class Written:
    """What was labelled, for the page and for who goes on.

    Attributes:
        pixels: of each class, that the drive labelled.
        said: of each class, that the network's word labelled.
        driven: driven pixels by what the network so far calls them.
        raised_called_grass: raised pixels that it calls grass.
        learn, held: frames.
        learnt_driven, learnt_all: driven pixels that are learnt from, and all pixels of these frames.
        held_driven: driven pixels of those held out.
        shown: some frames with their labels, for the page.
    """

    pixels: dict[str, int] = field(default_factory=lambda: dict.fromkeys(CLASS_NAMES.values(), 0))
    said: dict[str, int] = field(default_factory=lambda: dict.fromkeys(CLASS_NAMES.values(), 0))
    driven: dict[str, int] = field(default_factory=lambda: dict.fromkeys(CLASS_NAMES.values(), 0))
    raised_called_grass: int = 0
    learn: int = 0
    held: int = 0
    learnt_driven: int = 0
    learnt_all: int = 0
    held_driven: int = 0
    shown: list["Shown"] = field(default_factory=list)

    def facts(self) -> dict[str, Any]:
        """Plain numbers."""
        return {
            "frames_learn": self.learn,
            "frames_held": self.held,
            "pixels": self.pixels,
            "pixels_by_network": self.said,
            "driven_called_before": self.driven,
            "raised_called_grass_before": self.raised_called_grass,
            "driven_share": self.learnt_driven / max(1, self.learnt_all),
        }


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """A frame on the page."""

    name: str
    seconds: float
    held: bool
    rgb: NDArray[np.uint8]
    labels: FrameLabels
    before: Segmentation


def ground_of(
    drive: Drive, doubt: Doubt, area: WorkArea | None, unwanted: Sequence[WorkArea]
) -> DrivenGround:
    """What the drive says of the cells, less what is doubtful, left out or outside the work area."""
    nothing = doubt.cells.copy()
    if area is not None:
        nothing |= area.keep_out(drive.spec)
    silent = np.zeros(drive.spec.shape, np.bool_)
    for one in unwanted:
        one.check_frame(drive.spec.frame_id)
        for polygon in one.polygons:
            silent |= polygon.covers(drive.spec)
    nothing |= silent
    driven = (drive.driven > 0) & ~nothing
    least_other = least_other_of([p.looks for p in drive.used], driven, drive.spec)
    return DrivenGround(drive.spec, driven, nothing, silent, raised_cells(drive), least_other)


def doubt_of(drive: Drive) -> Doubt:
    """The driven ground that does not look like the rest."""
    return find_doubt([p.looks for p in drive.used], drive.driven > 0, drive.spec)


def write_labels(
    frames: Iterable[Frame],
    drive: Drive,
    ground: DrivenGround,
    segmenter: Segmenter,
    config: Config,
    plan: TeachPlan,
    out: Path,
    prefix: str,
    written: Written,
    on_frame: Callable[[], None],
) -> None:
    """Label the frames of a drive into OUT/learn, OUT/held and OUT/said.

    The last part of the drive is held out, of it what lies where nothing was learnt, if that is enough.

    Args:
        frames: the recording, read again.
        drive: of it.
        ground: what it says of the cells.
        segmenter: the network so far.
        config: as for `drive`.
        plan: limits.
        out: the folder.
        prefix: of the names.
        written: is added to.
        on_frame: told of each frame.
    """
    first_held = round(len(drive.used) * (1 - plan.labels.held_out))
    learnt = _learnt_cells(drive, first_held)
    shown_every = max(1, len(drive.used) // 12)
    apart = _apart_share(drive, ground, learnt, first_held) >= LEAST_APART
    for number, frame, heights, found in driven_again(frames, drive, segmenter, config, on_frame):
        held = number >= first_held
        if first_held - GAP_FRAMES <= number < first_held:
            continue
        labels = label_frame(heights, found, ground, plan.labels)
        _count(written, labels, found)
        if held and apart:
            labels = _without(labels, learnt, drive.spec, heights)
        name = f"{prefix}{number:04d}"
        small, cells = shrunk(labels, heights.cells)
        even = evened(small, cells, plan.labels.cell_pixels, number)
        _write(out, name, frame, even, held)
        written.held += held
        written.learnt_driven += 0 if held else int(np.count_nonzero(even.sure == GRASS.id))
        written.learnt_all += 0 if held else even.sure.size
        written.held_driven += int(np.count_nonzero(labels.sure == GRASS.id)) if held else 0
        written.learn += not held
        if number % shown_every == 0:
            seconds = float((frame.stamp_ns - drive.track.stamps_ns[0]) * 1e-9)
            written.shown.append(Shown(name, seconds, held, frame.rgb, labels, found))


def _learnt_cells(drive: Drive, first_held: int) -> Bools:
    cells = np.zeros(drive.spec.shape, np.bool_)
    for p in drive.used[: max(0, first_held - GAP_FRAMES)]:
        own, there = overlap(p.seen.spec, drive.spec)
        cells[there] |= p.seen.flat[own]
    return cells


def _apart_share(drive: Drive, ground: DrivenGround, learnt: Bools, first_held: int) -> float:
    """Share of the driven cells that the frames held out see, which nothing was learnt of."""
    new = total = 0
    for p in drive.used[first_held:]:
        own, there = overlap(p.seen.spec, drive.spec)
        driven = p.seen.flat[own] & ground.driven[there]
        total += int(driven.sum())
        new += int((driven & ~learnt[there]).sum())
    return new / total if total else 0.0


def _without(labels: FrameLabels, learnt: Bools, spec: GridSpec, heights: Heights) -> FrameLabels:
    """Labels of the ground that nothing was learnt of; what stands stays."""
    local = np.zeros(heights.spec.shape, np.bool_)
    own, there = overlap(heights.spec, spec)
    local[own] = learnt[there]
    known = heights.cells >= 0
    seen = known & local.ravel()[np.where(known, heights.cells, 0)]
    sure = np.where(seen & (labels.sure == GRASS.id), np.uint8(VOID_ID), labels.sure)
    return replace(labels, sure=sure)


def shrunk(labels: FrameLabels, cells: Cells) -> tuple[FrameLabels, Cells]:
    """Labels and cells of a frame at the size that is learnt from, at most MOST_EDGE pixels wide and high."""
    import cv2

    height, width = cells.shape
    factor = MOST_EDGE / max(height, width)
    if factor >= 1:
        return labels, cells
    size = (round(width * factor), round(height * factor))
    masks = (labels.sure, labels.said, labels.open_ground, cells)
    sure, said, open_ground, small = (cv2.resize(m, size, interpolation=cv2.INTER_NEAREST) for m in masks)
    free = (open_ground != SETTLED) & (open_ground <= MOST_IN_CELL)
    open_ground = np.where(free, in_cells(free, small), open_ground)
    return FrameLabels(sure, said, open_ground), small


def evened(labels: FrameLabels, cells: Cells, cell_pixels: float, seed: int) -> FrameLabels:
    """Labels in which every driven cell has about as many pixels of grass, near or far.

    Near cells hold hundreds of pixels, far ones a few, and the map asks for the far ones as often.

    Args:
        labels: of a frame.
        cells: (H, W) the cell of each pixel.
        cell_pixels: of a cell that stay, on average; all where it has fewer.
        seed: of which pixels stay.
    """
    grass = labels.sure == GRASS.id
    pixels = np.bincount(cells[grass], minlength=1)
    chance = cell_pixels / np.maximum(pixels[cells[grass]], cell_pixels)
    sure = labels.sure.copy()
    sure[grass] = np.where(np.random.default_rng(seed).random(len(chance)) < chance, GRASS.id, VOID_ID)
    return replace(labels, sure=sure)


def _count(written: Written, labels: FrameLabels, found: Segmentation) -> None:
    for counts, mask in ((written.pixels, labels.sure), (written.said, labels.said)):
        found_ids = np.bincount(mask.ravel(), minlength=256)
        for class_id, name in CLASS_NAMES.items():
            counts[name] += int(found_ids[class_id])
    classes = found.map_classes
    driven = np.bincount(classes[labels.sure == GRASS.id], minlength=4)
    for map_class, name in MAP_CLASS_NAMES.items():
        written.driven[name] += int(driven[map_class])
    raised = (labels.sure == OTHER.id) | (labels.sure == PERSON.id)
    written.raised_called_grass += int((raised & (classes == MapClass.GRASS)).sum())


def _write(out: Path, name: str, frame: Frame, labels: FrameLabels, held: bool) -> None:
    import cv2

    height, width = labels.sure.shape
    folder = out / (HELD if held else LEARN)
    masks = {folder / "labels": labels.sure, (folder if held else out) / SAID: labels.said}
    if not held:
        masks |= {out / OPEN: labels.open_ground}
    for part in (folder / "images", *masks):
        part.mkdir(parents=True, exist_ok=True)
    rgb = np.asarray(cv2.resize(frame.rgb, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    write_bytes(folder / "images" / f"{name}.jpg", encode_jpeg(rgb), durable=False)
    for part, mask in masks.items():
        write_bytes(part / f"{name}.png", encode_png(mask), durable=False)


def write_facts(path: Path, facts: dict[str, Any]) -> None:
    """A JSON file of plain values, whole or not at all."""
    write_text(path, json.dumps(facts, indent=1, sort_keys=True) + "\n")
