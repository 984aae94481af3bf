"""How well photos without depth teach: groups of one robot's photos, each with a lane ahead as if driven.

    python benchmarks/bench_teach_masks.py robot_lawns out/ --group ensta --list dev.txt

A folder with images and labels, as shared photos come. In each photo the lawn within a trapezoid ahead of
the robot, and no other pixel, is called driven; what is labelled beside it is what the network so far is sure
of: persons, and "no grass" where that is surer than it is of nearly all lanes. Nothing says what stands, for
there is no depth. Every second photo is learnt from, then the others (`--folds 1`: the first two thirds);
those left out are scored by their masks, before and after. The gate is that of `swardmap teach`.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.io.files import write_bytes
from swardmap.io.images import encode_jpeg, encode_png, read_color, read_mask
from swardmap.labels import GRASS, OTHER, PERSON, VOID_ID, MapClass
from swardmap.models import bundled_network
from swardmap.models.network_io import segmentation_of
from swardmap.models.onnx import OnnxSegmenter
from swardmap.teach.doubt import surer_than
from swardmap.teach.faults import CLEARS_255
from swardmap.teach.labels import SETTLED, UNSEEN, said_of
from swardmap.teach.plan import LabelConfig, TeachPlan, circle
from swardmap.teach.run import learn
from swardmap.teach.task import Task
from swardmap.teach.write import HELD, LEARN, OPEN, SAID, write_facts
from swardmap.types import Segmentation

LANE = np.array([[0.2, 1.0], [0.42, 0.6], [0.58, 0.6], [0.8, 1.0]])
"""Corners of the lane, as shares of width and height: about 0.6 m wide, to some metres ahead."""
SHARE = 0.05
"""Of the lane's pixels that teach, as of the near cells of a drive."""
CLASSES = (GRASS, OTHER, PERSON)
Photo = tuple[str, NDArray[np.uint8], NDArray[np.uint8]]


def photos(folder: Path, group: str, listed: str | None) -> list[Photo]:
    """Name, image and mask of those whose name begins so, by name."""
    names = {p.stem for p in (folder / "images").iterdir()}
    if listed is not None:
        names &= set((folder / listed).read_text(encoding="utf-8").split())
    paths = sorted(p for p in (folder / "images").iterdir() if p.stem in names and p.stem.startswith(group))
    return [(p.stem, read_color(p), read_mask(folder / "labels" / f"{p.stem}.png")) for p in paths]


def says(network: OnnxSegmenter, rgb: NDArray[np.uint8]) -> Segmentation:
    """What a network says of an image, at its size."""
    return segmentation_of(network.logits(rgb), network.spec).resized_to(*rgb.shape[:2])


