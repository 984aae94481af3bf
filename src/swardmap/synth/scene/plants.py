"""Plants from leaf cards: trees, shrubs, hedges, ground cover, flowers, daisies and fallen leaves."""

import numpy as np

from swardmap.synth.model import Float64Array, Material, Mesh, Model
from swardmap.synth.scene.lawn_look import linear_of_hsv
from swardmap.synth.scene.materials import (
    SOIL,
    TERRACOTTA,
    WHITE,
    bark,
    inner_green,
    leaf_texture,
    leaves,
    wood,
)
from swardmap.synth.shapes import beam, box, cards, cylinder, ellipsoid, lathe, model_of, moved, placed, tube

STRAW_LEAF = (0.30, 0.17, 0.07)


def tree(rng: np.random.Generator) -> Model:
    """A broad-leaved tree or a conifer, 3-8 m high."""
    return conifer(rng) if rng.random() < 0.25 else broadleaf(rng)


def broadleaf(rng: np.random.Generator) -> Model:
    """Trunk, boughs and a crown of some round clusters; the crown begins above a person."""
    height = rng.uniform(3.2, 7.5)
    radius, split = 0.022 * height * rng.uniform(0.8, 1.3), height * rng.uniform(0.3, 0.42)
    wood_, foliage = bark(rng), leaves(rng)
    bend = rng.normal(0, 0.05, 2) * height
    top = np.array([*bend, split])
    trunk = np.array([[0, 0, -0.05], [0, 0, 0.08], 0.5 * top + [0, 0, 0.0], top])
    parts = [tube(trunk, np.array([1.6, 1.25, 1.0, 0.85]) * radius, 9, wood_)]
    boughs = int(rng.integers(4, 8))
    for k in range(boughs):
        angle, reach = 2 * np.pi * (k + rng.uniform(-0.3, 0.3)) / boughs, height * rng.uniform(0.16, 0.26)
        end = top + np.array([reach * np.cos(angle), reach * np.sin(angle), height * rng.uniform(0.12, 0.38)])
        middle = (top + end) / 2 + [0, 0, -0.05 * height]
        parts.append(tube([top - [0, 0, 0.1], middle, end], np.array([0.55, 0.4, 0.15]) * radius, 6, wood_))
        parts.append(_cluster(rng, end, height * rng.uniform(0.14, 0.2), 110, 0.075 * height, foliage, top))
    crown = top + _up(0.35 * height)
    parts.append(_cluster(rng, crown, height * 0.24, 200, 0.08 * height, foliage, top))
    return model_of("broadleaf", parts)


def conifer(rng: np.random.Generator) -> Model:
    """A cone of drooping sprays around a straight trunk."""
    height, low = rng.uniform(2.5, 7.0), rng.uniform(0.15, 0.5)
    wide = height * rng.uniform(0.16, 0.26)
    foliage = leaves(rng, 0.0)
    t = rng.uniform(0, 1, 750) ** 1.3
    angle = rng.uniform(0, 2 * np.pi, t.size)
    r = wide * (1 - t) * rng.uniform(0.55, 1.05, t.size)
    at = np.stack((r * np.cos(angle), r * np.sin(angle), low + t * (height - low)), axis=1)
    out = np.stack((np.cos(angle), np.sin(angle), np.full(t.size, 0.6)), axis=1)
    facing = _unit(out + rng.normal(0, 0.45, out.shape))
    at[:, 2] = np.maximum(at[:, 2], 0.12 * wide + 0.1)
    size = np.clip(0.42 * wide * (1.1 - t), 0.12, 0.5)
    at[:, 2] = np.maximum(at[:, 2], 0.75 * size)
    trunk = tube([[0, 0, -0.05], [0, 0, 0.9 * height]], np.array([0.024, 0.005]) * height, 8, bark(rng))
    core = cylinder(0.55 * wide, 0.72 * height, 12, 0.02 * wide, inner_green(foliage))
    crown = cards(at, facing, size, rng.uniform(0, 6.28, t.size), _unit(out), foliage)
    return model_of("conifer", [trunk, moved(core, placed(0, 0, low + 0.05 * height)), crown])


