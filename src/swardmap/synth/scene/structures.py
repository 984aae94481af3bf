"""Fences, walls and buildings, from simple shapes."""

import numpy as np

from swardmap.synth.model import Material, Mesh, Model
from swardmap.synth.scene.materials import (
    DARK_METAL,
    GLASS,
    METAL,
    WHITE,
    bricks,
    painted_wood,
    plaster,
    stone,
    wood,
)
from swardmap.synth.shapes import beam, box, cylinder, mesh_of, model_of, moved, placed, tube

FENCE_STYLES = ("pickets", "boards", "rails")


def fence_part(rng: np.random.Generator, length_m: float, style: str, height_m: float) -> Model:
    """A panel of a fence along x with a post at its start: pickets, boards, rails, wire or railing."""
    build = {"wire": _wire, "railing": _railing}.get(style)
    if build is not None:
        return model_of(style, build(length_m, height_m))
    timber = wood(rng) if rng.random() < 0.6 else painted_wood(rng)
    start = -length_m / 2
    parts = [_upright(start + 0.045, 0.0, (0.0, height_m + 0.06), (0.09, 0.09), timber)]
    levels = (0.22, 0.55, 0.88) if style == "rails" else (0.22, 0.78)
    parts += [_level(start, length_m, z * height_m, (0.035, 0.08), timber) for z in levels]
    pitch, width = {"pickets": (0.13, 0.08), "boards": (0.125, 0.12), "rails": (9.0, 0.0)}[style]
    for x in np.arange(start + 0.15, start + length_m - 0.02, pitch) if width else ():
        tall = height_m * rng.uniform(0.985, 1.0) - 0.05
        parts.append(_upright(float(x), 0.028, (0.05, 0.05 + tall), (width, 0.02), timber))
    return model_of(style, parts)


def _wire(length: float, height: float) -> list[Mesh]:
    """Wire mesh of 10 cm on a steel post."""
    start = -length / 2
    parts = [moved(cylinder(0.024, height, 8, None, DARK_METAL), placed(start, 0))]
    level = [[(start, 0, z), (start + length, 0, z)] for z in np.arange(0.06, height, 0.1)]
    steep = [[(x, 0, 0.06), (x, 0, height - 0.02)] for x in np.arange(start, start + length, 0.1)]
    return parts + [tube(line, 0.0018, 3, DARK_METAL) for line in (*level, *steep)]


def _railing(length: float, height: float) -> list[Mesh]:
    """Iron railings."""
    start = -length / 2
    parts = [_level(start, length, z, (0.03, 0.012), DARK_METAL) for z in (0.12, height - 0.1)]
    parts.append(moved(box((0.04, 0.04, height), DARK_METAL), placed(start + 0.02, 0)))
    bar = cylinder(0.008, height - 0.06, 6, None, DARK_METAL)
    return parts + [moved(bar, placed(x, 0, 0.06)) for x in np.arange(start + 0.12, start + length, 0.11)]


def wall_part(rng: np.random.Generator, length_m: float, height_m: float, brick: bool) -> Model:
    """A piece of a garden wall along x with a coping."""
    body = bricks(rng) if brick else stone(rng)
    coping = moved(box((length_m, 0.34, 0.06), stone(rng)), placed(0, 0, height_m - 0.06))
    return model_of("wall", [box((length_m, 0.26, height_m - 0.06), body), coping])


