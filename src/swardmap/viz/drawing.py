"""What pictures are made of: text, legends, bars, images fitted into boxes. Colours are RGB throughout."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Color = tuple[int, int, int]
Box = tuple[int, int, int, int]
"""x, y, width, height in pixels."""

PAPER: Color = (253, 253, 251)
INK: Color = (40, 42, 46)
MUTED: Color = (112, 114, 118)
LINE: Color = (205, 205, 200)

Swatches = Sequence[tuple[str, Color]]


def blank(width: int, height: int) -> Picture:
    """An empty sheet."""
    return np.full((height, width, 3), PAPER, np.uint8)


def write(
    picture: Picture,
    words: str,
    x: int,
    baseline: int,
    size: int = 15,
    color: Color = INK,
    weight: int = 400,
    align: Literal["left", "right", "center"] = "left",
) -> None:
    """Write one line of text, in OpenCV 5's outline font, or its stroke font in older versions."""
    shift = {"left": 0.0, "right": 1.0, "center": 0.5}[align]
    x -= round(shift * text_width(words, size, weight))
    font = _font()
    if font is None:
        scale, strokes = _stroke(size, weight)
        plain = words.encode("ascii", "replace").decode()
        cv2.putText(
            picture, plain, (x, baseline), cv2.FONT_HERSHEY_SIMPLEX, scale, color, strokes, cv2.LINE_AA
        )
    else:
        _cv2().putText(picture, words, (x, baseline), color, font, size, weight)


@lru_cache(maxsize=512)
def text_width(words: str, size: int = 15, weight: int = 400) -> int:
    """Width of a line of text in pixels."""
    font = _font()
    if font is None:
        scale, strokes = _stroke(size, weight)
        plain = words.encode("ascii", "replace").decode()
        return int(cv2.getTextSize(plain, cv2.FONT_HERSHEY_SIMPLEX, scale, strokes)[0][0])
    x, _, width, _ = _cv2().getTextSize((1, 1), words, (0, 0), font, size, weight)
    return int(x + width)


def legend(picture: Picture, entries: Swatches, right: int, baseline: int, size: int = 14) -> int:
    """Coloured squares with their names, ending at `right`. Returns where they start."""
    x = right
    for words, color in reversed(entries):
        x -= text_width(words, size)
        write(picture, words, x, baseline, size, MUTED)
        x -= 18
        cv2.rectangle(picture, (x, baseline - 10), (x + 11, baseline + 1), color, cv2.FILLED)
        cv2.rectangle(picture, (x, baseline - 10), (x + 11, baseline + 1), LINE, 1)
        x -= 16
    return x


def color_bar(picture: Picture, ramp: Picture, low: str, high: str, right: int, baseline: int) -> int:
    """A horizontal colour ramp (N, 3) between two numbers, ending at `right`. Returns where it starts."""
    x = right - text_width(high, 14)
    write(picture, high, x, baseline, 14, MUTED)
    x -= 108
    strip = cv2.resize(ramp[None], (100, 12), interpolation=cv2.INTER_LINEAR)
    picture[baseline - 10 : baseline + 2, x : x + 100] = strip
    x -= 8 + text_width(low, 14)
    write(picture, low, x, baseline, 14, MUTED)
    return x - 16


def fitted(size: tuple[int, int], box: Box) -> Box:
    """The largest box of the proportions of `size` (width, height), centred in `box`."""
    x, y, width, height = box
    scale = min(width / size[0], height / size[1])
    w, h = max(1, round(size[0] * scale)), max(1, round(size[1] * scale))
    return x + (width - w) // 2, y + (height - h) // 2, w, h


def paste(picture: Picture, image: Picture, box: Box) -> None:
    """Fit an image into a box, keeping its proportions."""
    x, y, width, height = fitted((image.shape[1], image.shape[0]), box)
    shrinks = width < image.shape[1]
    how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    picture[y : y + height, x : x + width] = cv2.resize(image, (width, height), interpolation=how)


def frame_box(picture: Picture, box: Box) -> None:
    """A thin line around a box."""
    x, y, width, height = box
    cv2.rectangle(picture, (x - 1, y - 1), (x + width, y + height), LINE, 1)


def blend(under: Picture, over: Picture, opacity: NDArray[np.float32] | float) -> Picture:
    """Two pictures mixed, `opacity` (scalar or (H, W)) of the upper."""
    share = np.asarray(opacity, np.float32)[..., None]
    mixed = under.astype(np.float32) * (1 - share) + over.astype(np.float32) * share
    return (mixed + 0.5).astype(np.uint8)


def _cv2() -> Any:
    """OpenCV without types: older versions lack what version 5 has."""
    return cv2


@lru_cache(maxsize=1)
def _font() -> Any:
    face = getattr(cv2, "FontFace", None)
    return face("sans") if face is not None else None


def _stroke(size: int, weight: int) -> tuple[float, int]:
    """Scale and thickness of the stroke font that come near a size in pixels and a weight."""
    return size / 30, 2 if weight >= 600 else 1