def shrub(rng: np.random.Generator) -> Model:
    """A bush of 0.4-1.5 m, round or upright, at times in flower."""
    radius = rng.uniform(0.25, 0.75)
    tall = radius * rng.uniform(1.1, 2.1)
    foliage = leaves(rng, 0.1)
    core = ellipsoid((0.72 * radius, 0.72 * radius, 0.42 * tall), 8, 12, inner_green(foliage))
    parts = [core]
    for _ in range(5):
        at = np.array([*rng.normal(0, 0.28, 2) * radius, tall * rng.uniform(0.42, 0.62)])
        parts.append(_cluster(rng, at, 0.62 * radius, 75, 0.34 * radius, foliage, np.zeros(3), tall))
    if rng.random() < 0.35:
        parts.append(_blossoms(rng, radius, tall))
    return model_of("shrub", parts)


def hedge_part(
    rng: np.random.Generator, length_m: float, width_m: float, height_m: float, foliage: Material
) -> Model:
    """A piece of a clipped hedge along x."""
    size = np.array([length_m, width_m, height_m])
    core = box((length_m, 0.86 * width_m, 0.97 * height_m), inner_green(foliage))
    areas = np.array([size[1] * size[2], size[0] * size[2], 0.7 * size[0] * size[1]])
    count = np.maximum((areas * np.array([40, 115, 115])).astype(int), 4)
    parts = [core]
    for axis in range(3):
        for sign in (-1.0, 1.0) if axis < 2 else (1.0,):
            at = (rng.uniform(-0.5, 0.5, (count[axis], 3)) + _up(0.5)) * size
            face = np.eye(3)[axis] * sign
            offset = rng.normal(-0.01, 0.018, count[axis])
            at[:, axis] = (sign * size[axis] / 2 if axis < 2 else size[2]) + sign * offset
            at[:, 2] = np.maximum(at[:, 2], 0.11)
            facing = _unit(face + rng.normal(0, 0.55, at.shape))
            light = _unit(face + 0.35 * rng.normal(0, 1, at.shape))
            parts.append(
                cards(
                    at,
                    facing,
                    rng.uniform(0.11, 0.17, len(at)),
                    rng.uniform(0, 6.28, len(at)),
                    light,
                    foliage,
                )
            )
    return model_of("hedge", parts)


def ground_cover(rng: np.random.Generator, foliage: Material) -> Model:
    """Low plants on a patch of 0.7 m, 5-14 cm high: green, but not lawn."""
    at = _disc(rng, 0.36, 90)
    high = rng.uniform(0.05, 0.14)
    at[:, 2] = rng.uniform(0.45, 1.0, 90) * high
    facing = _unit(np.array([0, 0, 0.8]) + rng.normal(0, 0.4, at.shape))
    size = rng.uniform(0.09, 0.15, 90)
    at[:, 2] = np.maximum(at[:, 2], 0.72 * size * np.sqrt(1 - facing[:, 2] ** 2))
    return model_of(
        "ground cover",
        [cards(at, facing, size, rng.uniform(0, 6.28, 90), np.tile([0, 0, 1.0], (90, 1)), foliage)],
    )


def daisies(rng: np.random.Generator) -> Model:
    """Flowers of a lawn on a patch of 0.8 m: white or yellow heads of 2 cm on short stalks."""
    n = int(rng.integers(12, 40))
    at = _disc(rng, 0.45, n)
    at[:, 2] = rng.uniform(0.025, 0.055, n)
    head = WHITE if rng.random() < 0.7 else Material((0.7, 0.5, 0.03))
    facing = _unit(np.array([0, 0, 1.0]) + rng.normal(0, 0.25, at.shape))
    parts = [moved(cylinder(0.011, 0.004, 7, 0.008, head), placed(*p)) for p in at]
    eyes = cards(
        at + _up(0.0045),
        facing * [0, 0, 1] / facing[:, 2:],
        0.006,
        0.0,
        None,
        Material((0.65, 0.42, 0.02)),
    )
    stalk = Material((0.07, 0.13, 0.03))
    parts += [tube([[p[0], p[1], 0.0], [p[0], p[1], p[2]]], 0.0012, 3, stalk) for p in at]
    return model_of("daisies", [*parts, eyes])


