"""The map one layer at a time, and masks for Nav2's costmap filters, as values of nav_msgs/OccupancyGrid."""

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.mapping.costmap import INSCRIBED
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.mapping.sensor_model import PER_NAT
from swardmap.mapping.tiles import Lattice
from swardmap.mapping.work_area import WorkArea

Values = NDArray[np.int8]

CLASS_VALUES = np.array([-1, 0, 50, 100], np.int8)
"""Of unknown, grass, obstacle, person: apart in any viewer's colours."""


def class_values(grid: OccupancyGrid) -> Values:
    """(height, width) int8: unknown -1, grass 0, obstacle 50, person 100."""
    return CLASS_VALUES[grid.classes]


def evidence_values(log_odds: LogOddsMap, spec: GridSpec) -> Values:
    """(height, width) int8 probability of a hazard in percent, unknown -1, of a map of log-odds.

    Args:
        log_odds: the map.
        spec: grid on its lattice.
    """
    evidence = np.zeros(spec.shape, np.int16)
    known = np.zeros(spec.shape, bool)
    for key, here, there in Lattice(log_odds.corner_cell).overlapped(spec):
        if key in log_odds.tiles:
            tile = log_odds.tiles[key][there]
            evidence[here], known[here] = tile.evidence, (tile.evidence != 0) | (tile.classes != 0)
    percent = np.round(100 / (1 + np.exp(-evidence / np.float64(PER_NAT)))).astype(np.int8)
    return np.where(known, percent, np.int8(-1))


def keepout_mask(spec: GridSpec, area: WorkArea | None) -> Values:
    """(height, width) int8 for Nav2's KeepoutFilter: 100 outside of the work area, else 0."""
    if area is None or area.cost < INSCRIBED:
        return np.zeros(spec.shape, np.int8)
    return np.where(area.keep_out(spec), np.int8(100), np.int8(0))


def speed_mask(grid: OccupancyGrid, radius_m: float, percent: float) -> Values:
    """(height, width) int8 for Nav2's SpeedFilter: percent of full speed near persons, else 0 = no limit.

    Args:
        grid: the map.
        radius_m: cells whose centre is this near to that of a person's cell.
        percent: 1 to 100.
    """
    from scipy.ndimage import distance_transform_edt

    away = grid.classes != MapClass.PERSON
    if away.all():
        return np.zeros(grid.spec.shape, np.int8)
    distance_m = distance_transform_edt(away) * grid.spec.resolution_m
    return np.where(distance_m <= radius_m + 1e-9, np.int8(round(percent)), np.int8(0))
