"""The map as it is, from the triangles of a garden: seen or not, so that hidden obstacles are known.

Rules:
    * A cell holds an obstacle (or a person) if any triangle of a thing, cut to the heights between
      `min_height_m` and `max_height_m` above the ground beneath it, touches the inside of the cell.
    * So does a cell whose centre lies inside a closed thing, and a patch of free cells smaller than
      ENCLOSED_M2 that obstacles enclose: no wheel fits there.
    * A cell without a thing is grass only if every sample of it (borders included, LATTICE_M apart) is
      lawn; otherwise an obstacle. Cells not wholly on the ground's raster are unknown.
    * Person beats obstacle beats grass. Things that are labelled grass or void mark nothing.

Heights are taken at the vertices and are linear on each triangle.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Intrinsics, Pose, project
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MAP_CLASS_OF_ROLE, MapClass
from swardmap.synth.config import MapConfig
from swardmap.synth.footprints import clipped, cross, to_cells, touch
from swardmap.synth.model import Float64Array, Garden, Mesh, Thing
from swardmap.synth.terrain import Terrain

BoolArray = NDArray[np.bool_]

LATTICE_M = 0.025
ENCLOSED_M2 = 0.5
POINTS_AT_ONCE = 2_000_000


@dataclass(frozen=True, slots=True)
class _Slab:
    """Heights above the ground between which things count, and where."""

    spec: GridSpec
    ground: Terrain
    low_m: float
    high_m: float


def scene_map(garden: Garden, config: MapConfig | None = None) -> OccupancyGrid:
    """Everything that stands still, on the whole raster of the ground.

    Returns:
        Grid on the lattice of whole cells from (0, 0).
    """
    config = config or MapConfig()
    ground = garden.ground
    low = np.asarray(ground.origin_m)
    high = low + np.array(ground.height_m.shape[::-1]) * ground.texel_m
    spec = GridSpec.covering(
        config.resolution_m, (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))
    )
    classes = ground_classes(ground, spec)
    known = classes != MapClass.UNKNOWN
    mark_things(classes, garden.things, _Slab(spec, ground, config.min_height_m, config.max_height_m))
    classes[~known] = MapClass.UNKNOWN
    return OccupancyGrid(spec, classes)


def frame_map(
    garden: Garden,
    scene: OccupancyGrid,
    intrinsics: Intrinsics,
    T_map_camera: Pose,
    stamp_ns: int,
    config: MapConfig | None = None,
) -> OccupancyGrid:
    """What is ahead of the camera at a time, actors included; unknown where it does not look.

    A cell is ahead if its centre, on the ground, projects into the image at a depth up to `range_m`.

    Args:
        garden: the whole.
        scene: from `scene_map`, of the same garden and settings.
        intrinsics: of the camera.
        T_map_camera: pose of its optical frame.
        stamp_ns: time, for those who move.
        config: the limits.
    """
    config = config or MapConfig()
    window = _window(scene.spec, T_map_camera, intrinsics, config.range_m)
    ix, iy = window.offset_in(scene.spec)
    classes = scene.classes[iy : iy + window.height, ix : ix + window.width].copy()
    known = classes != MapClass.UNKNOWN
    moving = [actor.at(stamp_ns) for actor in garden.actors]
    mark_things(classes, moving, _Slab(window, garden.ground, config.min_height_m, config.max_height_m))
    ahead = _ahead(window, garden.ground, T_map_camera, intrinsics, config.range_m)
    classes[~(ahead & known)] = MapClass.UNKNOWN
    return OccupancyGrid(window, classes, stamp_ns)


def ground_classes(ground: Terrain, spec: GridSpec) -> NDArray[np.uint8]:
    """(height, width) uint8 MapClass of the bare ground: grass where all of a cell is lawn."""
    n = max(1, int(np.ceil(spec.resolution_m / LATTICE_M - 1e-9)))
    step = spec.resolution_m / n
    x = spec.origin_m[0] + np.arange(spec.width * n + 1) * step
    y = spec.origin_m[1] + np.arange(spec.height * n + 1) * step
    lawn = np.empty((len(y), len(x)), bool)
    rows = max(1, POINTS_AT_ONCE // len(x))
    for start in range(0, len(y), rows):
        points = np.stack(np.meshgrid(x, y[start : start + rows]), axis=-1)
        lawn[start : start + rows] = ground.is_lawn(points.reshape(-1, 2)).reshape(points.shape[:2])
    whole = np.ones(spec.shape, bool)
    for j in range(n + 1):
        for i in range(n + 1):
            whole &= lawn[j : j + n * (spec.height - 1) + 1 : n, i : i + n * (spec.width - 1) + 1 : n]
    classes = np.where(whole, np.uint8(MapClass.GRASS), np.uint8(MapClass.OBSTACLE))
    classes[~_on_raster(ground, spec)] = MapClass.UNKNOWN
    return classes


def mark_things(classes: NDArray[np.uint8], things: Sequence[Thing], slab: _Slab) -> None:
    """Mark in place the cells that things stand on or hang over."""
    for map_class in (MapClass.OBSTACLE, MapClass.PERSON):
        touched = np.zeros(slab.spec.shape, bool)
        inside = np.zeros(slab.spec.shape, np.int32)
        for thing in things:
            if MAP_CLASS_OF_ROLE[thing.label.role] is map_class:
                for mesh in thing.model.meshes:
                    _mark_mesh(touched, inside, mesh, thing.T_map_model, slab)
        marked = touched | (inside > 0)
        if marked.any():
            np.maximum(classes, np.uint8(map_class), out=classes, where=marked)
            _fill_enclosed(classes, marked, slab.spec, map_class)


def _mark_mesh(
    touched: BoolArray, inside: NDArray[np.int32], mesh: Mesh, T: Float64Array, slab: _Slab
) -> None:
    """Add the cells that one mesh touches, and the signed crossings above the cells' centres."""
    corners = _near_corners(mesh, T, slab)
    if not len(corners):
        return
    points = corners.reshape(-1, 3)
    height = (points[:, 2] - slab.ground.height_at(points[:, :2])).reshape(-1, 3)
    cut = (height.min(axis=1) < slab.high_m) & (height.max(axis=1) > slab.low_m)
    xy, there = clipped(corners[cut], height[cut], slab.low_m, slab.high_m)
    touch(touched, to_cells(xy[there], slab.spec))
    if not mesh.material.cutout:  # leaves and nets are no closed surfaces
        cross(inside, to_cells(corners[..., :2], slab.spec), height, slab.low_m)


