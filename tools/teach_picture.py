"""The picture of docs/tasks/teach.md: lawns as filmed, and what is clear of doubt before and after teaching.

    python tools/teach_picture.py docs/images/teach-before-after.jpg CASE:FRAME ...

Cases are folders of `benchmarks/bench_teach.py`, frames those of the other way. What the network is so sure
of that it clears a cell is green; grass of which it is less sure has no colour; other blue, a person orange.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.io import open_source
from swardmap.io.files import write_bytes
from swardmap.io.images import encode_jpeg
from swardmap.labels import MapClass
from swardmap.models import bundled_network
from swardmap.models.network_io import segmentation_of
from swardmap.models.onnx import OnnxSegmenter
from swardmap.teach.faults import CLEARS_255

COLOURS = {MapClass.GRASS: (60, 190, 60), MapClass.OBSTACLE: (60, 100, 190), MapClass.PERSON: (255, 165, 0)}
SIZE = (300, 225)


def shown(network: OnnxSegmenter, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An image with what a network says of it."""
    found = segmentation_of(network.logits(rgb), network.spec).resized_to(*rgb.shape[:2])
    picture = rgb.astype(np.float32)
    for map_class, colour in COLOURS.items():
        there = found.map_classes == map_class
        if map_class == MapClass.GRASS:
            there &= found.hazard_255 <= CLEARS_255
        picture[there] = 0.5 * picture[there] + 0.5 * np.array(colour, np.float32)
    return np.asarray(picture, np.uint8)


def main() -> None:
    """One row for each case."""
    out, *cases = sys.argv[1:]
    before, rows = bundled_network(), []
    if before is None:
        raise SystemExit("the package holds no network")
    for case in cases:
        folder, _, frame = case.partition(":")
        recording = next((Path(folder) / "other" / "folder").glob("*/*"))
        rgb = list(open_source(recording))[int(frame or 0)].rgb
        networks = [OnnxSegmenter(path, 1) for path in (before, Path(folder) / "taught.onnx")]
        row = [rgb, *(shown(network, rgb) for network in networks)]
        rows.append(np.hstack([cv2.resize(p, SIZE, interpolation=cv2.INTER_AREA) for p in row]))
    write_bytes(Path(out), encode_jpeg(np.asarray(np.vstack(rows), np.uint8), 85))


if __name__ == "__main__":
    main()
