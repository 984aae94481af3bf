"""Colour of the ground: lawn with its stripes and patches, and every other surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.synth.model import Float32Array
from swardmap.synth.scene.lawn_look import SOIL, STRAW, LawnLook, linear_of_hsv
from swardmap.synth.scene.noise import smooth_noise, smoothstep
from swardmap.synth.terrain import Surface

CLOVER_HUE, MOSS_HUE = 98.0, 66.0  # of their leaves, sRGB degrees


@dataclass(frozen=True, slots=True, eq=False)
class LawnPaint:
    """Rasters of a lawn, as if it were everywhere; see Ground for their meaning."""

    albedo: Float32Array
    blade_height_m: Float32Array
    blade_density: Float32Array
    dryness: Float32Array


def lawn_paint(
    look: LawnLook, x: Float32Array, y: Float32Array, lawn_m: Float32Array, texel_m: float,
    rng: np.random.Generator,
) -> LawnPaint:  # fmt: skip
    """Colour and blades of a lawn.

    Args:
        look: of the lawn.
        x: of each texel, metres.
        y: of each texel, metres.
        lawn_m: distance to its border.
        texel_m: edge of a texel.
        rng: source of chance.
    """
    shape = x.shape
    broad, middle = smooth_noise(shape, texel_m, 6, rng, 3), smooth_noise(shape, texel_m, 1.2, rng, 4)
    patch = [smooth_noise(shape, texel_m, w, rng, 4) for w in (2.5, 1.6, 3.5)]
    albedo = _greens(look, broad, middle)
    height = look.height_m * np.clip(1 + 0.18 * broad + 0.15 * middle, 0.4, 1.8)
    density = np.clip(look.density * (1 + 0.12 * middle), 0.15, 1)
    cut = {0.02: 2.6, 0.1: 1.5, 0.3: 0.7, 0.6: -0.1}.get(look.dry, 1.5)
    dryness = np.clip((0.9 * broad + 0.6 * patch[0] - cut) * 0.28, 0, 0.85) + np.float32(0.04)
    if look.stripe > 0:
        across = x * np.float32(np.cos(look.stripe_rad)) + y * np.float32(np.sin(look.stripe_rad))
        wave = np.tanh(3 * np.sin((across + 0.03 * broad) * np.float32(np.pi / look.stripe_m)))
        albedo *= (1 + np.float32(look.stripe) * wave)[..., None]
    if look.moss > 0:
        moss = np.float32(look.moss) * smoothstep(0.9, 1.8, patch[1])
        albedo = _mixed(albedo, linear_of_hsv(MOSS_HUE, 0.62, 0.42), 0.75 * moss)
        height, density = height * (1 - 0.6 * moss), density * (1 - 0.35 * moss)
    if look.clover > 0:
        clover = np.float32(look.clover) * smoothstep(0.8, 1.4, patch[2])
        albedo = _mixed(albedo, linear_of_hsv(CLOVER_HUE, 0.5, 0.36), 0.7 * clover)
        height = height * (1 - clover) + clover * min(0.05, look.height_m)
        dryness = dryness * (1 - 0.8 * clover)
    wear = _wear(look, x, y, lawn_m, rng)
    height, density = height * (1 - 0.65 * wear), density * (1 - 0.55 * wear)
    dryness = np.clip(dryness + 0.25 * wear, 0, 0.95)
    albedo = _mixed(albedo, STRAW, np.clip(dryness, 0, 0.9) * 0.9)
    albedo = _mixed(albedo, SOIL, 0.45 * wear)
    return LawnPaint(
        albedo, np.clip(height, 0.008, 0.14).astype(np.float32), density.astype(np.float32),
        dryness.astype(np.float32),
    )  # fmt: skip


def _greens(look: LawnLook, broad: Float32Array, middle: Float32Array) -> Float32Array:
    """The lawn's colour, between a darker, bluer and a lighter, yellower green."""
    dark = np.array(linear_of_hsv(look.hue_deg + 6, min(look.saturation + 0.06, 0.68), look.value * 0.86))
    light = np.array(linear_of_hsv(look.hue_deg - 5, max(look.saturation - 0.05, 0.25), look.value * 1.12))
    t = np.clip(0.5 + 0.2 * broad + 0.2 * middle, 0, 1)[..., None]
    greens: Float32Array = (dark * (1 - t) + light * t).astype(np.float32)
    return greens


