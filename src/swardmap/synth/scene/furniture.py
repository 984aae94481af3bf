"""Furniture, posts and other big objects, from simple shapes."""

from itertools import pairwise

import numpy as np

from swardmap.synth.model import Material, Mesh, Model
from swardmap.synth.scene.lawn_look import linear_of_hsv
from swardmap.synth.scene.materials import (
    DARK_METAL,
    METAL,
    RUBBER,
    SOIL,
    WHITE,
    paint,
    painted_wood,
    stone,
    wood,
)
from swardmap.synth.shapes import beam, box, cylinder, lathe, model_of, moved, placed, sphere, tube

CHAIR_SEAT_M, BENCH_SEAT_M = 0.44, 0.455  # tops of the seats


def bench(rng: np.random.Generator) -> Model:
    """A bench with a back."""
    length, timber, legs = rng.uniform(1.1, 1.7), wood(rng), DARK_METAL
    parts = [
        _bar((-length / 2, y, 0.44), (length / 2, y, 0.44), 0.09, 0.03, timber) for y in (-0.18, -0.06, 0.06)
    ]
    parts += [
        _bar((-length / 2, 0.16 + s, z), (length / 2, 0.16 + s, z), 0.03, 0.09, timber)
        for s, z in ((0, 0.6), (0.03, 0.76))
    ]
    for x in (-0.4 * length, 0.4 * length):
        parts += [
            _bar((x, -0.2, 0), (x, -0.2, 0.42), 0.05, 0.05, legs),
            _bar((x, 0.14, 0), (x, 0.2, 0.8), 0.05, 0.05, legs),
        ]
        parts.append(_bar((x, -0.2, 0.41), (x, 0.16, 0.41), 0.05, 0.03, legs))
    return model_of("bench", [moved(part, placed(0, 0, 0, -np.pi / 2)) for part in parts])


