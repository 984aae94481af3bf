"""The ground under and ahead of a robot that starts: no camera sees it, and a person says that it is free.

Unknown is never free, so a robot that begins in its own blind zone has no path. The operator, who stands
beside it, may grant a start area: the robot's width from its base to where its cameras see the ground. It
lies where the robot stood when it was granted, counts only where nobody knows anything, is limited in size
and time, and ends early when the robot has left it, the stop flag is set, or the map is cleared.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass

NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class StartArea:
    """All within a radius of a straight line from the robot's base ahead.

    Attributes:
        frame_id: of the map.
        from_m, to_m: (x, y) ends of the line.
        radius_m: half the width.
        until_ns: when it ends by itself.
    """

    frame_id: str
    from_m: tuple[float, float]
    to_m: tuple[float, float]
    radius_m: float
    until_ns: int

    def distance_m(self, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of points (..., 2) from the area; 0 within."""
        begin, way = np.asarray(self.from_m), np.subtract(self.to_m, self.from_m)
        along = (xy_m - begin) @ way / max(float(way @ way), 1e-12)
        nearest = begin + np.clip(along, 0.0, 1.0)[..., None] * way
        distance: NDArray[np.float64] = np.hypot(*np.moveaxis(xy_m - nearest, -1, 0)) - self.radius_m
        return np.maximum(distance, 0.0)

    def ended(self, now_ns: int, xy_m: tuple[float, float] | None) -> str:
        """Why it has ended; empty while it lasts.

        Args:
            now_ns: the time.
            xy_m: where the robot's base is now, or None.
        """
        if now_ns >= self.until_ns:
            return "its time is over"
        if xy_m is not None and self.distance_m(np.asarray(xy_m)) > 0:
            return "the robot has left it"
        return ""


def start_area(T_map_base: Pose, radius_m: float, ahead_m: float, lasts_s: float, now_ns: int) -> StartArea:
    """The area of a robot that stands now.

    Args:
        T_map_base: pose of its base.
        radius_m: half the width.
        ahead_m: length of the line along the robot's x axis; negative = behind it.
        lasts_s: so long at most.
        now_ns: the time.
    """
    x, y = (float(v) for v in T_map_base.position_m[:2])
    heading = math.atan2(T_map_base.matrix[1, 0], T_map_base.matrix[0, 0])
    end = x + ahead_m * math.cos(heading), y + ahead_m * math.sin(heading)
    return StartArea(T_map_base.parent, (x, y), end, radius_m, now_ns + round(lasts_s * NS))


def with_start_area(grid: OccupancyGrid, area: StartArea) -> OccupancyGrid:
    """The map with the unknown cells of a start area free; what anybody has seen stays as it is."""
    if area.frame_id != grid.spec.frame_id:
        return grid
    there, inside = _window(grid.spec, area)
    classes = grid.classes.copy()
    window = classes[there]
    window[inside & (window == MapClass.UNKNOWN)] = MapClass.GRASS
    return replace(grid, classes=classes)


def gap_m(grid: OccupancyGrid, area: StartArea) -> float | None:
    """Distance from a start area to the nearest cell seen free, less a cell; None if there is none."""
    rows, columns = np.nonzero(grid.classes == MapClass.GRASS)
    if area.frame_id != grid.spec.frame_id or len(rows) == 0:
        return None
    nearest = float(area.distance_m(grid.spec.center_of(np.column_stack([columns, rows]))).min())
    return max(0.0, nearest - grid.spec.resolution_m)


def _window(spec: GridSpec, area: StartArea) -> tuple[tuple[slice, slice], NDArray[np.bool_]]:
    """The part of a grid around an area, and which of its cells have their centre in the area."""
    ends = np.array([area.from_m, area.to_m])
    size = [spec.width, spec.height]
    low = np.clip(spec.cell_of(ends.min(axis=0) - area.radius_m), 0, size)
    high = np.clip(spec.cell_of(ends.max(axis=0) + area.radius_m) + 1, low, size)
    (x0, y0), (x1, y1) = low.tolist(), high.tolist()
    iy, ix = np.mgrid[y0:y1, x0:x1]
    inside = area.distance_m(spec.center_of(np.stack([ix, iy], axis=-1))) <= 0
    return (slice(y0, y1), slice(x0, x1)), inside
