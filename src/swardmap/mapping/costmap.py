"""Costs for Nav2: a list of layers, how they combine, inflation by the measured margin, and Nav2's tables.

Values are those of nav2_costmap_2d: 0 free, 1..252 scaled, 253 inscribed, 254 lethal, 255 unknown. Which
layers a configuration asks for says `swardmap.io.maps.costmap_layers`.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

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


class Layer(Protocol):
    """One layer of a costmap: takes the costs so far, as Nav2's `updateCosts` does, and gives new ones."""

    @property
    def frame_id(self) -> str | None:
        """Frame it is drawn in; None = whatever the grid's is."""

    def apply(self, costs: NDArray[np.uint8], grid: OccupancyGrid) -> NDArray[np.uint8]:
        """(height, width) uint8 costs with this layer in them; `costs` is not changed."""


@dataclass(frozen=True, slots=True)
class ObstacleLayer:
    """What was seen: grass free, obstacle and person lethal, unknown without information."""

    frame_id: None = None

    def apply(self, costs: NDArray[np.uint8], grid: OccupancyGrid) -> NDArray[np.uint8]:
        """The costs of the cells' classes, over what was there."""
        return combine(costs, COST_OF_CLASS.take(grid.classes), "overwrite")


@dataclass(frozen=True, slots=True)
class InflationLayer:
    """Obstacles grown by the margin, then costs that fall off; what no camera measured has no margin.

    Attributes:
        config: margins, radii, decay.
    """

    config: CostmapConfig
    frame_id: None = None

    def apply(self, costs: NDArray[np.uint8], grid: OccupancyGrid) -> NDArray[np.uint8]:
        """The costs around all that is lethal."""
        for seeds, margin_m in _seeds_by_margin(grid, costs == LETHAL, self.config):
            costs = inflate(costs, grid.spec, self.config, margin_m, seeds)
        return costs


def build_costmap(grid: OccupancyGrid, config: CostmapConfig, layers: Sequence[Layer] = ()) -> Costmap:
    """The costmap of a grid: what was seen, then `layers`, then margin and inflation around all of it.

    Args:
        grid: the map.
        config: margins, radii, decay.
        layers: between them, such as a work area.

    Returns:
        The costmap; unknown stays unknown unless something lethal or inscribed reaches it.
    """
    return layered_costmap(grid, (ObstacleLayer(), *layers, InflationLayer(config)))


def layered_costmap(grid: OccupancyGrid, layers: Iterable[Layer]) -> Costmap:
    """The costmap of a grid by a list of layers, the lowest first; nothing is known below the first."""
    costs = np.full(grid.spec.shape, NO_INFORMATION, np.uint8)
    for layer in layers:
        costs = layer.apply(costs, grid)
    return Costmap(grid.spec, costs, grid.stamp_ns)


def check_frames(layers: Iterable[Layer], frame_id: str) -> None:
    """Hold that poses or a grid are in the frame that layers are drawn in.

    Raises:
        InvalidValueError: if not.
    """
    for layer in layers:
        if layer.frame_id not in (None, frame_id):
            raise InvalidValueError(
                f"the work area is in the frame '{layer.frame_id}', the map in '{frame_id}': "
                "set area.frame_id to the frame whose origin the datum is"
            )


def _seeds_by_margin(
    grid: OccupancyGrid, lethal: NDArray[np.bool_], config: CostmapConfig
) -> list[tuple[NDArray[np.bool_], float]]:
    """Cells to inflate, by margin: persons may have their own, and no camera measured a boundary."""
    hazards, persons = grid.is_obstacle, grid.classes == MapClass.PERSON
    seeds = [
        (lethal & ~hazards, 0.0),
        (persons, config.people_margin_m),
        (hazards & ~persons, config.obstacle_margin_m),
    ]
    merged: dict[float, NDArray[np.bool_]] = {}
    for cells, margin_m in seeds:
        if cells.any():
            merged[margin_m] = merged[margin_m] | cells if margin_m in merged else cells
    return [(cells, margin_m) for margin_m, cells in merged.items()]


def restrict(costs: NDArray[np.uint8], zone: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Put the costs of a zone over what was seen; where it is free or unknown it says nothing.

    What may not be entered is so on unknown ground too; what may be entered at a price must be known.

    Args:
        costs: (height, width) uint8 costs so far.
        zone: (height, width) uint8.
    """
    says_nothing = np.uint8(NO_INFORMATION)
    forbidden = np.where(zone >= INSCRIBED, zone, says_nothing)
    priced = np.where((zone > FREE) & (zone < INSCRIBED), zone, says_nothing)
    return combine(combine(costs, forbidden, "max"), priced, "max_keep_unknown")


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
    return table.take(costs)  # in half the time of an index


def costs_from_occupancy(values: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Costs of nav_msgs/OccupancyGrid values by the rule of Costmap2D's constructor: round(v * 254 / 100).

    Not the inverse of `occupancy_from_costs`, and not the rule of Nav2's static layer.

    Raises:
        InvalidValueError: for values outside -1..100.
    """
    return _occupancy_table(np.floor(np.arange(101) * LETHAL / 100 + 0.5))[_checked(values)]


def _occupancy_table(known: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(102,) uint8: index 0..100 by value, index -1 for unknown."""
    return np.append(known, NO_INFORMATION).astype(np.uint8)


def _checked(values: NDArray[np.int8]) -> NDArray[np.int8]:
    if values.size and (values.min() < -1 or values.max() > 100):
        raise InvalidValueError(f"occupancy values: expected -1..100, got {values.min()}..{values.max()}")
    return values
