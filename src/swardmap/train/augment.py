"""Augmentation of an image and its codes: geometry, light, weather, camera. NumPy and OpenCV only.

Every function draws from the generator it is given, so that a sample is a function of its seed.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.labels import VOID_ID
from swardmap.train.light import harsh_light, saturated
from swardmap.train.recipe import AugmentConfig

Image = NDArray[np.uint8]


def warp(
    image: Image,
    codes: Image,
    size: tuple[int, int],
    config: AugmentConfig,
    rng: np.random.Generator,
    aspect: float | None = None,
    mean_zoom: float = 1.0,
) -> tuple[Image, Image]:
    """Random view of the image: flip, zoom, stretch, turn, shift. What lies outside is void.

    Args:
        image: (H, W, 3) uint8.
        codes: (H, W) or (H, W, n) uint8.
        size: (width, height) of the view. Unchanged, the image would have the view's area.
        config: how much.
        rng: source of chance.
        aspect: width to height of the network's input, to which images will be stretched; None = the view's.
        mean_zoom: 1 = the view has the area of the image, 2 = of a quarter of it.

    Returns:
        The view of both, uint8.
    """
    height, width = image.shape[:2]
    zoom = mean_zoom * np.sqrt(size[0] * size[1] / (width * height))
    zoom *= np.exp(rng.uniform(-0.8, 1.0) * config.scale)
    stretch = np.exp(rng.uniform(-1, 1) * config.aspect / 2)
    if rng.random() < 0.7:  # as the network will see it; otherwise as people do
        stretch *= np.sqrt((aspect or size[0] / size[1]) * height / width)
    scale = np.array([zoom * stretch, zoom / stretch])
    angle = np.deg2rad(rng.normal(0, config.rotation_deg))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    matrix = turn * scale
    if rng.random() < 0.5:
        matrix = matrix @ np.diag([-1.0, 1.0])
    slack = np.maximum(np.array([width, height]) - np.array(size) / scale, 0) / 2
    centre = np.array([width, height]) / 2 + rng.uniform(-1, 1, 2) * slack
    affine = np.column_stack([matrix, np.array(size) / 2 - matrix @ centre])
    if zoom < 0.6:  # linear sampling would skip pixels
        image = cv2.GaussianBlur(image, (0, 0), 0.4 / zoom)
    moved = cv2.warpAffine(image, affine, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
    moved_codes = cv2.warpAffine(
        codes,
        affine,
        size,
        flags=cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(VOID_ID,) * 4,
    )
    return np.asarray(moved, np.uint8), np.asarray(moved_codes, np.uint8)


def relight(image: Image, config: AugmentConfig, rng: np.random.Generator) -> Image:
    """Another light, mild or harsh; then the rare things."""
    if config.harsh and rng.random() < config.harsh:
        image = harsh_light(image, config, rng)
        shaded = True  # in its own way
    else:
        image = mild_light(image, config.light, rng)
        shaded = False
    for change in (shadow, haze, blur, low_resolution, noise, jpeg)[shaded:]:
        if rng.random() < config.rare:
            image = change(image, rng)
    return image


def mild_light(image: Image, deviation: float, rng: np.random.Generator) -> Image:
    """Exposure, gamma, colour of the light, contrast, saturation, as they differ between good photos."""
    levels = np.linspace(0, 1, 256)
    gamma = np.exp(rng.normal(0, deviation))
    contrast = np.exp(rng.normal(0, 0.6 * deviation))
    gain = np.exp(rng.normal(0, deviation) + rng.normal(0, 0.3 * deviation, 3))
    tables = 0.5 + (levels[:, None] ** gamma * gain - 0.5) * contrast
    image = cv2.LUT(image, np.clip(tables * 255, 0, 255).astype(np.uint8)[None])
    return saturated(image, rng.uniform(0.5, 1.4))


def shadow(image: Image, rng: np.random.Generator) -> Image:
    """A darker polygon with soft edges, as a tree or a house throws it."""
    height, width = image.shape[:2]
    corners = (rng.uniform(-0.3, 1.3, (int(rng.integers(3, 7)), 2)) * (width, height)).astype(np.int32)
    mask = np.zeros((height, width), np.float32)
    cv2.fillPoly(mask, [cv2.convexHull(corners)], 1.0)
    mask = cv2.GaussianBlur(mask, (0, 0), rng.uniform(0.5, 6))
    factor = 1 - rng.uniform(0.3, 0.7) * mask[..., None]
    return np.asarray(image * factor, np.uint8)


def haze(image: Image, rng: np.random.Generator) -> Image:
    """Mist, or glare of a low sun: light added, most at the top."""
    height = image.shape[0]
    amount = np.linspace(1, rng.uniform(0, 1), height, dtype=np.float32) * rng.uniform(0.1, 0.5)
    veil = rng.uniform(170, 255, 3).astype(np.float32)
    alpha = amount[:, None, None]
    return np.asarray(image * (1 - alpha) + veil * alpha, np.uint8)


def blur(image: Image, rng: np.random.Generator) -> Image:
    """Out of focus, or moving."""
    if rng.random() < 0.5:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), rng.uniform(0.5, 2)), np.uint8)
    length = int(rng.integers(3, 10))
    kernel = np.zeros((length, length), np.float32)
    kernel[length // 2] = 1 / length
    turn = cv2.getRotationMatrix2D(((length - 1) / 2, (length - 1) / 2), rng.uniform(0, 180), 1)
    kernel = cv2.warpAffine(kernel, turn, (length, length))
    return np.asarray(cv2.filter2D(image, -1, kernel / max(float(kernel.sum()), 1e-6)), np.uint8)


def low_resolution(image: Image, rng: np.random.Generator) -> Image:
    """As from a camera with fewer pixels."""
    height, width = image.shape[:2]
    factor = rng.uniform(0.35, 0.8)
    small = cv2.resize(image, (int(width * factor), int(height * factor)), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(small, (width, height)), np.uint8)


def noise(image: Image, rng: np.random.Generator) -> Image:
    """Sensor noise of a dark scene."""
    sigma = rng.uniform(3, 14)
    grain = rng.standard_normal(image.shape, dtype=np.float32) * np.float32(sigma)
    return np.clip(image + grain, 0, 255).astype(np.uint8)


def jpeg(image: Image, rng: np.random.Generator) -> Image:
    """Compression as in a recording."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(20, 80))])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


