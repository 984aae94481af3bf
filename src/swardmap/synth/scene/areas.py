"""Parts of the lot: rectangles, blobs and strips, each with its distance to the border."""

from dataclasses import dataclass

import numpy as np

from swardmap.synth.model import Float32Array, Float64Array
from swardmap.synth.terrain import Surface

XY = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A turned rectangle; `half_m` along its own x and y."""

    center_m: XY
    half_m: XY
    yaw_rad: float

    def distance_m(self, x: Float32Array, y: Float32Array) -> Float32Array:
        """Signed distance to the border, positive inside."""
        u, v = _turned(x, y, self.center_m, self.yaw_rad)
        a, b = np.abs(u) - np.float32(self.half_m[0]), np.abs(v) - np.float32(self.half_m[1])
        outside = np.hypot(np.maximum(a, 0), np.maximum(b, 0))
        return -(outside + np.minimum(np.maximum(a, b), 0))

    def corners_m(self) -> Float64Array:
        """4 x 2, counter-clockwise."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        local = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * self.half_m
        corners: Float64Array = local @ np.array([[c, s], [-s, c]]) + self.center_m
        return corners


@dataclass(frozen=True, slots=True)
class Blob:
    """A turned ellipse whose edge is wavy."""

    center_m: XY
    half_m: XY
    yaw_rad: float
    wave: float = 0.1
    phase_rad: float = 0.0

    def distance_m(self, x: Float32Array, y: Float32Array) -> Float32Array:
        """Distance to the border, positive inside; right to some per cent near it."""
        u, v = _turned(x, y, self.center_m, self.yaw_rad)
        a, b = (np.float32(h) for h in self.half_m)
        angle = np.arctan2(v / b, u / a)
        reach = 1 + np.float32(self.wave) * (
            np.sin(2 * angle + self.phase_rad) + 0.6 * np.sin(5 * angle + 2 * self.phase_rad)
        ).astype(np.float32)
        r = np.hypot(u / a, v / b) / reach
        slope = np.hypot(u / a**2, v / b**2) / np.maximum(r, 1e-6) / reach**2
        return np.asarray((1 - r) / np.maximum(slope, 0.3 / max(self.half_m)), np.float32)


@dataclass(frozen=True, slots=True)
class Strip:
    """A band of a width around a line of points."""

    points_m: tuple[XY, ...]
    width_m: float

    def distance_m(self, x: Float32Array, y: Float32Array) -> Float32Array:
        """Signed distance to the border, positive inside."""
        nearest = np.full(x.shape, np.inf, np.float32)
        for (x0, y0), (x1, y1) in zip(self.points_m[:-1], self.points_m[1:], strict=True):
            dx, dy = x1 - x0, y1 - y0
            t = np.clip(((x - np.float32(x0)) * dx + (y - np.float32(y0)) * dy) / (dx * dx + dy * dy), 0, 1)
            away = np.hypot(x - np.float32(x0) - t * np.float32(dx), y - np.float32(y0) - t * np.float32(dy))
            np.minimum(nearest, away, out=nearest)
        return np.float32(self.width_m / 2) - nearest


Shape = Rectangle | Blob | Strip


@dataclass(frozen=True, slots=True)
class Area:
    """A part of the ground that is not lawn.

    Attributes:
        shape: where.
        surface: covered with what.
        rough_m: how far its border strays.
        sunk_m: how far its middle lies below the lawn around it.
    """

    shape: Shape
    surface: Surface
    rough_m: float = 0.01
    sunk_m: float = 0.0


def _turned(x: Float32Array, y: Float32Array, center: XY, yaw: float) -> tuple[Float32Array, Float32Array]:
    c, s = np.float32(np.cos(yaw)), np.float32(np.sin(yaw))
    dx, dy = x - np.float32(center[0]), y - np.float32(center[1])
    return c * dx + s * dy, c * dy - s * dx


def inside_convex_m(corners_m: Float64Array, x: Float32Array, y: Float32Array) -> Float32Array:
    """Distance to the nearest edge line of a convex outline (counter-clockwise), positive inside."""
    after = np.roll(corners_m, -1, axis=0)
    distance = np.full(x.shape, np.inf, np.float32)
    for (x0, y0), (x1, y1) in zip(corners_m, after, strict=True):
        length = np.hypot(x1 - x0, y1 - y0)
        nx, ny = -(y1 - y0) / length, (x1 - x0) / length
        np.minimum(
            distance,
            np.float32(nx) * (x - np.float32(x0)) + np.float32(ny) * (y - np.float32(y0)),
            out=distance,
        )
    return distance


def curve(points_m: Float64Array, per_span: int = 6) -> Float64Array:
    """A smooth line through points (Catmull-Rom).

    Args:
        points_m: k x d, k >= 2.
        per_span: points from one to the next.

    Returns:
        ((k - 1) * per_span + 1) x d; first and last are those given.
    """
    p = np.concatenate([2 * points_m[:1] - points_m[1:2], points_m, 2 * points_m[-1:] - points_m[-2:-1]])
    t = (np.arange(per_span) / per_span)[:, None]
    spans = [
        0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
        for a, b, c, d in zip(p[:-3], p[1:-2], p[2:-1], p[3:], strict=True)
    ]
    return np.concatenate([*spans, points_m[-1:]])
