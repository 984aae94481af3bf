"""Gardens in the light of the drive: scaled so that their lawns have the colour of the driven ground.

A network that is taught a bluish lawn would call a bluish bed lawn, too, and the drive need not show one.
The gardens with exact labels have beds, paths, things and persons: in that light they say what is none.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.io.files import write_bytes
from swardmap.io.images import encode_jpeg, read_color, read_mask
from swardmap.labels import GRASS
from swardmap.teach.safety import SafetyFrame

FEWEST_PIXELS, FEWEST_DRIVEN = 200, 50
"""Of a garden's lawn, and of driven ground, of which few pixels of each cell are left, to say its colour."""
MOST_GAIN = 6.0
"""Of a channel of linear light, or of its inverse: beyond it little but noise is seen."""

Image = NDArray[np.uint8]
Bools = NDArray[np.bool_]
Float64 = NDArray[np.float64]


def driven_colours(folder: Path) -> Float64:
    """Mean colours of the driven ground in the frames that are learnt from.

    Args:
        folder: with images and labels, as `write_labels` leaves it.

    Returns:
        (N, 3) linear RGB, one for each frame that shows enough of it.
    """
    found = []
    for image in sorted((folder / "images").glob("*.jpg")):
        driven = read_mask(folder / "labels" / f"{image.stem}.png") == GRASS.id
        if np.count_nonzero(driven) >= FEWEST_DRIVEN:
            found.append(_mean_colour(read_color(image), driven))
    return np.array(found).reshape(-1, 3)


def lit(images: Sequence[tuple[Image, Bools]], colours: Float64) -> Iterator[Image]:
    """Images in other light: each as if its lawn had one of the colours, in turn.

    Args:
        images: (H, W, 3) RGB, and (H, W) what of it is lawn; one with hardly any is lit as the mean of all.
        colours: (N, 3) linear RGB; without one, or without any lawn, no image comes.
    """
    lawns = [_mean_colour(rgb, lawn) if lawn.sum() >= FEWEST_PIXELS else None for rgb, lawn in images]
    known = [lawn for lawn in lawns if lawn is not None]
    if not known or not len(colours):
        return
    usual = np.mean(known, axis=0)
    for number, ((rgb, _), lawn) in enumerate(zip(images, lawns, strict=True)):
        wanted = colours[number % len(colours)]
        gains = wanted / np.maximum(usual if lawn is None else lawn, 1e-4)
        yield _srgb(_linear(rgb) * np.clip(gains, 1 / MOST_GAIN, MOST_GAIN))


def write_lit(source: Path, out: Path, colours: Float64) -> None:
    """Write a folder of images and labels in another light; labels are as they were.

    Args:
        source: with images and labels.
        out: folder; what is there is written over.
        colours: (N, 3) linear RGB.
    """
    paths = sorted((source / "images").iterdir())
    masks = [source / "labels" / f"{path.stem}.png" for path in paths]
    images = [(read_color(p), read_mask(m) == GRASS.id) for p, m in zip(paths, masks, strict=True)]
    for part in ("images", "labels"):
        (out / part).mkdir(parents=True, exist_ok=True)
    for path, mask, rgb in zip(paths, masks, lit(images, colours), strict=False):
        write_bytes(out / "images" / f"{path.stem}.jpg", encode_jpeg(rgb), durable=False)
        write_bytes(out / "labels" / mask.name, mask.read_bytes(), durable=False)


def lit_frames(frames: Iterable[SafetyFrame], colours: Float64) -> Iterator[SafetyFrame]:
    """Frames of the safety set in another light; none without a colour."""
    if len(colours):
        kept = list(frames)
        images = [(frame.rgb, frame.labels == GRASS.id) for frame in kept]
        for frame, rgb in zip(kept, lit(images, colours), strict=False):
            yield replace(frame, rgb=rgb)


def _mean_colour(rgb: Image, chosen: Bools) -> Float64:
    return np.asarray(_linear(rgb[chosen]).mean(0), np.float64)


def _linear(rgb: Image) -> NDArray[np.float32]:
    """Linear light of sRGB (IEC 61966-2-1)."""
    c = np.arange(256) / 255
    table = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4).astype(np.float32)
    return table[rgb]


def _srgb(light: NDArray[np.floating]) -> Image:
    c = np.clip(light, 0, 1)
    curve = np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * curve), np.uint8)
