"""Pictures of analytic scenes: exact depth and labels, and colours that look like a garden."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Float32Array, Intrinsics, Pose
from swardmap.labels import GRASS, VOID_ID
from swardmap.synth.analytic_footprints import BoolArray, Float64Array
from swardmap.synth.analytic_solids import Finish, Patch, Solid

LAWN = Finish((94, 138, 60), "lawn", 0.34)
SUN = np.array([-0.45, 0.62, 0.64]) / np.linalg.norm([-0.45, 0.62, 0.64])  # towards the sun
SUNLIGHT = (1.0, 0.96, 0.86)
SKYLIGHT = (0.44, 0.47, 0.55)
HAZE = (196.0, 212.0, 224.0)
STRIPE_M = 0.5
NEAR_M = 1e-4
EDGES = np.array([(a, a | bit) for bit in (1, 2, 4) for a in range(8) if not a & bit])  # of _corners


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """What each pixel sees, all of shape (H, W).

    Attributes:
        depth_m: float64 along the optical axis, infinity for the sky.
        labels: uint8 class ids, void for the sky.
        surface: int16 index: -2 sky, -1 lawn, then solids, then patches.
        rays: (H, W, 3) as `camera_rays` gives them.
    """

    depth_m: Float64Array
    labels: NDArray[np.uint8]
    surface: NDArray[np.int16]
    rays: Float64Array


def camera_rays(intrinsics: Intrinsics, T_map_camera: Pose) -> Float64Array:
    """(H, W, 3) directions in the map whose optical z is 1, so that the ray parameter is the depth."""
    R = T_map_camera.matrix[:3, :3]
    x = (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx
    y = (np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy
    rays: Float64Array = x[None, :, None] * R[:, 0] + y[:, None, None] * R[:, 1] + R[:, 2]
    return rays


def cast(
    solids: tuple[Solid, ...], patches: tuple[Patch, ...], intrinsics: Intrinsics, T_map_camera: Pose
) -> Hits:
    """First surface along the ray of each pixel centre."""
    rays, origin = camera_rays(intrinsics, T_map_camera), T_map_camera.position_m
    with np.errstate(divide="ignore", over="ignore"):  # the lawn of a level ray is infinitely far away
        depth = np.where(rays[..., 2] * origin[2] < 0, -origin[2] / rays[..., 2], np.inf)
    surface = np.where(np.isfinite(depth), -1, -2).astype(np.int16)
    labels = np.where(surface == -1, GRASS.id, VOID_ID).astype(np.uint8)
    for index, solid in enumerate(solids):
        rows, columns = _window(solid, intrinsics, T_map_camera)
        block = rays[rows, columns]
        t = solid.intersect(origin, block.reshape(-1, 3)).reshape(block.shape[:2])
        nearer = (t < depth[rows, columns]) & (t > NEAR_M)
        depth[rows, columns][nearer] = t[nearer]
        labels[rows, columns][nearer] = solid.label.id
        surface[rows, columns][nearer] = index
    for index, patch in enumerate(patches):
        ground = np.nonzero(surface == -1)
        xy = origin[:2] + depth[ground][:, None] * rays[ground][:, :2]
        inside = patch.contains(xy)
        hit = ground[0][inside], ground[1][inside]
        labels[hit] = patch.label.id
        surface[hit] = len(solids) + index
    return Hits(depth, labels, surface, rays)


def paint(
    hits: Hits,
    solids: tuple[Solid, ...],
    patches: tuple[Patch, ...],
    T_map_camera: Pose,
) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB: texture, sun with cast shadows, sky light, haze."""
    seen = hits.surface >= -1
    image = np.empty((*seen.shape, 3), np.uint8)
    image[~seen] = _sky(hits.rays[~seen])
    depth = hits.depth_m[seen]
    points = T_map_camera.position_m + depth[:, None] * hits.rays[seen]
    normals, albedo = _surfaces(hits.surface[seen], points, depth, solids, patches)
    sun = np.clip(normals @ SUN, 0, 1) * ~_in_shadow(points + 1e-4 * normals, solids)
    image[seen] = _lit(
        albedo, sun.astype(np.float32), normals[:, 2].astype(np.float32), depth.astype(np.float32)
    )
    return image


