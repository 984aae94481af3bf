"""Pictures for OpenGL: mipmaps that keep colours and holes as they are."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.synth.model import Float32Array
from swardmap.synth.render.context import Context

SRGB8_ALPHA8 = 0x8C43
HOLE = 0.4
LEAST = 4  # edge of the smallest mipmap


def mipmaps(rgba: NDArray[np.uint8], cutout: bool) -> list[NDArray[np.uint8]]:
    """A picture and its halves, quarters, ..., row 0 at the bottom as OpenGL has it.

    Colours are averaged in linear light, weighted with alpha, so that the colour of holes does not bleed.
    Of cut-outs, alpha is scaled on each level so that as much of the area is solid as on the first: trees
    keep their leaves far off (Castano 2010).

    Args:
        rgba: H x W x 4, sRGB with straight alpha, row 0 at the top.
        cutout: whether alpha below 0.4 is a hole.
    """
    flipped = np.ascontiguousarray(rgba[::-1])
    levels = [flipped]
    alpha = flipped[..., 3:].astype(np.float32) / 255
    solid = float((alpha >= HOLE).mean()) if cutout else 1.0
    weight = np.maximum(alpha, 1e-3)
    color = (flipped[..., :3].astype(np.float32) / 255) ** 2.2 * weight
    while min(alpha.shape[:2]) >= 2 * LEAST:
        size = (alpha.shape[1] // 2, alpha.shape[0] // 2)
        color = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
        alpha, weight = (
            cv2.resize(a, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], 1)
            for a in (alpha, weight)
        )
        shown = np.clip(alpha * _gain(alpha, solid), 0, 1) if cutout else alpha
        srgb = np.clip(color / weight, 0, 1) ** (1 / 2.2)
        levels.append(np.rint(np.concatenate([srgb, shown], axis=2) * 255).astype(np.uint8))
    return levels


def srgba_of(linear: Float32Array) -> NDArray[np.uint8]:
    """Linear RGB (H x W x 3) as sRGB of 8 bits with an alpha of 1; OpenGL averages it linear again."""
    curve = np.linspace(0, 1, 4096, dtype=np.float32)
    curve = np.where(curve <= 0.0031308, 12.92 * curve, 1.055 * curve ** (1 / 2.4) - 0.055)
    table = np.rint(curve * 255).astype(np.uint8)
    rgba = np.full((*linear.shape[:2], 4), 255, np.uint8)
    rgba[..., :3] = table[np.rint(np.clip(linear, 0, 1) * 4095).astype(np.uint16)]
    return rgba


def _gain(alpha: Float32Array, solid: float) -> float:
    """What alpha is multiplied with, so that the share of solid texels is as wanted."""
    if not 0 < solid < 1:
        return 1.0
    edge = float(np.quantile(alpha, 1 - solid))
    return float(np.clip(HOLE / max(edge, 1e-3), 0.5, 4.0))


def upload(context: Context, rgba: NDArray[np.uint8], cutout: bool) -> Any:
    """A texture with its mipmaps."""
    levels = mipmaps(rgba, cutout)
    h, w = rgba.shape[:2]
    texture = context.texture((w, h), 4, internal_format=SRGB8_ALPHA8)
    texture.build_mipmaps(0, len(levels) - 1)
    for k, level in enumerate(levels):
        texture.write(level.tobytes(), level=k)
    texture.filter = (0x2703, 0x2601)  # GL_LINEAR_MIPMAP_LINEAR, GL_LINEAR
    return texture
