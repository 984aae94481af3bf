"""How far every point of the lawn is from what a mower must not touch."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.labels import GRASS
from swardmap.synth.model import Float32Array, Float64Array, Garden, Thing
from swardmap.synth.scene.areas import inside_convex_m

CELL_M = 0.06
TALL_M, SEEN_THROUGH = 0.9, ("wire", "railing", "washing line", "swing", "trampoline")
SIGHT_STEPS = 100
LOW_M = 1.5  # what hangs higher than this above a thing's base lets a mower pass


@dataclass(frozen=True, slots=True, eq=False)
class Clearance:
    """A raster of distances.

    Attributes:
        origin_m: outer corner of cell (0, 0).
        things_m: ny x nx, metres to the nearest thing that stands still, short by up to a cell.
        border_m: ny x nx, metres to the border of the lawn or the lot, positive on the lawn.
        tall: ny x nx, where something higher than TALL_M stands: people behind it are hidden.
    """

    origin_m: tuple[float, float]
    things_m: Float32Array
    border_m: Float32Array
    tall: NDArray[np.bool_]

    def free(self, xy: Float64Array, things_m: float, border_m: float) -> NDArray[np.bool_]:
        """Whether points (n x 2) are farther from both."""
        inside, i, j = self._cells(xy)
        free: NDArray[np.bool_] = inside & (self.things_m[j, i] > things_m) & (self.border_m[j, i] > border_m)
        return free

    def room(self, xy: Float64Array) -> Float64Array:
        """The smaller of both distances at points, 0 beyond the raster."""
        inside, i, j = self._cells(xy)
        return np.where(inside, np.minimum(self.things_m[j, i], self.border_m[j, i]), 0.0).astype(np.float64)

    def sees(self, start: Float64Array, end: Float64Array) -> NDArray[np.bool_]:
        """Whether nothing tall lies between points (n x 2 each), half a metre before the end left out."""
        step = end - start
        length = np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
        share = np.linspace(0, 1, SIGHT_STEPS) * np.maximum(1 - 0.5 / length, 0)
        points = start[:, None] + share[..., None] * step[:, None]
        inside, i, j = self._cells(points.reshape(-1, 2))
        hidden = (inside & self.tall[j, i]).reshape(len(start), SIGHT_STEPS)
        return np.asarray(~hidden.any(axis=1))

    def _cells(self, xy: Float64Array) -> tuple[NDArray[np.bool_], NDArray[np.intp], NDArray[np.intp]]:
        """Whether points lie on the raster; column and row of their cells, 0 beyond."""
        at = np.floor((xy - self.origin_m) / CELL_M).astype(np.intp)
        inside = np.asarray(((at >= 0) & (at < self.things_m.shape[::-1])).all(axis=1), np.bool_)
        return inside, np.where(inside, at[:, 0], 0), np.where(inside, at[:, 1], 0)


def clearance_of(garden: Garden) -> Clearance:
    """Distances over the lot of a garden; flowers and leaves of the lawn are no things."""
    low, high = garden.lot_m.min(axis=0), garden.lot_m.max(axis=0)
    nx, ny = (int(np.ceil(n)) for n in (high - low) / CELL_M)
    x, y = np.meshgrid((np.arange(nx) + 0.5) * CELL_M + low[0], (np.arange(ny) + 0.5) * CELL_M + low[1])
    ground = garden.ground
    at = np.floor((np.stack((x, y), axis=-1) - ground.origin_m) / ground.texel_m).astype(np.intp)
    i, j = (
        np.clip(at[..., 0], 0, ground.lawn_m.shape[1] - 1),
        np.clip(at[..., 1], 0, ground.lawn_m.shape[0] - 1),
    )
    edge = inside_convex_m(garden.lot_m, x.astype(np.float32), y.astype(np.float32))
    blocked, tall = np.zeros((ny, nx), np.uint8), np.zeros((ny, nx), np.uint8)
    for thing in garden.things:
        if thing.label != GRASS:
            _block(blocked, tall if thing.kind not in SEEN_THROUGH else np.zeros_like(tall), thing, low)
    tall = np.asarray(cv2.dilate(tall, np.ones((3, 3), np.uint8)), np.uint8)  # wider than a step of a sight
    things = cv2.distanceTransform(1 - blocked, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * np.float32(CELL_M)
    things = np.maximum(things - np.float32(CELL_M), 0)
    return Clearance((float(low[0]), float(low[1])), things, np.minimum(ground.lawn_m[j, i], edge), tall > 0)


def _block(blocked: NDArray[np.uint8], tall: NDArray[np.uint8], thing: Thing, low: Float64Array) -> None:
    """Mark the cells below the low triangles of a thing, and those where it is tall."""
    T = thing.T_map_model
    for mesh in thing.model.meshes:
        xyz = mesh.xyz.astype(np.float64) @ T[:3, :3].T + T[:3, 3]
        triangles = xyz[mesh.faces]
        triangles = triangles[triangles[..., 2].min(axis=1) < T[2, 3] + LOW_M]
        high = triangles[..., 2].max(axis=1) > T[2, 3] + TALL_M
        cells = (triangles[..., :2] - low) / CELL_M
        big = np.ptp(cells, axis=1).max(axis=1) > 1
        _mark(blocked, cells[~big].reshape(-1, 2))
        _mark(tall, cells[~big & high].reshape(-1, 2))
        for triangle, is_high in zip(np.floor(cells[big]).astype(np.int32), high[big], strict=True):
            cv2.fillConvexPoly(blocked, triangle, 1)
            if is_high:
                cv2.fillConvexPoly(tall, triangle, 1)


def _mark(blocked: NDArray[np.uint8], cells: Float64Array) -> None:
    at = np.floor(cells).astype(np.intp)
    at = at[((at >= 0) & (at < blocked.shape[::-1])).all(axis=1)]
    blocked[at[:, 1], at[:, 0]] = 1
