"""A map of log-odds: the evidence of every frame in tiles of one lattice, for a window or a whole field."""

from collections.abc import Mapping
from copy import copy

import numpy as np

from swardmap.config import EvidenceConfig, GridConfig
from swardmap.errors import InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.mapping.last_seen_map import fixed_spec, lattice_corner
from swardmap.mapping.sensor_model import Cells, Viewpoint, parameters
from swardmap.mapping.tiles import TILE, Lattice, TileKey
from swardmap.perception.observation import Observation


class LogOddsMap:
    """Accumulates what frames have seen as evidence, so that one wrong frame does not decide.

    Tiles are made where something was seen and nowhere else: memory follows the area visited, not the time
    driven. Cells are addressed by whole numbers from a fixed corner, so that they never drift. With
    `evidence.window_m` tiles that the square around the camera has left are forgotten.

    Args:
        grid: resolution, extent and points a sighting needs.
        evidence: sensor model and window.
        lowest_m: lowest ground there may be, above the ground that a view shows.
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
        self._lattice = Lattice(lattice_corner(grid, frame_id))
        self._tiles: dict[TileKey, Cells] = {}
        self._window: GridSpec | None = None
        self._stamp_ns = 0

    @property
    def corner_cell(self) -> GridSpec:
        """The cell that all cells are counted from."""
        return self._lattice.corner_cell

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

    def integrate(self, seen: Observation) -> None:
        """Let one frame speak; it must be on this map's lattice.

        Raises:
            InvalidValueError: if `seen` is on another lattice.
        """
        from swardmap.kernels import log_odds as kernel

        points, spec = seen.points, seen.spec
        view = Viewpoint.of(seen.viewpoint_m, seen.camera_height_m, spec, self._evidence, self._lowest_m)
        passed = np.zeros(spec.shape, np.bool_)
        kernel.cells_passed(points, view.x, view.y, view.back, self._model[0], self._model[11], passed)
        for key, here, there in self._lattice.overlapped(spec):
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
            self._window = self._lattice.square_around(seen.viewpoint_m[:2], self._evidence.window_m)
            self._tiles = self._lattice.kept_within(self._tiles, self._window)

    @property
    def spec(self) -> GridSpec | None:
        """Where the map lies: the window, the configured extent, or all that was seen; None if nothing."""
        return self._window or self._fixed or self._lattice.spec_of_tiles(self._tiles)

    @property
    def grid(self) -> OccupancyGrid | None:
        """A copy of the map; None if nothing was seen."""
        spec = self.spec
        if spec is None:
            return None
        classes = np.zeros(spec.shape, np.uint8)
        for key, here, there in self._lattice.overlapped(spec):
            if key in self._tiles:
                classes[here] = self._tiles[key].classes[there]
        return OccupancyGrid(spec, classes, self._stamp_ns)

    def copy(self) -> "LogOddsMap":
        """The same map with arrays of its own: it stays as it is while this one goes on."""
        twin = copy(self)
        twin._tiles = {key: tile.copy() for key, tile in self._tiles.items()}
        return twin

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
