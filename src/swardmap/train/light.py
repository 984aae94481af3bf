"""Harsh light and poor cameras: what a lawn looks like in shade, at dusk, under a wrong white balance.

All of it works on linear light, as shade and exposure do, and alike on lawn and on everything else: if only
lawns grew dark, a network would learn that dark things are lawn. NumPy and OpenCV only; chance comes from
the generator.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.train.recipe import AugmentConfig

Image = NDArray[np.uint8]
Float32Image = NDArray[np.float32]

SRGB_GAMMA = 2.2
_LINEAR = (np.linspace(0, 1, 256) ** SRGB_GAMMA).astype(np.float32)
_STEPS = 4096  # of the table from linear light back to eight bits; the square root keeps the dark end fine


def harsh_light(image: Image, config: AugmentConfig, rng: np.random.Generator) -> Image:
    """Another light and another camera: shade, vignette, exposure, white balance, noise, tone, saturation.

    Args:
        image: (H, W, 3) uint8 RGB.
        config: how much.
        rng: source of chance.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    light = _LINEAR[image]
    if rng.random() < config.shade:
        light *= shade(image.shape[:2], rng)
    if rng.random() < 0.5:
        light *= vignette(image.shape[:2], rng.uniform(0, config.vignette))[..., None]
    light *= exposure_gain(light, config, rng) * white_balance(config, rng)
    if rng.random() < 0.5:
        light = _sensor_noise(light, rng)
    levels = _tone_curve(config, rng)
    index = (np.sqrt(np.clip(light, 0, 1)) * (_STEPS - 1)).astype(np.int32)
    return saturated(levels[index], rng.uniform(config.saturation_low, config.saturation_high))


def exposure_gain(light: Float32Image, config: AugmentConfig, rng: np.random.Generator) -> np.float32:
    """Gain of the exposure, darker more often than brighter; what would leave nothing to see is held back."""
    gain = np.exp(rng.normal(-0.5, 1.0) * config.exposure)
    mean = max(float(light.mean()), 1e-4)
    return np.float32(np.clip(gain, min(1.0, 0.006 / mean), max(1.0, 0.6 / mean)))


def white_balance(config: AugmentConfig, rng: np.random.Generator) -> Float32Image:
    """(3,) float32 gains of a light of another colour: yellow to blue, and a little green to pink."""
    warm, pink = rng.normal(0, config.cast), rng.normal(0, 0.4 * config.cast)
    return np.exp(np.array([warm + pink / 2, -pink, -warm + pink / 2])).astype(np.float32)


def shade(shape: tuple[int, int], rng: np.random.Generator) -> Float32Image:
    """(H, W, 3) float32 factors of the shade of houses, poles and trees, bluish as the sky that lights it."""
    lit = np.ones(shape, np.float32)
    if rng.random() < 0.6:
        lit = np.minimum(lit, _hard_shadow(shape, rng))
    if rng.random() < 0.6:
        lit = np.minimum(lit, _dappled(shape, rng))
    depth = rng.uniform(0.06, 0.5)
    sky = depth * np.exp(rng.uniform(0, 0.35) * np.array([-1.0, 0.0, 1.0]))
    return (lit[..., None] + (1 - lit[..., None]) * sky).astype(np.float32)


def vignette(shape: tuple[int, int], loss: float) -> Float32Image:
    """(H, W) float32 factors of a lens that loses this share of the light in the corners."""
    rows, columns = (np.linspace(-1, 1, n, dtype=np.float32) ** 2 for n in shape)
    return (1 - loss * ((rows[:, None] + columns) / 2)).astype(np.float32)


def saturated(image: Image, saturation: float) -> Image:
    """Colours farther from grey (above 1) or nearer to it."""
    grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    return np.asarray(cv2.addWeighted(image, saturation, grey, 1 - saturation, 0), np.uint8)


def _hard_shadow(shape: tuple[int, int], rng: np.random.Generator) -> Float32Image:
    """1 in the sun, 0 in the shade of one to three things with straight edges, some of them narrow."""
    height, width = shape
    lit = np.ones(shape, np.float32)
    for _ in range(int(rng.integers(1, 4))):
        centre, half = rng.uniform(0, 1, 2) * (width, height), rng.uniform(0.02, 0.6) * width
        along = rng.uniform(0, np.pi)
        axes = np.array([[np.cos(along), np.sin(along)], [-np.sin(along), np.cos(along)]])
        corners = np.array([[-2 * width, -half], [2 * width, -half], [2 * width, half], [-2 * width, half]])
        corners[:, 1] += rng.normal(0, 0.1 * width, 4)
        cv2.fillPoly(lit, [(centre + corners @ axes).astype(np.int32)], 0.0)
    return np.asarray(cv2.GaussianBlur(lit, (0, 0), rng.uniform(0.4, 4)), np.float32)


def _dappled(shape: tuple[int, int], rng: np.random.Generator) -> Float32Image:
    """1 in the sun, 0 in the shade of a crown: blobs of some size, flat as they lie on the ground."""
    height, width = shape
    cells, field = rng.uniform(4, 25), np.zeros(shape, np.float32)
    for octave in (1, 2, 4):  # leaves in twigs in branches
        grid = (max(2, int(octave * cells * 1.5 * height / width)), max(2, int(octave * cells)))
        blobs = rng.standard_normal(grid, dtype=np.float32)
        field += cv2.resize(blobs, (width, height), interpolation=cv2.INTER_LINEAR) * rng.uniform(0.3, 1.0)
    level, soft = rng.normal(0, 0.7), rng.uniform(0.05, 0.5)
    return np.asarray(np.clip((field - level) / soft + 0.5, 0, 1), np.float32)


def _sensor_noise(light: Float32Image, rng: np.random.Generator) -> Float32Image:
    """Shot noise that grows with the light, and read noise that does not."""
    grain = rng.standard_normal(light.shape, dtype=np.float32)
    shot, read = rng.uniform(0.005, 0.05), rng.uniform(0.0002, 0.004)
    return np.asarray(light + grain * np.sqrt(np.float32(shot**2) * light + np.float32(read**2)), np.float32)


def _tone_curve(config: AugmentConfig, rng: np.random.Generator) -> Image:
    """(_STEPS,) uint8: eight bits by the square root of linear light, with another gamma and contrast."""
    linear = np.linspace(0, 1, _STEPS) ** 2
    curve = linear ** (np.exp(rng.normal(0, config.gamma)) / SRGB_GAMMA)
    s_shaped = curve * curve * (3 - 2 * curve)
    curve += rng.uniform(-0.4, 0.8) * (s_shaped - curve)
    return np.clip(curve * 255 + 0.5, 0, 255).astype(np.uint8)
