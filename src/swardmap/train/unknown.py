"""What a camera shows that sees its scene badly or not at all: covered, dirty, wet, fogged, dazzled, dark.

Made from photos, so that a network file can learn what it does not know (familiar.py).
Lengths are shares of the width. NumPy and OpenCV only; chance comes from the generator.
"""

from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.train.light import SRGB_GAMMA

Image = NDArray[np.uint8]
Float32Array = NDArray[np.float32]

LENS_COVERS = ((12, 10, 10), (90, 60, 45), (60, 80, 35), (128, 128, 128), (200, 190, 180), (35, 30, 25))
LEAVES = ((70, 95, 30), (110, 80, 35), (40, 55, 20), (150, 120, 50))
SOILS = ((60, 45, 30), (85, 65, 45), (40, 32, 25))


def covered(image: Image, rng: np.random.Generator) -> Image:
    """A hand, a cap or cloth on the lens: one colour, a soft gradient, and noise."""
    height, width = image.shape[:2]
    colour = _one_of(LENS_COVERS, rng) + rng.normal(0, 6, 3)
    slope = np.linspace(-1, 1, height)[:, None] * rng.normal(0, 12)
    slope = slope + np.linspace(-1, 1, width) * rng.normal(0, 12)
    return _noisy(colour + slope[..., None], float(rng.choice([1.5, 4, 10, 20])), rng)


def leaf(image: Image, rng: np.random.Generator) -> Image:
    """A leaf over more than half of the lens, out of focus."""
    height, width = image.shape[:2]
    along = rng.uniform(0, 2 * np.pi)
    edge = np.linspace(-1, 1, width) * np.cos(along) + np.linspace(-1, 1, height)[:, None] * np.sin(along)
    edge += 0.3 * _blobs((height, width), (3, 4), rng)
    share = rng.uniform(0.55, 0.85)
    mask = _soft(edge > np.quantile(edge, 1 - share), rng.uniform(0.012, 0.04))
    texture = cv2.GaussianBlur(rng.standard_normal((height, width), np.float32), (0, 0), 0.024 * width)
    texture *= 8 / max(float(texture.std()), 1e-6)
    return _noisy(_over(image, _one_of(LEAVES, rng) + texture[..., None], mask), 2, rng)


def mud(image: Image, rng: np.random.Generator) -> Image:
    """Splashes of mud over a third to two thirds of the lens."""
    height, width = image.shape[:2]
    field = _blobs((height, width), (6, 8), rng) + 0.4 * _blobs((height, width), (24, 32), rng)
    spots = field > np.quantile(field, 1 - rng.uniform(0.3, 0.6))
    mask = _soft(spots, rng.uniform(0.006, 0.018)) * np.float32(rng.uniform(0.85, 1))
    return _noisy(_over(image, _one_of(SOILS, rng), mask), 2, rng)


def drops(image: Image, rng: np.random.Generator) -> Image:
    """Rain on the lens: each drop shows the scene blurred and upside down, with a dark rim."""
    height, width = image.shape[:2]
    wet = np.zeros((height, width), np.float32)
    for _ in range(int(rng.integers(60, 160))):
        radius = rng.uniform(0.008, 0.055) * width
        centre = (int(rng.uniform(0, width)), int(rng.uniform(0, height)))
        cv2.ellipse(wet, centre, (int(radius), int(radius * rng.uniform(1, 1.5))), 0, 0, 360, 1.0, -1)
    wet = cv2.GaussianBlur(wet, (0, 0), 0.005 * width)
    rim = cv2.GaussianBlur(np.abs(cv2.Laplacian(wet, cv2.CV_32F)), (0, 0), 0.003 * width)[..., None]
    through = cv2.GaussianBlur(image, (0, 0), 0.012 * width)[::-1] * np.float32(0.9) + 20
    return _clipped(_over(image, through, wet) - 400 * rim)


def fogged(image: Image, rng: np.random.Generator) -> Image:
    """A lens with mist or grease on it: blurred, with little contrast."""
    blurred = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.012, 0.032) * image.shape[1])
    left = rng.uniform(0.25, 0.6)
    return _noisy(blurred * left + (1 - left) * rng.uniform(120, 200), 1.5, rng)


def dazzled(image: Image, rng: np.random.Generator) -> Image:
    """The low sun in the image, with flare about it."""
    height, width = image.shape[:2]
    x, y = np.linspace(0, 1, width), np.linspace(0, height / width, height)[:, None]
    far = np.hypot(x - rng.uniform(0.15, 0.85), y - rng.uniform(0, 0.4))
    flare = np.exp(-far / rng.uniform(0.15, 0.4))[..., None] * rng.uniform(1.5, 4)
    return _shown(_linear(image) + flare * np.array([1, 0.97, 0.9]))


def night(image: Image, rng: np.random.Generator) -> Image:
    """Hardly any light, and the noise of a sensor."""
    light = _linear(image)
    light *= rng.uniform(0.0006, 0.004) / max(float(light.mean()), 1e-6)
    shot, read = rng.uniform(0.01, 0.03), rng.uniform(0.001, 0.004)
    return _shown(light + rng.standard_normal(light.shape) * np.sqrt(shot**2 * light + read**2))


KINDS: Mapping[str, Callable[[Image, np.random.Generator], Image]] = {
    "covered": covered,
    "leaf": leaf,
    "mud": mud,
    "drops": drops,
    "fogged": fogged,
    "dazzled": dazzled,
    "night": night,
}
"""Each takes (H, W, 3) uint8 RGB and gives such an image."""


def _one_of(colours: tuple[tuple[int, int, int], ...], rng: np.random.Generator) -> NDArray[np.float64]:
    return np.array(colours[int(rng.integers(len(colours)))], np.float64)


def _blobs(shape: tuple[int, int], cells: tuple[int, int], rng: np.random.Generator) -> Float32Array:
    coarse = rng.standard_normal(cells, np.float32)
    return np.asarray(cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC), np.float32)


def _soft(mask: NDArray[np.bool_], blur: float) -> Float32Array:
    return np.asarray(cv2.GaussianBlur(mask.astype(np.float32), (0, 0), blur * mask.shape[1]), np.float32)


def _over(image: Image, above: NDArray[Any], mask: Float32Array) -> NDArray[np.float64]:
    share = mask[..., None].astype(np.float64)
    return image * (1 - share) + above * share


def _linear(image: Image) -> NDArray[np.float64]:
    return (image / 255.0) ** SRGB_GAMMA


def _shown(light: NDArray[np.float64]) -> Image:
    return _clipped(np.clip(light, 0, 1) ** (1 / SRGB_GAMMA) * 255)


def _noisy(image: NDArray[np.float64], deviation: float, rng: np.random.Generator) -> Image:
    return _clipped(image + rng.normal(0, deviation, image.shape))


def _clipped(image: NDArray[np.float64]) -> Image:
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
