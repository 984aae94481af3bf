"""Colour-index segmentation: excess green with an adaptive threshold, the baseline without weights.

The approach of the paper's reference [32]: vegetation is where green outweighs red and blue in
chromaticity, ExG = 2g - r - b with r + g + b = 1, and Otsu's method finds the threshold in each frame.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import SegmenterConfig
from swardmap.labels import GRASS, GRASS_OBSTACLE, OTHER, LabelSet
from swardmap.types import Frame, Segmentation

LOWEST_THRESHOLD = 0.08  # of ExG; both chosen on MSRC v2's training photos
HIGHEST_THRESHOLD = 0.18
DARKEST_SUM = 48  # of R + G + B; below it chromaticity is noise
GREEN_SCALE = 510.0  # g = 0.5 (ExG = 0.5) fills a byte; nothing that grows is greener


@dataclass(frozen=True, slots=True)
class ColourSegmenter:
    """Grass where the excess green is above the frame's threshold; everything else is other.

    Otsu's threshold always splits a frame in two, grass or no grass. It is therefore held between
    two fixed bounds: a frame of paving stays below the lower one, a frame of lawn above the upper one.

    Attributes:
        label_set: other, grass.
        name: `colour`.
    """

    label_set: LabelSet = GRASS_OBSTACLE
    name: str = "colour"

    def __call__(self, frame: Frame) -> Segmentation:
        """Classes of the frame, at its own size; there is no confidence."""
        import cv2

        green, dark = green_chromaticity(frame.rgb)
        threshold = grass_threshold(green[~dark] if dark.any() else green)
        grass = (green > threshold) & ~dark
        grass_u8 = cv2.medianBlur(grass.view(np.uint8), 5)  # single blades and sensor noise
        labels = np.where(grass_u8, np.uint8(GRASS.id), np.uint8(OTHER.id))
        return Segmentation(labels, self.label_set)


def green_chromaticity(rgb: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Green share of each pixel; ExG = 2g - r - b = 3g - 1 is a straight line of it.

    Args:
        rgb: (H, W, 3) uint8.

    Returns:
        (H, W) uint8, g * 510 saturated at g = 0.5, and (H, W) bool, true where the pixel is too dark
        to have a colour.
    """
    import cv2

    red, green, blue = cv2.split(rgb)
    total = cv2.add(cv2.add(red, blue, dtype=cv2.CV_32F), green, dtype=cv2.CV_32F)
    share = cv2.divide(green, total, scale=GREEN_SCALE, dtype=cv2.CV_8U)  # saturates; x / 0 = 0
    return np.asarray(share, np.uint8), np.asarray(total) < DARKEST_SUM


def grass_threshold(green: NDArray[np.uint8]) -> float:
    """Otsu's threshold of the frame, held between the two fixed bounds.

    Args:
        green: any shape, as `green_chromaticity` gives it.

    Returns:
        Threshold on the same scale: a pixel above it is grass.
    """
    import cv2

    low, high = (GREEN_SCALE * (1 + excess) / 3 for excess in (LOWEST_THRESHOLD, HIGHEST_THRESHOLD))
    if green.size == 0:
        return high
    otsu, _ = cv2.threshold(green.reshape(1, -1), 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return float(np.clip(otsu, low, high))


def open_segmenter(config: SegmenterConfig, source_label_set: LabelSet | None) -> ColourSegmenter:  # noqa: ARG001
    """The baseline needs neither settings nor labels."""
    return ColourSegmenter()
