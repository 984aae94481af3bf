"""What a stereo depth camera does to true depth: noise that grows with z squared, holes, flying pixels."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.types import Frame

EDGE_RELATIVE = 0.05  # a step of this share of the depth is an edge


@dataclass(frozen=True, slots=True)
class StereoNoise:
    """Faults of the sensor.

    Attributes:
        sigma_m_at_1m: standard deviation at 1 m; it grows with the square of the depth.
        dropout: share of the pixels in holes.
        flying: share of the pixels at depth edges that float between front and back.
    """

    sigma_m_at_1m: float = 0.002
    dropout: float = 0.02
    flying: float = 0.4

    def __post_init__(self) -> None:
        shares = (self.dropout, self.flying)
        if not (np.isfinite(self.sigma_m_at_1m) and self.sigma_m_at_1m >= 0):
            raise InvalidValueError(f"noise: expected a sigma of 0 m or more, got {self.sigma_m_at_1m}")
        if not all(0 <= share <= 1 for share in shares):
            raise InvalidValueError(f"noise: expected shares in 0..1, got {shares}")


def with_sensor_noise(frame: Frame, rng: np.random.Generator, noise: StereoNoise | None = None) -> Frame:
    """The same frame through a worse sensor; colour, labels and pose stay.

    Args:
        frame: with true depth.
        rng: source of chance.
        noise: how bad; None = StereoNoise().

    Returns:
        Frame with depth of the same type; no reading where there was none.
    """
    noise = noise or StereoNoise()
    truth = frame.depth_m.astype(np.float64)
    depth = _with_flying_pixels(truth, rng, noise.flying)
    depth = depth + rng.standard_normal(depth.shape) * noise.sigma_m_at_1m * np.square(depth)
    depth[_holes(depth.shape, rng, noise.dropout) | ~(depth > 0)] = 0
    if frame.depth.dtype == np.float32:
        return replace(frame, depth=depth.astype(np.float32))
    units = np.rint(depth / frame.depth_unit_m)
    return replace(frame, depth=np.where(units <= 65535, units, 0).astype(np.uint16))


def _with_flying_pixels(
    depth: NDArray[np.float64], rng: np.random.Generator, share: float
) -> NDArray[np.float64]:
    """Set some of the pixels at edges to a depth between the nearest and the farthest neighbour."""
    padded = np.pad(depth, 1, constant_values=np.nan)
    h, w = depth.shape
    around = [padded[i : i + h, j : j + w] for i in range(3) for j in range(3)]
    near, far = around[0], around[0]
    for other in around[1:]:
        near, far = np.fmin(near, other), np.fmax(far, other)
    edge = (far - near > EDGE_RELATIVE * near) & (rng.random(depth.shape) < share) & np.isfinite(depth)
    between = near + rng.random(depth.shape) * (far - near)
    return np.where(edge, between, depth)


def _holes(shape: tuple[int, ...], rng: np.random.Generator, share: float) -> NDArray[np.bool_]:
    """Blobs that cover a share of the image: the lowest values of blurred noise."""
    if share <= 0:
        return np.zeros(shape, bool)
    h, w = shape
    coarse = rng.standard_normal((h // 8 + 2, w // 8 + 2))
    rows, columns = np.linspace(0, h // 8 + 0.999, h), np.linspace(0, w // 8 + 0.999, w)
    i, j = rows.astype(int)[:, None], columns.astype(int)[None, :]
    a, b = (rows % 1)[:, None], (columns % 1)[None, :]
    top = coarse[i, j] * (1 - b) + coarse[i, j + 1] * b
    bottom = coarse[i + 1, j] * (1 - b) + coarse[i + 1, j + 1] * b
    field = top * (1 - a) + bottom * a
    holes: NDArray[np.bool_] = field <= np.quantile(field, share)
    return holes
