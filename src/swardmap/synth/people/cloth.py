"""Fabrics: plain, striped, checked, denim, printed, camouflage; pictures that repeat, from a generator."""

import numpy as np

from swardmap.synth.model import Float64Array, Material, Texture

RGB = tuple[float, float, float]
SIZE = 128

# sRGB, what people wear: muted, dark and a few clear colours
COLORS: tuple[RGB, ...] = (
    (38, 42, 52), (52, 60, 78), (68, 84, 112), (96, 118, 148), (140, 158, 178), (196, 204, 210),
    (236, 234, 228), (214, 204, 186), (176, 158, 130), (128, 106, 82), (86, 70, 58), (58, 50, 46),
    (30, 30, 32), (92, 94, 96), (146, 146, 146), (132, 44, 48), (168, 62, 54), (190, 110, 96),
    (206, 152, 142), (198, 158, 84), (212, 190, 120), (90, 62, 92), (150, 120, 150), (54, 96, 104),
)  # fmt: skip
GREENS: tuple[RGB, ...] = (
    (78, 98, 58), (96, 118, 62), (60, 82, 54), (110, 128, 84), (70, 110, 60), (124, 144, 78), (84, 90, 58),
)  # fmt: skip
DENIM: tuple[RGB, ...] = ((52, 66, 96), (74, 94, 128), (38, 46, 66), (112, 134, 162))
TROUSERS: tuple[RGB, ...] = (
    (44, 46, 52), (62, 62, 64), (92, 84, 72), (142, 128, 104), (168, 156, 134), (66, 58, 48), (34, 36, 44),
    (88, 92, 98), (120, 110, 90),
)  # fmt: skip
HI_VIS: tuple[RGB, ...] = ((214, 232, 44), (250, 112, 30))


def linear(srgb: RGB) -> RGB:
    """SRGB in 0..255 to linear RGB in 0..1."""
    c = np.asarray(srgb) / 255
    r, g, b = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return float(r), float(g), float(b)


def picked(rng: np.random.Generator, colors: tuple[RGB, ...]) -> RGB:
    """One colour, a little changed."""
    base = np.array(colors[int(rng.integers(len(colors)))])
    r, g, b = np.clip(base * rng.uniform(0.88, 1.1) + rng.normal(0, 3, 3), 8, 250)
    return float(r), float(g), float(b)


def clouds(rng: np.random.Generator, size: int, waves: int) -> Float64Array:
    """Size x size, about -1..1: smooth noise that repeats; waves = how many across."""
    y, x = np.mgrid[0:size, 0:size] / size * 2 * np.pi
    out = np.zeros((size, size))
    for _ in range(10):
        kx, ky = rng.integers(-waves, waves + 1, 2)
        out += np.cos(kx * x + ky * y + rng.uniform(0, 2 * np.pi))
    scaled: Float64Array = out / max(float(np.abs(out).max()), 1e-9)
    return scaled


def fabric(rng: np.random.Generator, kind: str, base: RGB, name: str) -> Material:
    """A material of cloth; 128 x 128 texels are 0.25 m.

    Args:
        rng: for everything by chance.
        kind: plain, stripes, check, denim, print, camouflage, fleece or vest.
        base: its main colour, sRGB in 0..255.
        name: of the texture; unique.
    """
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    color = np.broadcast_to(np.array(base), (SIZE, SIZE, 3)).astype(np.float64)
    other = np.array(picked(rng, COLORS))
    if kind == "stripes":
        width = int(rng.choice([8, 16, 32]))
        band = ((y if rng.random() < 0.7 else x) // width) % 2 == 0
        color = np.where(band[..., None], color, 0.5 * color + 0.5 * other)
    elif kind == "check":
        width = int(rng.choice([16, 32]))
        h, v = (y // width) % 2 == 0, (x // width) % 2 == 0
        color = color * (1 - 0.3 * h - 0.3 * v)[..., None] + other * (0.3 * h + 0.3 * v)[..., None]
    elif kind == "denim":
        twill = ((x + 2 * y) % 4 < 2) * 14.0 + rng.normal(0, 7, (SIZE, SIZE))
        color = color + twill[..., None] - 7
    elif kind == "print":
        for _ in range(int(rng.integers(8, 22))):
            cx, cy, r = (*rng.uniform(0, SIZE, 2), rng.uniform(3, 11))
            dx, dy = (x - cx + SIZE / 2) % SIZE - SIZE / 2, (y - cy + SIZE / 2) % SIZE - SIZE / 2
            petal = r * (1 + 0.3 * np.cos(5 * np.arctan2(dy, dx)))
            color = np.where((np.hypot(dx, dy) < petal)[..., None], other, color)
    elif kind == "camouflage":
        for tone in ((0.6, 0.62, 0.55), (1.15, 1.05, 0.9), (0.35, 0.36, 0.33)):
            color = np.where((clouds(rng, SIZE, 5) > 0.28)[..., None], np.array(base) * tone, color)
    elif kind == "vest":
        band = (y % SIZE > SIZE * 0.62) & (y % SIZE < SIZE * 0.82)
        color = np.where(band[..., None], np.array([205.0, 208, 212]), color)
    weave = rng.normal(0, 9 if kind == "fleece" else 4, (SIZE, SIZE))
    shade = 1 + 0.06 * clouds(rng, SIZE, 3) + 0.05 * clouds(rng, SIZE, 7)
    rgba = np.full((SIZE, SIZE, 4), 255, np.uint8)
    rgba[..., :3] = np.clip(color * shade[..., None] + weave[..., None], 0, 255).astype(np.uint8)
    return Material(texture=Texture(name, rgba), translucency=0.05, specular=0.02, roughness=0.95)