def house(rng: np.random.Generator, half_m: tuple[float, float]) -> Model:
    """A house with doors, windows and a gable roof; its door looks along +y."""
    w, d = 2 * half_m[0], 2 * half_m[1]
    eaves = float(rng.choice([2.6, 2.8, 5.2]))
    body = bricks(rng) if rng.random() < 0.35 else plaster(rng)
    frame = WHITE if rng.random() < 0.6 else painted_wood(rng)
    parts = [box((w, d, eaves), body), box((w + 0.06, d + 0.06, 0.35), stone(rng))]
    parts += roof(rng, w, d, eaves, rng.uniform(0.45, 0.85))
    for floor in np.arange(0, eaves - 2, 2.6):
        for side, yaw in ((d / 2, 0.0), (-d / 2, np.pi)):
            door_at = rng.integers(0, int(w // 2.2)) if floor == 0 else -1
            for k in range(int(w // 2.2)):
                x = (k + 0.5) * w / int(w // 2.2) - w / 2
                door = k == door_at
                opening = _door(rng, frame) if door else _window(frame, floor + 0.95)
                parts += [moved(moved(part, placed(0, 0, 0, yaw)), placed(x, side)) for part in opening]
    return model_of("house", parts)


def shed(rng: np.random.Generator, half_m: tuple[float, float]) -> Model:
    """A shed of boards."""
    w, d, eaves = 2 * half_m[0], 2 * half_m[1], rng.uniform(1.8, 2.1)
    timber = wood(rng) if rng.random() < 0.6 else painted_wood(rng)
    parts = [box((w, d, eaves), timber), *roof(rng, w, d, eaves, 0.4)]
    parts += [
        _upright(float(x), side * (d / 2 + 0.01), (0.0, eaves), (0.13, 0.02), timber)
        for side in (-1, 1)
        for x in np.arange(-w / 2 + 0.07, w / 2, 0.14)
    ]
    parts += [moved(part, placed(0.2 * w, d / 2 + 0.02)) for part in _door(rng, painted_wood(rng))]
    return model_of("shed", parts)


def roof(rng: np.random.Generator, w: float, d: float, eaves: float, pitch: float) -> list[Mesh]:
    """A gable roof with its ridge along x, and the gables below it."""
    over, rise = 0.35, pitch * d / 2
    color = [(0.22, 0.075, 0.045), (0.06, 0.06, 0.065), (0.13, 0.085, 0.06)][int(rng.integers(3))]
    tiles, gable = Material(color, roughness=0.9), plaster(rng)
    down = over * pitch
    parts = []
    for sign in (-1.0, 1.0):
        low, high = np.array([0, sign * (d / 2 + over), eaves - down]), np.array([0, 0, eaves + rise])
        slab = beam(low, high, (w + 2 * over, 0.1), tiles)
        parts.append(slab)
    for sign in (-1.0, 1.0):
        x, n = sign * w / 2, np.tile([sign, 0, 0], (3, 1))
        corners = np.array([(x, -d / 2, eaves), (x, d / 2, eaves), (x, 0, eaves + rise)])
        parts.append(mesh_of(corners, n, corners[:, 1:], [[0, 1, 2]] if sign > 0 else [[0, 2, 1]], gable))
    return parts


def _window(frame: Material, sill: float) -> list[Mesh]:
    """A window in a wall along x that looks along +y."""
    return [
        moved(box((1.1, 0.05, 1.25), frame), placed(0, 0.02, sill)),
        moved(box((0.46, 0.06, 1.1), GLASS), placed(-0.26, 0.025, sill + 0.075)),
        moved(box((0.46, 0.06, 1.1), GLASS), placed(0.26, 0.025, sill + 0.075)),
        moved(box((1.2, 0.16, 0.04), frame), placed(0, 0.06, sill - 0.04)),
    ]


def _door(rng: np.random.Generator, frame: Material) -> list[Mesh]:
    leaf = painted_wood(rng)
    return [
        moved(box((1.05, 0.05, 2.05), frame), placed(0, 0.02)),
        moved(box((0.9, 0.07, 1.95), leaf), placed(0, 0.02)),
        moved(box((0.03, 0.06, 0.12), METAL), placed(0.36, 0.07, 1.0)),
    ]


def _upright(
    x: float, y: float, z: tuple[float, float], size: tuple[float, float], material: Material
) -> Mesh:
    """A post or board from z[0] to z[1], its grain upright; `size` along x and y."""
    return beam((x, y, z[0]), (x, y, z[1]), (size[1], size[0]), material)


def _level(start: float, length: float, z: float, size: tuple[float, float], material: Material) -> Mesh:
    return beam((start, 0, z), (start + length, 0, z), size, material)