def covered(size: tuple[int, int], rng: np.random.Generator) -> Image:
    """What a camera gives that sees nothing: one colour, often black, a soft gradient, and noise.

    A network that has seen lawns at night would take a covered lens for one; it must not.
    """
    width, height = size
    level = rng.uniform(0, 25) if rng.random() < 0.7 else rng.uniform(0, 255)
    color = np.clip(level + rng.normal(0, 6, 3), 0, 255)
    slope = np.linspace(-1, 1, height)[:, None] * rng.normal(0, 8) + np.linspace(-1, 1, width) * rng.normal(
        0, 8
    )
    grain = rng.standard_normal((height, width, 3), dtype=np.float32) * rng.choice([2.0, 6.0, 12.0, 25.0])
    if rng.random() < 0.4:  # noise of a coarser grain, as after compression or enlargement
        grain = cv2.GaussianBlur(grain, (0, 0), rng.uniform(0.5, 1.5)) * 2
    return np.clip(color + slope[..., None] + grain, 0, 255).astype(np.uint8)


def paste(image: Image, codes: Image, donor: Image, donor_codes: Image, code: int) -> tuple[Image, Image]:
    """Put what the donor has of one class (a rare one) into the image; its outline becomes void."""
    mask = (donor_codes == code).astype(np.uint8)
    inside = mask.view(np.bool_)
    ring = cv2.dilate(mask, np.ones((3, 3), np.uint8)).view(np.bool_) & ~inside
    image, codes = image.copy(), codes.copy()
    image[inside], codes[inside], codes[ring] = donor[inside], code, VOID_ID
    return image, codes
