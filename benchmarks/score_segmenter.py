"""Score a network file, or the colour baseline, on labelled photos: figures, reliability, worst photos.

    python benchmarks/score_segmenter.py auto --data ~/photos/msrc_v2 --list val.txt
    python benchmarks/score_segmenter.py auto --data ~/photos/gardens/test --recording --borders
    python benchmarks/score_segmenter.py auto --covered

The folder holds images/ and labels/ (0 other, 1 grass, 2 person, 255 void), or with --recording it is
anything that `swardmap map` reads and that has true labels, such as the gardens of `swardmap synth`, which
are also scored by the light they are in. These are the figures of the model card (docs/models.md).
"""

import argparse
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from swardmap.labels import GRASS_OBSTACLE_PERSON, VOID_ID
from swardmap.models import bundled_network
from swardmap.models.colour import grass_threshold, green_chromaticity
from swardmap.models.onnx import OnnxSegmenter
from swardmap.train.classes import classes_text
from swardmap.train.data import load_photos
from swardmap.train.evaluate import Evaluation, evaluate_network
from swardmap.train.photos import Photo
from swardmap.train.recipe import recipe_from_dict
from swardmap.train.score import Score


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("segmenter", help="an .onnx file, auto (the one in the package), or colour")
    parser.add_argument("--data", type=Path)
    parser.add_argument("--list", help="text file in the folder with one stem a line")
    parser.add_argument("--every", type=int, default=1, help="use every n-th photo")
    parser.add_argument(
        "--hold-out", type=int, default=0, help="those that a recipe with hold_out: N holds out"
    )
    parser.add_argument("--recording", action="store_true", help="the folder is a recording with true labels")
    parser.add_argument("--worst", type=int, default=0, help="name the n photos with most wrong pixels")
    parser.add_argument("--borders", action="store_true", help="how much of what is wrong is at borders")
    parser.add_argument("--covered", action="store_true", help="only what it sees with a covered lens")
    arguments = parser.parse_args()
    if arguments.covered:
        show_covered(bundled_network() if arguments.segmenter == "auto" else Path(arguments.segmenter))
        return
    if arguments.data is None:
        parser.error("expected --data, or --covered")
    entry = {
        "name": "photos",
        "folder": arguments.data.name,
        "list": arguments.list,
        "every": arguments.every,
        "kind": "recording" if arguments.recording else "images",
        "hold_out": arguments.hold_out,
        "validation": True,
    }
    colour = arguments.segmenter == "colour"
    path = bundled_network() if arguments.segmenter in ("auto", "colour") else Path(arguments.segmenter)
    if path is None:
        raise SystemExit("this package holds no network")
    label_set = GRASS_OBSTACLE_PERSON if colour else OnnxSegmenter(path).label_set
    network = {"classes": classes_text(label_set)}
    recipe = {"name": "score", "network": network, "data": [{**entry, "validation": False}, entry]}
    photos = load_photos(recipe_from_dict(recipe), arguments.data.resolve().parent, validation=True)[0].photos
    if colour:
        show(_score_of_colour(photos), len(photos))
        return
    lights = {photo.light: [p for p in photos if p.light == photo.light] for photo in photos}
    by_light = {light: evaluate_network(path, some) for light, some in lights.items()}
    evaluation = together(by_light.values())
    show(evaluation.score, len(photos))
    if len(by_light) > 1:
        show_lights({light: part.score for light, part in by_light.items()})
    show_reliability(evaluation)
    if arguments.borders:
        show_borders(path, photos)
    if arguments.worst:
        show_worst(path, photos, arguments.worst)


def _score_of_colour(photos: list[Photo]) -> Score:
    score = Score.empty((0, 1, 2), GRASS_OBSTACLE_PERSON)
    for photo in photos:
        green, dark = green_chromaticity(photo.image)
        grass = (green > grass_threshold(green[~dark])) & ~dark
        score = score.plus(photo.codes, grass.astype(np.uint8))
    return score


def together(parts: Iterable[Evaluation]) -> Evaluation:
    """The figures of all parts."""
    first, *rest = parts
    for part in rest:
        score = replace(first.score, counts=first.score.counts + part.score.counts)
        first = Evaluation(score, first.bins + part.bins)
    return first


