"""When each cell was last seen, so that what has not been seen for long is not given as free.

Kept beside a map of either mode, on the same lattice, in tiles: memory follows the area visited.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec, OccupancyGrid, overlap
from swardmap.labels import MapClass

TILE = 128
"""Cells along the edge of a tile."""

NEVER = np.int64(np.iinfo(np.int64).min)

TileKey = tuple[int, int]
Slices = tuple[slice, slice]


class Freshness:
    """Remembers the stamp of the last frame that knew each cell (8 bytes a cell, 131 kB a tile).

    Args:
        corner_cell: any grid on the lattice of the map; its frame, resolution and origin count.
    """

    def __init__(self, corner_cell: GridSpec) -> None:
        self._corner = replace(corner_cell, width=1, height=1)
        self._tiles: dict[TileKey, NDArray[np.int64]] = {}

    @property
    def nbytes(self) -> int:
        """Memory of all tiles."""
        return sum(tile.nbytes for tile in self._tiles.values())

    def integrate(self, seen: OccupancyGrid) -> None:
        """Take one frame's grid: the cells that it knows were seen at its stamp."""
        known = seen.classes != MapClass.UNKNOWN
        for key, here, there in self._overlapped(seen.spec):
            if not known[here].any():
                continue
            tile = self._tiles.setdefault(key, np.full((TILE, TILE), NEVER, np.int64))
            window = tile[there]
            np.maximum(window, seen.stamp_ns, out=window, where=known[here])

    def last_seen_ns(self, spec: GridSpec) -> NDArray[np.int64]:
        """(height, width) int64 stamps of the last frame that knew each cell; NEVER where none did."""
        stamps = np.full(spec.shape, NEVER, np.int64)
        for key, here, there in self._overlapped(spec):
            if key in self._tiles:
                stamps[here] = self._tiles[key][there]
        return stamps

    def forget_stale(self, grid: OccupancyGrid, before_ns: int | None) -> OccupancyGrid:
        """The map with every free cell that was last seen before a time turned unknown.

        Obstacles and persons stay: that they are old does not make them go away. Nothing becomes free.

        Args:
            grid: the map, on this lattice; not changed.
            before_ns: `HealthReport.forget_before_ns`; None changes nothing.
        """
        if before_ns is None:
            return grid
        stale = (grid.classes == MapClass.GRASS) & (self.last_seen_ns(grid.spec) < before_ns)
        return replace(grid, classes=np.where(stale, np.uint8(MapClass.UNKNOWN), grid.classes))

    def keep_within(self, spec: GridSpec) -> None:
        """Drop the tiles that a grid does not overlap, such as those a rolling window has left."""
        kept = {key for key, _, _ in self._overlapped(spec)}
        self._tiles = {key: tile for key, tile in self._tiles.items() if key in kept}

    def _overlapped(self, spec: GridSpec) -> Iterator[tuple[TileKey, Slices, Slices]]:
        """Keys of the tiles a grid overlaps, and slices into the grid's arrays and the tile's."""
        ix, iy = spec.offset_in(self._corner)
        r, (x, y) = self._corner.resolution_m, self._corner.origin_m
        for ty in range(iy // TILE, (iy + spec.height - 1) // TILE + 1):
            for tx in range(ix // TILE, (ix + spec.width - 1) // TILE + 1):
                corner = round(x + tx * TILE * r, 9), round(y + ty * TILE * r, 9)
                here, there = overlap(spec, GridSpec(r, TILE, TILE, corner, self._corner.frame_id))
                yield (tx, ty), here, there
