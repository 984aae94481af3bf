"""Fine structure of each surface: factors on the albedo, from photos in the assets or drawn."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from swardmap.synth.assets import Assets
from swardmap.synth.model import Float32Array
from swardmap.synth.render.context import Context
from swardmap.synth.terrain import Surface

SIZE = 512
LARGEST = 3.0
"""Factors are stored as their share of this."""


@dataclass(frozen=True, slots=True, eq=False)
class Details:
    """Layers of an uploaded texture array, one a surface.

    Attributes:
        texture: of OpenGL.
        tile_m: edge of a repeat on the ground, a surface each.
    """

    texture: Any
    tile_m: tuple[float, ...]


def details_of(context: Context, assets: Assets | None, seed: int) -> Details:
    """The fine structure of all surfaces of a garden.

    Args:
        context: where to.
        assets: photos; None = all is drawn.
        seed: chooses among photos of a kind.
    """
    pairs = [_detail(surface, assets, np.random.default_rng([seed, 61, int(surface)])) for surface in Surface]
    layers = [np.rint(np.clip(factor / LARGEST, 0, 1) * 255).astype(np.uint8) for factor, _ in pairs]
    alpha = np.full((SIZE, SIZE, 1), 255, np.uint8)
    data = b"".join(np.concatenate([layer, alpha], axis=2).tobytes() for layer in layers)
    texture = context.texture_array((SIZE, SIZE, len(layers)), 4, data)
    texture.build_mipmaps()
    texture.filter = (0x2703, 0x2601)  # GL_LINEAR_MIPMAP_LINEAR, GL_LINEAR
    return Details(texture, tuple(tile for _, tile in pairs))


def _detail(surface: Surface, assets: Assets | None, rng: np.random.Generator) -> tuple[Float32Array, float]:
    """Factor on the albedo, mean 1 in each channel (SIZE x SIZE x 3), and the edge of a repeat in metres."""
    kind = "grass" if surface is Surface.LAWN else surface.name.lower()
    names = [] if assets is None else sorted(assets.texture_names(kind))
    if surface is Surface.LAWN:
        names = [name for name in names if "detail" in name] or names
    if assets is None or not names:
        return _drawn(surface, rng)
    name = names[int(rng.integers(len(names)))]
    linear = (assets.texture(name).rgba[..., :3].astype(np.float32) / 255) ** np.float32(2.2)
    if linear.shape[:2] != (SIZE, SIZE):
        linear = cv2.resize(linear, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
    factor: Float32Array = linear / np.maximum(linear.mean(axis=(0, 1)), 1e-4)
    return factor, assets.texture_entry(name).tile_m[0]


def _drawn(surface: Surface, rng: np.random.Generator) -> tuple[Float32Array, float]:
    """Grain of many sizes; how much of each depends on the surface."""
    grains = {
        Surface.GRAVEL: ((4, 0.5), (9, 0.4)),
        Surface.LAWN: ((2, 0.3), (6, 0.25), (20, 0.15)),
        Surface.MULCH: ((5, 0.5), (14, 0.4)),
        Surface.LEAF_LITTER: ((9, 0.5), (24, 0.4)),
        Surface.GROUND_COVER: ((7, 0.5), (20, 0.3)),
        Surface.WATER: ((60, 0.05),),
        Surface.CARPET: ((2, 0.12),),
    }.get(surface, ((2, 0.1), (8, 0.1), (40, 0.1)))
    factor = np.ones((SIZE, SIZE), np.float32)
    for grain, strength in grains:
        noise = rng.standard_normal((SIZE, SIZE), np.float32)
        blurred = cv2.GaussianBlur(np.tile(noise, (2, 2)), (0, 0), grain / 2)
        wrapped = blurred[SIZE // 2 : SIZE // 2 + SIZE, SIZE // 2 : SIZE // 2 + SIZE]
        factor += np.float32(strength) * wrapped / max(float(wrapped.std()), 1e-6)
    factor = np.clip(factor, 0.1, LARGEST)
    factor /= factor.mean()
    return np.repeat(factor[..., None], 3, axis=2), 1.0