def fallen_leaves(rng: np.random.Generator) -> Model:
    """Single dry leaves on a patch of a metre, none above 5 cm."""
    n = int(rng.integers(15, 60))
    at = _disc(rng, 0.5, n)
    at[:, 2] = rng.uniform(0.02, 0.04, n)
    facing = _unit(np.array([0, 0, 1.0]) + rng.normal(0, 0.22, at.shape))
    r, g, b = np.array(STRAW_LEAF) * rng.uniform(0.6, 1.5)
    material = Material((float(r), float(g), float(b)), leaf_texture(), cutout=True, translucency=0.2)
    return model_of(
        "fallen leaves",
        [cards(at, facing, rng.uniform(0.035, 0.06, n), rng.uniform(0, 6.28, n), None, material)],
    )


def flowers(rng: np.random.Generator) -> Model:
    """A clump of garden flowers, 0.2-0.5 m high."""
    n, high = int(rng.integers(7, 16)), rng.uniform(0.2, 0.5)
    foliage = leaves(rng, 0.0)
    tips = _disc(rng, 0.2, n) + np.array([0, 0, 1]) * (high * rng.uniform(0.75, 1.0, n))[:, None]
    petal = Material(
        linear_of_hsv(rng.choice([0, 25, 48, 275, 300, 335]), rng.uniform(0.3, 0.85), 0.9), translucency=0.3
    )
    parts = [tube([p * [0.4, 0.4, 0], p], 0.004, 4, Material((0.06, 0.12, 0.03))) for p in tips]
    parts += [moved(ellipsoid((0.028, 0.028, 0.02), 4, 8, petal), placed(*p)) for p in tips]
    at = _disc(rng, 0.2, 40) + _up(high) * rng.uniform(0.15, 0.6, (40, 1))
    size = rng.uniform(0.08, 0.14, 40)
    at[:, 2] = np.maximum(at[:, 2], 0.72 * size)
    facing = _unit(np.array([0, 0, 0.5]) + rng.normal(0, 1, at.shape))
    parts.append(cards(at, facing, size, rng.uniform(0, 6.28, 40), np.tile([0, 0, 1.0], (40, 1)), foliage))
    return model_of("flowers", parts)


def flower_pot(rng: np.random.Generator) -> Model:
    """A pot with a plant, 0.2-0.9 m in all."""
    r = rng.uniform(0.08, 0.26)
    h = r * rng.uniform(1.3, 2.0)
    pot = lathe(
        [
            (0, 0),
            (0.7 * r, 0),
            (r, 0.9 * h),
            (1.08 * r, 0.9 * h),
            (1.08 * r, h),
            (0.9 * r, h),
            (0.9 * r, 0.9 * h),
            (0, 0.9 * h),
        ],
        18,
        TERRACOTTA,
    )
    foliage = leaves(rng, 0.15)
    crown = _cluster(rng, np.array([0, 0, h + 0.9 * r]), 1.1 * r, 60, 0.5 * r, foliage, np.array([0, 0, h]))
    return model_of("flower pot", [pot, crown])


def raised_bed(rng: np.random.Generator) -> Model:
    """A wooden box with soil and plants."""
    length, width, high = rng.uniform(1.0, 2.2), rng.uniform(0.6, 1.1), rng.uniform(0.2, 0.5)
    board, foliage = wood(rng), leaves(rng, 0.0)
    parts = [moved(box((length, width, 0.9 * high), SOIL), placed(0, 0))]
    for sign in (-1.0, 1.0):
        parts.append(moved(box((length + 0.06, 0.03, high), board), placed(0, sign * (width / 2 + 0.015))))
        parts.append(moved(box((0.03, width, high), board), placed(sign * (length / 2 + 0.015), 0)))
    for _ in range(int(length * width * 7)):
        at = np.array([rng.uniform(-0.42, 0.42) * length, rng.uniform(-0.38, 0.38) * width, 0.92 * high])
        r = rng.uniform(0.07, 0.16)
        parts.append(_cluster(rng, at + _up(r), r, 22, 0.9 * r, foliage, at))
    return model_of("raised bed", parts)


