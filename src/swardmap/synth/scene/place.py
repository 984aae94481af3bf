"""Where things may stand, and how they meet the ground."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.synth.model import Float64Array, Model
from swardmap.synth.shapes import placed
from swardmap.synth.terrain import Terrain

XY = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Footprint:
    """The turned rectangle that a thing takes up on the ground."""

    center_m: XY
    half_m: XY
    yaw_rad: float = 0.0

    def corners_m(self) -> Float64Array:
        """4 x 2, counter-clockwise."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        local = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * self.half_m
        corners: Float64Array = local @ np.array([[c, s], [-s, c]]) + self.center_m
        return corners


class Occupancy:
    """Footprints that are taken."""

    def __init__(self) -> None:
        self._rows = np.zeros((0, 5))

    def take(self, footprint: Footprint) -> None:
        """Take a footprint."""
        self._rows = np.concatenate([self._rows, _row(footprint)[None]])

    def gap_m(self, footprint: Footprint) -> float:
        """Widest of the separating gaps to the nearest footprint taken; negative = they overlap by that.

        It is not more than the true distance, by the separating axis theorem.
        """
        if not len(self._rows):
            return float("inf")
        return float(separation_m(_row(footprint), self._rows).min())


def separation_m(one: Float64Array, many: Float64Array) -> Float64Array:
    """Gaps of a turned rectangle to others along the best of their four axes; negative = overlap.

    Args:
        one: (5,): centre x, y, half sizes, yaw.
        many: n x 5, the same.
    """
    away = many[:, :2] - one[:2]
    best = np.full(len(many), -np.inf)
    for yaw in (np.broadcast_to(one[4], len(many)), many[:, 4]):
        for turn in (0.0, np.pi / 2):
            c, s = np.cos(yaw + turn), np.sin(yaw + turn)
            distance = np.abs(away[:, 0] * c + away[:, 1] * s)
            gap = distance - _reach(np.broadcast_to(one, many.shape), yaw + turn) - _reach(many, yaw + turn)
            best = np.maximum(best, gap)
    return best


def footprint_of(
    model: Model, xy: XY, yaw_rad: float, scale: float = 1.0, below_m: float = np.inf
) -> Footprint:
    """The rectangle around a model's vertices, or around those below a height (a trunk, not its crown)."""
    xyz = np.concatenate([mesh.xyz for mesh in model.meshes]).astype(np.float64)
    part = xyz[xyz[:, 2] <= xyz[:, 2].min() + below_m, :2] * scale
    low, high = part.min(axis=0), part.max(axis=0)
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    middle = np.array([[c, -s], [s, c]]) @ ((low + high) / 2) + xy
    half = np.maximum((high - low) / 2, 0.01)
    return Footprint((float(middle[0]), float(middle[1])), (float(half[0]), float(half[1])), yaw_rad)


def upright(
    ground: Terrain, model: Model, xy: XY, yaw_rad: float, scale: float = 1.0, sink_m: float = 0.01
) -> Float64Array:
    """T_map_model of something that stays vertical: its base touches the lowest ground below it.

    Args:
        ground: to stand on.
        model: with its origin at the ground.
        xy: where its origin goes.
        yaw_rad: its heading.
        scale: of all axes.
        sink_m: how far the base is let into the ground.
    """
    base = _base(model) * scale
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    at = base[:, :2] @ np.array([[c, s], [-s, c]]) + xy
    z = float((ground.height_at(at) - base[:, 2]).min()) - sink_m
    return placed(*xy, z, yaw_rad, scale)


def tilted(ground: Terrain, model: Model, xy: XY, yaw_rad: float, scale: float = 1.0) -> Float64Array:
    """T_map_model of something that leans with the ground: its lowest points lie on it or just in it."""
    base = _base(model) * scale
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    at = (base @ turn.T)[:, :2] + xy
    span = max(float(np.ptp(at, axis=0).max()), 0.12)
    offsets = np.array([(dx, dy) for dx in (-0.5, 0, 0.5) for dy in (-0.5, 0, 0.5)]) * span
    middle = (at.min(axis=0) + at.max(axis=0)) / 2
    heights = ground.height_at(middle + offsets)
    (gx, gy, _), *_ = np.linalg.lstsq(np.column_stack([offsets, np.ones(9)]), heights, rcond=None)
    normal = np.array([-gx, -gy, 1.0]) / np.sqrt(gx * gx + gy * gy + 1)
    T = np.eye(4)
    T[:3, :3] = _rotation_to(normal) @ turn * scale
    T[:2, 3] = xy
    foot = base / scale @ T[:3, :3].T + T[:3, 3]
    T[2, 3] = float((ground.height_at(foot[:, :2]) - foot[:, 2]).min()) + 0.005
    return T


def sunk_m(ground: Terrain, model: Model, T_map_model: Float64Array) -> float:
    """How far the deepest of a model's lowest points lies below the ground; negative = they all hover."""
    base = _base(model) @ T_map_model[:3, :3].T + T_map_model[:3, 3]
    return float((ground.height_at(base[:, :2]) - base[:, 2]).max())


def _base(model: Model) -> Float64Array:
    """Vertices within 1.5 cm of the lowest, at most some hundred."""
    xyz = np.concatenate([mesh.xyz for mesh in model.meshes]).astype(np.float64)
    low = xyz[xyz[:, 2] <= xyz[:, 2].min() + 0.015]
    base: Float64Array = low[:: max(1, len(low) // 200)]
    return base


def _rotation_to(normal: Float64Array) -> Float64Array:
    """The smallest rotation that takes z to a direction."""
    x, y, z = normal
    k = 1 / (1 + z)
    return np.array([[1 - k * x * x, -k * x * y, x], [-k * x * y, 1 - k * y * y, y], [-x, -y, z]])


def _row(footprint: Footprint) -> Float64Array:
    return np.array([*footprint.center_m, *footprint.half_m, footprint.yaw_rad])


def _reach(rows: Float64Array, axis_rad: NDArray[np.floating]) -> Float64Array:
    """Half the width of rectangles seen along an axis."""
    turn = rows[:, 4] - axis_rad
    reach: Float64Array = np.abs(np.cos(turn)) * rows[:, 2] + np.abs(np.sin(turn)) * rows[:, 3]
    return reach