def show_lights(scores: dict[str, Score]) -> None:
    names = ("accuracy", "grass_iou", "person_iou", "person_f1", "obstacle_called_grass")
    print("  light       " + "".join(f"{name:>24}" for name in names))
    for light, score in scores.items():
        figures = score.figures()
        shares = ("-" if figures.get(n) is None else f"{100 * (figures[n] or 0.0):.2f} %" for n in names)
        print(f"  {light:12}" + "".join(f"{share:>24}" for share in shares))


def show(score: Score, count: int) -> None:
    print(f"{count} photos, {score.counts.sum()} labelled pixels")
    for name, value in score.figures().items():
        print(f"  {name:24} {'-' if value is None else f'{100 * value:.2f} %'}")
    names = {c.id: c.name for c in score.label_set.classes}
    print(f"  true \\ found  {'   '.join(names[i] for i in score.ids)}   void")
    for name, row in zip((names[i] for i in score.ids), score.counts, strict=True):
        print(f"  {name:12}" + "".join(f"{n:9d}" for n in row))


def show_reliability(evaluation: Evaluation) -> None:
    print("  confidence   pixels   mean confidence   right")
    for low, (count, confidence, right) in enumerate(evaluation.bins):
        if count:
            print(
                f"  {low / 10:.1f}-{low / 10 + 0.1:.1f} {count:12.0f}"
                f" {confidence / count:12.3f} {right / count:12.3f}"
            )
    print(f"  expected calibration error {evaluation.calibration_error:.4f}")


def show_borders(path: Path, photos: list[Photo]) -> None:
    """How much of what is wrong lies within one and two pixels of a pixel of another class."""
    segmenter = OnnxSegmenter(path)
    counts = {reach: np.zeros(2, np.int64) for reach in (0, 1, 2)}  # pixels, wrong ones; 0: all
    for photo in photos:
        labels = segmenter.segment(photo.image)[0]
        labels = np.asarray(cv2.resize(labels, photo.codes.shape[::-1], interpolation=cv2.INTER_NEAREST))
        known = photo.codes != VOID_ID
        for reach, count in counts.items():
            kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
            edge = cv2.dilate(photo.codes, kernel) != cv2.erode(photo.codes, kernel)
            near = known & edge if reach else known
            count += near.sum(), (near & (labels != photo.codes)).sum()
    for reach in (1, 2):
        pixels, wrong = 100 * counts[reach] / counts[0]
        print(
            f"  within {reach} px of another class: {pixels:.1f} % of all, {wrong:.0f} % of the wrong pixels"
        )


def show_covered(path: Path | None) -> None:
    if path is None:
        raise SystemExit("this package holds no network")
    segmenter, rng = OnnxSegmenter(path), np.random.default_rng(0)
    print("noise, size, mean, deviation: share called grass, with what mean confidence")
    for name, channels in (("coloured", 3), ("grey", 1)):
        for height, width in ((480, 640), (240, 320)):
            for mean, deviation in ((0, 4), (10, 5), (10, 12), (20, 12), (30, 20), (60, 30), (128, 25)):
                noise = np.clip(rng.normal(mean, deviation, (height, width, channels)), 0, 255)
                rgb = np.repeat(noise.astype(np.uint8), 3 // channels, axis=2)
                labels, confidence = segmenter.segment(rgb)
                grass = labels == 1
                sure = float(confidence[grass].mean()) if grass.any() else 0.0
                share = f"{100 * grass.mean():6.1f} %  {sure:.2f}"
                print(f"  {name:8} {width}x{height} {mean:4d} {deviation:3d} {share}")


def show_worst(path: Path, photos: list[Photo], count: int) -> None:
    scored = []
    for photo in photos:
        counts = evaluate_network(path, [photo]).score.counts
        known = (photo.codes != VOID_ID).sum()
        scored.append((int(counts.sum() - np.trace(counts)), int(known), photo.stem))
    for wrong, known, stem in sorted(scored, reverse=True)[:count]:
        print(f"  {stem}: {wrong} of {known} labelled pixels wrong")


if __name__ == "__main__":
    main()
