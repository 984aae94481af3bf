"""Score network files side by side on every photo set that has labels and is not learnt from: one table.

    python benchmarks/score_networks.py old.onnx auto --data ~/photos
    python benchmarks/score_networks.py auto --data ~/photos --only dev,igvc --bias -0.8,-0.4,0

The data root is that of the recipes (tools/training_root.py makes it). Per set and network: accuracy, IoU of
grass, share of obstacle pixels called grass, IoU of persons, in percent. What is missing under the root is
named and left out. `--by-robot` shows for each camera of dev, for igvc_lawn and for gardens/dev whether
P(not grass) and P(person) mean what they say.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.labels import VOID_ID
from swardmap.models import bundled_network
from swardmap.models.network_io import decide
from swardmap.models.onnx import OnnxSegmenter
from swardmap.train.data import load_photos
from swardmap.train.light import SRGB_GAMMA, saturated, vignette
from swardmap.train.photos import Photo
from swardmap.train.recipe import recipe_from_dict
from swardmap.train.score import Score
from swardmap.types import Segmentation

FOREST = "ensta_1 ensta_10 ensta_11 ensta_12 ensta_ob3"
PATHS = "ensta_3 ensta_7 ensta_15 ensta_ob16"  # no grass is labelled there
CAMPUS = "ensta_2 ensta_6 ensta_8 ensta_14 ensta_ob7"
PICTURE = (240, 180)
COLUMNS = ("accuracy", "grass_iou", "obstacle_called_grass", "person_iou")

EDGES = np.array([0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.001])
EVENTS: dict[str, tuple[tuple[int, ...], bool]] = {"not grass": ((1,), False), "person": ((2,), True)}
"""Classes, and whether it is one of them or none."""

Image = NDArray[np.uint8]
Camera = Callable[[Image], Image]


@dataclass(frozen=True)
class EvaluationSet:
    """Labelled photos that are never learnt from.

    Attributes:
        name: in the table.
        entry: as in a recipe's `data`.
        stems: the photos it is limited to; empty = all.
        camera: what another camera makes of the photos; none = as they are.
    """

    name: str
    entry: dict[str, Any]
    stems: frozenset[str] = field(default_factory=frozenset)
    camera: Camera | None = None


def through_camera(
    gains: tuple[float, float, float], saturation: float = 1.0, corners: float = 0.0
) -> Camera:
    """A camera with gains of linear light (red, green, blue) and this share of it lost in the corners."""

    def see(image: Image) -> Image:
        linear = (image / np.float32(255)) ** np.float32(SRGB_GAMMA) * np.array(gains, np.float32)
        linear *= vignette(image.shape[:2], corners)[..., None]
        seen = np.clip(linear, 0, 1) ** np.float32(1 / SRGB_GAMMA) * 255
        return saturated(np.rint(seen).astype(np.uint8), saturation)

    return see


IGVC = {"folder": "igvc_lawn", "list": "held.txt"}
DEV = {"folder": "robot_lawns", "list": "dev.txt"}
HELD = {"folder": "msrc_v2", "list": "train.txt", "hold_out": 9, "validation": True}
SETS = (
    EvaluationSet("dev: all robots", DEV),
    EvaluationSet("dev: campus, shade", DEV, frozenset(f"{CAMPUS} {PATHS}".split())),
    EvaluationSet("dev: forest and paths", DEV, frozenset(f"{FOREST} {PATHS}".split())),
    EvaluationSet("dev: 2.5 stops darker", DEV, camera=through_camera((0.18, 0.18, 0.18))),
    EvaluationSet("dev: darker and bluish", DEV, camera=through_camera((0.25, 0.4, 0.65))),
    EvaluationSet("dev: yellowish", DEV, camera=through_camera((1.5, 1.0, 0.5))),
    EvaluationSet("dev: nearly grey, vignette", DEV, camera=through_camera((0.7, 0.7, 0.7), 0.2, 0.8)),
    EvaluationSet("igvc_lawn, held out by time", IGVC),
    EvaluationSet("MSRC, 46 held out", HELD),
    EvaluationSet("MSRC, val.txt", {"folder": "msrc_v2", "list": "val.txt"}),
    EvaluationSet("gardens/dev", {"folder": "gardens/dev", "kind": "recording"}),
    EvaluationSet("gardens/test", {"folder": "gardens/test", "kind": "recording"}),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("networks", nargs="+", help=".onnx files, or auto (the one in the package)")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--only", default="", help="sets whose name has one of these in it, with commas")
    parser.add_argument(
        "--bias", default="0", help="also with these added to the logit of grass, with commas"
    )
    parser.add_argument("--person-bias", default="0", help="and each with these, added to that of persons")
    parser.add_argument(
        "--by-robot", action="store_true", help="reliability of P(not grass) and P(person) by camera"
    )
    parser.add_argument("--pictures", type=Path, help="write photo and masks side by side here, of --stems")
    parser.add_argument("--stems", default="", help="names of dev's or igvc_lawn's photos, with commas")
    arguments = parser.parse_args()
    paths = [bundled_network() if n == "auto" else Path(n) for n in arguments.networks]
    if None in paths:
        raise SystemExit("this package holds no network")
    segmenters = [OnnxSegmenter(path) for path in paths if path is not None]
    grass, persons = ([float(b) for b in text.split(",")] for text in (arguments.bias, arguments.person_bias))
    biases = list(product(grass, persons))
    if arguments.by_robot:
        show_by_robot(arguments.networks, segmenters, arguments.data)
        return
    if arguments.pictures is not None:
        write_pictures(arguments.pictures, segmenters, arguments.stems.split(","), arguments.data)
        return
    print(f"set | photos | network | bias | {' | '.join(COLUMNS)}")
    for evaluation in SETS:
        if not any(part in evaluation.name for part in arguments.only.split(",")):
            continue
        try:
            photos = read_set(evaluation, arguments.data)
        except InputError as error:
            print(f"{evaluation.name}: left out, {error}")
            continue
        for name, segmenter in zip(arguments.networks, segmenters, strict=True):
            for (bias, of_person), score in zip(biases, scores(segmenter, photos, biases), strict=True):
                figures = (score.figures()[key] for key in COLUMNS)
                shown = " | ".join("-" if v is None else f"{100 * v:.1f}" for v in figures)
                moved = f"{bias:g}" + (f", person {of_person:g}" if of_person else "")
                print(
                    f"{evaluation.name} | {len(photos)} | {Path(name).stem} | {moved} | {shown}", flush=True
                )


def read_set(evaluation: EvaluationSet, root: Path) -> list[Photo]:
    """Its photos at their own size, however they are held out."""
    entry = {"name": evaluation.name, "validation": True, **evaluation.entry}
    learnt = {**entry, "validation": False}  # a recipe must have something to learn from; it is not read
    recipe = recipe_from_dict({"name": "score", "data": [learnt, entry]})
    photos = load_photos(recipe, root, validation=True)[0].photos
    photos = [p for p in photos if not evaluation.stems or p.stem in evaluation.stems]
    if evaluation.camera is None:
        return photos
    return [replace(p, image=evaluation.camera(p.image)) for p in photos]


def scores(
    segmenter: OnnxSegmenter, photos: Sequence[Photo], biases: Sequence[tuple[float, float]]
) -> list[Score]:
    """One score for each bias of grass and persons."""
    spec = segmenter.spec
    found = [Score.empty(spec.channel_ids, spec.label_set) for _ in biases]
    for photo, logits in each_logits(segmenter, photos):
        for index, both in enumerate(biases):
            shifted = logits.copy()
            for class_id, bias in enumerate(both, 1):
                shifted[:, spec.channel_ids.index(class_id)] += np.float32(bias)
            mask = Segmentation(decide(shifted, spec)[0], spec.label_set)
            found[index] = found[index].plus(photo.codes, mask.resized_to(*photo.codes.shape).labels)
    return found


def each_logits(
    segmenter: OnnxSegmenter, photos: Sequence[Photo]
) -> Iterator[tuple[Photo, NDArray[np.float32]]]:
    """Every photo with the network's logits (1, C, h, w)."""
    for photo in photos:
        yield photo, segmenter.logits(photo.image)


