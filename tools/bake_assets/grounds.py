"""Make the seamless textures of ground, walls and roofs: photos under CC0 where there are, else from noise.

python -m tools.bake_assets.grounds OUT        (needs scikit-image, for its photos)
"""

import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from swardmap.synth.asset_entries import Source
from tools.bake_assets.bundle import BundleWriter

N = 512
Picture = NDArray[np.float64]
Color = tuple[int, int, int]
"""sRGB, 0..255."""
OURS = Source("procedural texture", "the swardmap authors", "CC0-1.0", "tools/bake_assets/grounds.py")


def photo(name: str, size: int = N) -> Picture:
    """A grey photo of scikit-image around 1, made seamless (Moisan, J. Math. Imaging Vis. 2011)."""
    import skimage.data  # type: ignore[import-not-found]  # of the bake alone

    grey = np.asarray(getattr(skimage.data, name)(), np.float64)
    grey = cv2.resize(grey, (size, size), interpolation=cv2.INTER_AREA)
    border = np.zeros_like(grey)
    border[0] += grey[-1] - grey[0]
    border[-1] += grey[0] - grey[-1]
    border[:, 0] += grey[:, -1] - grey[:, 0]
    border[:, -1] += grey[:, 0] - grey[:, -1]
    k = 2 * np.pi * np.fft.fftfreq(size)
    laplacian = 2 * np.cos(k)[:, None] + 2 * np.cos(k)[None] - 4
    laplacian[0, 0] = 1
    smooth = np.fft.fft2(border) / laplacian
    smooth[0, 0] = 0
    whole: Picture = grey - np.fft.ifft2(smooth).real
    low = np.hypot(*np.meshgrid(k, k)) < 0.06  # spots that one would see repeat
    broad = np.fft.ifft2(np.fft.fft2(whole) * low).real
    flat: Picture = whole - 0.8 * (broad - whole.mean())
    return np.asarray(np.maximum(flat / flat.mean(), 0.05))


def noise(seed: int, slope: float = 1.0, stretch: tuple[float, float] = (1, 1), size: int = N) -> Picture:
    """Periodic noise of mean 0 and deviation 1 whose amplitude falls with frequency^slope.

    Args:
        seed: of the noise.
        slope: 0 = white, 2 = soft clouds.
        stretch: along x and y.
        size: pixels.
    """
    k = np.fft.fftfreq(size) * size
    radius = np.hypot(k[None] * stretch[0], k[:, None] * stretch[1])
    radius[0, 0] = np.inf
    white = np.fft.fft2(np.random.default_rng(seed).standard_normal((size, size)))
    field: Picture = np.fft.ifft2(white / np.maximum(radius, 2) ** slope).real
    return np.asarray(field / field.std())


def cells(seed: int, count: int, stretch: float = 1.0) -> tuple[Picture, NDArray[np.int64], int]:
    """Periodic Voronoi cells: distance to the border (pixels, about), number of the cell; and their count."""
    rng = np.random.default_rng(seed)
    seeds = rng.uniform(0, N, (count, 2))
    y, x = np.mgrid[0:N, 0:N] + 0.0
    at = np.stack((x + 3 * noise(seed + 1, 1.6), (y + 3 * noise(seed + 2, 1.6)) * stretch), axis=-1).reshape(
        -1, 2
    )
    seeds = np.concatenate([seeds + np.array([0, k * N]) for k in range(round(stretch))])
    names = np.tile(np.arange(count), round(stretch))
    period = np.array([N, N * round(stretch)])
    distance, nearest = cKDTree(seeds, boxsize=period).query(at % period, k=2)
    return (distance[:, 1] - distance[:, 0]).reshape(N, N), names[nearest[:, 0]].reshape(N, N), count


def relief(height: Picture, strength: float) -> Picture:
    """Brightness of a relief that is lit from one side."""
    dx, dy = (height - np.roll(height, 1, axis) for axis in (1, 0))
    return np.clip(1 + strength * (dx + dy), 0.35, 1.7)


