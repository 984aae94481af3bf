"""A tiny set of photos that the tests of the training make themselves."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

collect_ignore_glob: list[str] = []
try:
    import torch  # noqa: F401
except ImportError:  # the extra `train` is not installed
    collect_ignore_glob = ["test_*.py"]


def make_photo(seed: int, height: int = 72, width: int = 96) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A lawn with fine texture, smooth green boxes (no grass, though as green), a reddish person, sky."""
    rng = np.random.default_rng(seed)
    rgb = np.empty((height, width, 3))
    labels = np.zeros((height, width), np.uint8)
    horizon = int(rng.integers(height // 5, height // 3))
    rgb[:horizon] = (150, 180, 220)
    texture = rng.normal(0, 28, (height - horizon, width, 1))
    rgb[horizon:] = np.array([80, 125, 50]) * rng.uniform(0.7, 1.2) + texture
    labels[horizon:] = 1
    for color, class_id in (*[((84, 128, 54), 0)] * 4, ((205, 90, 60), 2)):
        y, x = int(rng.integers(horizon, height - 22)), int(rng.integers(0, width - 22))
        rgb[y : y + 20, x : x + 20] = color
        labels[y : y + 20, x : x + 20] = class_id
    noisy = rgb + rng.normal(0, 3, rgb.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8), labels


def write_photos(folder: Path, seeds: range) -> None:
    for sub in ("images", "labels"):
        (folder / sub).mkdir(parents=True, exist_ok=True)
    for seed in seeds:
        rgb, labels = make_photo(seed)
        cv2.imwrite(str(folder / "images" / f"{seed:03d}.png"), rgb[..., ::-1])
        cv2.imwrite(str(folder / "labels" / f"{seed:03d}.png"), labels)


@pytest.fixture(scope="session")
def data_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("data")
    write_photos(root / "made", range(24))
    write_photos(root / "held", range(100, 108))
    return root


@pytest.fixture(scope="session")
def tiny_recipe() -> Callable[..., dict[str, Any]]:
    def make(steps: int = 4, **network: object) -> dict[str, Any]:
        return {
            "name": "tiny",
            "network": {
                "encoder": "efficientnet-lite0",
                "decoder_channels": 16,
                "rates": [1, 2, 3],
                "width": 96,
                "height": 64,
                "imagenet": False,
                **network,
            },
            "schedule": {
                "steps": steps,
                "batch": 4,
                "crop": 64,
                "warmup": 2,
                "check_every": 2,
                "averaging": 0.9,
                "encoder_rate": 2e-3,
                "decoder_rate": 2e-3,
                "precision": "fp32",
            },
            "data": [
                {"name": "made", "folder": "made"},
                {"name": "held", "folder": "held", "validation": True},
            ],
        }

    return make