def lane_of(mask: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(H, W) bool: lawn in the lane that reaches the robot without a break; as a person would drive it."""
    height, width = mask.shape
    lane = np.zeros(mask.shape, np.uint8)
    cv2.fillPoly(lane, [np.round(LANE * (width, height)).astype(np.int32)], 1)
    free = ((lane > 0) & (mask == GRASS.id)).astype(np.uint8)
    _, parts = cv2.connectedComponents(cv2.erode(free, np.ones((5, 5), np.uint8)))
    near = np.unique(parts[int(0.95 * height) :])
    return np.asarray(np.isin(parts, near[near > 0]))


def write_fold(chosen: Sequence[Photo], folder: Path, network: OnnxSegmenter) -> None:
    """Labels of photos as `swardmap teach` keeps them; each fifth is for its gate."""
    rng, limits, driven, pixels = np.random.default_rng(0), LabelConfig(), 0, 0
    words = [says(network, rgb) for _, rgb, _ in chosen]
    hazards = [word.hazard_255[lane_of(mask)] for word, (_, _, mask) in zip(words, chosen, strict=True)]
    least_other = surer_than(np.concatenate(hazards) / np.float32(255))
    for number, ((name, rgb, mask), word) in enumerate(zip(chosen, words, strict=True)):
        held = number % 5 == min(4, len(chosen) - 1)
        lane = lane_of(mask)
        sure = np.where(lane & (rng.random(mask.shape) < SHARE), np.uint8(GRASS.id), np.uint8(VOID_ID))
        open_ground = np.where(lane, np.uint8(SETTLED), np.uint8(UNSEEN))
        said = said_of(open_ground, word, limits, least_other)
        parts = {f"{HELD if held else LEARN}/labels": sure, f"{HELD}/{SAID}" if held else SAID: said}
        if not held:
            parts |= {OPEN: open_ground}
            driven, pixels = driven + int((sure == GRASS.id).sum()), pixels + sure.size
        images = folder / (HELD if held else LEARN) / "images"
        for needed in (images, *(folder / part for part in parts)):
            needed.mkdir(parents=True, exist_ok=True)
        write_bytes(images / f"{name}.jpg", encode_jpeg(rgb), durable=False)
        for part, image in parts.items():
            write_bytes(folder / part / f"{name}.png", encode_png(image), durable=False)
    facts = {
        "digest": "masks", "drives": ["photos"], "driven_m2": 0.0, "frames_learn": len(chosen),
        "driven_share": driven / max(1, pixels),
    }  # fmt: skip
    write_facts(folder / "labels.json", facts)


def score(network: Path, left_out: Sequence[Photo]) -> NDArray[np.int64]:
    """(3, 3) pixels of lawn, of other things and of persons: called grass, surely so, and all."""
    segmenter, counts = OnnxSegmenter(network, 1), np.zeros((3, 3), np.int64)
    for _, rgb, mask in left_out:
        found = says(segmenter, rgb)
        grass = found.map_classes == MapClass.GRASS
        sure = grass & (found.hazard_255 <= CLEARS_255)
        for i, one in enumerate(CLASSES):
            there = mask == one.id
            counts[i] += [np.count_nonzero(x & there) for x in (grass, sure, there)]
    return counts


def told(counts: NDArray[np.int64]) -> str:
    """Shares called grass, and surely so."""
    shares = counts[:, :2] / np.maximum(counts[:, 2:], 1)
    return "   ".join(
        f"{one.name} {100 * called:.1f} % ({100 * sure:.1f} surely) of {of}"
        for one, (called, sure), of in zip(CLASSES, shares.tolist(), counts[:, 2].tolist(), strict=True)
    )


def main() -> None:
    """Learn each fold, and score what was left out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--group", default="", help="how the names begin")
    parser.add_argument("--list", default=None, help="file of names in the folder")
    parser.add_argument("--folds", type=int, default=2)
    parser.add_argument("--threads", type=int, default=0)
    chosen = parser.parse_args()
    found = photos(chosen.folder, chosen.group, chosen.list)
    start = bundled_network()
    assert start is not None
    total = np.zeros((2, 3, 3), np.int64)
    for fold in range(chosen.folds):
        learnt = found[: 2 * len(found) // 3] if chosen.folds == 1 else found[fold :: chosen.folds]
        rest = [p for p in found if all(p[0] != name for name, _, _ in learnt)]
        out = chosen.out / f"{chosen.group or chosen.folder.name}-{fold}.onnx"
        task = Task((), (), out, Config(), TeachPlan(circle(0.3)))
        if not out.is_file():
            write_fold(learnt, task.folder, OnnxSegmenter(start, 1))
            verdict = learn(task, "cpu", chosen.threads, lambda _: None)
            print(f"fold {fold}: {'; '.join(verdict.reasons) or 'the gate lets it pass'}", flush=True)
        for k, network in enumerate((start, out if out.is_file() else start)):
            total[k] += score(network, rest)
    for name, counts in zip(("before", "after"), total, strict=True):
        print(f"{name:<7} called grass: {told(counts)}", flush=True)


if __name__ == "__main__":
    main()