def mixed(palette: list[Color], chosen: NDArray[np.int64]) -> Picture:
    """Colours 0..1 by index."""
    return np.array(palette, np.float64)[chosen % len(palette)] / 255


def tinted(color: Color, brightness: Picture) -> Picture:
    """A colour times brightness."""
    return np.array(color) / 255 * brightness[..., None]


def stones(seed: int, count: int, palette: list[Color], gap: float = 2.5) -> Picture:
    """Rounded stones that lie close."""
    edge, name, n = cells(seed, count)
    rng = np.random.default_rng(seed)
    round_up = np.sqrt(np.clip(edge / 14, 0, 1))
    shade = (
        relief(round_up * 4, 0.35)
        * (0.45 + 0.55 * np.clip(edge / gap, 0, 1))
        * (1 + 0.05 * noise(seed + 5, 0.5))
    )
    color = mixed(palette, rng.integers(0, 99, n)[name]) * rng.uniform(0.8, 1.15, n)[name][..., None]
    return color * shade[..., None]


def slabs(seed: int, columns: int, rows: int, shifted: bool, color: Color, joint: Color,
          spread: float, gap_px: float = 3.0) -> Picture:  # fmt: skip
    """Rectangles with joints: paving, bricks, tiles."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:N, 0:N] + 0.5
    wobble = 0.6 * noise(seed + 1, 1.2)
    row = np.floor(y / N * rows).astype(int)
    across = (x / N * columns + (0.5 * (row % 2) if shifted else 0)) % columns
    column = np.floor(across).astype(int)
    w, h = N / columns, N / rows
    u, v = (across % 1) * w, (y / N * rows % 1) * h
    edge = np.minimum(np.minimum(u, w - u), np.minimum(v, h - v)) + wobble
    face = np.clip((edge - gap_px / 2) / 1.5, 0, 1)
    tone = rng.uniform(1 - spread, 1 + spread, (rows, columns))[row, column]
    hue = 1 + rng.normal(0, spread / 7, (rows, columns, 3))[row, column]
    body = np.array(color) / 255 * (tone * (1 + 0.06 * noise(seed + 2, 0.7)))[..., None] * hue
    mortar = tinted(joint, 1 + 0.08 * noise(seed + 3, 0.4))
    shade = relief(np.clip(edge / 4, 0, 1) * 2, 0.12)[..., None]
    return np.asarray((body * face[..., None] + mortar * (1 - face[..., None])) * shade)


def boards(seed: int, count: int, color: Color, gap_px: float = 4.0, overlap: bool = False) -> Picture:
    """Boards along x with grain; overlapping ones throw a shadow (cladding)."""
    rng = np.random.default_rng(seed)
    y = np.repeat((np.arange(N) + 0.5)[:, None], N, axis=1)
    board = np.floor(y / N * count).astype(int)
    v = y / N * count % 1
    grain = noise(seed, 0.9, (9, 1)) * 0.06 + noise(seed + 1, 0.5, (24, 1)) * 0.05
    grain = np.stack([np.roll(grain, int(s), axis=1) for s in rng.integers(0, N, count)])[
        board, np.arange(N)[:, None], np.arange(N)[None]
    ]
    edge = np.minimum(v, 1 - v) * N / count
    shade = np.clip(edge / gap_px, 0.15, 1) if not overlap else np.clip(0.35 + v * N / count / 8, 0, 1)
    tone = rng.uniform(0.85, 1.12, count)[board]
    return tinted(color, (1 + grain) * shade * tone)


def chips(seed: int, count: int, length: float, width: float, palette: list[Color], under: Picture,
          round_ends: bool = False) -> Picture:  # fmt: skip
    """Flat pieces that lie across each other: bark, leaves, straw; drawn on nine tiles to be seamless."""
    rng = np.random.default_rng(seed)
    picture = np.ascontiguousarray(np.clip(under, 0, 1) * 255, np.uint8)
    for k in range(count):
        x, y, a = rng.uniform(0, N), rng.uniform(0, N), rng.uniform(0, np.pi)
        long, wide = length * rng.uniform(0.6, 1.4), width * rng.uniform(0.6, 1.4)
        tone = rng.uniform(0.55, 1.0) * (0.6 + 0.4 * k / count)
        color = [float(c) * tone for c in palette[int(rng.integers(len(palette)))]]
        for dx in (-N, 0, N):
            for dy in (-N, 0, N):
                if -length * 2 < x + dx < N + length * 2 and -length * 2 < y + dy < N + length * 2:
                    _piece(picture, (x + dx, y + dy), a, long, wide, color, round_ends)
    return picture / 255 * (1 + 0.07 * noise(seed + 9, 0.4))[..., None]


def _piece(picture: NDArray[np.uint8], at: tuple[float, float], angle: float, length: float, width: float,
           color: list[float], round_ends: bool) -> None:  # fmt: skip
    """A piece with its shadow at the lower right."""
    t = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    power = 1.0 if round_ends else 0.45
    local = np.stack((np.sign(np.cos(t)) * np.abs(np.cos(t)) ** power * length / 2,
                      np.sign(np.sin(t)) * np.abs(np.sin(t)) ** power * width / 2))  # fmt: skip
    c, s = np.cos(angle), np.sin(angle)
    points = (np.array([[c, -s], [s, c]]) @ local).T + at
    for offset, paint in (((1.5, 1.5), [value * 0.3 for value in color]), ((0, 0), color)):
        fixed = np.rint((points + offset) * 16).astype(np.int32)
        cv2.fillPoly(picture, [fixed], paint, cv2.LINE_AA, 4)


def plain(color: Color, *grains: tuple[float, float]) -> Picture:
    """A colour with noise; grains are (deviation, slope)."""
    brightness = np.ones((N, N))
    for k, (share, slope) in enumerate(grains):
        brightness += share * noise(31 + k, slope)
    return tinted(color, brightness)


def bare(color: Color) -> Picture:
    """One colour."""
    return tinted(color, np.ones((N, N)))


GREY_STONES = [(150, 148, 145), (120, 118, 116), (175, 170, 160)]
WARM_STONES = [(196, 176, 140), (170, 150, 120), (205, 195, 175), (140, 122, 100)]
PEBBLES = [(170, 165, 160), (110, 108, 108), (190, 180, 165), (140, 120, 105)]
BARK = [(112, 74, 48), (88, 58, 38), (134, 94, 62)]
DEAD_LEAVES = [(150, 96, 46), (120, 78, 44), (176, 128, 60), (98, 70, 44)]
GREEN_LEAVES = [(74, 112, 46), (58, 92, 40), (94, 128, 56)]
UNDER_DEAD, UNDER_GREEN = bare((56, 42, 30)), bare((26, 38, 18))
CONCRETE, PLASTER = (168, 166, 160), (222, 216, 204)

TEXTURES: dict[str, tuple[str, float, Callable[[], Picture]]] = {
    "grass-detail": ("grass", 0.8, lambda: photo("grass")[..., None].repeat(3, 2) * 0.5),
    "grass-green": ("grass", 0.8, lambda: tinted((88, 106, 52), photo("grass") ** 0.9)),
    "gravel-photo": ("gravel", 0.7, lambda: tinted((150, 142, 130), photo("gravel") ** 0.9)),
    "gravel-grey": ("gravel", 0.6, lambda: stones(11, 1500, GREY_STONES)),
    "gravel-warm": ("gravel", 0.5, lambda: stones(12, 900, WARM_STONES)),
    "pebbles": ("gravel", 0.9, lambda: stones(13, 260, PEBBLES, 4)),
    "paving-slabs": ("paving", 1.2, lambda: slabs(21, 3, 3, False, (165, 160, 150), (96, 92, 84), 0.07, 4)),
    "paving-bricks": ("paving", 0.8, lambda: slabs(22, 4, 8, True, (150, 88, 68), (110, 100, 88), 0.14)),
    "paving-setts": ("paving", 0.8, lambda: slabs(23, 8, 8, True, (120, 118, 115), (70, 66, 60), 0.15, 5)),
    "dirt": ("dirt", 1.0, lambda: plain((112, 84, 60), (0.13, 0.6), (0.08, 1.5))),
    "dirt-dry": ("dirt", 1.0, lambda: plain((158, 132, 100), (0.10, 0.5), (0.06, 1.5))),
    "mulch": ("mulch", 0.7, lambda: chips(41, 2600, 34, 9, BARK, bare((40, 28, 20)))),
    "sand": ("sand", 0.8, lambda: plain((206, 184, 144), (0.05, 0.2), (0.03, 1.4))),
    "concrete": ("concrete", 1.5, lambda: plain(CONCRETE, (0.035, 0.3), (0.035, 1.3))),
    "deck-wood": ("wood", 0.9, lambda: boards(71, 6, (160, 120, 84), 5)),
    "deck-grey": ("wood", 0.9, lambda: boards(72, 6, (142, 136, 126), 5)),
    "leaf-litter": ("leaf_litter", 0.9, lambda: chips(81, 1500, 48, 26, DEAD_LEAVES, UNDER_DEAD, True)),
    "carpet": ("carpet", 0.3, lambda: plain((64, 118, 54), (0.16, 0.15))),
    "ground-cover": ("ground_cover", 0.6, lambda: chips(95, 3600, 26, 17, GREEN_LEAVES, UNDER_GREEN, True)),
    "wall-plaster": ("plaster", 2.0, lambda: plain(PLASTER, (0.02, 0.3), (0.015, 1.2))),
    "wall-brick": ("brick", 1.0, lambda: slabs(103, 4, 12, True, (146, 80, 60), (168, 160, 148), 0.13)),
    "wall-wood": ("cladding", 1.2, lambda: boards(104, 8, (150, 112, 76), 4, True)),
    "roof-tiles": ("roof", 1.5, lambda: slabs(105, 7, 5, True, (150, 74, 52), (60, 36, 28), 0.12, 4)),
    "roof-slate": ("roof", 1.5, lambda: slabs(106, 7, 6, True, (84, 88, 94), (44, 46, 50), 0.10, 3)),
}  # fmt: skip
PHOTOS = {"grass-detail": "grass", "grass-green": "grass", "gravel-photo": "gravel"}
AUTHORS = {  # as scikit-image's documentation of the pictures names them
    "grass": ("Grass 01", "linolafett (DeviantArt)"), "gravel": ("Gravel04", "CC0Textures"),
}  # fmt: skip


def source_of(name: str) -> Source:
    """Where a texture comes from."""
    if name not in PHOTOS:
        return OURS
    import skimage

    title, author = AUTHORS[PHOTOS[name]]
    package = f"scikit-image {skimage.__version__} (PyPI), {PHOTOS[name]}.png"
    return Source(title, author, "CC0-1.0", package, "made seamless, coloured")


def main() -> None:
    """Write grounds.zip, and grounds.png to look at (each texture twice as wide and high as it is)."""
    out, bundle, tiles = Path(sys.argv[1]), BundleWriter(), []
    for name, (kind, tile_m, make) in TEXTURES.items():
        picture = np.clip(np.rint(make() * 255), 0, 255).astype(np.uint8)
        bundle.add_texture(name, picture, kind, source_of(name), (tile_m, tile_m), quality=72)
        tile = cv2.resize(np.tile(picture, (2, 2, 1)), (330, 330), interpolation=cv2.INTER_AREA)
        cv2.putText(tile, name, (4, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 2, cv2.LINE_AA)
        tiles.append(tile)
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % 6)
    rows = [np.concatenate(tiles[k : k + 6], axis=1) for k in range(0, len(tiles), 6)]
    cv2.imwrite(sys.argv[2], np.concatenate(rows)[..., ::-1])
    print(bundle.write(out / "grounds.zip"), "bytes")


if __name__ == "__main__":
    main()
