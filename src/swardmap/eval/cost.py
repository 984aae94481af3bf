"""What a margin costs: the area a mower can still reach as obstacles are grown, by exact morphology."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.errors import InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.mapping.polygons import cells_inside

EIGHT = np.ones((3, 3), np.bool_)


@dataclass(frozen=True, slots=True)
class AreaPoint:
    """One point of the curve.

    Attributes:
        margin_m: what obstacles are grown by.
        reachable_m2: area that the mower's disc sweeps without touching a grown obstacle, what is
            unknown, or the outside of the work area.
        share: of the grass inside the work area; None if there is none.
        covered: share of the missed cells that this margin covers; None without missed cells.
    """

    margin_m: float
    reachable_m2: float
    share: float | None
    covered: float | None = None


def reachable_areas(
    grid: OccupancyGrid,
    polygon_m: ArrayLike,
    mower_width_m: float,
    margins_m: Iterable[float],
    start_m: Sequence[float] | None = None,
) -> list[AreaPoint]:
    """Area that is still reached for each margin.

    The mower is a disc of its width, so that it may turn anywhere. A cell belongs to a disc if its centre
    does. Unknown cells and cells whose centre is outside the polygon cannot be entered.

    Args:
        grid: map of the garden.
        polygon_m: (N, 2) corners of the work area in the grid's frame.
        mower_width_m: of the disc.
        margins_m: what to grow obstacles by.
        start_m: (x, y) where the mower is; only what is connected to it counts. None = the largest part.

    Returns:
        One point for each margin, in their order.
    """
    if not (np.isfinite(mower_width_m) and mower_width_m > 0):
        raise InvalidValueError(f"mower: expected a positive width in metres, got {mower_width_m}")
    r = grid.spec.resolution_m
    grass = (grid.classes == MapClass.GRASS) & cells_inside(grid.spec, polygon_m)
    to_obstacle = squared_distance(grid.is_obstacle)
    points = []
    for margin_m in margins_m:
        free = grass & (np.sqrt(to_obstacle.astype(np.float64)) * r > margin_m)
        count = int(np.count_nonzero(_swept(free, mower_width_m / 2 / r, _start_cell(grid.spec, start_m))))
        total = int(np.count_nonzero(grass))
        points.append(AreaPoint(float(margin_m), count * r * r, count / total if total else None))
    return points


def squared_distance(cells: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(H, W) int64 squared distance in cells from each cell to the nearest True one, exact.

    Where there is none, a distance larger than any in the grid.
    """
    if not cells.any():
        return np.full(cells.shape, cells.shape[0] ** 2 + cells.shape[1] ** 2, np.int64)
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~cells, return_distances=False, return_indices=True)
    dy = nearest[0].astype(np.int64) - np.arange(cells.shape[0])[:, None]
    dx = nearest[1].astype(np.int64) - np.arange(cells.shape[1])
    squared: NDArray[np.int64] = dx * dx + dy * dy
    return squared


def _start_cell(spec: GridSpec, start_m: Sequence[float] | None) -> tuple[int, int] | None:
    if start_m is None:
        return None
    cell = spec.cell_of(start_m)
    if not spec.contains(cell):
        raise InvalidValueError(f"start: expected a point of the map {spec.extent_m}, got {tuple(start_m)}")
    return int(cell[1]), int(cell[0])


def _swept(free: NDArray[np.bool_], radius_cells: float, start: tuple[int, int] | None) -> NDArray[np.bool_]:
    """Cells a disc covers that moves from `start`, or in the largest part, without leaving `free`."""
    from scipy.ndimage import label

    blocked = np.pad(~free, 1, constant_values=True)  # beyond the map is not free
    limit = radius_cells * radius_cells + 1e-9
    centers = (squared_distance(blocked) > limit)[1:-1, 1:-1]
    parts, n = label(centers, EIGHT)
    if n == 0 or (start is not None and parts[start] == 0):
        return np.zeros_like(free)
    if start is not None:
        return _around(parts == parts[start], limit)
    return max((_around(parts == k, limit) for k in range(1, n + 1)), key=np.count_nonzero)


def _around(centers: NDArray[np.bool_], limit: float) -> NDArray[np.bool_]:
    return squared_distance(centers) <= limit


def margin_cost(
    results: Mapping[str, Any], map_file: Path | None, work_area: Path | None, mower_width_m: float
) -> dict[str, Any] | None:
    """The curve of an evaluation: reachable share of a map against share of misses covered.

    Args:
        results: of the evaluation, with its margin curve.
        map_file: map (YAML) of the garden; None = no curve.
        work_area: polygon (YAML); None = the whole map.
        mower_width_m: of the mower.

    Returns:
        Points at margins from 0 to 1 m and at the proven margin, or None without a map.
    """
    if map_file is None:
        return None
    from swardmap.io.maps.area_files import read_metric_area
    from swardmap.io.maps.map_files import read_map

    grid = read_map(map_file)
    x0, x1, y0, y1 = grid.spec.extent_m
    whole = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    polygon = whole if work_area is None else read_metric_area(work_area).polygons[0].rings[0]
    proven = results["margin"]["margin_m"]
    margins = sorted({round(0.05 * i, 2) for i in range(21)} | ({proven} if proven is not None else set()))
    curve = results["margin"]["curve"]
    points = [
        replace(point, covered=_covered(curve, point.margin_m))
        for point in reachable_areas(grid, polygon, mower_width_m, margins)
    ]
    return {
        "map": str(map_file),
        "mower_width_m": mower_width_m,
        "margin_m": proven,
        "points": [asdict(point) for point in points],
    }


def _covered(curve: Sequence[Sequence[float]], margin_m: float) -> float | None:
    reached = [share for distance, share in curve if distance <= margin_m + 1e-9]
    return None if not curve else (reached[-1] if reached else 0.0)
