"""How large the map of a run may become: a jump of the poses is an error, not a map of gigabytes."""

from dataclasses import dataclass

import numpy as np

from swardmap.config.mapping import MAX_MAP_CELLS
from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.grid import GridSpec


@dataclass(slots=True)
class Bounds:
    """The rectangle around what the frames of a run could see.

    Attributes:
        resolution_m: edge of a cell.
        max_cells: largest map.
    """

    resolution_m: float
    max_cells: int = MAX_MAP_CELLS
    _low_m: tuple[float, float] | None = None
    _high_m: tuple[float, float] = (0.0, 0.0)
    _last_m: tuple[float, float] = (0.0, 0.0)
    _last: str = "the one before"

    def begin_with(self, saved: GridSpec) -> None:
        """Take the map that a run goes on from.

        Raises:
            InputError: if it is too large already.
        """
        if saved.width * saved.height > self.max_cells:
            raise InputError(
                f"saved map: expected at most {self.max_cells} cells, got {saved.width} x {saved.height}; "
                "set evidence.window_m, or begin a new map"
            )
        x0, x1, y0, y1 = saved.extent_m
        self._low_m, self._high_m = (x0, y0), (x1, y1)
        self._last_m, self._last = ((x0 + x1) / 2, (y0 + y1) / 2), "the middle of the saved map"

    def take_in(self, name: str, T_map_camera: Pose, seen: GridSpec) -> None:
        """Take what one frame could see.

        Raises:
            InputError: if the map would become too large.
        """
        low, size = np.array(seen.origin_m), np.array([seen.width, seen.height]) * seen.resolution_m
        high = low + size
        place = T_map_camera.position_m[:2]
        if self._low_m is not None:
            low, high = np.minimum(low, self._low_m), np.maximum(high, self._high_m)
        cells = int(np.prod(np.ceil((high - low) / self.resolution_m)))
        if cells > self.max_cells:
            moved = float(np.hypot(*(place - self._last_m)))
            raise InputError(
                f"frame {name} is {moved:.1f} m from {self._last}, and the map would have {cells} cells, "
                f"more than {self.max_cells}: check the poses for a jump, or set a larger "
                "grid.resolution_m, grid.origin_m with grid.size_m, or evidence.window_m"
            )
        self._low_m, self._high_m = (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))
        self._last_m, self._last = (float(place[0]), float(place[1])), "the one before"
