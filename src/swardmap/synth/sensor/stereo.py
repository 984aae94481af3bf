"""A stereo depth camera like the D435i: what it makes of exact depth and of the grey image.

Disparity d = f B / z (pixels of the infrared imagers). On it act, in this order: the matching window, the
half-occlusions, calibration error, sub-pixel noise, quantisation, flying pixels, holes, range limits and
the removal of speckles. A standard deviation s of the disparity is s z^2 / (f B) in depth.

Sources:
    [tuning] Grunnet-Jepsen, Sweetser, Woodfill: Tuning depth cameras for best performance, Intel, rev. 2.0:
        RMS = z^2 subpixel / (f B); D435 best at 848 x 480.
    [linearity] Grunnet-Jepsen et al.: Subpixel linearity improvement for D400, Intel: HFOV 90 degrees, so
        f = 424 px at 848 px; steps of the disparity.
    [3904] Grunnet-Jepsen in librealsense issue 3904: subpixel 0.08 is usual, 0.032 the best.
    [datasheet] Intel D400 series datasheet: baseline 50 mm, nearest reading 0.28 m at 1280 x 720, range
        about 10 m, error at most 2 % at 2 m; the left imager is the reference (Invalid Depth Band).
    [keselman] Keselman et al.: Intel RealSense Stereoscopic Depth Cameras, CVPRW 2017 (arXiv 1705.05548):
        census matching in local windows, constant error of the disparity, holes where confidence is low.
    [elevation] ANYbotics elevation_mapping, realsense_d435.yaml: noise of a real D435, `literature_sigma_m`.

Not modelled: the projector (drowned by daylight), the 15 mm between colour camera and left imager, errors
that stay the same from frame to frame other than scale and offset.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.synth.config import StereoConfig

Float32Array = NDArray[np.float32]
BoolArray = NDArray[np.bool_]

NOISE_PARTS = ((0.35, 0.0), (0.80, 1.3), (0.48, 12.0))
"""Weight and correlation length in pixels of the parts of the noise: matching windows overlap and costs are
aggregated over neighbours, so most of it is smooth [keselman]. The squares of the weights are scaled to 1."""
BLOB_SIGMA_PX = 4.0
TEXTURE_WINDOW_PX = 7
MIN_CONFIDENCE = 0.15
MOST_STEPS = 32767  # of 16 bits, for OpenCV's removal of speckles


@dataclass(frozen=True, slots=True)
class StereoModel:
    """One sensor: the settings with all ranges drawn. See StereoConfig for what each number means."""

    baseline_m: float = 0.05
    focal_px: float = 424.0
    subpixel_px: float = 0.08
    step_px: float = 1 / 32
    scale_error: float = 0.0
    offset_px: float = 0.0
    window_px: int = 7
    fattening: float = 0.35
    edge_px: float = 1.0
    flying: float = 0.15
    dropout: float = 0.02
    blank_dropout: float = 0.7
    texture_full: float = 0.03
    dark: float = 0.03
    saturated: float = 0.985
    min_m: float = 0.28
    max_m: float = 10.0
    speckle_px: int = 40

    def sigma_m(self, z_m: NDArray[np.floating] | float) -> NDArray[np.float64]:
        """The stated curve: standard deviation of the depth on a well textured surface [tuning]."""
        z = np.asarray(z_m, np.float64)
        return np.asarray(self.subpixel_px * z**2 / (self.focal_px * self.baseline_m))


def draw_stereo(config: StereoConfig, rng: np.random.Generator) -> StereoModel:
    """One sensor of the many that the settings allow; every range is drawn from evenly."""
    drawn: dict[str, Any] = {
        name: float(rng.uniform(*getattr(config, name)))
        for name in ("subpixel_px", "scale_error", "offset_px", "flying", "dropout")
    }
    same = {f.name: getattr(config, f.name) for f in fields(StereoModel) if f.name not in drawn}
    return StereoModel(**drawn, **same)


def stereo_depth(
    depth_m: NDArray[np.floating],
    gray: NDArray[np.uint8],
    fx_px: float,
    model: StereoModel,
    rng: np.random.Generator,
) -> NDArray[np.uint16]:
    """What the sensor reads.

    Args:
        depth_m: (H, W) exact depth along the optical axis; 0, NaN and infinity: nothing there (sky).
        gray: (H, W) what the imagers see; texture, darkness and glare are judged by it.
        fx_px: focal length of these images.
        model: the sensor.
        rng: source of chance; the same state gives the same depth.

    Returns:
        (H, W) uint16 millimetres, 0 = no reading.

    Raises:
        InvalidValueError: for images of different size, or a step of the disparity that is too small.
    """
    import cv2

    if model.focal_px * model.baseline_m / model.min_m / model.step_px > MOST_STEPS:
        raise InvalidValueError(f"stereo: expected at most {MOST_STEPS} steps of disparity; enlarge step_px")
    if depth_m.shape != gray.shape or depth_m.ndim != 2 or gray.dtype != np.uint8:
        raise InvalidValueError(
            f"stereo: expected depth and uint8 grey of one size, got {depth_m.shape} and {gray.shape}"
        )
    scale = fx_px / model.focal_px
    matched, edge, near, far = _matched(_disparity(depth_m, model), scale, model)
    confidence, blind = _confidence(gray, model)
    noise = _noise(depth_m.shape, rng) * np.float32(model.subpixel_px) / np.sqrt(confidence)
    measured = matched / np.float32(1 + model.scale_error) + np.float32(model.offset_px) + noise
    floats = edge & (rng.random(edge.shape, np.float32) < model.flying)
    between = near + (far - near) * rng.random(edge.shape, np.float32)
    measured = np.where(floats, between, measured)
    lost = occluded(matched, scale) | _holes(confidence, blind, model, rng) | (matched <= 0)
    steps = np.rint(measured / np.float32(model.step_px))
    nearest = model.focal_px * model.baseline_m / model.min_m
    steps[lost | (steps < 1) | (steps * model.step_px > nearest)] = 0
    steps = steps.astype(np.int16)
    if model.speckle_px:
        cv2.filterSpeckles(steps, 0, model.speckle_px, round(1.0 / model.step_px))
    return _millimetres(steps, model)


def occluded(disparity: Float32Array, scale: float) -> BoolArray:
    """Where the right imager cannot see what the left one sees: beside near things, on their left.

    The left imager is the reference [datasheet]; the right one sits to its right, so a near thing covers
    for it what lies left behind the thing.

    Args:
        disparity: (H, W) in pixels of the imagers.
        scale: pixels of this image to one of the imagers.
    """
    u = np.arange(disparity.shape[1], dtype=np.float32)
    right = u[None, :] - disparity * np.float32(scale)
    first = np.minimum.accumulate(right[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(disparity.shape, bool)
    hidden[:, :-1] = right[:, :-1] >= first[:, 1:]
    return hidden


def literature_sigma_m(z_m: NDArray[np.floating] | float) -> NDArray[np.float64]:
    """Noise of a real D435 along the normal of a plane, fitted from 0.4 to 3.25 m [elevation]."""
    return np.asarray(0.000611 + 0.003587 * (np.asarray(z_m, np.float64) - 0.3515) ** 2)


def _disparity(depth_m: NDArray[np.floating], model: StereoModel) -> Float32Array:
    z = np.asarray(depth_m, np.float32)
    there = np.isfinite(z) & (z > 0)
    fb = np.float32(model.focal_px * model.baseline_m)
    return np.where(there, fb / np.where(there, z, 1), 0).astype(np.float32)


def _matched(
    disparity: Float32Array, scale: float, model: StereoModel
) -> tuple[Float32Array, BoolArray, Float32Array, Float32Array]:
    """What a matching window finds: the mean on surfaces, one of two sides at edges.

    The near side wins where it fills the stated share of the window, so near things grow by a part of a
    window, and thin things vanish. Blades of grass within a window melt into one surface.

    Returns:
        disparity, whether there is an edge in the window, largest and smallest disparity in it.
    """
    import cv2

    size = max(1, round(model.window_px * scale)) | 1
    kernel, around = (np.ones((n, n), np.uint8) for n in (size, 2 * size + 1))
    near, far = cv2.dilate(disparity, kernel), cv2.erode(disparity, kernel)
    middle = (cv2.dilate(disparity, around) + cv2.erode(disparity, around)) / 2
    front = (disparity > middle).astype(np.float32)
    mean, share = cv2.blur(disparity, (size, size)), cv2.blur(front, (size, size))
    sum_front = cv2.blur(disparity * front, (size, size))
    front_mean = sum_front / np.maximum(share, np.float32(1e-6))
    back_mean = (mean - sum_front) / np.maximum(1 - share, np.float32(1e-6))
    edge = near - far > np.float32(model.edge_px)
    chosen = np.where(share >= np.float32(model.fattening), front_mean, back_mean)
    return np.where(edge, chosen, mean), edge, near, far


def _confidence(gray: NDArray[np.uint8], model: StereoModel) -> tuple[Float32Array, BoolArray]:
    """0..1 from local contrast, and where the imagers are too dark or saturated to match."""
    import cv2

    window = (TEXTURE_WINDOW_PX, TEXTURE_WINDOW_PX)
    g = gray.astype(np.float32) / np.float32(255)
    mean = cv2.blur(g, window)
    contrast = np.sqrt(np.maximum(cv2.blur(g * g, window) - mean * mean, 0))
    confidence = np.clip(contrast / np.float32(model.texture_full), MIN_CONFIDENCE, 1).astype(np.float32)
    glare = cv2.blur((g >= np.float32(model.saturated)).astype(np.float32), window) > 0.5
    return confidence, glare | (mean < np.float32(model.dark))


def _noise(shape: tuple[int, ...], rng: np.random.Generator) -> Float32Array:
    """Gaussian noise of standard deviation 1, mostly smooth: see NOISE_PARTS."""
    total = np.zeros(shape, np.float32)
    norm = np.sqrt(sum(weight**2 for weight, _ in NOISE_PARTS))
    for weight, sigma_px in NOISE_PARTS:
        total += np.float32(weight / norm) * _smooth_noise(shape, sigma_px, rng)
    return total


def _smooth_noise(shape: tuple[int, ...], sigma_px: float, rng: np.random.Generator) -> Float32Array:
    """Gaussian noise of standard deviation 1 and a correlation length; coarse where it is long."""
    import cv2

    h, w = shape
    if sigma_px <= 0:
        return rng.standard_normal(shape, np.float32)
    step = max(1, int(sigma_px // 3))  # noise as smooth as this needs no finer grid
    coarse = rng.standard_normal((h // step + 3, w // step + 3), np.float32)
    taps = cv2.getGaussianKernel(2 * int(np.ceil(3 * sigma_px / step)) + 1, sigma_px / step, cv2.CV_32F)
    field = cv2.sepFilter2D(coarse, -1, taps, taps) / np.float32((taps**2).sum())
    if step == 1:
        return np.ascontiguousarray(field[:h, :w])
    size = (field.shape[1] * step, field.shape[0] * step)
    return np.ascontiguousarray(cv2.resize(field, size, interpolation=cv2.INTER_CUBIC)[:h, :w])


def _holes(
    confidence: Float32Array, blind: BoolArray, model: StereoModel, rng: np.random.Generator
) -> BoolArray:
    """Blobs without a reading: few where there is texture, many where there is none, most where blind."""
    from scipy.special import ndtri

    blank = np.clip((0.6 - confidence) / (0.6 - MIN_CONFIDENCE), 0, 1)
    share = model.dropout + (1 - model.dropout) * model.blank_dropout * blank
    share = np.where(blind, 0.97, share).astype(np.float32)
    holes: BoolArray = _smooth_noise(confidence.shape, BLOB_SIGMA_PX, rng) < ndtri(share)
    return holes


def _millimetres(steps: NDArray[np.int16], model: StereoModel) -> NDArray[np.uint16]:
    d = steps.astype(np.float32) * np.float32(model.step_px)
    there = steps > 0
    z_mm = np.where(there, 1000 * model.focal_px * model.baseline_m / np.where(there, d, 1), 0)
    z_mm[(z_mm < model.min_m * 1000) | (z_mm > model.max_m * 1000)] = 0
    return np.rint(z_mm).astype(np.uint16)
