"""A map image that says where not to drive: the convention of Nav2's KeepoutFilter.

The mask is a map of map_server's (YAML and image), black where the robot must not be, grey where it may
be at a price (mode scale or raw). A mask of SpeedFilter's means speeds and not costs, and goes to Nav2 as
it is.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from swardmap.config import AreaConfig
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.maps.map_files import read_nav_values
from swardmap.mapping.costmap import check_frames, costs_from_occupancy, restrict


@dataclass(frozen=True, slots=True, eq=False)
class KeepoutMask:
    """A layer of costs in a grid of its own (`swardmap.mapping.costmap.Layer`).

    Attributes:
        spec: where the mask lies.
        costs: (height, width) uint8; 0 and 255 say nothing.
        beyond: cost outside of the image; 0 says nothing, as in Nav2, 254 makes the image a keep-in mask.
    """

    spec: GridSpec
    costs: NDArray[np.uint8]
    beyond: int = 0

    @property
    def frame_id(self) -> str:
        """Frame the mask lies in."""
        return self.spec.frame_id

    def zone(self, spec: GridSpec) -> NDArray[np.uint8]:
        """(height, width) uint8: the cost of the mask at each cell's centre, in another grid."""
        check_frames([self], spec.frame_id)
        return _sampled(self, spec)

    def apply(self, costs: NDArray[np.uint8], grid: OccupancyGrid) -> NDArray[np.uint8]:
        """Costs with the mask in them; unlike in Nav2 a free mask does not make free what is unknown."""
        return restrict(costs, self.zone(grid.spec))


@lru_cache(maxsize=4)
def _sampled(mask: KeepoutMask, spec: GridSpec) -> NDArray[np.uint8]:
    columns = spec.center_of(np.stack([np.arange(spec.width), np.zeros(spec.width)], axis=-1))
    rows = spec.center_of(np.stack([np.zeros(spec.height), np.arange(spec.height)], axis=-1))
    ix, iy = mask.spec.cell_of(columns)[:, 0], mask.spec.cell_of(rows)[:, 1]
    inside_x, inside_y = (ix >= 0) & (ix < mask.spec.width), (iy >= 0) & (iy < mask.spec.height)
    zone = np.full(spec.shape, mask.beyond, np.uint8)
    zone[np.ix_(inside_y, inside_x)] = mask.costs[np.ix_(iy[inside_y], ix[inside_x])]
    zone.flags.writeable = False
    return zone


def read_keepout(config: AreaConfig) -> KeepoutMask | None:
    """The mask that is configured, in `area.frame_id`; None if none is.

    Raises:
        InputError: if it is no map of map_server's, or turned.
    """
    if config.mask is None:
        return None
    spec, values = read_nav_values(config.mask)
    placed = GridSpec(spec.resolution_m, spec.width, spec.height, spec.origin_m, config.frame_id)
    return KeepoutMask(placed, costs_from_occupancy(values), config.mask_beyond)
