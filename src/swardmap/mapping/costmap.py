"""Costs for Nav2: layers, how they combine, inflation by the measured margin, and Nav2's tables.

Values are those of nav2_costmap_2d: 0 free, 1..252 scaled, 253 inscribed, 254 lethal, 255 unknown.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.config import CostmapConfig
from swardmap.errors import InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass

FREE, INSCRIBED, LETHAL, NO_INFORMATION = 0, 253, 254, 255

COST_OF_CLASS = np.array([NO_INFORMATION, FREE, LETHAL, LETHAL], np.uint8)
"""Cost of each MapClass before inflation."""

Combination = Literal["overwrite", "max", "max_keep_unknown"]


@dataclass(frozen=True, slots=True, eq=False)
class Costmap:
    """What a planner pays to have its centre in a cell.

    Attributes:
        spec: where the grid lies.
        costs: (height, width) uint8 in Nav2's values.
        stamp_ns: time of the last measurement in it.
    """

    spec: GridSpec
    costs: NDArray[np.uint8]
    stamp_ns: int = 0

    def __post_init__(self) -> None:
        if self.costs.shape != self.spec.shape or self.costs.dtype != np.uint8:
            raise InvalidValueError(
                f"costmap: expected uint8 of shape {self.spec.shape}, "
                f"got {self.costs.dtype} of shape {self.costs.shape}"
            )


def build_costmap(
    grid: OccupancyGrid, config: CostmapConfig, boundary: NDArray[np.uint8] | None = None
) -> Costmap:
    """The costmap of a grid: obstacle layer, boundary layer, inflation by margin and radius.

    Args:
        grid: the map.
        config: margins, radii, decay.
        boundary: (height, width) uint8 costs of `boundary_layer` or of a work area, or None. Free in it
            says nothing; what is lethal is inflated without a margin.

    Returns:
        The costmap; unknown stays unknown unless something lethal or inscribed reaches it.
    """
    costs = obstacle_layer(grid)
    if boundary is not None:
        barred = np.where(boundary >= INSCRIBED, boundary, np.uint8(NO_INFORMATION))
        dear = np.where((boundary > FREE) & (boundary < INSCRIBED), boundary, np.uint8(NO_INFORMATION))
        # where the boundary is FREE it says nothing, and what may be driven on at a price must be known
        costs = combine(combine(costs, barred, "max"), dear, "max_keep_unknown")
    for seeds, margin_m in _seeds_by_margin(grid, costs == LETHAL, config):
        costs = inflate(costs, grid.spec, config, margin_m, seeds)
    return Costmap(grid.spec, costs, grid.stamp_ns)


def _seeds_by_margin(
    grid: OccupancyGrid, lethal: NDArray[np.bool_], config: CostmapConfig
) -> list[tuple[NDArray[np.bool_], float]]:
    """Cells to inflate, by margin: persons may have their own, and no camera measured a boundary."""
    hazards, persons = grid.is_obstacle, grid.classes == MapClass.PERSON
    person_margin_m = config.margin_m if config.person_margin_m is None else config.person_margin_m
    seeds = [(lethal & ~hazards, 0.0), (persons, person_margin_m), (hazards & ~persons, config.margin_m)]
    merged: dict[float, NDArray[np.bool_]] = {}
    for cells, margin_m in seeds:
        if cells.any():
            merged[margin_m] = merged[margin_m] | cells if margin_m in merged else cells
    return [(cells, margin_m) for margin_m, cells in merged.items()]


def obstacle_layer(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """(height, width) uint8: grass free, obstacle and person lethal, unknown without information."""
    return COST_OF_CLASS[grid.classes]


def boundary_layer(spec: GridSpec, polygon_m: ArrayLike) -> NDArray[np.uint8]:
    """The edge of the work area: cells whose centre lies outside the polygon are lethal.

    Args:
        spec: the grid.
        polygon_m: (N, 2) corners in the grid's frame, in order; the last joins the first.

    Returns:
        (height, width) uint8, 0 inside, 254 outside. Even-odd rule, so that holes can be cut.
    """
    corners = np.asarray(polygon_m, np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise InvalidValueError(
            f"boundary: expected at least three finite corners (N, 2), got shape {corners.shape}"
        )
    xs = spec.center_of(np.stack([np.arange(spec.width), np.zeros(spec.width)], axis=-1))[:, 0]
    ys = spec.center_of(np.stack([np.zeros(spec.height), np.arange(spec.height)], axis=-1))[:, 1]
    inside = np.zeros(spec.shape, bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        rows = np.flatnonzero((ys >= min(y0, y1)) & (ys < max(y0, y1)))
        crossings = x0 + (ys[rows] - y0) * ((x1 - x0) / (y1 - y0)) if len(rows) else ys[rows]
        inside[rows] ^= xs[None, :] < crossings[:, None]
    return np.where(inside, FREE, LETHAL).astype(np.uint8)


def combine(
    below: NDArray[np.uint8], above: NDArray[np.uint8], rule: Combination = "max"
) -> NDArray[np.uint8]:
    """Put one layer over another, as Nav2's combination_method 0, 1 and 2 do.

    Args:
        below: (height, width) uint8 costs so far.
        above: (height, width) uint8 costs of the layer; its unknown cells change nothing.
        rule: `overwrite` (0): the layer wins where it knows something. `max` (1): the higher cost
            wins, and what the layer knows replaces unknown. `max_keep_unknown` (2): the same, but
            unknown below stays unknown.
    """
    knows = above != NO_INFORMATION
    if rule == "overwrite":
        return np.where(knows, above, below)
    if rule == "max":
        raised = knows & ((below == NO_INFORMATION) | (above > below))
    elif rule == "max_keep_unknown":
        raised = knows & (below != NO_INFORMATION) & (above > below)
    else:
        raise InvalidValueError(f"combination: expected overwrite, max or max_keep_unknown, got '{rule}'")
    return np.where(raised, above, below)


def inflate(
    costs: NDArray[np.uint8],
    spec: GridSpec,
    config: CostmapConfig,
    margin_m: float = 0.0,
    seeds: NDArray[np.bool_] | None = None,
) -> NDArray[np.uint8]:
    """Grow lethal cells by the margin, then let the cost fall off as Nav2's inflation layer does.

    Exact Euclidean distances between cell centres. With a margin of 0 the result is Nav2's.

    Args:
        costs: (height, width) uint8.
        spec: the grid.
        config: radii, decay, and what happens to unknown cells.
        margin_m: cells this near to a lethal cell are lethal too: a miss may hide there.
        seeds: cells to inflate; None = all lethal cells.

    Returns:
        (height, width) uint8; `costs` is not changed.
    """
    from swardmap.kernels import inflation as kernel

    seeds = costs == LETHAL if seeds is None else seeds
    inflated = costs.copy()
    table = cost_of_squared_distance(spec.resolution_m, config, margin_m)
    radius = math.isqrt(len(table) - 1) - 1
    squared = np.empty(costs.shape, np.int32)
    kernel.squared_distances(np.ascontiguousarray(seeds), radius, squared)
    kernel.apply_costs(squared, table, config.inflate_unknown, inflated)
    return inflated


def cost_of_squared_distance(
    resolution_m: float, config: CostmapConfig, margin_m: float = 0.0
) -> NDArray[np.uint8]:
    """Cost by squared distance in cells: exact, since squared distances between cells are whole numbers.

    Returns:
        (n,) uint8; the last entry is 0 and stands for everything farther than the inflation reaches.
    """
    margin_cells = margin_m / resolution_m
    reach = math.ceil(config.inflation_radius_m / resolution_m)  # Nav2 rounds the radius up to cells
    radius = math.ceil(margin_cells) + reach
    cells = np.sqrt(np.arange((radius + 1) ** 2 + 1, dtype=np.float64))
    beyond = np.maximum(0.0, cells - margin_cells)
    meters = beyond * resolution_m
    exponents = np.minimum(0, -config.cost_scaling_factor * (meters - config.inscribed_radius_m))
    decay = np.array([math.exp(e) for e in exponents.tolist()])  # as C's exp; NumPy's differs in the last bit
    table = np.where(meters <= config.inscribed_radius_m, INSCRIBED, (INSCRIBED - 1) * decay)
    table = np.where(beyond > reach, FREE, table)
    # a measured margin is a sum of rounded numbers: one that ends at a cell's centre reaches that cell
    table = np.where(cells <= margin_cells + 1e-9, LETHAL, table)
    table[-1] = FREE
    return table.astype(np.uint8)


def squared_distances(occupied: NDArray[np.bool_], radius: int) -> NDArray[np.int32]:
    """Squared distance in cells to the nearest occupied cell, capped at (radius + 1) squared.

    The NumPy twin of the kernel: nearest above and below in each column, then over the columns.
    """
    height, width = occupied.shape
    far = radius + 1
    rows = np.arange(height)[:, None]
    last_above = np.maximum.accumulate(np.where(occupied, rows, -far), axis=0)
    next_below = np.minimum.accumulate(np.where(occupied, rows, height + far)[::-1], axis=0)[::-1]
    vertical = np.minimum(np.minimum(rows - last_above, next_below - rows), far)
    padded = np.pad(vertical**2, ((0, 0), (radius, radius)), constant_values=far**2)
    shifted: Sequence[NDArray[np.int64]] = [
        padded[:, radius + dx : radius + dx + width] + dx**2 for dx in range(-radius, radius + 1)
    ]
    nearest: NDArray[np.int64] = np.min(shifted, axis=0)
    return np.minimum(nearest, far**2).astype(np.int32)


def occupancy_from_costs(costs: NDArray[np.uint8]) -> NDArray[np.int8]:
    """nav_msgs/OccupancyGrid values of costs, as Nav2 publishes them: 253 -> 99, 254 -> 100, 255 -> -1."""
    scaled = 1 + (97 * (np.arange(256) - 1)) // 251
    scaled[[FREE, INSCRIBED, LETHAL, NO_INFORMATION]] = 0, 99, 100, -1
    table: NDArray[np.int8] = scaled.astype(np.int8)
    return table[costs]


def costs_from_occupancy(values: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Costs of nav_msgs/OccupancyGrid values by the rule of Costmap2D's constructor: round(v * 254 / 100).

    Not the inverse of `occupancy_from_costs`, and not the rule of Nav2's static layer.

    Raises:
        InvalidValueError: for values outside -1..100.
    """
    return _occupancy_table(np.floor(np.arange(101) * LETHAL / 100 + 0.5))[_checked(values)]


def static_layer_costs(
    values: NDArray[np.int8], track_unknown: bool = True, trinary: bool = True
) -> NDArray[np.uint8]:
    """Costs of nav_msgs/OccupancyGrid values by the rule of Nav2's static layer (interpretValue).

    Args:
        values: (height, width) int8, -1..100.
        track_unknown: False makes unknown free, as Nav2 does when told so.
        trinary: Nav2's trinary_costmap: everything below 99 is free.
    """
    between = np.zeros(101) if trinary else np.trunc(np.arange(101) / 100 * LETHAL)
    table = _occupancy_table(between)
    table[99], table[100], table[-1] = INSCRIBED, LETHAL, NO_INFORMATION if track_unknown else FREE
    return table[_checked(values)]


def _occupancy_table(known: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(102,) uint8: index 0..100 by value, index -1 for unknown."""
    return np.append(known, NO_INFORMATION).astype(np.uint8)


def _checked(values: NDArray[np.int8]) -> NDArray[np.int8]:
    if values.size and (values.min() < -1 or values.max() > 100):
        raise InvalidValueError(f"occupancy values: expected -1..100, got {values.min()}..{values.max()}")
    return values
