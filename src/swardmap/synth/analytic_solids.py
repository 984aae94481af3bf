"""Solids that can be ray cast in closed form.

A ray is `origin + t * direction`. With directions whose optical z is 1, t is the depth (REP-118).
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.labels import OTHER, LabelClass
from swardmap.synth.analytic_footprints import (
    BoolArray,
    Float64Array,
    ellipse_covers,
    rectangle_covers,
    rotation_z,
)


@dataclass(frozen=True, slots=True)
class Finish:
    """How a surface looks: colour (RGB), texture, and how strongly the texture shows (0..1)."""

    color: tuple[int, int, int]
    texture: str = "plain"  # plain, leaves, wood, bricks, slabs
    grain: float = 0.08


GRAVEL = Finish((168, 158, 142), "slabs", 0.16)
LEAVES = Finish((82, 84, 54), "leaves", 0.85)  # olive: less green than any lawn
WOOD = Finish((142, 104, 70), "wood", 0.25)


class Solid(Protocol):
    """What the renderer and the true map ask of a solid."""

    @property
    def label(self) -> LabelClass:
        """Class of its pixels and cells."""

    @property
    def material(self) -> Finish:
        """How it looks."""

    def intersect(self, origin: Float64Array, directions: Float64Array) -> Float64Array:
        """(N,) smallest t > 0 of rays (N, 3) from origin (3,) or (N, 3); infinity where they miss."""

    def normals(self, points: Float64Array) -> Float64Array:
        """(N, 3) outward unit normals at points (N, 3) on the surface."""

    def bounds(self) -> tuple[Float64Array, Float64Array]:
        """Lower and upper corner (3,) of a box around it."""

    def covers(self, lower: Float64Array, upper: Float64Array, max_height_m: float) -> BoolArray:
        """Whether the part of it below a height stands on each of the rectangles lower..upper (N, 2)."""


@dataclass(frozen=True, slots=True)
class Box:
    """A box that stands upright.

    Attributes:
        center_m: (x, y) of its middle.
        size_m: edges along its own x and y, and its height.
        yaw_deg: turn about z.
        base_m: height of its bottom.
        label, material: class and look.
    """

    center_m: tuple[float, float]
    size_m: tuple[float, float, float]
    yaw_deg: float = 0.0
    base_m: float = 0.0
    label: LabelClass = OTHER
    material: Finish = WOOD

    def __post_init__(self) -> None:
        _check_positive("box", self.size_m)

    @property
    def _half(self) -> Float64Array:
        return np.asarray(self.size_m) / 2

    @property
    def _middle(self) -> Float64Array:
        return np.array([*self.center_m, self.base_m + self.size_m[2] / 2])

    def intersect(self, origin: Float64Array, directions: Float64Array) -> Float64Array:
        """Slabs: enter the last of three pairs of planes before leaving the first."""
        turn = rotation_z(self.yaw_deg)
        start, along = (origin - self._middle) @ turn, directions @ turn
        enter, leave = np.full(len(directions), -np.inf), np.full(len(directions), np.inf)
        with np.errstate(all="ignore"):  # a ray along a face meets its plane infinitely far away
            for half, s, d in zip(self._half, _split(start), _split(along), strict=True):
                a, b = (-half - s) / d, (half - s) / d
                enter = np.fmax(enter, np.fmin(a, b))  # fmax: a ray in a face gives 0/0, no limit
                leave = np.fmin(leave, np.fmax(a, b))
        t = np.where(enter > 0, enter, leave)
        return np.where((enter <= leave) & (leave > 0), t, np.inf)

    def normals(self, points: Float64Array) -> Float64Array:
        """Along the axis whose face is nearest."""
        turn = rotation_z(self.yaw_deg)
        local = (points - self._middle) @ turn
        axis = np.argmin(np.abs(np.abs(local) - self._half), axis=1)
        flat = np.zeros_like(local)
        rows = np.arange(len(local))
        flat[rows, axis] = np.sign(local[rows, axis])
        outward: Float64Array = flat @ turn.T
        return outward

    def bounds(self) -> tuple[Float64Array, Float64Array]:
        """Of the turned box."""
        reach = np.abs(rotation_z(self.yaw_deg)) @ self._half
        return self._middle - reach, self._middle + reach

    def covers(self, lower: Float64Array, upper: Float64Array, max_height_m: float) -> BoolArray:
        """By separating axes."""
        if self.base_m >= max_height_m:
            return np.zeros(len(lower), bool)
        return rectangle_covers(self.center_m, self.size_m[:2], self.yaw_deg, lower, upper)


@dataclass(frozen=True, slots=True)
class Cylinder:
    """An upright cylinder: a pole, a trunk, a leg.

    Attributes:
        center_m: (x, y) of its axis.
        radius_m: of its circle.
        height_m: from bottom to top.
        base_m: height of its bottom.
        label, material: class and look.
    """

    center_m: tuple[float, float]
    radius_m: float
    height_m: float
    base_m: float = 0.0
    label: LabelClass = OTHER
    material: Finish = WOOD

    def __post_init__(self) -> None:
        _check_positive("cylinder", (self.radius_m, self.height_m))

    def intersect(self, origin: Float64Array, directions: Float64Array) -> Float64Array:
        """Between the two crossings of the endless cylinder and the two of its caps."""
        start = origin - np.array([*self.center_m, self.base_m])
        (sx, sy, sz), (dx, dy, dz) = _split(start), _split(directions)
        side = _between_roots(dx * dx + dy * dy, dx * sx + dy * sy, sx * sx + sy * sy - self.radius_m**2)
        with np.errstate(all="ignore"):  # a level ray meets the caps infinitely far away
            a, b = -sz / dz, (self.height_m - sz) / dz
        enter = np.fmax(side[0], np.fmin(a, b))
        leave = np.fmin(side[1], np.fmax(a, b))
        t = np.where(enter > 0, enter, leave)
        return np.where((enter <= leave) & (leave > 0), t, np.inf)

    def normals(self, points: Float64Array) -> Float64Array:
        """Radial on the side, up or down on the caps."""
        local: Float64Array = points - np.array([*self.center_m, self.base_m])
        radial = local.copy()
        radial[:, 2] = 0
        length = np.linalg.norm(radial, axis=1, keepdims=True)
        radial /= np.maximum(length, 1e-12)
        to_side = np.abs(length[:, 0] - self.radius_m)
        to_top, to_bottom = np.abs(local[:, 2] - self.height_m), np.abs(local[:, 2])
        radial[to_top < np.minimum(to_side, to_bottom)] = (0, 0, 1)
        radial[to_bottom < np.minimum(to_side, to_top)] = (0, 0, -1)
        return radial

    def bounds(self) -> tuple[Float64Array, Float64Array]:
        """Of the cylinder."""
        x, y = self.center_m
        r, low, high = self.radius_m, self.base_m, self.base_m + self.height_m
        return np.array([x - r, y - r, low]), np.array([x + r, y + r, high])

    def covers(self, lower: Float64Array, upper: Float64Array, max_height_m: float) -> BoolArray:
        """Its circle."""
        if self.base_m >= max_height_m:
            return np.zeros(len(lower), bool)
        return ellipse_covers(self.center_m, (self.radius_m, self.radius_m), lower, upper)


@dataclass(frozen=True, slots=True)
class Ellipsoid:
    """An ellipsoid along the axes: a ball, a bush, the crown of a tree, a body.

    Attributes:
        center_m: (x, y, z) of its middle.
        radii_m: along x, y and z.
        label, material: class and look.
    """

    center_m: tuple[float, float, float]
    radii_m: tuple[float, float, float]
    label: LabelClass = OTHER
    material: Finish = LEAVES

    def __post_init__(self) -> None:
        _check_positive("ellipsoid", self.radii_m)

    def intersect(self, origin: Float64Array, directions: Float64Array) -> Float64Array:
        """The unit sphere, after a division by the radii."""
        radii = np.asarray(self.radii_m)
        start, along = (origin - np.asarray(self.center_m)) / radii, directions / radii
        (sx, sy, sz), (dx, dy, dz) = _split(start), _split(along)
        enter, leave = _between_roots(
            dx * dx + dy * dy + dz * dz, dx * sx + dy * sy + dz * sz, sx * sx + sy * sy + sz * sz - 1
        )
        t = np.where(enter > 0, enter, leave)
        return np.where((enter <= leave) & (leave > 0), t, np.inf)

    def normals(self, points: Float64Array) -> Float64Array:
        """Gradient of the quadric."""
        gradient = (points - np.asarray(self.center_m)) / np.square(self.radii_m)
        unit: Float64Array = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
        return unit

    def bounds(self) -> tuple[Float64Array, Float64Array]:
        """Of the ellipsoid."""
        center, radii = np.asarray(self.center_m), np.asarray(self.radii_m)
        return center - radii, center + radii

    def covers(self, lower: Float64Array, upper: Float64Array, max_height_m: float) -> BoolArray:
        """Widest section below the height, and above the ground."""
        z, rz = self.center_m[2], self.radii_m[2]
        widest = min(max(z, 0.0), max_height_m)  # the height at which the section is widest
        share = 1 - ((widest - z) / rz) ** 2
        if share <= 0:
            return np.zeros(len(lower), bool)
        radii = (self.radii_m[0] * share**0.5, self.radii_m[1] * share**0.5)
        return ellipse_covers(self.center_m[:2], radii, lower, upper)


def sphere(
    center_m: tuple[float, float, float],
    radius_m: float,
    label: LabelClass = OTHER,
    material: Finish = LEAVES,
) -> Ellipsoid:
    """An ellipsoid of three equal radii."""
    return Ellipsoid(center_m, (radius_m, radius_m, radius_m), label, material)


@dataclass(frozen=True, slots=True)
class Patch:
    """A flat rectangle of another class in the lawn: a path, a terrace.

    Attributes:
        center_m: (x, y) of its middle.
        size_m: edges along its own x and y.
        yaw_deg: turn about z.
        label, material: class and look.
    """

    center_m: tuple[float, float]
    size_m: tuple[float, float]
    yaw_deg: float = 0.0
    label: LabelClass = OTHER
    material: Finish = GRAVEL

    def __post_init__(self) -> None:
        _check_positive("patch", self.size_m)

    def local(self, xy: Float64Array) -> Float64Array:
        """Points (N, 2) of the ground, in the patch's own axes."""
        turned: Float64Array = (xy - np.asarray(self.center_m)) @ rotation_z(self.yaw_deg)[:2, :2]
        return turned

    def contains(self, xy: Float64Array) -> BoolArray:
        """Whether points (N, 2) of the ground lie in it."""
        inside: BoolArray = np.all(np.abs(self.local(xy)) <= np.asarray(self.size_m) / 2, axis=-1)
        return inside

    def covers(self, lower: Float64Array, upper: Float64Array) -> BoolArray:
        """Whether it has a part in each of the rectangles lower..upper (N, 2)."""
        return rectangle_covers(self.center_m, self.size_m, self.yaw_deg, lower, upper)


def _between_roots(a: Float64Array, b: Float64Array, c: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Where a t^2 + 2 b t + c < 0: from, to; from > to where nowhere."""
    with np.errstate(all="ignore"):
        root = np.sqrt(b * b - a * c)  # NaN: no crossing
        enter, leave = (-b - root) / a, (-b + root) / a
    parallel = a < 1e-18  # along the axis of a cylinder: inside for ever, or never
    enter = np.where(parallel, np.where(c < 0, -np.inf, np.inf), enter)
    leave = np.where(parallel, np.where(c < 0, np.inf, -np.inf), leave)
    miss = np.isnan(enter)
    return np.where(miss, np.inf, enter), np.where(miss, -np.inf, leave)


def _split(v: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    return v[..., 0], v[..., 1], v[..., 2]


def _check_positive(what: str, sizes: tuple[float, ...]) -> None:
    if not (np.isfinite(sizes).all() and min(sizes) > 0):
        raise InvalidValueError(f"{what}: expected positive sizes in metres, got {sizes}")
