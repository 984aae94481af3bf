"""Which images a network file calls unfamiliar: known ones, spoilt ones, and those of other places.

    python benchmarks/score_unknown.py lawn.onnx --data ~/training
    python benchmarks/score_unknown.py lawn.onnx --data ~/training --also ~/rooms --every 3

The data root is that of the recipes (tools/training_root.py makes it). First the sets of score_networks.py,
none of which is learnt from, with the share called unfamiliar and the largest score (1 is the limit); then
the same photos spoilt in each way (swardmap.train.unknown, another seed than at export) and upside down;
then folders of images of other places (--also).
"""

import argparse
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from score_networks import SETS, read_set

import swardmap
from swardmap.errors import InputError
from swardmap.geometry import Intrinsics
from swardmap.models.onnx import OnnxSegmenter
from swardmap.train.unknown import KINDS
from swardmap.types import Frame

Image = NDArray[np.uint8]
DEMO = Path(swardmap.__file__).parent / "data" / "demo" / "rgb"
SUFFIXES = (".png", ".jpg", ".jpeg")
SEED = 77


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("network", type=Path, help=".onnx file with a score")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--also", type=Path, action="append", default=[], help="folder of colour images")
    parser.add_argument("--every", type=int, default=1, help="only every n-th photo of each set")
    arguments = parser.parse_args()
    segmenter = OnnxSegmenter(arguments.network)
    if segmenter.spec.unfamiliar_limit is None:
        raise SystemExit(f"{arguments.network}: holds no score; teach it with swardmap export --recipe")
    known: list[Image] = []
    print("known images | images | called unfamiliar, % | largest score")
    for evaluation in SETS:
        try:
            images = [p.image for p in read_set(evaluation, arguments.data)][:: arguments.every]
        except InputError as error:
            print(f"{evaluation.name}: left out, {error}")
            continue
        show(evaluation.name, images, segmenter)
        known += images if evaluation.camera is None and not evaluation.stems else []
    drive = read_folder(DEMO)[:: arguments.every]
    show("the drive in the package", drive, segmenter)
    print("spoilt images | images | called unfamiliar, % | largest score")
    rng = np.random.default_rng(SEED)
    size = (segmenter.spec.width, segmenter.spec.height)
    small = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (*known, *drive)]
    for kind, spoil in KINDS.items():
        show(kind, (spoil(np.asarray(image, np.uint8), rng) for image in small[::3]), segmenter)
    show("upside down", (np.ascontiguousarray(image[::-1, ::-1]) for image in small[::3]), segmenter)
    for folder in arguments.also:
        show(str(folder), read_folder(folder), segmenter)


def show(name: str, images: Iterable[Image], segmenter: OnnxSegmenter) -> None:
    """One row: how many, how many beyond the limit, and how far the farthest."""
    scores = np.array([segmenter(frame_of(image)).unfamiliar for image in images], np.float64)
    if len(scores):
        print(f"{name} | {len(scores)} | {100 * np.mean(scores > 1):.1f} | {scores.max():.3g}", flush=True)


def frame_of(image: Image) -> Frame:
    """A frame of the image alone."""
    height, width = image.shape[:2]
    intrinsics = Intrinsics(width, height, float(width), float(width), width / 2, height / 2)
    return Frame(0, intrinsics, np.ascontiguousarray(image), np.zeros((height, width), np.uint16))


def read_folder(folder: Path) -> list[Image]:
    """Colour images of a folder by name; depth beside them is left out."""
    paths = sorted(p for p in folder.iterdir() if p.suffix in SUFFIXES and "depth" not in p.name)
    return [np.asarray(cv2.cvtColor(cv2.imread(str(p)), cv2.COLOR_BGR2RGB), np.uint8) for p in paths]


if __name__ == "__main__":
    main()