def stump(rng: np.random.Generator) -> Model:
    """What is left of a felled tree."""
    r, h = rng.uniform(0.12, 0.3), rng.uniform(0.12, 0.45)
    body = lathe([(1.35 * r, 0), (1.1 * r, 0.25 * h), (r, h)], 16, bark(rng))
    top = moved(cylinder(r, 0.002, 16, None, Material((0.42, 0.3, 0.18))), placed(0, 0, h - 0.002))
    return model_of("stump", [body, top])


def log(rng: np.random.Generator) -> Model:
    """A branch or log that lies on the ground."""
    r, length = rng.uniform(0.04, 0.14), rng.uniform(0.6, 1.8)
    sway = rng.uniform(-0.06, 0.06, 2) * length
    path = [[-length / 2, 0, r], [-length / 6, sway[0], r], [length / 6, sway[1], r], [length / 2, 0, r]]
    return model_of("log", [tube(path, r, 10, bark(rng))])


def trellis(rng: np.random.Generator) -> Model:
    """A wooden frame with a climbing plant."""
    width, high, bars, foliage = rng.uniform(0.8, 1.6), rng.uniform(1.4, 2.0), wood(rng), leaves(rng)
    parts = [beam((x, 0, -0.05), (x, 0, high), (0.04, 0.04), bars) for x in (-width / 2, width / 2)]
    parts += [
        beam((-width / 2, 0, z), (width / 2, 0, z), (0.02, 0.03), bars) for z in np.linspace(0.3, high, 6)
    ]
    at = rng.uniform((-width / 2, -0.08, 0.2), (width / 2, 0.08, high), (170, 3))
    facing = _unit(np.array([0, 1.0, 0.2]) * rng.choice([-1, 1], 170)[:, None] + rng.normal(0, 0.5, (170, 3)))
    parts.append(cards(at, facing, rng.uniform(0.1, 0.2, 170), rng.uniform(0, 6.28, 170), None, foliage))
    return model_of("trellis", parts)


def _cluster(
    rng: np.random.Generator, center: Float64Array, radius: float, count: int, size: float, foliage: Material,
    away_from: Float64Array, top: float = np.inf,
) -> Mesh:  # fmt: skip
    """Cards in the outer part of a ball, lit as a round body would be."""
    out = _unit(rng.normal(0, 1, (count, 3)))
    at = center + out * radius * rng.uniform(0.55, 1.0, (count, 1))
    edge = size * rng.uniform(0.7, 1.25, count)
    low = 0.72 * edge
    at[:, 2] = np.minimum(np.maximum(at[:, 2], low), np.maximum(top - low, low))
    facing = _unit(out + rng.normal(0, 0.5, at.shape))
    light = _unit(0.7 * _unit(at - away_from) + 0.6 * out + [0, 0, 0.1])
    return cards(at, facing, edge, rng.uniform(0, 2 * np.pi, count), light, foliage)


def _blossoms(rng: np.random.Generator, radius: float, tall: float) -> Mesh:
    n = int(rng.integers(15, 50))
    out = _unit(rng.normal(0, 1, (n, 3)) * [1, 1, 0.8] + [0, 0, 0.4])
    at = out * np.array([1.0, 1.0, 0.5]) * [radius, radius, tall] * 0.95 + [0, 0, 0.5 * tall]
    hue = float(rng.choice([345, 320, 285, 50, 5]))
    material = Material(
        linear_of_hsv(hue, rng.uniform(0.1, 0.7), 0.92), leaf_texture(), cutout=True, translucency=0.3
    )
    at[:, 2] = np.maximum(at[:, 2], 0.1)
    return cards(at, _unit(out + rng.normal(0, 0.3, at.shape)), 0.1, rng.uniform(0, 6.28, n), out, material)


def _disc(rng: np.random.Generator, radius: float, n: int) -> Float64Array:
    """Points at z = 0, even over a disc."""
    r, angle = radius * np.sqrt(rng.random(n)), rng.uniform(0, 2 * np.pi, n)
    return np.stack((r * np.cos(angle), r * np.sin(angle), np.zeros(n)), axis=1)


def _unit(v: Float64Array) -> Float64Array:
    unit: Float64Array = v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9)
    return unit


def _up(z: float) -> Float64Array:
    return np.array([0.0, 0.0, z])
