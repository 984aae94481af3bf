import time
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.labels import GRASS, OTHER, VOID_ID
from swardmap.models.colour import GREEN_SCALE, ColourSegmenter, grass_threshold, green_chromaticity
from swardmap.types import Frame

MakeFrame = Callable[..., Frame]

LAWN = (86, 130, 52)
PAVING = (140, 138, 132)


def plain(color: tuple[int, int, int], noise: int = 6) -> NDArray[np.uint8]:
    rng = np.random.default_rng(3)
    return np.clip(np.array(color) + rng.integers(-noise, noise + 1, (120, 160, 3)), 0, 255).astype(np.uint8)


def test_lawn_and_box_are_told_apart(lawn_frame: MakeFrame) -> None:
    frame = lawn_frame()
    assert frame.labels is not None
    labels = ColourSegmenter()(frame).labels
    assert (labels == frame.labels).mean() > 0.98


@pytest.mark.parametrize(
    ("color", "expected"),
    [
        (LAWN, GRASS.id),
        (PAVING, OTHER.id),
        ((120, 140, 190), OTHER.id),
        ((2, 5, 2), OTHER.id),
        ((0, 0, 0), OTHER.id),
    ],
    ids=["only lawn", "only paving", "only sky", "too dark", "black"],
)
def test_frames_of_one_kind_are_not_split(
    frame_of: MakeFrame, color: tuple[int, int, int], expected: int
) -> None:
    labels = ColourSegmenter()(frame_of(plain(color, 2))).labels
    assert (labels == expected).mean() > 0.99


@pytest.mark.parametrize("gain", [0.4, 0.7, 1.3])
def test_brightness_changes_nothing(frame_of: MakeFrame, lawn_frame: MakeFrame, gain: float) -> None:
    frame = lawn_frame()
    darker = frame_of(np.clip(frame.rgb * gain, 0, 255).astype(np.uint8))
    same = ColourSegmenter()(darker).labels == ColourSegmenter()(frame).labels
    assert same.mean() > 0.98


def test_green_chromaticity_is_the_formula() -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (40, 50, 3), np.uint8)
    green, dark = green_chromaticity(rgb)
    total = rgb.sum(2, dtype=np.float64)
    expected = np.clip(GREEN_SCALE * rgb[..., 1] / np.maximum(total, 1), 0, 255)
    assert np.abs(green - expected).max() <= 0.5 + 1e-4
    np.testing.assert_array_equal(dark, total < 48)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 40))
def test_any_image_gives_only_declared_classes(
    frame_of: MakeFrame, seed: int, height: int, width: int
) -> None:
    rgb = np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)
    segmenter = ColourSegmenter()
    labels = segmenter(frame_of(rgb)).labels
    assert labels.shape == (height, width)
    assert set(np.unique(labels)) <= {c.id for c in segmenter.label_set.classes} - {VOID_ID}


def test_threshold_of_an_empty_frame_is_the_safe_one() -> None:
    frame = np.repeat(np.array([180, 255], np.uint8), 50)  # Otsu's threshold would be between
    assert grass_threshold(np.empty(0, np.uint8)) >= grass_threshold(frame) > 180


def test_a_vga_frame_is_fast(frame_of: MakeFrame) -> None:
    frame = frame_of(np.random.default_rng(1).integers(0, 256, (480, 640, 3), np.uint8))
    segmenter = ColourSegmenter()
    times = []
    for _ in range(15):
        start = time.perf_counter()
        segmenter(frame)
        times.append(time.perf_counter() - start)
    assert min(times) < 0.05  # 2 ms on a free core; this only catches a mistake of an order of magnitude