def _lit(
    albedo: Float32Array, sun: Float32Array, upward: Float32Array, depth: Float32Array
) -> NDArray[np.uint8]:
    """(N, 3) uint8: what sun and sky make of the albedo, behind haze."""
    clear = np.exp(-np.minimum(depth, 1e3) / 90)
    sky = 0.62 + 0.38 * upward
    shown = np.empty(albedo.shape, np.uint8)
    for channel in range(3):  # one at a time: contiguous, and half the time
        light = sun * SUNLIGHT[channel] + sky * SKYLIGHT[channel]
        color = albedo[:, channel] * light * clear + HAZE[channel] * (1 - clear)
        shown[:, channel] = np.clip(color, 0, 255)
    return shown


def _surfaces(
    surface: NDArray[np.int16],
    points: Float64Array,
    depth: Float64Array,
    solids: tuple[Solid, ...],
    patches: tuple[Patch, ...],
) -> tuple[Float64Array, Float32Array]:
    """Normals (N, 3) and albedo (N, 3), 0..255, of what N pixels see."""
    normals = np.zeros_like(points)
    normals[:, 2] = 1
    albedo = np.empty(points.shape, np.float32)
    fine = np.clip(4.0 / np.maximum(depth, 1e-3), 0.12, 1.0)  # texture fades before it aliases
    lawn = surface == -1
    albedo[lawn] = _texture(LAWN, points[lawn], normals[lawn], fine[lawn])
    for index in np.unique(surface[~lawn]):
        on = np.nonzero(surface == index)[0]
        if index < len(solids):
            normals[on] = solids[index].normals(points[on])
            albedo[on] = _texture(solids[index].material, points[on], normals[on], fine[on])
        else:
            patch = patches[index - len(solids)]
            flat = np.column_stack((patch.local(points[on, :2]), points[on, 2]))
            albedo[on] = _texture(patch.material, flat, normals[on], fine[on])
    return normals, albedo


def _window(solid: Solid, intrinsics: Intrinsics, T_map_camera: Pose) -> tuple[slice, slice]:
    """Part of the image that can show a solid: around its box, cut off in front of the camera."""
    corners = T_map_camera.inverse().apply(_corners(solid))
    first, second = corners[EDGES[:, 0]], corners[EDGES[:, 1]]
    cut = (first[:, 2] < NEAR_M) != (second[:, 2] < NEAR_M)
    first, second = first[cut], second[cut]
    share = (NEAR_M - first[:, 2:]) / (second[:, 2:] - first[:, 2:])
    shown = np.vstack((corners[corners[:, 2] >= NEAR_M], first + share * (second - first)))
    if not len(shown):
        return slice(0, 0), slice(0, 0)
    u = intrinsics.fx * shown[:, 0] / shown[:, 2] + intrinsics.cx
    v = intrinsics.fy * shown[:, 1] / shown[:, 2] + intrinsics.cy
    left, right = np.clip([np.floor(u.min()), np.ceil(u.max()) + 1], 0, intrinsics.width).astype(int)
    top, bottom = np.clip([np.floor(v.min()), np.ceil(v.max()) + 1], 0, intrinsics.height).astype(int)
    return slice(top, bottom), slice(left, right)


def _in_shadow(points: Float64Array, solids: tuple[Solid, ...]) -> BoolArray:
    """Whether something stands between each point (N, 3) and the sun."""
    shadow = np.zeros(len(points), bool)
    x, y, z = (np.ascontiguousarray(c) for c in points.T)
    for solid in solids:
        lower, upper = solid.bounds()
        back = SUN[:2] * (upper[2] / SUN[2])  # how far its shadow can reach on the ground
        low, high = np.minimum(lower[:2], lower[:2] - back), np.maximum(upper[:2], upper[:2] - back)
        near = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1]) & (z < upper[2])
        index = np.nonzero(near & ~shadow)[0]
        rays = np.broadcast_to(SUN, (len(index), 3))
        shadow[index[np.isfinite(solid.intersect(points[index], rays))]] = True
    return shadow


def _corners(solid: Solid) -> Float64Array:
    """(8, 3) corners of the box around a solid."""
    lower, upper = solid.bounds()
    picks = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)], bool)
    return np.where(picks, upper, lower)