def write_pictures(out: Path, segmenters: Sequence[OnnxSegmenter], stems: Sequence[str], root: Path) -> None:
    """A row for each photo: the photo, and what each network says of it."""
    photos = {p.stem: p for s in SETS if s.entry in (DEV, IGVC) for p in read_set(s, root) if not s.camera}
    rows = []
    for photo in (photos[stem] for stem in stems):
        small = np.asarray(cv2.resize(photo.image, PICTURE, interpolation=cv2.INTER_AREA), np.uint8)
        cells = [small]
        for segmenter in segmenters:
            mask = Segmentation(segmenter.segment(photo.image)[0], segmenter.label_set)
            colors = segmenter.label_set.color_table[mask.resized_to(*PICTURE[::-1]).labels]
            cells.append(np.asarray(cv2.addWeighted(small, 0.5, colors, 0.5, 0), np.uint8))
        rows.append(np.hstack(cells))
    cv2.imwrite(str(out), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])


def show_by_robot(names: Sequence[str], segmenters: Sequence[OnnxSegmenter], root: Path) -> None:
    """Reliability of each network for the photos of each camera."""
    for name, segmenter in zip(names, segmenters, strict=True):
        for robot, photos in by_robot(root):
            show_reliability(f"{Path(name).stem} | {robot}", segmenter, photos)


