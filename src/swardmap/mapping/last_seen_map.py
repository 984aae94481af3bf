"""A map that persists over a sequence: one frame's grid after another, on one lattice of cells."""

import numpy as np
from numpy.typing import NDArray

from swardmap.config import GridConfig
from swardmap.grid import GridSpec, OccupancyGrid, overlap
from swardmap.labels import MapClass

GROWTH_M = 8.0
"""A growing map is enlarged in steps of this size, so that it is not copied for every frame."""


class GridMapper:
    """Accumulates standalone grids: clears what was seen as grass, then marks (Sec. 3.5).

    Without a fixed extent the map grows with what is seen. An obstacle cell is cleared once
    `obstacle_clear_frames` frames in a row have seen grass there, a person cell after
    `person_clear_frames`; frames that do not see the cell do not count.

    Args:
        config: resolution, extent and evidence.
        frame_id: frame of the map.
    """

    def __init__(self, config: GridConfig, frame_id: str = "map") -> None:
        self._resolution_m = config.resolution_m
        self._frame_id = frame_id
        self._frames_to_clear = np.array(
            [1, 1, config.obstacle_clear_frames, config.person_clear_frames], np.uint8
        )
        self._spec = fixed_spec(config, frame_id)
        self._fixed = self._spec is not None
        self._classes: NDArray[np.uint8] = np.zeros((0, 0), np.uint8)
        self._grass_in_a_row: NDArray[np.uint8] = np.zeros((0, 0), np.uint8)
        if self._spec is not None:
            self._classes = np.full(self._spec.shape, MapClass.UNKNOWN, np.uint8)
            self._grass_in_a_row = np.zeros(self._spec.shape, np.uint8)
        self._stamp_ns = 0

    def integrate(self, seen: OccupancyGrid) -> None:
        """Update the map with what one frame has seen; `seen` must be on this map's lattice."""
        spec = self._spec if self._fixed else self._grown_to(seen)
        if spec is None:  # nothing seen yet, and nothing now
            return
        from swardmap.kernels import grid as kernel

        here, there = overlap(seen.spec, spec)
        kernel.merge(
            seen.classes[here], self._classes[there], self._grass_in_a_row[there], self._frames_to_clear
        )
        self._stamp_ns = max(self._stamp_ns, seen.stamp_ns)

    @property
    def grid(self) -> OccupancyGrid | None:
        """A copy of the map so far; None if nothing was seen and no extent is configured."""
        if self._spec is None:
            return None
        return OccupancyGrid(self._spec, self._classes.copy(), self._stamp_ns)

    def _grown_to(self, seen: OccupancyGrid) -> GridSpec | None:
        """The map's spec, enlarged if a known cell of `seen` lies outside it."""
        needed = _known_extent_m(seen)
        if needed is None:
            return self._spec
        x0, x1, y0, y1 = needed
        old = self._spec
        if old is not None:
            ox0, ox1, oy0, oy1 = old.extent_m
            half = self._resolution_m / 2  # extents are on the lattice: compare without rounding trouble
            if x0 > ox0 - half and x1 < ox1 + half and y0 > oy0 - half and y1 < oy1 + half:
                return old
            x0, x1 = (min(x0 - GROWTH_M, ox0) if x0 < ox0 - half else ox0,
                      max(x1 + GROWTH_M, ox1) if x1 > ox1 + half else ox1)  # fmt: skip
            y0, y1 = (min(y0 - GROWTH_M, oy0) if y0 < oy0 - half else oy0,
                      max(y1 + GROWTH_M, oy1) if y1 > oy1 + half else oy1)  # fmt: skip
        # whole cells, rounded outwards from half a cell inside so that lattice points stay put
        half = self._resolution_m / 2
        spec = GridSpec.covering(
            self._resolution_m, (x0 + half, y0 + half), (x1 - half, y1 - half), self._frame_id
        )
        classes = np.full(spec.shape, MapClass.UNKNOWN, np.uint8)
        streak = np.zeros(spec.shape, np.uint8)
        if old is not None:
            here, there = overlap(old, spec)
            classes[there], streak[there] = self._classes[here], self._grass_in_a_row[here]
        self._spec, self._classes, self._grass_in_a_row = spec, classes, streak
        return spec


def fixed_spec(config: GridConfig, frame_id: str) -> GridSpec | None:
    """The grid the configuration asks for, or None if it is to grow."""
    if config.origin_m is None or config.size_m is None:
        return None
    r = config.resolution_m
    width, height = (max(1, round(size / r)) for size in config.size_m)
    return GridSpec(r, width, height, config.origin_m, frame_id)


def _known_extent_m(seen: OccupancyGrid) -> tuple[float, float, float, float] | None:
    """(x_min, x_max, y_min, y_max) of the known cells' outer border, or None if there are none."""
    known = seen.classes != MapClass.UNKNOWN
    columns, rows = np.flatnonzero(known.any(axis=0)), np.flatnonzero(known.any(axis=1))
    if len(columns) == 0:
        return None
    (x, y), r = seen.spec.origin_m, seen.spec.resolution_m
    return x + columns[0] * r, x + (columns[-1] + 1) * r, y + rows[0] * r, y + (rows[-1] + 1) * r