def _texture(
    material: Finish, points: Float64Array, normals: Float64Array, fine: Float64Array
) -> Float64Array:
    """(N, 3) albedo 0..255 at points (N, 3)."""
    x, y, z = points.T
    base = np.asarray(material.color, np.float64)
    if material.texture == "lawn":
        blades = 0.55 * _noise(x / 0.35, y / 0.35) + 0.45 * _noise(x / 0.9, y / 0.9 + 40)
        clover = _noise(x / 7.0, y / 7.0 + 90, smooth=True)
        stripe = np.where(np.floor(y / STRIPE_M) % 2 == 0, 0.07, -0.07)
        tone = 1 + material.grain * blades * fine + stripe + 0.10 * clover
        warm = (14.0, 3.0, -2.0)
        return np.stack([(base[c] + warm[c] * clover) * tone for c in range(3)], axis=-1)
    # Along the surface: across whichever horizontal axis the wall does not face, and up.
    horizontal = np.where(np.abs(normals[:, 0]) > np.abs(normals[:, 1]), y, x)
    upright = np.where(np.abs(normals[:, 2]) > 0.7, y, z)
    grain = _noise(horizontal / 1.1, upright / 1.1) * fine
    if material.texture == "leaves":
        grain = fine * (
            0.6 * _noise(horizontal / 1.7, upright / 1.7) + 0.4 * _noise(x / 3.1, z / 3.1 + y / 3)
        )
    elif material.texture == "wood":
        grain = grain - 1.6 * ((upright % 0.14) < 0.012) * fine
    elif material.texture == "bricks":
        row = np.floor(upright / 0.08)
        joint = ((upright % 0.08) < 0.010) | (((horizontal + 0.12 * (row % 2)) % 0.24) < 0.010)
        grain = grain + np.where(joint, 1.2, 0.5 * np.sin(57 * row + 31 * np.floor(horizontal / 0.24))) * fine
    elif material.texture == "slabs":
        joint = ((x % 0.5) < 0.012) | ((y % 0.5) < 0.012)
        grain = grain - 2.0 * joint * fine
    return base * (1 + material.grain * grain)[:, None]


def _sky(rays: Float64Array) -> Float64Array:
    """(N, 3) blue that pales towards the horizon, with thin clouds."""
    length = np.sqrt(np.einsum("nc,nc->n", rays, rays))
    up = np.clip(rays[..., 2] / length, 0.0, 1.0)[..., None]
    blue = np.array([198, 216, 232]) * (1 - up**0.5) + np.array([78, 130, 196]) * up**0.5
    over = np.maximum(rays[..., 2], 0.02)
    cloud = _noise(rays[..., 0] / over * 0.35, rays[..., 1] / over * 0.35, smooth=True)
    share = np.clip(0.9 * cloud, 0, 1)[..., None] * np.clip(6 * up, 0, 1)
    shown: Float64Array = blue * (1 - share) + 245.0 * share
    return shown


def _noise(a: Float64Array, b: Float64Array, smooth: bool = False) -> Float64Array:
    """Repeating noise of mean 0, about -1..1, of 64 texels a unit; smooth is interpolated between them."""
    table = _noise_table(smooth)
    size = len(table)
    i, j = np.floor(a * 64), np.floor(b * 64)
    column, row = i.astype(np.int64) & size - 1, j.astype(np.int64) & size - 1
    if not smooth:
        nearest: Float64Array = table[row, column]
        return nearest
    right, below, s, t = column + 1 & size - 1, row + 1 & size - 1, a * 64 - i, b * 64 - j
    upper = table[row, column] * (1 - s) + table[row, right] * s
    lower = table[below, column] * (1 - s) + table[below, right] * s
    values: Float64Array = upper * (1 - t) + lower * t
    return values


@lru_cache(maxsize=2)
def _noise_table(smooth: bool) -> Float64Array:
    """(512, 512) repeating noise of several octaves, made in the Fourier domain."""
    rng = np.random.default_rng(7 if smooth else 3)
    size = 512
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.fftfreq(size)[None, :]) * size
    power = 1 / np.maximum(frequency, 1) ** (1.7 if smooth else 0.55)
    power[0, 0] = 0
    table = np.fft.ifft2(np.fft.fft2(rng.standard_normal((size, size))) * power).real
    clipped: Float64Array = np.clip(table / (2.0 * table.std()), -1.5, 1.5)
    return clipped
