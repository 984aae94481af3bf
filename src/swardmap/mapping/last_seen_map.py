"""The paper's map: the last frame that saw a cell decides (Sec. 3.5)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import GridConfig
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.mapping.tiles import TILE, Lattice, TileKey
from swardmap.perception.observation import Observation

GROWTH_M = 8.0
"""A growing map is enlarged in steps of this size, so that its extent does not change with every frame."""


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """A tile: class of each cell, and frames in a row that saw grass there; changed in place."""

    classes: NDArray[np.uint8]
    grass_in_a_row: NDArray[np.uint8]


POINTS_OF_DOUBT = 3
"""One or two points off the ground are noise of the depth, and no reason to forget that a cell was free."""


class LastSeenMap:
    """Accumulates observations: clears what was seen as grass, then marks (Sec. 3.5).

    Without a fixed extent the map grows with what is seen. An obstacle cell is cleared once
    `obstacle_clear_frames` frames in a row have seen grass there, a person cell after
    `person_clear_frames`; frames that do not see the cell do not count. What was free and is in doubt when
    it is seen again, by three points or as many as would clear it, is unknown: the last frame decides.

    Args:
        config: resolution, extent and evidence.
        frame_id: frame of the map.
    """

    def __init__(self, config: GridConfig, frame_id: str = "map") -> None:
        self.reconfigure(config)
        self._fixed = fixed_spec(config, frame_id)
        self._lattice = Lattice(lattice_corner(config, frame_id))
        self._tiles: dict[TileKey, _Cells] = {}
        self._extent: tuple[int, int, int, int] | None = None
        self._stamp_ns = 0

    def reconfigure(self, config: GridConfig) -> None:
        """Judge frames from now on by other evidence; what is known stays, and so do cells and extent."""
        self._frames_to_clear = np.array(
            [1, 1, config.obstacle_clear_frames, config.person_clear_frames], np.uint8
        )
        self._points_of_doubt = min(POINTS_OF_DOUBT, config.min_grass_points)

    def integrate(self, seen: Observation) -> None:
        """Update the map with what one frame has seen; `seen` must be on this map's lattice."""
        from swardmap.kernels import grid as kernel

        if self._fixed is None:
            self._extent = self._extent_with(seen)
            if self._extent is None:  # nothing seen yet, and nothing now
                return
        doubted = self._doubted(seen)
        for key, here, there in self._lattice.overlapped(seen.spec):
            if key not in self._tiles:
                if not seen.classes[here].any():
                    continue
                self._tiles[key] = _Cells(*(np.zeros((TILE, TILE), np.uint8) for _ in range(2)))
            tile = self._tiles[key]
            kernel.merge(
                seen.classes[here], doubted[here], tile.classes[there], tile.grass_in_a_row[there],
                self._frames_to_clear,
            )  # fmt: skip
        self._stamp_ns = max(self._stamp_ns, seen.stamp_ns)

    def _doubted(self, seen: Observation) -> NDArray[np.bool_]:
        """Cells with points enough that are in doubt; without ground a view says nothing of lawn."""
        if seen.ground is None:
            return np.zeros(seen.spec.shape, np.bool_)
        return np.asarray(seen.points[..., MapClass.UNKNOWN] >= self._points_of_doubt)

    @property
    def grid(self) -> OccupancyGrid | None:
        """A copy of the map so far; None if nothing was seen and no extent is configured."""
        spec = self._fixed
        if spec is None:
            if self._extent is None:
                return None
            x0, x1, y0, y1 = self._extent
            spec = self._lattice.spec_of((x0, y0), x1 - x0, y1 - y0)
        classes = np.full(spec.shape, MapClass.UNKNOWN, np.uint8)
        for key, here, there in self._lattice.overlapped(spec):
            if key in self._tiles:
                classes[here] = self._tiles[key].classes[there]
        return OccupancyGrid(spec, classes, self._stamp_ns)

    def _extent_with(self, seen: Observation) -> tuple[int, int, int, int] | None:
        """Cells (x0, x1, y0, y1) of the map, enlarged if a known cell of `seen` lies outside them."""
        known = seen.classes != MapClass.UNKNOWN
        columns, rows = np.flatnonzero(known.any(axis=0)), np.flatnonzero(known.any(axis=1))
        if len(columns) == 0:
            return self._extent
        ix, iy = seen.spec.offset_in(self._lattice.corner_cell)
        x0, x1 = ix + int(columns[0]), ix + int(columns[-1]) + 1
        y0, y1 = iy + int(rows[0]), iy + int(rows[-1]) + 1
        if self._extent is None:
            return x0, x1, y0, y1
        step = round(GROWTH_M / seen.spec.resolution_m)
        ox0, ox1, oy0, oy1 = self._extent
        return (
            ox0 if x0 >= ox0 else min(x0 - step, ox0),
            ox1 if x1 <= ox1 else max(x1 + step, ox1),
            oy0 if y0 >= oy0 else min(y0 - step, oy0),
            oy1 if y1 <= oy1 else max(y1 + step, oy1),
        )


def fixed_spec(config: GridConfig, frame_id: str) -> GridSpec | None:
    """The grid the configuration asks for, or None if it is to grow."""
    if config.origin_m is None or config.size_m is None:
        return None
    r = config.resolution_m
    width, height = (max(1, round(size / r)) for size in config.size_m)
    return GridSpec(r, width, height, config.origin_m, frame_id)


def lattice_corner(config: GridConfig, frame_id: str) -> GridSpec:
    """The cell that cells of a map are counted from: at its origin if it has one, else at (0, 0)."""
    corner = (0.0, 0.0) if config.origin_m is None else config.origin_m
    return GridSpec(config.resolution_m, 1, 1, corner, frame_id)