def table(rng: np.random.Generator) -> Model:
    """A round or square garden table."""
    timber, h, r = wood(rng) if rng.random() < 0.6 else WHITE, rng.uniform(0.68, 0.75), rng.uniform(0.4, 0.7)
    if rng.random() < 0.5:
        top, foot = (
            moved(cylinder(r, 0.03, 24, None, timber), placed(0, 0, h)),
            cylinder(0.25, 0.03, 16, None, DARK_METAL),
        )
        return model_of("table", [top, foot, cylinder(0.035, h, 10, None, DARK_METAL)])
    legs = [
        _bar((sx * 0.9 * r, sy * 0.9 * r, 0), (sx * 0.9 * r, sy * 0.9 * r, h), 0.05, 0.05, timber)
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    return model_of("table", [moved(box((2 * r, 2 * r, 0.03), timber), placed(0, 0, h)), *legs])


def chair(rng: np.random.Generator) -> Model:
    """A garden chair whose back is at -x; its seat is 0.44 m high."""
    timber = wood(rng) if rng.random() < 0.5 else paint(rng, (0.1, 0.6))
    parts = [moved(box((0.44, 0.44, 0.035), timber), placed(0, 0, 0.405))]
    parts += [
        _bar((x, y, 0), (x, y, 0.41), 0.035, 0.035, timber) for x in (-0.19, 0.19) for y in (-0.19, 0.19)
    ]
    parts += [
        _bar((-0.2, y, 0.42), (-0.28, y, 0.88), 0.035, 0.025, timber) for y in (-0.18, -0.06, 0.06, 0.18)
    ]
    return model_of("chair", [*parts, _bar((-0.28, -0.2, 0.87), (-0.28, 0.2, 0.87), 0.03, 0.05, timber)])


def pole(rng: np.random.Generator) -> Model:
    """A post, a bollard or a flag pole, 0.6-4 m."""
    h, r = float(rng.choice([0.6, 1.0, 1.6, 4.0])), rng.uniform(0.02, 0.06)
    return model_of("pole", [cylinder(r, h, 12, None, wood(rng) if rng.random() < 0.5 else METAL)])


def lamp_post(rng: np.random.Generator) -> Model:
    """A garden lamp of 0.7-3 m."""
    h = rng.uniform(0.7, 3.0)
    parts = [cylinder(0.035, h, 10, None, DARK_METAL), cylinder(0.09, 0.05, 12, 0.05, DARK_METAL)]
    return model_of("lamp post", [*parts, moved(sphere(0.13, 10, 16, WHITE), placed(0, 0, h - 0.03))])


def washing_line_post(rng: np.random.Generator) -> Model:
    """A rotary drier without its washing."""
    h, metal = rng.uniform(1.6, 1.9), METAL
    parts = [cylinder(0.025, h, 10, None, metal)]
    for k in range(4):
        c, s = np.cos(k * np.pi / 2), np.sin(k * np.pi / 2)
        parts.append(tube([(0, 0, 0.65 * h), (1.2 * c, 1.2 * s, h + 0.1)], 0.012, 6, metal))
    for f in (0.4, 0.6, 0.8, 1.0):
        ends = [
            (
                1.2 * f * np.cos(k * np.pi / 2),
                1.2 * f * np.sin(k * np.pi / 2),
                0.65 * h + f * (0.35 * h + 0.1),
            )
            for k in range(5)
        ]
        parts += [tube([a, b], 0.002, 3, WHITE) for a, b in pairwise(ends)]
    return model_of("washing line", parts)


def planter(rng: np.random.Generator) -> Model:
    """A trough of wood or concrete with soil, without plants."""
    length, w, h = rng.uniform(0.5, 1.2), rng.uniform(0.25, 0.4), rng.uniform(0.2, 0.45)
    side = wood(rng) if rng.random() < 0.5 else stone(rng)
    return model_of(
        "planter",
        [
            box((length, w, 0.93 * h), SOIL),
            *[moved(box((length + 0.04, 0.03, h), side), placed(0, s * (w / 2 + 0.015))) for s in (-1, 1)],
            *[moved(box((0.02, w, h), side), placed(s * (length / 2 + 0.01), 0)) for s in (-1, 1)],
        ],
    )


def bin_or_barrel(rng: np.random.Generator) -> Model:
    """A dustbin or a water butt."""
    if rng.random() < 0.5:
        r, h = rng.uniform(0.25, 0.33), rng.uniform(0.7, 0.95)
        return model_of(
            "water butt", [lathe([(0, 0), (0.85 * r, 0), (r, 0.5 * h), (0.85 * r, h), (0, h)], 20, wood(rng))]
        )
    plastic = Material(linear_of_hsv(rng.choice([110, 215, 30, 0]), rng.uniform(0.1, 0.5), 0.3), specular=0.2)
    body = moved(box((0.55, 0.5, 0.9), plastic), placed(0, 0, 0.06))
    return model_of(
        "dustbin",
        [
            body,
            moved(box((0.6, 0.54, 0.05), plastic), placed(0, 0, 0.96)),
            _bar((-0.25, -0.27, 0.08), (-0.25, 0.27, 0.08), 0.16, 0.16, RUBBER),
        ],
    )


def wheelbarrow(rng: np.random.Generator) -> Model:
    """A wheelbarrow that looks along +x."""
    tray = prism_tray(paint(rng, (0.2, 0.7)))
    wheel = _bar((0.55, -0.04, 0.17), (0.55, 0.04, 0.17), 0.34, 0.34, RUBBER)
    bars = [_bar((0.55, 0.06 * s, 0.2), (-0.75, 0.28 * s, 0.5), 0.03, 0.03, METAL) for s in (-1, 1)]
    legs = [_bar((-0.3, 0.22 * s, 0.36), (-0.38, 0.25 * s, 0), 0.03, 0.03, METAL) for s in (-1, 1)]
    return model_of("wheelbarrow", [tray, wheel, *bars, *legs])


def prism_tray(material: Material) -> Mesh:
    """The tray of a wheelbarrow."""
    return moved(
        lathe([(0, 0), (0.24, 0), (0.4, 0.24), (0.37, 0.24), (0.22, 0.03), (0, 0.03)], 4, material),
        placed(-0.02, 0, 0.32, np.pi / 4, (1.15, 0.8, 1)),
    )


def play_frame(rng: np.random.Generator) -> Model:
    """A swing of wooden beams."""
    timber, h = wood(rng), rng.uniform(1.7, 2.1)
    parts = [_bar((0, -1.2, h), (0, 1.2, h), 0.09, 0.09, timber)]
    parts += [
        _bar((x, y, 0), (0, 0.9 * y, h), 0.08, 0.08, timber) for x in (-0.7, 0.7) for y in (-1.25, 1.25)
    ]
    seat = moved(box((0.18, 0.42, 0.03), paint(rng)), placed(0, 0, 0.42))
    ropes = [tube([(0, y, 0.44), (0, y, h)], 0.008, 4, WHITE) for y in (-0.19, 0.19)]
    return model_of("swing", [*parts, seat, *ropes])


def sign_board(rng: np.random.Generator) -> Model:
    """A board on a post."""
    h = rng.uniform(0.5, 1.4)
    face = moved(
        box((0.03, rng.uniform(0.3, 0.6), rng.uniform(0.2, 0.4)), painted_wood(rng)), placed(0.03, 0, h - 0.2)
    )
    return model_of("sign", [cylinder(0.03, h, 10, None, wood(rng)), face])


def trampoline(rng: np.random.Generator) -> Model:
    """A round trampoline on legs."""
    r, h, metal = rng.uniform(0.9, 1.6), rng.uniform(0.4, 0.75), METAL
    angle = np.linspace(0, 2 * np.pi, 33)
    rim = tube(np.stack((r * np.cos(angle), r * np.sin(angle), np.full(33, h)), 1), 0.025, 8, metal)
    mat = moved(cylinder(0.82 * r, 0.01, 32, None, RUBBER), placed(0, 0, h - 0.005))
    edge = lathe([(0.8 * r, h), (0.81 * r, h + 0.02), (1.02 * r, h + 0.02), (1.03 * r, h)], 32, paint(rng))
    legs = [
        tube([(k * r * c, k * r * s, z) for k, z in ((1.0, h), (1.03, 0.02), (0.97, 0.0))], 0.02, 7, metal)
        for c, s in ((np.cos(a), np.sin(a)) for a in np.arange(6) * np.pi / 3)
    ]
    return model_of("trampoline", [rim, mat, edge, *legs])


def _bar(
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    width: float,
    height: float,
    material: Material,
) -> Mesh:
    return beam(start, end, (width, height), material)
