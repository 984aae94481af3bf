"""The ground of a lot: its height, where it is lawn, and how it looks.

What counts as grass at the border of the lawn is decided here, from the plan and not from the blades:
worn lawn, moss and clover are grass; bare soil, dirt trails, deep leaf litter, ground cover and green carpets
are not. The border strays by 1-2 cm (more at trails), as a mown edge does.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.synth.model import Float32Array
from swardmap.synth.scene.areas import Area, Strip
from swardmap.synth.scene.lawn_look import LawnLook
from swardmap.synth.scene.lot import Lot
from swardmap.synth.scene.noise import smooth_noise, smoothstep
from swardmap.synth.scene.paint import lawn_paint, surface_color
from swardmap.synth.terrain import Surface, Terrain

MARGIN_M = 4.0
BARE_LEVEL = 1.9  # of a field of mean 0 and deviation 1 above which a bare lawn shows its soil


def build_ground(lot: Lot, look: LawnLook, seed: int) -> Terrain:
    """Rasters of the lot and a margin around it.

    Args:
        lot: its plan.
        look: of the lawn.
        seed: of the garden; height, border and look draw from streams of their own.
    """
    low, high = lot.corners_m.min(axis=0) - MARGIN_M, lot.corners_m.max(axis=0) + MARGIN_M
    texel = float(np.clip(np.max(high - low) / 1150, 0.025, 0.04))
    nx, ny = (int(np.ceil(n)) for n in (high - low) / texel)
    origin = (float(low[0]), float(low[1]))
    x, y = np.meshgrid(
        (np.arange(nx, dtype=np.float32) + 0.5) * np.float32(texel) + np.float32(origin[0]),
        (np.arange(ny, dtype=np.float32) + 0.5) * np.float32(texel) + np.float32(origin[1]),
    )
    field, surface = _cover(lot, look, x, y, texel, np.random.default_rng([seed, 11]))
    lawn = signed_distance_m(-field, texel)
    height = _height(lot, x, y, lawn, texel, np.random.default_rng([seed, 12]))
    rng = np.random.default_rng([seed, 13])
    paint = lawn_paint(look, x, y, lawn, texel, rng)
    albedo = surface_color(surface, x, y, texel, rng)
    grass = lawn > -texel  # a texel more, so that the border is not darkened by its neighbour
    albedo[grass] = paint.albedo[grass]
    blank = np.where(lawn > -1.5 * texel, np.float32(1), np.float32(0))
    return Terrain(
        origin, texel, height, lawn, surface, np.clip(albedo, 0.004, 0.9),
        paint.blade_height_m * blank, paint.blade_density * blank, paint.dryness,
    )  # fmt: skip


def signed_distance_m(field_m: Float32Array, texel_m: float) -> Float32Array:
    """Distance to where a smooth field crosses zero, with the field's sign.

    Near the border it is the field over its slope, so that the border lies between texels where the field
    has it; farther off it is the distance to the nearest texel of the other side (half a texel is its error).
    """
    inside = field_m > 0
    if inside.all() or not inside.any():
        return np.where(inside, np.float32(1e3), np.float32(-1e3))
    away = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    away -= cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    far = (away - np.sign(away) * np.float32(0.5)) * np.float32(texel_m)
    gy, gx = np.gradient(field_m, np.float32(texel_m))
    near = field_m / np.maximum(np.hypot(gx, gy), np.float32(0.2))
    near = np.clip(near, -1.5 * texel_m, 1.5 * texel_m)
    mixed = np.where(np.abs(away) <= 1.5, near, far)
    tiny = np.float32(1e-6)
    signed: Float32Array = np.where(inside, np.maximum(mixed, tiny), np.minimum(mixed, -tiny)).astype(
        np.float32
    )
    return signed


def _cover(
    lot: Lot, look: LawnLook, x: Float32Array, y: Float32Array, texel: float, rng: np.random.Generator
) -> tuple[Float32Array, NDArray[np.uint8]]:
    """A field that is positive where it is not lawn, and the surface there."""
    shape = x.shape
    stray = smooth_noise(shape, texel, 0.35, rng, 3)
    sway = smooth_noise(shape, texel, 1.6, rng, 2)
    field = np.full(shape, -10, np.float32)
    surface = np.full(shape, Surface.LAWN, np.uint8)
    for area in lot.areas:
        distance = area.shape.distance_m(x, y) + np.float32(area.rough_m) * _stray(area, stray, sway)
        surface[distance > -2 * texel] = area.surface  # the texture reaches under the lawn's edge
        field = np.maximum(field, distance)
    if look.bare > 0:
        where = smooth_noise(shape, texel, 9, rng, 1)  # spots come in groups, most of the lawn has none
        level = BARE_LEVEL + np.float32(0.5 * (1 - look.bare)) - np.clip(where - 1, -1.2, 0.6)
        soil = (smooth_noise(shape, texel, 1.6, rng, 4) - level) * np.float32(0.3)
        surface[(soil > -0.05) & (field < -0.05)] = Surface.DIRT
        field = np.maximum(field, soil)
    return field, surface


def _stray(area: Area, stray: Float32Array, sway: Float32Array) -> Float32Array:
    """How a border strays: trails sway, edges of beds are only rough."""
    trail = isinstance(area.shape, Strip) and area.surface is Surface.DIRT
    return sway + np.float32(0.4) * stray if trail else stray


def _height(
    lot: Lot, x: Float32Array, y: Float32Array, lawn: Float32Array, texel: float, rng: np.random.Generator
) -> Float32Array:
    """Slope, waves of the land, at times a bank, bumps of the lawn; level at buildings, sunk ponds."""
    gentle = 1.0 if lot.house is None else 0.6  # nobody builds on the steepest land
    slope, facing = np.tan(np.deg2rad(min(abs(rng.normal(0, 4)), 7.5) * gentle)), rng.uniform(0, 2 * np.pi)
    z = np.float32(slope) * (x * np.float32(np.cos(facing)) + y * np.float32(np.sin(facing)))
    z += np.float32(rng.uniform(0.03, 0.12)) * smooth_noise(x.shape, texel, 14, rng, 2)
    if rng.random() < 0.35:
        z += _bank(lot, x, y, rng)
    bumps = np.float32(rng.uniform(0.005, 0.012)) * smooth_noise(x.shape, texel, 1.4, rng, 3)
    soft = smoothstep(-0.15, 0.25, lawn)
    for box, blend in lot.flats:
        into = box.distance_m(x, y)
        weight = smoothstep(-blend, 0.0, into)
        level = np.float32(z[into > 0].mean()) if (into > 0).any() else np.float32(0)
        z += weight * (level - z)
        bumps *= 1 - smoothstep(-0.3, 0.0, into)
    z += bumps * (np.float32(0.25) + np.float32(0.75) * soft)
    for area in lot.areas:
        if area.sunk_m > 0:
            _sink(area, z, x, y)
    return z.astype(np.float32)


def _sink(area: Area, z: Float32Array, x: Float32Array, y: Float32Array) -> None:
    """Press an area down in place; water is level, its banks reach half a metre into the land."""
    into = area.shape.distance_m(x, y)
    if area.surface is Surface.WATER and (into > 0).any():
        level = np.float32(z[into > 0].mean() - area.sunk_m)
        z += smoothstep(-0.9, -0.05, into) * (level - z)
    else:
        z -= np.float32(area.sunk_m) * smoothstep(-0.05, 0.3, into)


def _bank(lot: Lot, x: Float32Array, y: Float32Array, rng: np.random.Generator) -> Float32Array:
    """A step in the land, 0.25-0.7 m high and 12-22 degrees steep, off the middle."""
    facing, rise = rng.uniform(0, 2 * np.pi), rng.uniform(0.25, 0.7)
    steep = np.tan(np.deg2rad(rng.uniform(12, 22)))
    off = rng.uniform(0.1, 0.35) * float(np.ptp(lot.corners_m, axis=0).min())
    along = x * np.float32(np.cos(facing)) + y * np.float32(np.sin(facing)) - np.float32(off)
    run = 1.5 * rise / steep  # the steepest part of a smooth step is 1.5 times its mean
    return np.float32(rise) * smoothstep(-run / 2, run / 2, along)