def _wear(
    look: LawnLook, x: Float32Array, y: Float32Array, lawn_m: Float32Array, rng: np.random.Generator
) -> Float32Array:
    """0..1: worn lines across the lawn and wheel tracks; the lawn's border suffers a little too."""
    worn = np.float32(0.25) * (1 - smoothstep(0.0, 0.12, lawn_m))
    span = float(max(np.ptp(x[0]), np.ptp(y[:, 0])))
    turns, shifts = rng.uniform(0, np.pi, 2), rng.uniform(-0.25, 0.25, 2) * span
    for k, (on, half_m, gauge) in enumerate(
        ((look.worn, rng.uniform(0.15, 0.35), 0.0), (0.55 * look.tracks, 0.06, rng.uniform(0.3, 0.5)))
    ):
        if on > 0:
            c, s = np.float32(np.cos(turns[k])), np.float32(np.sin(turns[k]))
            along, across = c * x + s * y, -s * x + c * y - np.float32(shifts[k])
            across = across + np.float32(0.9) * np.sin(along * np.float32(0.21) + np.float32(k))
            lines = np.abs(np.abs(across) - np.float32(gauge))
            worn = np.maximum(worn, np.float32(on) * (1 - smoothstep(half_m * 0.4, half_m * 1.6, lines)))
    return worn


def surface_color(
    surface: NDArray[np.uint8], x: Float32Array, y: Float32Array, texel_m: float, rng: np.random.Generator
) -> Float32Array:
    """Linear RGB of all that is not lawn, each surface with its own tint and grain."""
    fine = rng.standard_normal(surface.shape, np.float32)
    rough, blotch = (
        smooth_noise(surface.shape, texel_m, 0.5, rng, 2),
        smooth_noise(surface.shape, texel_m, 2, rng, 3),
    )
    albedo = np.zeros((*surface.shape, 3), np.float32)
    for kind in Surface:
        base, (grain, patchy) = _tint(kind, rng)
        here = surface == kind
        if not here.any():
            continue
        shade = (
            1 + np.float32(grain) * (0.6 * fine[here] + 0.6 * rough[here]) + np.float32(patchy) * blotch[here]
        )
        if kind in (Surface.PAVING, Surface.WOOD):
            shade = shade * _joints(kind, x[here], y[here], rng)
        albedo[here] = np.asarray(base, np.float32) * np.clip(shade, 0.25, 2)[:, None]
    return albedo


def _tint(kind: Surface, rng: np.random.Generator) -> tuple[NDArray[np.float64], tuple[float, float]]:
    """Colour of a surface by chance, and how much it varies by texel and by patch."""
    k, warm = rng.uniform(0.75, 1.25), rng.uniform(-1, 1)
    base, grain, patchy = {
        Surface.LAWN: ((0.10, 0.14, 0.04), 0.1, 0.1),
        Surface.GRAVEL: ((0.33, 0.30, 0.26), 0.3, 0.06),
        Surface.PAVING: ((0.36, 0.33, 0.30), 0.08, 0.06),
        Surface.DIRT: ((0.19, 0.135, 0.09), 0.16, 0.15),
        Surface.MULCH: ((0.10, 0.06, 0.04), 0.4, 0.12),
        Surface.SAND: ((0.46, 0.38, 0.26), 0.06, 0.05),
        Surface.CONCRETE: ((0.38, 0.37, 0.35), 0.05, 0.08),
        Surface.WOOD: ((0.27, 0.17, 0.10), 0.12, 0.08),
        Surface.WATER: ((0.03, 0.045, 0.035), 0.05, 0.1),
        Surface.GROUND_COVER: (linear_of_hsv(95 + 18 * warm, 0.52, 0.34), 0.3, 0.15),
        Surface.CARPET: (linear_of_hsv(97 + 15 * warm, 0.48, 0.33), 0.06, 0.03),
        Surface.LEAF_LITTER: ((0.25, 0.13, 0.05), 0.4, 0.15),
    }[kind]
    color = np.array(base) * k
    if kind not in (Surface.CARPET, Surface.GROUND_COVER):
        color *= 1 + 0.08 * warm * np.array([1, 0, -1])
    return color, (grain, patchy)


def _joints(kind: Surface, x: Float32Array, y: Float32Array, rng: np.random.Generator) -> Float32Array:
    """Dark lines between slabs or boards."""
    turn, width = rng.uniform(0, np.pi / 2), rng.uniform(0.3, 0.6)
    u = x * np.float32(np.cos(turn)) + y * np.float32(np.sin(turn))
    v = -x * np.float32(np.sin(turn)) + y * np.float32(np.cos(turn))
    if kind is Surface.WOOD:
        return np.where((u % 0.145) < 0.03, np.float32(0.5), np.float32(1))
    row = np.floor(v / np.float32(width))
    tone = 1 + np.float32(0.07) * np.sin(
        row * 12.9 + np.floor(u / np.float32(width) + 0.5 * (row % 2)) * 78.2
    )
    joint = ((u / np.float32(width) + 0.5 * (row % 2)) % 1 < 0.06) | ((v / np.float32(width)) % 1 < 0.06)
    return np.where(joint, np.float32(0.55), tone.astype(np.float32))


def _mixed(
    albedo: Float32Array, color: tuple[float, float, float], share: NDArray[np.floating]
) -> Float32Array:
    """Part of the way to a colour."""
    mixed: Float32Array = albedo + share[..., None].astype(np.float32) * (
        np.asarray(color, np.float32) - albedo
    )
    return mixed
