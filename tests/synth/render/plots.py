"""Small gardens and a camera for the tests of the renderer, and rays in closed form."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.synth.model import Float64Array, Garden, Light, Thing
from swardmap.synth.terrain import Surface, Terrain

LENS = Intrinsics(160, 120, 140.0, 141.0, 80.3, 58.9)
TEXEL_M = 0.04
HALF_M = 12.0

Field = Callable[[Float64Array, Float64Array], Float64Array]


def flat(x: Float64Array, y: Float64Array) -> Float64Array:
    return 0 * x * y


def bumpy(x: Float64Array, y: Float64Array) -> Float64Array:
    """A slope of 7 degrees with bumps as a rough lawn has them."""
    waves = 0.010 * np.sin(4.4 * x + 1) * np.sin(4.1 * y) + 0.003 * np.sin(11 * x) * np.sin(13 * y + 2)
    return 0.1 * x - 0.06 * y + waves


def ground_of(height: Field = flat, lawn: Field | None = None, blade_m: float = 0.0) -> Terrain:
    """24 m x 24 m around the origin."""
    n = round(2 * HALF_M / TEXEL_M)
    at = (np.arange(n) + 0.5) * TEXEL_M - HALF_M
    x, y = np.meshgrid(at, at)
    one = np.ones((n, n), np.float32)
    inside = one if lawn is None else lawn(x, y).astype(np.float32)
    surface = np.where(inside > 0, Surface.LAWN, Surface.GRAVEL).astype(np.uint8)
    return Terrain(
        (-HALF_M, -HALF_M), TEXEL_M, height(x, y).astype(np.float32), inside, surface,
        np.full((n, n, 3), (0.1, 0.14, 0.05), np.float32), blade_m * one, one, 0.1 * one,
    )  # fmt: skip


def garden_of(ground: Terrain | None = None, things: Sequence[Thing] = (), seed: int = 3) -> Garden:
    lot = HALF_M * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    return Garden("plot", seed, ground or ground_of(), tuple(things), lot)


def light_of(
    sun: float = 2.0, sky: float = 0.4, direction: tuple[float, float, float] = (0.0, 0.6, 0.8)
) -> Light:
    white, grey = (sun, sun, sun), (sky, sky, sky)
    return Light("clear", direction, white, grey, grey, grey, 0.01, 0.0, 0.0)


def camera_at(
    x: float = 0.0, y: float = 0.0, yaw_deg: float = 0.0, height: float = 0.8, pitch_deg: float = 18.0
) -> Pose:
    c, s = np.cos(np.deg2rad(yaw_deg)), np.sin(np.deg2rad(yaw_deg))
    turn = np.eye(4)
    turn[:2, :2] = [[c, -s], [s, c]]
    turn[:2, 3] = x, y
    return Pose("map", "base", turn) @ mount_pose(height, pitch_deg, 1.5, parent="base")


def rays(T_map_camera: Pose, lens: Intrinsics = LENS) -> tuple[Float64Array, Float64Array]:
    """Origin (3,) and directions (H, W, 3) in the map, of length 1 along the optical axis."""
    u, v = np.meshgrid(np.arange(lens.width), np.arange(lens.height))
    d = np.stack(((u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, np.ones(u.shape)), axis=-1)
    return T_map_camera.position_m, d @ T_map_camera.matrix[:3, :3].T


def smooth(depth: NDArray[np.floating], step: float = 0.06) -> NDArray[np.bool_]:
    """Pixels away from silhouettes: the neighbours have the depth of a smooth surface."""
    inverse = np.where(depth > 0, 1 / np.maximum(depth, 1e-9), 0)
    padded = np.pad(inverse, 1, mode="edge")
    kept = depth > 0
    for axis in (0, 1):
        before = np.roll(padded, 1, axis)[1:-1, 1:-1]
        after = np.roll(padded, -1, axis)[1:-1, 1:-1]
        kept &= np.abs(before + after - 2 * inverse) < step * inverse
        kept &= (before > 0) & (after > 0)
    kept[[0, -1]] = kept[:, [0, -1]] = False
    return np.asarray(kept)


def hit_ground(
    origin: Float64Array, directions: Float64Array, ground: Terrain, far_m: float = 20.0
) -> Float64Array:
    """Depth where rays first meet the height field: a march in steps of 5 mm, then bisection; 0 = none."""
    flat_rays = directions.reshape(-1, 3)
    depth, low = np.zeros(len(flat_rays)), np.full(len(flat_rays), np.nan)
    going = np.ones(len(flat_rays), bool)

    def above(at: Float64Array, who: NDArray[np.bool_]) -> Float64Array:
        p = origin + flat_rays[who] * at[:, None]
        z: Float64Array = p[:, 2] - ground.height_at(p[:, :2])
        return z

    t, step = 0.3, 0.005
    while t < far_m and going.any():
        below = above(np.full(going.sum(), t + step), going) <= 0
        index = np.flatnonzero(going)[below]
        low[index] = t
        going[index] = False
        t += step
    found = np.isfinite(low)
    a, b = low[found], low[found] + step
    for _ in range(30):
        middle = (a + b) / 2
        over = above(middle, found) > 0
        a, b = np.where(over, middle, a), np.where(over, b, middle)
    depth[found] = a
    return depth.reshape(directions.shape[:2])


def hit_sphere(
    origin: Float64Array, directions: Float64Array, centre: Sequence[float], radius: float
) -> Float64Array:
    o = origin - np.asarray(centre)
    a, b, c = (directions**2).sum(-1), directions @ o, o @ o - radius**2
    root = b * b - a * c
    t = (-b - np.sqrt(np.maximum(root, 0))) / a
    return np.where((root > 0) & (t > 0), t, np.inf)


def hit_box(
    origin: Float64Array, directions: Float64Array, low: Sequence[float], high: Sequence[float]
) -> Float64Array:
    """By slabs."""
    with np.errstate(divide="ignore"):
        t = np.stack([(np.asarray(edge) - origin) / directions for edge in (low, high)])
    near, far = t.min(0).max(-1), t.max(0).min(-1)
    return np.where((near < far) & (near > 0), near, np.inf)


def hit_cylinder(
    origin: Float64Array,
    directions: Float64Array,
    xy: Sequence[float],
    radius: float,
    low: float,
    high: float,
) -> Float64Array:
    """Upright, with its caps."""
    o, d = origin[:2] - np.asarray(xy), directions[..., :2]
    a, b, c = (d**2).sum(-1), d @ o, o @ o - radius**2
    root = b * b - a * c
    t = (-b - np.sqrt(np.maximum(root, 0))) / a
    z = origin[2] + t * directions[..., 2]
    side = np.where((root > 0) & (t > 0) & (z > low) & (z < high), t, np.inf)
    caps = []
    for level in (low, high):
        at = (level - origin[2]) / directions[..., 2]
        off = o + at[..., None] * d
        caps.append(np.where((at > 0) & ((off**2).sum(-1) < radius**2), at, np.inf))
    return np.minimum(side, np.minimum(*caps))
