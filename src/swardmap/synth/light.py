"""The five lights of EDEN as ranges: sun, sky and air of a day by chance.

Ratios of sun to sky follow the illuminance of daylight: clear noon has about 100 klx from the sun and
15-20 klx from the sky, an overcast day 10-20 klx, the time around sunset 1-10 klx, twilight below 0.5 klx.
Radiances are scaled so that the mean of a garden on a clear day is near 0.3.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.synth.model import Light

RGB = tuple[float, float, float]
Array = NDArray[np.float64]

LEVEL = 1.8
"""Of all radiances, so that the mean of a garden is as said."""
NOON = 2.3
"""Radiance of a white surface that faces the sun of a clear noon, before `LEVEL`."""
AIR = np.array([0.10, 0.16, 0.31])
"""Optical depth of clear air with some dust, for red, green and blue."""
LAWN = np.array([0.09, 0.11, 0.045])
"""Mean albedo of a garden's ground, for the light that comes back from it."""
SUN_SIZE = 0.0093
"""Angle under which the sun is seen, radians."""


def sample_light(illumination: str, rng: np.random.Generator) -> Light:
    """One of the many lights of a name.

    Args:
        illumination: clear, cloudy, overcast, sunset or twilight.
        rng: source of chance.

    Raises:
        InvalidValueError: for another name.
    """
    if illumination not in _LIGHTS:
        raise InvalidValueError(f"light: expected one of {', '.join(_LIGHTS)}, got '{illumination}'")
    return _LIGHTS[illumination](rng)


def _clear(rng: np.random.Generator) -> Light:
    elevation = rng.uniform(26, 63)
    blue = np.array([0.22, 0.36, 0.63]) * rng.uniform(0.75, 1.05)
    pale = _between([0.55, 0.66, 0.80], [0.66, 0.72, 0.78], rng) * rng.uniform(0.85, 1.1)
    sun = NOON * _through_air(elevation, rng.uniform(0.8, 1.2))
    return _light("clear", rng, elevation, sun, blue, pale, SUN_SIZE, rng.uniform(0.0, 0.35), 0.0006)


def _cloudy(rng: np.random.Generator) -> Light:
    elevation = rng.uniform(24, 60)
    share = rng.uniform(0.25, 0.75)  # of the sun that comes through
    white = np.array([0.62, 0.68, 0.78]) * rng.uniform(0.8, 1.15)
    blue = _between([0.30, 0.42, 0.66], [0.58, 0.62, 0.68], rng) * rng.uniform(0.85, 1.1)
    sun = share * NOON * _through_air(elevation, 1.1)
    soft = SUN_SIZE + 0.05 * (0.8 - share)
    return _light("cloudy", rng, elevation, sun, blue, white, soft, rng.uniform(0.5, 0.8), 0.001)


def _overcast(rng: np.random.Generator) -> Light:
    elevation = rng.uniform(30, 65)
    grey = _between([0.50, 0.52, 0.55], [0.52, 0.53, 0.53], rng) * rng.uniform(0.7, 1.2)
    sun = rng.uniform(0.0, 0.12) * np.array([1.0, 0.98, 0.95])
    low = grey * rng.uniform(0.5, 0.75)  # overcast skies are brightest above (CIE)
    haze = 0.0012 if rng.random() < 0.75 else rng.uniform(0.004, 0.012)
    return _light("overcast", rng, elevation, sun, grey, low, 0.12, rng.uniform(0.92, 1.0), haze)


def _sunset(rng: np.random.Generator) -> Light:
    elevation = rng.uniform(4, 13)
    sun = NOON * _through_air(elevation, rng.uniform(0.75, 1.05))
    zenith = np.array([0.20, 0.26, 0.42]) * rng.uniform(0.75, 1.15)
    low = _between([0.58, 0.43, 0.30], [0.50, 0.46, 0.43], rng) * rng.uniform(0.85, 1.2)
    return _light("sunset", rng, elevation, sun, zenith, low, SUN_SIZE * 1.3, rng.uniform(0.1, 0.55), 0.0015)


def _twilight(rng: np.random.Generator) -> Light:
    dim = float(np.exp(rng.uniform(np.log(0.05), np.log(0.13))))
    zenith = dim * _between([0.26, 0.39, 0.68], [0.34, 0.43, 0.60], rng)
    low = dim * _between([0.72, 0.67, 0.62], [0.50, 0.57, 0.70], rng)
    sun = dim * np.array([0.30, 0.24, 0.20])  # the bright side of the sky, where the sun went down
    return _light("twilight", rng, rng.uniform(8, 15), sun, zenith, low, 0.3, rng.uniform(0.1, 0.6), 0.002)


_LIGHTS: dict[str, Callable[[np.random.Generator], Light]] = {
    "clear": _clear,
    "cloudy": _cloudy,
    "overcast": _overcast,
    "sunset": _sunset,
    "twilight": _twilight,
}


def _light(
    name: str, rng: np.random.Generator, elevation_deg: float, sun: Array, zenith: Array, horizon: Array,
    softness: float, clouds: float, haze_per_m: float,
) -> Light:  # fmt: skip
    e, azimuth = np.deg2rad(elevation_deg), rng.uniform(0, 2 * np.pi)
    up = float(np.sin(e))
    direction = (float(np.cos(e) * np.cos(azimuth)), float(np.cos(e) * np.sin(azimuth)), up)
    sun, zenith, horizon = LEVEL * sun, LEVEL * zenith, LEVEL * horizon
    back = LAWN * (sun * up + 0.5 * (zenith + horizon))
    return Light(
        name, direction, _rgb(sun), _rgb(zenith), _rgb(horizon), _rgb(back), float(softness), float(clouds),
        float(haze_per_m * rng.uniform(0.5, 1.5)),
    )  # fmt: skip


def _through_air(elevation_deg: float, dust: float) -> Array:
    """Share of sunlight that reaches the ground: Kasten and Young's air mass (1989), exponential loss."""
    mass = 1 / (np.sin(np.deg2rad(elevation_deg)) + 0.50572 * (elevation_deg + 6.07995) ** -1.6364)
    passed: Array = np.exp(-AIR * dust * (mass - 1))
    return passed


def _between(a: list[float], b: list[float], rng: np.random.Generator) -> Array:
    t = rng.random()
    return (1 - t) * np.array(a) + t * np.array(b)


def _rgb(color: Array) -> RGB:
    r, g, b = (float(c) for c in color)
    return r, g, b
