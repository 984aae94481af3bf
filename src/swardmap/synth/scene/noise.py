"""Smooth random fields on a raster."""

import cv2
import numpy as np

from swardmap.synth.model import Float32Array


def smooth_noise(
    shape: tuple[int, int], texel_m: float, wavelength_m: float, rng: np.random.Generator, octaves: int = 1
) -> Float32Array:
    """A field of mean 0 and standard deviation about 1 that changes over a wavelength.

    Args:
        shape: rows and columns.
        texel_m: edge of a texel.
        wavelength_m: of the coarsest octave; each further one has half the wavelength and half the height.
        rng: source of chance; how much is drawn depends on the arguments only.
        octaves: how many.

    Returns:
        Array of `shape`, float32.
    """
    total, power = np.zeros(shape, np.float32), 0.0
    for octave in range(octaves):
        cell = max(wavelength_m / 2**octave / 2, texel_m) / texel_m  # two knots to a wavelength
        knots = [int(np.ceil(n / cell)) + 3 for n in shape]
        coarse = rng.standard_normal(knots, np.float32)
        size = [round(k * cell) for k in knots]
        fine = cv2.resize(coarse, (size[1], size[0]), interpolation=cv2.INTER_CUBIC)
        skip = int(cell)  # the border of a resized picture is flat
        weight = 0.5**octave
        total += weight * fine[skip : skip + shape[0], skip : skip + shape[1]]
        power += weight**2 * 0.55  # cubic interpolation keeps about this share of the variance
    return total / np.float32(np.sqrt(power))


def smoothstep(low: float, high: float, x: Float32Array) -> Float32Array:
    """0 below `low`, 1 above `high`, smooth between."""
    t = np.clip((x - np.float32(low)) / np.float32(high - low), 0, 1)
    step: Float32Array = t * t * (3 - 2 * t)
    return step