def by_robot(root: Path) -> Iterator[tuple[str, list[Photo]]]:
    """The photos of each camera of dev, and of the other two sets that confidence was fitted on."""
    dev = read_set(SETS[0], root)
    for robot in sorted({_camera_of(p) for p in dev}):
        yield robot, [p for p in dev if _camera_of(p) == robot]
    for evaluation in SETS:
        if evaluation.name.startswith("igvc") or evaluation.name == "gardens/dev":
            yield evaluation.name, read_set(evaluation, root)


def _camera_of(photo: Photo) -> str:
    return photo.stem.rstrip("0123456789").split("_")[0]


def show_reliability(name: str, segmenter: OnnxSegmenter, photos: Sequence[Photo]) -> None:
    """Of the pixels with a probability in each range: the mean of it, and the share that is so."""
    sums = {event: np.zeros((len(EDGES) - 1, 3)) for event in EVENTS}
    for photo, logits in each_logits(segmenter, photos):
        for event, (classes, holds) in EVENTS.items():
            probability, truth = (
                _probability(logits, segmenter, photo, classes),
                np.isin(photo.codes, classes),
            )
            known = photo.codes != VOID_ID
            p, t = (probability, truth) if holds else (1 - probability, ~truth)
            index = np.digitize(p[known], EDGES) - 1
            columns = (None, p[known], t[known].astype(np.float64))
            sums[event] += np.stack(
                [np.bincount(index, weights=w, minlength=len(EDGES) - 1) for w in columns], 1
            )
    for event, rows in sums.items():
        cells = (
            f"{low:.1f}-{min(high, 1.0):.1f}: " + (f"{p / n:.2f} {t / n:.2f}" if n else "-")
            for low, high, (n, p, t) in zip(EDGES, EDGES[1:], rows, strict=False)
        )
        error = np.abs(rows[:, 1] - rows[:, 2]).sum() / rows[:, 0].sum()
        print(f"{name} | {event} | error {error:.4f} | {' | '.join(cells)}", flush=True)


def _probability(
    logits: NDArray[np.float32], segmenter: OnnxSegmenter, photo: Photo, classes: Sequence[int]
) -> NDArray[np.float64]:
    """(H, W) P of one of these classes at the size of the photo's mask."""
    spec = segmenter.spec
    scaled = logits[0] / spec.temperature
    exponents = np.exp(scaled - scaled.max(0))
    share = sum(exponents[spec.channel_ids.index(c)] for c in classes) / exponents.sum(0)
    mask = Segmentation(np.zeros(share.shape, np.uint8), spec.label_set, share.astype(np.float32))
    resized = mask.resized_to(*photo.codes.shape).confidence
    assert resized is not None
    return resized.astype(np.float64)


if __name__ == "__main__":
    main()
