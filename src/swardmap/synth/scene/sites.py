"""Points of a lot where things of a sort belong."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.synth.model import Float64Array
from swardmap.synth.scene.areas import inside_convex_m
from swardmap.synth.scene.lot import Lot
from swardmap.synth.scene.place import XY
from swardmap.synth.terrain import Surface, Terrain

BEDS = (Surface.MULCH, Surface.DIRT, Surface.GROUND_COVER)
HARD = (Surface.GRAVEL, Surface.PAVING, Surface.CONCRETE, Surface.WOOD)
STEP_M = 0.12  # between the points that are tried


@dataclass(frozen=True, slots=True, eq=False)
class Sites:
    """Points of the lot on a coarse raster.

    Attributes:
        xy: n x 2.
        lawn_m: distance to the border of the lawn.
        edge_m: distance to the outline of the lot.
        hard_m: distance to the nearest path or terrace; capped.
        surface: what covers the point where it is not lawn.
    """

    xy: Float64Array
    lawn_m: NDArray[np.float32]
    edge_m: NDArray[np.float32]
    hard_m: NDArray[np.float32]
    surface: NDArray[np.uint8]

    def of(self, where: str, room_m: float) -> NDArray[np.intp]:
        """Indices of points of a sort with room around them.

        Args:
            where: lawn, middle (of the lawn), rim (of the lot), path (beside one), bed, cover, terrace, any.
            room_m: how far the thing reaches from the point.
        """
        deep = -self.lawn_m
        chosen = {
            "lawn": self.lawn_m > room_m + 0.05,
            "middle": (self.lawn_m > room_m + 0.3) & (self.edge_m > 3.0),
            "rim": (self.lawn_m > room_m) & (self.edge_m < room_m + 1.3),
            "path": (self.lawn_m > room_m + 0.03) & (self.hard_m < room_m + 0.7),
            "bed": np.isin(self.surface, BEDS) & (deep > min(0.25 * room_m, 0.2)),
            "cover": (self.surface == Surface.GROUND_COVER) & (deep > 0.05),
            "terrace": np.isin(self.surface, HARD[1:]) & (deep > 0.6 * room_m),
            "any": np.isfinite(deep),
        }[where]
        return np.flatnonzero(chosen & (self.edge_m > min(room_m, 1.0) + 0.25))


def sites_of(lot: Lot, ground: Terrain) -> Sites:
    """The points of a lot, none in ponds."""
    every = max(1, round(STEP_M / ground.texel_m))
    j, i = np.mgrid[0 : ground.lawn_m.shape[0] : every, 0 : ground.lawn_m.shape[1] : every]
    xy = np.stack((i.ravel() + 0.5, j.ravel() + 0.5), axis=1) * ground.texel_m + ground.origin_m
    x, y = xy[:, 0].astype(np.float32), xy[:, 1].astype(np.float32)
    lawn, surface = ground.lawn_m[j, i].ravel(), ground.surface[j, i].ravel()
    hard = np.full(len(xy), np.inf, np.float32)
    for area in lot.areas:
        if area.surface in HARD:
            hard = np.minimum(hard, -area.shape.distance_m(x, y))
    edge = inside_convex_m(lot.corners_m, x, y)
    keep = (edge > 0) & ~((surface == Surface.WATER) & (lawn < 0.1))
    return Sites(xy[keep], lawn[keep], edge[keep], hard[keep], surface[keep])


def jittered(xy: Float64Array, rng: np.random.Generator) -> XY:
    """A point near a raster point."""
    x, y = xy + rng.uniform(-STEP_M / 3, STEP_M / 3, 2)
    return float(x), float(y)
