"""Where tufts of grass stand and how they look: chance from the garden's seed and the place alone."""

import numpy as np
from numpy.typing import NDArray

from swardmap.synth.model import Float32Array
from swardmap.synth.scene.lawn_look import STRAW
from swardmap.synth.terrain import Terrain

TILE_M = 1.0
FULL_PER_M2 = 1500
"""Tufts of a lawn of density 1."""
SHORTEST_M = 0.004
STRAW_SHARE = 0.9
"""Of the dryness: how far the albedo of a lawn goes to straw; `paint` mixes it in, here it is taken out."""

BLADE_TYPE = np.dtype([("root", "f4", 4), ("draw", "f4", 2), ("look", "u1", 4)])


def tufts(ground: Terrain, seed: int, tile: tuple[int, int]) -> NDArray[np.void]:
    """Tufts of one tile of the lawn, in random order, so that the first k are spread over all of it.

    Args:
        ground: with its lawn and blades.
        seed: of the garden.
        tile: number in x and y; tile (0, 0) starts at the origin of the map.

    Returns:
        n of BLADE_TYPE: root (x, y from the tile's corner, z of the soil, mean length of the blades), draw
        (direction in radians, chance 0..1), look (square root of the living blades' linear RGB, share of
        straw; all 0..255).
    """
    rng = np.random.default_rng([seed, 51, tile[0] + 2**20, tile[1] + 2**20])
    draws = rng.random((5, int(FULL_PER_M2 * TILE_M**2)))
    at = draws[:2].T * TILE_M
    xy = at + np.array(tile) * TILE_M
    ny, nx = ground.height_m.shape
    inside = (xy >= ground.origin_m) & (xy < np.array(ground.origin_m) + np.array([nx, ny]) * ground.texel_m)
    grid = (xy - ground.origin_m) / ground.texel_m
    i, j = (np.clip(grid[:, k].astype(np.intp), 0, n - 1) for k, n in ((0, nx), (1, ny)))
    grown = inside.all(axis=1) & (ground.blade_height_m[j, i] > SHORTEST_M)
    grown &= draws[2] < ground.blade_density[j, i]
    at, xy, i, j, draws = at[grown], xy[grown], i[grown], j[grown], draws[:, grown]
    lawn = ground.is_lawn(xy) if len(xy) else np.zeros(0, bool)
    at, xy, i, j, draws = at[lawn], xy[lawn], i[lawn], j[lawn], draws[:, lawn]
    found = np.zeros(len(at), BLADE_TYPE)
    if len(at):
        height = ground.blade_height_m[j, i] * (0.8 + 0.4 * draws[4])
        found["root"] = np.column_stack([at, ground.height_at(xy), height])
        found["draw"] = np.column_stack([2 * np.pi * draws[3], draws[4]])
        found["look"] = _look(ground.albedo[j, i], ground.dryness[j, i])
    return found


def _look(albedo: Float32Array, dryness: Float32Array) -> NDArray[np.uint8]:
    """Colour of the living blades, such that with the share of straw the mean is the albedo."""
    share = np.clip(dryness * np.float32(STRAW_SHARE), 0, 0.85)[:, None]
    living = np.maximum((albedo - share * np.array(STRAW, np.float32)) / (1 - share), 0.3 * albedo)
    look = np.concatenate([np.sqrt(np.clip(living, 0, 1)), share], axis=1)
    return np.asarray(np.rint(look * 255), np.uint8)
