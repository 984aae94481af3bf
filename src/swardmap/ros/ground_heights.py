"""How high the ground lies, cell by cell, as it was last seen: a layer for viewers and planners."""

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec
from swardmap.mapping.tiles import TILE, Lattice, TileKey
from swardmap.perception.observation import Observation

STEP_M = 0.05
"""Height of one step of the layer's values."""

LEVEL = 50
"""Value of what lies as high as the robot's base; 0 and 100 are 2.5 m below and above, or more."""


class GroundHeights:
    """Heights of the ground in the map frame, in tiles of the map's lattice (65 kB each).

    Args:
        spec: any grid on the lattice.
    """

    def __init__(self, spec: GridSpec) -> None:
        self._lattice = Lattice.around(spec)
        self._tiles: dict[TileKey, NDArray[np.float32]] = {}

    def integrate(self, seen: Observation) -> None:
        """Take one frame: where it shows the ground, that is its height; one carried over says nothing."""
        if seen.ground is None or seen.ground.carried:
            return
        ground_m = seen.ground_m
        shown = np.isfinite(ground_m)
        for key, here, there in self._lattice.overlapped(seen.spec):
            if shown[here].any():
                tile = self._tiles.setdefault(key, np.full((TILE, TILE), np.nan, np.float32))
                np.copyto(tile[there], ground_m[here], where=shown[here])

    def keep_within(self, spec: GridSpec) -> None:
        """Drop the tiles that a grid does not overlap."""
        self._tiles = self._lattice.kept_within(self._tiles, spec)

    def values(self, spec: GridSpec, base_z_m: float) -> NDArray[np.int8]:
        """(height, width) int8: 50 + (ground - base) / 5 cm, from 0 to 100; -1 where no ground was seen.

        Args:
            spec: grid on the lattice.
            base_z_m: height of the robot's base in the map frame.
        """
        ground_m = np.full(spec.shape, np.nan, np.float32)
        for key, here, there in self._lattice.overlapped(spec):
            if key in self._tiles:
                ground_m[here] = self._tiles[key][there]
        steps = np.clip(np.round((ground_m - np.float32(base_z_m)) / STEP_M) + LEVEL, 0, 100)
        return np.where(np.isfinite(steps), steps, -1).astype(np.int8)
