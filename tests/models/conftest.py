"""Frames that the tests of the segmenters make themselves."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.geometry import Intrinsics
from swardmap.labels import GRASS, GRASS_OBSTACLE, OTHER, LabelSet
from swardmap.types import Frame


def make_frame(
    rgb: NDArray[np.uint8], labels: NDArray[np.uint8] | None = None, label_set: LabelSet | None = None
) -> Frame:
    height, width = rgb.shape[:2]
    intrinsics = Intrinsics(width, height, 500.0, 500.0, width / 2, height / 2)
    depth = np.full((height, width), 1500, np.uint16)
    return Frame(0, intrinsics, rgb, depth, labels=labels, label_set=label_set, name="made")


def make_lawn(height: int = 240, width: int = 320, seed: int = 0) -> Frame:
    """Sky above, lawn below, a grey box on the lawn."""
    rng = np.random.default_rng(seed)
    color = np.empty((height, width, 3))
    labels = np.full((height, width), OTHER.id, np.uint8)
    horizon = height // 3
    color[:horizon] = (150, 180, 220)
    color[horizon:] = (86, 130, 52)
    labels[horizon:] = GRASS.id
    box = (slice(height // 2, 3 * height // 4), slice(width // 3, width // 2))
    color[box] = (130, 125, 120)
    labels[box] = OTHER.id
    rgb = np.clip(color + rng.normal(0, 8, color.shape), 0, 255).astype(np.uint8)
    return make_frame(rgb, labels, GRASS_OBSTACLE)


@pytest.fixture(scope="session")
def frame_of() -> Callable[..., Frame]:
    return make_frame


@pytest.fixture(scope="session")
def lawn_frame() -> Callable[..., Frame]:
    return make_lawn
