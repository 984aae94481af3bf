"""The lattice of tiles under every map: cells are counted from one corner, so that they never drift.

Memory follows the area visited, not the time driven: a tile is made where something was seen.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.grid import GridSpec, shared_cells

TILE = 128
"""Cells along the edge of a tile: 6.4 m at 0.05 m."""

TileKey = tuple[int, int]
Slices = tuple[slice, slice]
Tile = TypeVar("Tile")


@dataclass(frozen=True, slots=True)
class Lattice:
    """Where tiles lie: tile (0, 0) has the corner cell at its corner.

    Attributes:
        corner_cell: the one cell that all cells are counted from.
    """

    corner_cell: GridSpec

    @classmethod
    def around(cls, spec: GridSpec) -> "Lattice":
        """The lattice that a grid lies on, counted from the grid's corner."""
        return cls(replace(spec, width=1, height=1))

    def spec_of(self, cell: TileKey, width: int, height: int) -> GridSpec:
        """The grid of `width` x `height` cells from a cell (ix, iy)."""
        r, (x, y) = self.corner_cell.resolution_m, self.corner_cell.origin_m
        corner = round(x + cell[0] * r, 9), round(y + cell[1] * r, 9)  # -11.7, not -11.700000000000001
        return GridSpec(r, width, height, corner, self.corner_cell.frame_id)

    def overlapped(self, spec: GridSpec) -> Iterator[tuple[TileKey, Slices, Slices]]:
        """Keys of the tiles that a grid overlaps, and slices into the grid's arrays and the tile's."""
        ix, iy = spec.offset_in(self.corner_cell)
        for ty in range(iy // TILE, (iy + spec.height - 1) // TILE + 1):
            for tx in range(ix // TILE, (ix + spec.width - 1) // TILE + 1):
                offset = ix - tx * TILE, iy - ty * TILE
                yield (tx, ty), *shared_cells(offset, spec.shape, (TILE, TILE))

    def kept_within(self, tiles: Mapping[TileKey, Tile], spec: GridSpec) -> dict[TileKey, Tile]:
        """The tiles that a grid overlaps, such as those that a rolling window has not left."""
        kept = {key for key, _, _ in self.overlapped(spec)}
        return {key: tile for key, tile in tiles.items() if key in kept}

    def square_around(self, xy_m: ArrayLike, edge_m: float) -> GridSpec:
        """Whole cells around the cell of a place, of the same size wherever it is."""
        half = max(1, round(edge_m / self.corner_cell.resolution_m / 2))
        ix, iy = (self.corner_cell.cell_of(xy_m) - half).tolist()
        return self.spec_of((ix, iy), 2 * half + 1, 2 * half + 1)

    def spec_of_tiles(self, keys: Mapping[TileKey, Tile]) -> GridSpec | None:
        """The rectangle of whole tiles around all of some; None if there are none."""
        if not keys:
            return None
        cells: NDArray[np.int64] = np.array(list(keys), np.int64)
        (tx, ty), (tx1, ty1) = cells.min(axis=0).tolist(), cells.max(axis=0).tolist()
        return self.spec_of((tx * TILE, ty * TILE), (tx1 - tx + 1) * TILE, (ty1 - ty + 1) * TILE)
