"""A map that lives: evidence of every frame in tiles of one lattice, for a window or a whole field."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from swardmap.config import EvidenceConfig, GridConfig
from swardmap.errors import InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid, overlap
from swardmap.mapping.last_seen_map import fixed_spec
from swardmap.mapping.sensor_model import Cells, Viewpoint, parameters

TILE = 128
"""Cells along the edge of a tile: 6.4 m at 0.05 m, 80 kB."""

TileKey = tuple[int, int]
Slices = tuple[slice, slice]


class LivingMap:
    """Accumulates what frames have seen as evidence, so that one wrong frame does not decide.

    Tiles are made where something was seen and nowhere else: memory follows the area visited, not the time
    driven. Cells are addressed by whole numbers from a fixed corner, so that they never drift. With
    `evidence.window_m` tiles that the square around the camera has left are forgotten.

    Args:
        grid: resolution, extent and points a sighting needs.
        evidence: sensor model and window.
        lowest_m: lowest ground there may be, in the map frame.
        frame_id: frame of the map.
    """

    def __init__(
        self,
        grid: GridConfig,
        evidence: EvidenceConfig | None = None,
        lowest_m: float = -0.5,
        frame_id: str = "map",
    ) -> None:
        self._evidence = evidence or EvidenceConfig()
        self._model = parameters(self._evidence, grid.min_points, grid.min_grass_points)
        self._lowest_m = lowest_m
        self._fixed = fixed_spec(grid, frame_id)
        corner = (0.0, 0.0) if grid.origin_m is None else grid.origin_m
        self._corner_cell = GridSpec(grid.resolution_m, 1, 1, corner, frame_id)
        self._tiles: dict[TileKey, Cells] = {}
        self._window: GridSpec | None = None
        self._stamp_ns = 0

    @property
    def corner_cell(self) -> GridSpec:
        """The cell that all cells are counted from."""
        return self._corner_cell

    @property
    def tiles(self) -> Mapping[TileKey, Cells]:
        """Tiles by (ix, iy); tile (0, 0) has the corner cell at its corner."""
        return self._tiles

    @property
    def stamp_ns(self) -> int:
        """Time of the last frame that was integrated."""
        return self._stamp_ns

    @property
    def nbytes(self) -> int:
        """Memory of all tiles."""
        return sum(tile.nbytes for tile in self._tiles.values())

    def integrate(self, seen: OccupancyGrid) -> None:
        """Let one frame's grid speak; it must be on this map's lattice, and know its points.

        Raises:
            InvalidValueError: if `seen` does not say what it was made of, or is on another lattice.
        """
        if seen.sighting is None:
            raise InvalidValueError("living map: expected a frame's grid with its sighting, got one without")
        from swardmap.kernels import log_odds as kernel

        points, spec = seen.sighting.points, seen.spec
        view = Viewpoint.of(seen.sighting, spec, self._evidence, self._lowest_m)
        passed = np.zeros(spec.shape, np.bool_)
        kernel.cells_passed(points, view.x, view.y, view.back, self._model[0], self._model[11], passed)
        for key, here, there in self._overlapped(spec):
            tile = self._tiles.get(key)
            if tile is None:
                if not seen.classes[here].any():
                    continue
                tile = self._tiles[key] = Cells.unknown(TILE, TILE)
            block = tile[there]
            kernel.update_cells(
                points[here], passed[here], view.x, view.y, view.half, here[1].start, here[0].start,
                self._model, block.evidence, block.person, block.classes,
            )  # fmt: skip
        self._stamp_ns = max(self._stamp_ns, seen.stamp_ns)
        if self._evidence.window_m is not None:
            x, y, _ = seen.sighting.viewpoint_m
            self._window = self._square_around((x, y), self._evidence.window_m)
            kept = {key for key, _, _ in self._overlapped(self._window)}
            self._tiles = {key: tile for key, tile in self._tiles.items() if key in kept}

    @property
    def grid(self) -> OccupancyGrid | None:
        """A copy of the map: the window, the configured extent, or all that was seen; None if nothing."""
        spec = self._window or self._fixed or self._seen_spec()
        if spec is None:
            return None
        classes = np.zeros(spec.shape, np.uint8)
        for key, here, there in self._overlapped(spec):
            if key in self._tiles:
                classes[here] = self._tiles[key].classes[there]
        return OccupancyGrid(spec, classes, self._stamp_ns)

    def restore(self, tiles: Mapping[TileKey, Cells], stamp_ns: int) -> None:
        """Replace all that is known by tiles of a saved map on the same lattice.

        Raises:
            InvalidValueError: if a tile has another size.
        """
        for key, tile in tiles.items():
            if tile.classes.shape != (TILE, TILE):
                raise InvalidValueError(
                    f"tile {key}: expected {TILE} x {TILE} cells, got {tile.classes.shape}"
                )
        self._tiles, self._stamp_ns, self._window = dict(tiles), stamp_ns, None

    def _tile_spec(self, key: TileKey, columns: int = 1, rows: int = 1) -> GridSpec:
        r, (x, y) = self._corner_cell.resolution_m, self._corner_cell.origin_m
        corner = round(x + key[0] * TILE * r, 9), round(y + key[1] * TILE * r, 9)
        return GridSpec(r, columns * TILE, rows * TILE, corner, self._corner_cell.frame_id)

    def _overlapped(self, spec: GridSpec) -> Iterator[tuple[TileKey, Slices, Slices]]:
        """Keys of the tiles a grid overlaps, and slices into the grid's arrays and the tile's."""
        ix, iy = spec.offset_in(self._corner_cell)
        for ty in range(iy // TILE, (iy + spec.height - 1) // TILE + 1):
            for tx in range(ix // TILE, (ix + spec.width - 1) // TILE + 1):
                here, there = overlap(spec, self._tile_spec((tx, ty)))
                yield (tx, ty), here, there

    def _square_around(self, xy_m: tuple[float, float], edge_m: float) -> GridSpec:
        """The window: whole cells around the camera's cell, of the same size wherever it is."""
        r, frame_id = self._corner_cell.resolution_m, self._corner_cell.frame_id
        half = max(1, round(edge_m / r / 2))
        low = self._corner_cell.cell_of(np.asarray(xy_m)) - half
        x, y = (np.asarray(self._corner_cell.origin_m) + low * r).round(9).tolist()
        return GridSpec(r, 2 * half + 1, 2 * half + 1, (x, y), frame_id)

    def _seen_spec(self) -> GridSpec | None:
        """The rectangle of whole tiles around all that was seen."""
        if not self._tiles:
            return None
        keys: NDArray[np.int64] = np.array(list(self._tiles), np.int64)
        (tx, ty), (tx1, ty1) = keys.min(axis=0).tolist(), keys.max(axis=0).tolist()
        return self._tile_spec((tx, ty), tx1 - tx + 1, ty1 - ty + 1)
