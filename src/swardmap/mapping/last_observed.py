"""When each cell was last seen, so that what has not been seen for long is not given as free.

Kept beside a map of either mode, on the same lattice.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.mapping.tiles import TILE, Lattice, TileKey
from swardmap.perception.observation import Observation

NEVER = np.int64(np.iinfo(np.int64).min)


class LastObserved:
    """Remembers the stamp of the last frame that knew each cell (8 bytes a cell, 131 kB a tile).

    Args:
        corner_cell: any grid on the lattice of the map; its frame, resolution and origin count.
    """

    def __init__(self, corner_cell: GridSpec) -> None:
        self._lattice = Lattice.around(corner_cell)
        self._tiles: dict[TileKey, NDArray[np.int64]] = {}

    @property
    def nbytes(self) -> int:
        """Memory of all tiles."""
        return sum(tile.nbytes for tile in self._tiles.values())

    def integrate(self, seen: Observation) -> None:
        """Take one frame: the cells that it knows were seen at its stamp."""
        known = seen.classes != MapClass.UNKNOWN
        for key, here, there in self._lattice.overlapped(seen.spec):
            if not known[here].any():
                continue
            tile = self._tiles.setdefault(key, np.full((TILE, TILE), NEVER, np.int64))
            window = tile[there]
            np.maximum(window, seen.stamp_ns, out=window, where=known[here])

    def last_seen_ns(self, spec: GridSpec) -> NDArray[np.int64]:
        """(height, width) int64 stamps of the last frame that knew each cell; NEVER where none did."""
        stamps = np.full(spec.shape, NEVER, np.int64)
        for key, here, there in self._lattice.overlapped(spec):
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
        self._tiles = self._lattice.kept_within(self._tiles, spec)
