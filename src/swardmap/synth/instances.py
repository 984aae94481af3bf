"""Which thing each pixel of a garden shows: ids, what they stand for, and the true ground as files."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Intrinsics, Pose
from swardmap.io.sources.truth import FIRST_AREA, GroundRaster, KnownThing
from swardmap.labels import GRASS
from swardmap.synth.model import Thing, View
from swardmap.synth.terrain import Surface, Terrain


def instance_ids(
    view: View, ground: Terrain, intrinsics: Intrinsics, T_map_camera: Pose
) -> NDArray[np.uint16]:
    """(H, W) uint16: 1 + index of the thing, FIRST_AREA + surface of bare ground that is no lawn, else 0.

    Args:
        view: what is seen; its depth is exact.
        ground: says what covers it.
        intrinsics: of the view.
        T_map_camera: pose of the camera.
    """
    ids = view.thing.astype(np.uint16)
    bare = (view.thing == 0) & (view.depth_m > 0) & (view.labels != GRASS.id)
    v, u = np.nonzero(bare)
    if len(v):
        ray_x, ray_y = intrinsics.ray_tables()
        z = view.depth_m[v, u].astype(np.float64)
        xy = T_map_camera.apply(np.stack((ray_x[u] * z, ray_y[v] * z, z), axis=1))[:, :2]
        at = np.floor((xy - ground.origin_m) / ground.texel_m).astype(np.int64)
        ny, nx = ground.surface.shape
        ix, iy = np.clip(at[:, 0], 0, nx - 1), np.clip(at[:, 1], 0, ny - 1)
        ids[v, u] = FIRST_AREA + ground.surface[iy, ix].astype(np.uint16)
    return ids


def known_things(ids: NDArray[np.uint16], things: Sequence[Thing], ground: Terrain) -> dict[int, KnownThing]:
    """What the ids of an image stand for.

    Args:
        ids: from `instance_ids`.
        things: `garden.at(stamp_ns)` of the same moment.
        ground: heights are above it.
    """
    known = {}
    for key in np.unique(ids).tolist():
        if key >= FIRST_AREA:
            known[key] = KnownThing(Surface(key - FIRST_AREA).name.lower().replace("_", " "), 0.0)
        elif key > 0:
            thing = things[key - 1]
            known[key] = KnownThing(thing.kind, height_above(thing, ground))
    return known


def height_above(thing: Thing, ground: Terrain) -> float:
    """How far a thing rises above the ground at its foot, in metres."""
    low, high = thing.model.bounds_m()
    box = np.stack(np.meshgrid(*np.stack((low, high)).astype(np.float64).T, indexing="ij"), axis=-1)
    T = thing.T_map_model
    top = float((box.reshape(-1, 3) @ T[:3, :3].T + T[:3, 3])[:, 2].max())
    return top - float(ground.height_at(T[None, :2, 3])[0])


def ground_raster(ground: Terrain) -> GroundRaster:
    """The ground as it lies beside a recording."""
    return GroundRaster(ground.origin_m, ground.texel_m, ground.height_m.astype(np.float32))
