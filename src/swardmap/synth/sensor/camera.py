"""A colour camera: from radiance to the 8-bit picture that its processing gives.

In the order of a real one: lens (softness, aberration, vignetting, dirt, drops, veil), exposure and white
balance, shot and read noise in linear light, tone curve, JPEG. Every strength is drawn once a sequence; only
noise differs from frame to frame.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.synth.config import OpticsConfig

Float32Array = NDArray[np.float32]

MEAN_GOAL = 0.21
"""Linear mean that the automatic exposure aims at: 127 of 255 in sRGB."""
ADAPTATION = 0.88
"""How far the automatic exposure makes up for the light: dusk stays a little darker than noon."""
MOST_GAIN = 60.0
DAYLIGHT_MEAN = 0.35
"""Mean radiance of a garden in the sun; what is darker needs gain, and gain brings noise."""
LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)  # Rec. 709
CURVE_TOP = 8.0
CURVE_SIZE = 4096


@dataclass(frozen=True, slots=True)
class CameraFaults:
    """One camera: the settings with all ranges drawn; the default is a clean one.

    Attributes:
        exposure_ev: error of the exposure in stops.
        gains: of red, green and blue.
        saturation, contrast, knee: of the tone curve.
        vignetting: light lost in the corners.
        dirt: (k, 4) of specks: u and v in 0..1, radius in image widths, opacity.
        drops: (k, 3) of raindrops: u and v in 0..1, radius in image widths.
        veil: stray light, as share of the mean.
        shot_noise, read_noise: standard deviations at full signal and in the dark, in daylight.
        softness_px: sigma of the blur of lens and demosaicing.
        aberration: difference in size of the red and the blue image.
        jpeg_quality: 0 = none.
    """

    exposure_ev: float = 0.0
    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    saturation: float = 1.0
    contrast: float = 0.1
    knee: float = 0.7
    vignetting: float = 0.0
    dirt: tuple[tuple[float, float, float, float], ...] = ()
    drops: tuple[tuple[float, float, float], ...] = ()
    veil: float = 0.0
    shot_noise: float = 0.0
    read_noise: float = 0.0
    softness_px: float = 0.0
    aberration: float = 0.0
    jpeg_quality: int = 0


def draw_faults(config: OpticsConfig, rng: np.random.Generator) -> CameraFaults:
    """One camera of the many that the settings allow; the errors of exposure and colour are mostly small."""
    warm, tint = _mostly_small(config.white_balance, rng), _mostly_small(config.tint, rng)
    evenly = {
        name: float(rng.uniform(*getattr(config, name)))
        for name in ("saturation", "contrast", "knee", "vignetting", "veil", "shot_noise", "read_noise",
                     "softness_px", "aberration")
    }  # fmt: skip
    specks = max(0, round(rng.uniform(*config.dirt)))
    drops = max(0, round(rng.uniform(*config.raindrops)))
    exposure_ev = _mostly_small(config.exposure_ev, rng)
    quality = round(rng.uniform(*config.jpeg_quality))
    dirt = tuple(
        (float(u), float(v), float(rng.uniform(0.01, 0.06)), float(rng.uniform(0.05, 0.35)))
        for u, v in rng.random((specks, 2))
    )
    wet = tuple((float(u), float(v), float(rng.uniform(0.012, 0.04))) for u, v in rng.random((drops, 2)))
    if not config.faults:
        return CameraFaults()
    gains = (float(np.exp(warm / 2)), float(np.exp(tint)), float(np.exp(-warm / 2)))
    return CameraFaults(exposure_ev, gains, dirt=dirt, drops=wet, jpeg_quality=quality, **evenly)


def photograph(radiance: Float32Array, faults: CameraFaults, rng: np.random.Generator) -> NDArray[np.uint8]:
    """The picture of what comes through the lens.

    Args:
        radiance: (H, W, 3) float32, linear RGB; of a moving camera the mean of several.
        faults: the camera.
        rng: source of the noise.

    Returns:
        (H, W, 3) uint8, sRGB.

    Raises:
        InvalidValueError: for another shape, or numbers that are not finite.
    """
    if radiance.ndim != 3 or radiance.shape[2] != 3 or not np.isfinite(radiance).all():
        raise InvalidValueError(
            f"camera: expected finite radiance of shape (H, W, 3), got {radiance.shape} of {radiance.dtype}"
        )
    image = _through_lens(np.maximum(radiance.astype(np.float32), 0), faults)
    gain = exposure_gain(radiance)
    image = image * (np.asarray(faults.gains, np.float32) * np.float32(gain * 2.0**faults.exposure_ev))
    image = _with_noise(image, gain, faults, rng)
    return _compressed(_developed(image, faults), faults.jpeg_quality)


def exposure_gain(radiance: Float32Array) -> float:
    """What the automatic exposure multiplies with: by the mean, the middle counts double, glare is cut."""
    luma = radiance @ LUMA
    h, w = luma.shape
    middle = luma[h // 4 : h - h // 4, w // 4 : w - w // 4]
    top = max(float(np.quantile(luma[::4, ::4], 0.95)), 1e-6)
    mean = (float(np.minimum(luma, top).mean()) + float(np.minimum(middle, top).mean())) / 2
    mean = max(mean, 1e-6)
    gain = MEAN_GOAL / DAYLIGHT_MEAN * (DAYLIGHT_MEAN / mean) ** ADAPTATION
    return float(min(gain, MOST_GAIN))


def srgb(linear: Float32Array) -> Float32Array:
    """The transfer curve of sRGB (IEC 61966-2-1), 0..1 to 0..1."""
    x = np.clip(linear, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055).astype(np.float32)


def tone_curve(linear: Float32Array, knee: float, contrast: float) -> Float32Array:
    """Linear light 0.. to 0..1: highlights above the knee are compressed, then sRGB, then an S."""
    x = np.maximum(linear, 0)
    rolled = np.where(x > knee, knee + (1 - knee) * (1 - np.exp(-(x - knee) / (1 - knee))), x)
    y = srgb(rolled.astype(np.float32))
    return np.clip(y + np.float32(contrast) * y * (1 - y) * (2 * y - 1), 0, 1).astype(np.float32)


def _mostly_small(limits: tuple[float, float], rng: np.random.Generator) -> float:
    low, high = limits
    return float(rng.triangular(low, (low + high) / 2, high)) if high > low else low


def _through_lens(image: Float32Array, faults: CameraFaults) -> Float32Array:
    import cv2

    if faults.aberration > 0:
        image = np.stack(
            [
                _scaled(np.ascontiguousarray(image[..., 0]), 1 + faults.aberration),
                image[..., 1],
                _scaled(np.ascontiguousarray(image[..., 2]), 1 - faults.aberration),
            ],
            axis=-1,
        )
    if faults.softness_px > 0:
        image = cv2.GaussianBlur(image, (0, 0), faults.softness_px)
    for u, v, radius in faults.drops:
        image = _with_drop(image, u, v, radius)
    image = image * _transmission(image.shape[:2], faults)[..., None]
    if faults.veil > 0:
        image = image * np.float32(1 - faults.veil) + np.float32(faults.veil) * image.mean(axis=(0, 1))
    return np.asarray(image, np.float32)


def _scaled(channel: Float32Array, factor: float) -> Float32Array:
    import cv2

    h, w = channel.shape
    cu, cv = (w - 1) / 2, (h - 1) / 2
    matrix = np.array([[factor, 0, cu * (1 - factor)], [0, factor, cv * (1 - factor)]])
    return np.asarray(cv2.warpAffine(channel, matrix, (w, h), borderMode=cv2.BORDER_REPLICATE), np.float32)


def _with_drop(image: Float32Array, u: float, v: float, radius: float) -> Float32Array:
    """A drop shows a small, blurred picture of the scene upside down, with a soft rim."""
    import cv2

    h, w = image.shape[:2]
    r = max(2, round(radius * w))
    x, y = round(u * (w - 1)), round(v * (h - 1))
    x0, x1, y0, y1 = max(0, x - r), min(w, x + r + 1), max(0, y - r), min(h, y + r + 1)
    inner = cv2.resize(image[::-1, ::-1], (2 * r + 1, 2 * r + 1), interpolation=cv2.INTER_AREA)
    inner = cv2.GaussianBlur(inner, (0, 0), max(0.8, r / 8))
    inner = inner[y0 - y + r : y1 - y + r, x0 - x + r : x1 - x + r]
    vv, uu = np.mgrid[y0:y1, x0:x1]
    alpha = np.clip((1 - np.hypot(uu - x, vv - y) / r) * 3, 0, 0.85).astype(np.float32)[..., None]
    out: Float32Array = image.copy()
    out[y0:y1, x0:x1] = out[y0:y1, x0:x1] * (1 - alpha) + inner * alpha
    return out


def _transmission(shape: tuple[int, int], faults: CameraFaults) -> Float32Array:
    """Share of the light that vignetting and dirt let through."""
    h, w = shape
    v, u = np.mgrid[:h, :w].astype(np.float32)
    square = ((u - (w - 1) / 2) ** 2 + (v - (h - 1) / 2) ** 2) / np.float32((w**2 + h**2) / 4)
    passed: Float32Array = (1 - np.float32(faults.vignetting) * square).astype(np.float32)
    for x, y, radius, opacity in faults.dirt:
        away = ((u - x * (w - 1)) ** 2 + (v - y * (h - 1)) ** 2) / np.float32((radius * w) ** 2)
        passed *= 1 - np.float32(opacity) * np.exp(-away * away)
    return passed


def _with_noise(
    image: Float32Array, gain: float, faults: CameraFaults, rng: np.random.Generator
) -> Float32Array:
    """Shot noise grows with the root of the signal, both with the gain that a dark scene needs."""
    if faults.shot_noise <= 0 and faults.read_noise <= 0:
        return image
    more = max(1.0, gain * DAYLIGHT_MEAN / MEAN_GOAL)
    variance = np.float32(faults.shot_noise**2 * more) * np.maximum(image, 0)
    variance += np.float32((faults.read_noise * more) ** 2)
    noise = rng.standard_normal(image.shape, np.float32)
    noisy: Float32Array = (image + np.sqrt(variance) * noise).astype(np.float32)
    return noisy


def _developed(image: Float32Array, faults: CameraFaults) -> NDArray[np.uint8]:
    """Saturation in linear light, then the tone curve from a table that is fine where the eye is."""
    if faults.saturation != 1:
        luma: Float32Array = (image @ LUMA)[..., None]
        image = luma + np.float32(faults.saturation) * (image - luma)
    light = np.linspace(0, 1, CURVE_SIZE, dtype=np.float32) ** 2 * np.float32(CURVE_TOP)
    levels = np.rint(tone_curve(light, faults.knee, faults.contrast) * 255).astype(np.uint8)
    at = np.sqrt(np.clip(image, 0, CURVE_TOP) / np.float32(CURVE_TOP)) * np.float32(CURVE_SIZE - 1)
    return np.asarray(levels[np.rint(at).astype(np.int32)])


def _compressed(rgb: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    from swardmap.io.images import color_of, decode, encode_jpeg

    if quality <= 0:
        return rgb
    return color_of(decode(encode_jpeg(rgb, min(quality, 100)), "camera picture"), "camera picture")