def _near_corners(mesh: Mesh, T: Float64Array, slab: _Slab) -> Float64Array:
    """(m, 3, 3) corners in the map of the triangles that can matter: over the window and not too high."""
    if not len(mesh.faces):
        return np.empty((0, 3, 3))
    low, high = _bounds(mesh, T)
    x0, x1, y0, y1 = slab.spec.extent_m
    if high[0] < x0 or low[0] > x1 or high[1] < y0 or low[1] > y1:
        return np.empty((0, 3, 3))
    top = _highest_ground(slab.ground, low[:2], high[:2]) + slab.high_m
    if low[2] > top and mesh.material.cutout:
        return np.empty((0, 3, 3))
    xyz = mesh.xyz.astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    x, y, z = xyz.T
    sides = [x < x0, x > x1, y < y0, y > y1]
    if mesh.material.cutout:  # of others, what is higher tells inside from outside
        sides.append(z > top)
    out = sum(side.astype(np.uint8) << bit for bit, side in enumerate(sides))
    assert isinstance(out, np.ndarray)  # noqa: S101 - narrows the type
    a, b, c = (mesh.faces[:, k] for k in range(3))
    keep = (out[a] & out[b] & out[c]) == 0
    return np.asarray(xyz[mesh.faces[keep]])


def _bounds(mesh: Mesh, T: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Box in the map around a mesh, by the corners of its own box."""
    box = np.stack((mesh.xyz.min(axis=0), mesh.xyz.max(axis=0))).astype(np.float64)
    corners = np.stack(np.meshgrid(*box.T, indexing="ij"), axis=-1).reshape(-1, 3)
    moved = corners @ T[:3, :3].T + T[:3, 3]
    return moved.min(axis=0), moved.max(axis=0)


def _highest_ground(ground: Terrain, low: Float64Array, high: Float64Array) -> float:
    """Upper bound of the ground's height over a rectangle."""
    ny, nx = ground.height_m.shape
    first = np.floor((low - ground.origin_m) / ground.texel_m - 0.5).astype(int)
    last = np.ceil((high - ground.origin_m) / ground.texel_m - 0.5).astype(int)
    i0, j0 = np.clip(first, 0, (nx - 1, ny - 1))
    i1, j1 = np.clip(last, 0, (nx - 1, ny - 1))
    return float(ground.height_m[j0 : j1 + 1, i0 : i1 + 1].max())


def _fill_enclosed(
    classes: NDArray[np.uint8], marked: BoolArray, spec: GridSpec, map_class: MapClass
) -> None:
    """Give small patches of unmarked cells that marked ones enclose their class."""
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats((~marked).astype(np.uint8), connectivity=4)
    h, w = marked.shape
    for k in range(1, count):
        x, y, width, height, area = (int(v) for v in stats[k])
        inner = x > 0 and y > 0 and x + width < w and y + height < h
        if inner and area * spec.resolution_m**2 < ENCLOSED_M2:
            here = (slice(y, y + height), slice(x, x + width))
            hole = labels[here] == k
            np.maximum(classes[here], np.uint8(map_class), out=classes[here], where=hole)


def _on_raster(ground: Terrain, spec: GridSpec) -> BoolArray:
    """Cells that lie wholly on the ground's raster."""
    low = np.asarray(ground.origin_m)
    high = low + np.array(ground.height_m.shape[::-1]) * ground.texel_m
    x = spec.origin_m[0] + np.arange(spec.width + 1) * spec.resolution_m
    y = spec.origin_m[1] + np.arange(spec.height + 1) * spec.resolution_m
    on_x = (x[:-1] >= low[0] - 1e-9) & (x[1:] <= high[0] + 1e-9)
    on_y = (y[:-1] >= low[1] - 1e-9) & (y[1:] <= high[1] + 1e-9)
    return np.asarray(on_y[:, None] & on_x[None, :])


def _window(spec: GridSpec, T_map_camera: Pose, intrinsics: Intrinsics, range_m: float) -> GridSpec:
    """The part of a grid around all that the camera can see up to a depth."""
    u = np.array([0, intrinsics.width - 1, 0, intrinsics.width - 1])
    v = np.array([0, 0, intrinsics.height - 1, intrinsics.height - 1])
    rays = np.stack(((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, np.ones(4)), 1)
    xy = T_map_camera.apply(np.concatenate((rays * range_m, np.zeros((1, 3)))))[:, :2]
    low, high = xy.min(axis=0), xy.max(axis=0)
    around = GridSpec.covering(
        spec.resolution_m, (float(low[0]), float(low[1])), (float(high[0]), float(high[1])), spec.frame_id
    )
    return spec.part_within(around)


def _ahead(
    spec: GridSpec, ground: Terrain, T_map_camera: Pose, intrinsics: Intrinsics, range_m: float
) -> BoolArray:
    iy, ix = np.indices(spec.shape)
    xy = spec.center_of(np.stack((ix, iy), axis=-1).reshape(-1, 2))
    xyz = np.column_stack((xy, ground.height_at(xy)))
    uv, z = project(T_map_camera.inverse().apply(xyz), intrinsics)
    size = (intrinsics.width - 0.5, intrinsics.height - 0.5)
    with np.errstate(invalid="ignore"):
        seen = (z > 0) & (z <= range_m) & (uv >= -0.5).all(axis=1) & (uv < size).all(axis=1)
    return np.asarray(seen.reshape(spec.shape))
