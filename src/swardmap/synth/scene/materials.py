"""What things are made of: materials, and the few textures that are drawn."""

from functools import cache

import cv2
import numpy as np

from swardmap.synth.model import Material, Texture
from swardmap.synth.scene.lawn_look import linear_of_hsv

RGB = tuple[float, float, float]
SOIL = Material((0.075, 0.05, 0.035), roughness=1.0)
METAL = Material((0.35, 0.36, 0.37), specular=0.5, roughness=0.4)
DARK_METAL = Material((0.03, 0.035, 0.035), specular=0.35, roughness=0.45)
GLASS = Material((0.035, 0.045, 0.055), specular=0.7, roughness=0.15)
RUBBER = Material((0.02, 0.02, 0.02))
WHITE = Material((0.72, 0.71, 0.68), specular=0.1)
TERRACOTTA = Material((0.36, 0.13, 0.065))


def paint(
    rng: np.random.Generator, saturation: tuple[float, float] = (0.55, 0.9), gloss: float = 0.3
) -> Material:
    """A bright colour, as of toys and tools."""
    hue, value = rng.uniform(0, 360), rng.uniform(0.45, 0.9)
    return Material(linear_of_hsv(hue, rng.uniform(*saturation), value), specular=gloss, roughness=0.4)


def wood(rng: np.random.Generator) -> Material:
    """Weathered grey to red-brown wood with grain."""
    hue, saturation, value = rng.uniform(18, 34), rng.uniform(0.12, 0.55), rng.uniform(0.35, 0.72)
    return Material(linear_of_hsv(hue, saturation, value), texture=wood_texture())


def painted_wood(rng: np.random.Generator) -> Material:
    """Wood under paint: white, green, blue-grey or dark; mostly pale."""
    color = [(0.68, 0.67, 0.63), (0.05, 0.11, 0.06), (0.14, 0.2, 0.24), (0.06, 0.035, 0.02)][
        int(rng.integers(4))
    ]
    return Material(_varied(color, rng), texture=wood_texture(), specular=0.1)


def stone(rng: np.random.Generator) -> Material:
    """Grey to sandy stone."""
    return Material(
        linear_of_hsv(rng.uniform(20, 50), rng.uniform(0.02, 0.2), rng.uniform(0.4, 0.72)),
        texture=rough_texture(),
    )


def plaster(rng: np.random.Generator) -> Material:
    """Walls of a house."""
    return Material(linear_of_hsv(rng.uniform(15, 55), rng.uniform(0.02, 0.28), rng.uniform(0.68, 0.9)))


def bricks(rng: np.random.Generator) -> Material:
    """Brickwork; four courses to 0.3 m."""
    return Material(
        linear_of_hsv(rng.uniform(9, 22), rng.uniform(0.3, 0.5), rng.uniform(0.42, 0.62)), brick_texture()
    )


def leaves(rng: np.random.Generator, autumn: float = 0.06) -> Material:
    """Foliage: greens of shrubs and trees, at times red or yellow."""
    hue, saturation, value = rng.uniform(74, 112), rng.uniform(0.32, 0.55), rng.uniform(0.34, 0.54)
    if rng.random() < autumn:
        hue, saturation, value = rng.uniform(5, 48), rng.uniform(0.5, 0.75), rng.uniform(0.45, 0.7)
    return Material(
        linear_of_hsv(hue, saturation, value), leaf_texture(), cutout=True, translucency=0.45, specular=0.05
    )


def inner_green(foliage: Material) -> Material:
    """The dark inside of a bush."""
    r, g, b = foliage.color
    return Material((0.3 * r, 0.3 * g, 0.3 * b), roughness=1.0)


def bark(rng: np.random.Generator) -> Material:
    """Bark: grey to brown, or the white of birches."""
    if rng.random() < 0.12:
        return Material((0.5, 0.49, 0.45), texture=rough_texture())
    return Material(
        linear_of_hsv(rng.uniform(20, 38), rng.uniform(0.12, 0.4), rng.uniform(0.28, 0.45)),
        texture=rough_texture(),
    )


@cache
def leaf_texture() -> Texture:
    """A spray of leaves on nothing; nearly white, so that the material gives the colour."""
    size, rng = 128, np.random.default_rng(1)
    rgba = np.zeros((size, size, 4), np.uint8)
    rgba[..., :3] = 190
    for _ in range(26):
        at, angle = rng.uniform(16, size - 16, 2), float(rng.uniform(0, 360))
        long, tone = float(rng.uniform(11, 17)), int(rng.uniform(150, 245))
        center = (int(at[0]), int(at[1]))
        cv2.ellipse(
            rgba,
            center,
            (int(long), int(0.45 * long)),
            angle,
            0,
            360,
            (tone, tone, int(0.93 * tone), 255),
            -1,
        )
        tip = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))]) * long
        a, b = (at - tip).astype(int), (at + tip).astype(int)
        vein = int(0.8 * tone)
        cv2.line(rgba, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), (vein, vein, vein, 255), 1)
    return Texture("drawn-leaves", rgba)


@cache
def wood_texture() -> Texture:
    """Grain along u; one metre a repeat."""
    rng = np.random.default_rng(2)
    lines = cv2.resize(rng.standard_normal((128, 6), np.float32), (128, 128), interpolation=cv2.INTER_CUBIC)
    return _grey("drawn-wood", 0.82 + 0.09 * lines)


@cache
def rough_texture() -> Texture:
    """Blotches and grain of stone and bark."""
    rng = np.random.default_rng(3)
    coarse = cv2.resize(rng.standard_normal((16, 16), np.float32), (128, 128), interpolation=cv2.INTER_CUBIC)
    return _grey("drawn-stone", 0.78 + 0.08 * coarse + 0.07 * rng.standard_normal((128, 128)))


@cache
def brick_texture() -> Texture:
    """Brickwork in one metre by one: courses of 1/12 m, bricks of 1/4 m."""
    rng = np.random.default_rng(4)
    v, u = np.meshgrid(np.arange(240) / 240, np.arange(240) / 240, indexing="ij")
    course = np.floor(v * 12)
    along = u * 4 + 0.5 * (course % 2)
    tone = rng.uniform(0.62, 1.0, (12, 4))[course.astype(int), np.floor(along).astype(int) % 4]
    joint = (along % 1 < 0.05) | (v * 12 % 1 < 0.14)
    return _grey("drawn-bricks", np.where(joint, 0.95, tone * (1 + 0.04 * rng.standard_normal(u.shape))))


def _grey(name: str, value: np.ndarray[tuple[int, ...], np.dtype[np.floating]]) -> Texture:
    rgba = np.full((*value.shape, 4), 255, np.uint8)
    rgba[..., :3] = np.clip(value * 255, 0, 255).astype(np.uint8)[..., None]
    return Texture(name, rgba)


def _varied(color: RGB, rng: np.random.Generator) -> RGB:
    r, g, b = np.array(color) * rng.uniform(0.75, 1.2)
    return float(r), float(g), float(b)
