"""Toys, tools, stones, figures, animals and the test body, from simple shapes."""

import numpy as np

from swardmap.synth.model import Material, Mesh, Model
from swardmap.synth.scene.areas import curve
from swardmap.synth.scene.lawn_look import linear_of_hsv
from swardmap.synth.scene.materials import (
    DARK_METAL,
    METAL,
    RUBBER,
    WHITE,
    bark,
    paint,
    rough_texture,
    stone,
    wood,
)
from swardmap.synth.shapes import beam, box, cylinder, ellipsoid, lathe, model_of, moved, placed, sphere, tube

TEST_BODY_HEIGHT_M, TEST_BODY_DIAMETER_M = 0.80, 0.38


def iso_test_body(rng: np.random.Generator) -> Model:
    """The barrel-shaped test body of ISO 18497: torso and head of a person who sits, matt olive green.

    Barrel-shaped, and meant to mimic torso and head of a seated human: Steen et al., J. Imaging 2016, 2(1),
    6. The text of the standard was not at hand: height 0.80 m and diameter 0.38 m are from memory, the
    diameter of the head is that of a head. At times it lies.
    """
    r, h, head = TEST_BODY_DIAMETER_M / 2, TEST_BODY_HEIGHT_M, 0.1
    profile = [(0, 0), (0.86 * r, 0), (0.93 * r, 0.03), (r, 0.16), (r, 0.42), (0.9 * r, 0.51),
               (0.6 * r, 0.565), (head, 0.585), (head, h - 0.04), (0.75 * head, h - 0.01), (0.4 * head, h),
               (0, h)]  # fmt: skip
    body = lathe(profile, 24, Material((0.085, 0.095, 0.035), roughness=0.9))
    if rng.random() < 0.2:
        lying = np.array([[0, 0, 1.0, -h / 2], [0, 1, 0, 0], [-1, 0, 0, r], [0, 0, 0, 1]])
        body = moved(body, lying)
    return model_of("test body", [body])


def ball(rng: np.random.Generator) -> Model:
    """A ball of 6-25 cm."""
    return model_of("ball", [sphere(float(rng.uniform(0.03, 0.125)), 12, 18, paint(rng))])


def toy(rng: np.random.Generator) -> Model:
    """Blocks, a cart, a bucket with a spade, or a ring."""
    kind = int(rng.integers(4))
    if kind == 0:
        parts = [
            moved(
                box((0.1, 0.1, 0.1), paint(rng)),
                placed(rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 0, rng.uniform(0, 3)),
            )
            for _ in range(4)
        ]
    elif kind == 1:
        wheels = [
            _bar((x, y - 0.02, 0.05), (x, y + 0.02, 0.05), 0.1, 0.1, RUBBER)
            for x in (-0.15, 0.15)
            for y in (-0.12, 0.12)
        ]
        parts = [
            moved(box((0.45, 0.2, 0.1), paint(rng)), placed(0, 0, 0.07)),
            moved(box((0.16, 0.18, 0.12), paint(rng)), placed(-0.08, 0, 0.17)),
            *wheels,
        ]
    elif kind == 2:
        pail = lathe([(0, 0), (0.075, 0), (0.1, 0.17), (0.09, 0.17), (0.07, 0.01), (0, 0.01)], 16, paint(rng))
        parts = [
            pail,
            tube([(0.16, 0, 0.012), (0.3, 0.05, 0.012)], 0.012, 6, paint(rng)),
            moved(box((0.09, 0.07, 0.02), paint(rng)), placed(0.34, 0.06)),
        ]
    else:
        angle = np.linspace(0, 2 * np.pi, 28)
        parts = [
            tube(
                np.stack((0.3 * np.cos(angle), 0.3 * np.sin(angle), np.full(28, 0.015)), 1),
                0.015,
                8,
                paint(rng),
            )
        ]
    return model_of("toy", parts)


def hose(rng: np.random.Generator) -> Model:
    """A garden hose that lies on the ground in curves, 1.6 cm thick."""
    n = int(rng.integers(5, 8))
    knots = np.cumsum(rng.normal((0.28, 0), 0.45, (n, 2)), axis=0)
    knots -= (knots.min(axis=0) + knots.max(axis=0)) / 2
    line = curve(np.concatenate([knots, np.full((n, 1), 0.01)], axis=1), 9)
    color = linear_of_hsv(
        rng.choice([95, 110, 140, 48, 205]), rng.uniform(0.5, 0.85), rng.uniform(0.35, 0.75)
    )
    jet = moved(cylinder(0.016, 0.12, 8, 0.01, METAL), placed(line[-1, 0], line[-1, 1]))
    return model_of("hose", [tube(line, 0.008, 6, Material(color, specular=0.3, roughness=0.4)), jet])


def tool(rng: np.random.Generator) -> Model:
    """A rake or a shovel that lies on the ground along x."""
    timber, length = wood(rng), rng.uniform(1.1, 1.5)
    shaft = tube([(-length / 2, 0, 0.018), (length / 2, 0, 0.025)], 0.014, 8, timber)
    if rng.random() < 0.5:
        teeth = [
            _bar((length / 2, y, 0.0), (length / 2, y, 0.06), 0.008, 0.008, DARK_METAL)
            for y in np.linspace(-0.19, 0.19, 13)
        ]
        head = [_bar((length / 2, -0.2, 0.05), (length / 2, 0.2, 0.05), 0.02, 0.02, DARK_METAL), *teeth]
    else:
        blade = moved(ellipsoid((0.15, 0.1, 0.012), 6, 12, METAL), placed(length / 2 + 0.13, 0))
        head = [blade, _bar((-length / 2, -0.07, 0.02), (-length / 2, 0.07, 0.02), 0.025, 0.025, timber)]
    return model_of("tool", [shaft, *head])


def low_object(rng: np.random.Generator) -> Model:
    """Something of 10-20 cm that a mower must not run over: a brick, light, sprinkler, can, shoe or bowl."""
    kind, h = int(rng.integers(6)), rng.uniform(0.1, 0.2)
    if kind == 0:
        return model_of(
            "brick", [box((0.24, 0.115, 0.1), Material((0.33, 0.11, 0.07), texture=rough_texture()))]
        )
    if kind == 1:
        return model_of(
            "garden light",
            [
                cylinder(0.012, h, 8, None, DARK_METAL),
                moved(cylinder(0.05, 0.05, 12, 0.035, METAL), placed(0, 0, h - 0.05)),
            ],
        )
    if kind == 2:
        arms = [
            _bar((0, 0, h), (0.12 * c, 0.12 * s, h), 0.012, 0.012, METAL)
            for c, s in ((1, 0), (-0.5, 0.87), (-0.5, -0.87))
        ]
        return model_of(
            "sprinkler",
            [cylinder(0.11, 0.02, 14, None, paint(rng)), cylinder(0.02, h, 8, None, METAL), *arms],
        )
    if kind == 3:
        spout = tube([(0.08, 0, 0.06), (0.22, 0, h + 0.02)], 0.012, 6, METAL)
        return model_of("watering can", [cylinder(0.09, h, 16, None, METAL), spout])
    if kind == 4:
        sole = Material(linear_of_hsv(rng.uniform(0, 360), 0.4, 0.4))
        shoes = [
            moved(ellipsoid((0.13, 0.045, 0.05), 6, 10, sole), placed(0, y, 0, a))
            for y, a in ((-0.09, 0.1), (0.09, -0.3))
        ]
        return model_of("shoes", shoes)
    return model_of(
        "bowl",
        [lathe([(0, 0), (0.12, 0), (0.09, 0.1), (0.08, 0.1), (0.07, 0.03), (0, 0.03)], 18, paint(rng))],
    )


BIRD_BATH = [
    (0, 0), (0.18, 0), (0.16, 0.06), (0.07, 0.14), (0.06, 0.6), (0.12, 0.68), (0.3, 0.74),
    (0.28, 0.75), (0, 0.69),
]  # fmt: skip
BUST = [
    (0, 0), (0.2, 0), (0.21, 0.18), (0.06, 0.28), (0.055, 0.34), (0.09, 0.4), (0.1, 0.5),
    (0.06, 0.6), (0, 0.62),
]  # fmt: skip
"""Outlines: radius and height, from below."""


def garden_figure(rng: np.random.Generator) -> Model:
    """A gnome, a bird bath, a stone lantern or a bust on a plinth: no person."""
    kind, rock = int(rng.integers(4)), stone(rng)
    if kind == 0:
        parts = _gnome(rng)
    elif kind == 1:
        parts = [lathe(BIRD_BATH, 20, rock)]
    elif kind == 2:
        parts = [
            box((0.3, 0.3, 0.1), rock),
            cylinder(0.08, 0.5, 8, None, rock),
            moved(box((0.26, 0.26, 0.2), rock), placed(0, 0, 0.5)),
            moved(cylinder(0.26, 0.18, 4, 0.03, rock), placed(0, 0, 0.7)),
        ]
    else:
        parts = [box((0.4, 0.4, 0.7), rock), moved(lathe(BUST, 18, rock), placed(0, 0, 0.7))]
    return model_of("garden figure", parts)


def _gnome(rng: np.random.Generator) -> list[Mesh]:
    skin = Material((0.5, 0.3, 0.22))
    return [
        cylinder(0.08, 0.2, 12, 0.06, paint(rng)),
        moved(sphere(0.055, 8, 12, skin), placed(0, 0, 0.19)),
        moved(cylinder(0.06, 0.14, 12, 0.005, paint(rng)), placed(0, 0, 0.27)),
        moved(ellipsoid((0.03, 0.05, 0.06), 6, 10, WHITE), placed(0.035, 0, 0.14)),
    ]


def rock(rng: np.random.Generator) -> Model:
    """A boulder or a stone, 0.08-0.6 m."""
    radii = rng.uniform(0.06, 0.4) * rng.uniform(0.7, 1.3, 3) * np.array([1, 1, 0.65])
    mesh = ellipsoid((float(radii[0]), float(radii[1]), float(radii[2])), 10, 14, stone(rng))
    wave, phase = rng.uniform(2, 5, 3) / radii, rng.uniform(0, 6, 3)
    bump = (
        1
        + 0.06 * np.sin(mesh.xyz @ wave[:, None] + phase[0])[:, 0]
        + 0.05 * np.sin(3 * mesh.xyz[:, 0] / radii[0] + phase[1])
    )
    center = np.array([0, 0, radii[2]])
    xyz = (mesh.xyz - center) * bump[:, None] + center
    xyz[:, 2] -= xyz[:, 2].min()
    return Model(
        "rock", (type(mesh)(xyz.astype(np.float32), mesh.normals, mesh.uv, mesh.faces, mesh.material),)
    )


def animal(rng: np.random.Generator) -> Model:
    """A dog, cat, rabbit, hen or hedgehog that stands or sits and looks along +x."""
    kind = str(rng.choice(["dog", "cat", "rabbit", "hen", "hedgehog"]))
    size = {"dog": rng.uniform(0.3, 0.6), "cat": 0.26, "rabbit": 0.18, "hen": 0.3, "hedgehog": 0.13}[kind]
    coat = linear_of_hsv(rng.uniform(18, 36), rng.uniform(0.05, 0.55), rng.uniform(0.15, 0.85))
    fur, s = Material(coat), size
    if kind == "hedgehog":
        return model_of(
            kind,
            [
                ellipsoid((0.13, 0.09, 0.065), 8, 14, Material((0.09, 0.06, 0.04))),
                moved(ellipsoid((0.05, 0.035, 0.03), 6, 10, fur), placed(0.12, 0)),
            ],
        )
    legs = [
        tube([(x * s, y * s, 0), (x * s, y * s, 0.5 * s)], 0.05 * s + 0.006, 7, fur)
        for x in (-0.42, 0.42)
        for y in (-0.13, 0.13)
    ]
    body = moved(ellipsoid((0.58 * s, 0.2 * s, 0.22 * s), 8, 14, fur), placed(0, 0, 0.42 * s))
    head = moved(ellipsoid((0.2 * s, 0.14 * s, 0.15 * s), 8, 12, fur), placed(0.62 * s, 0, 0.72 * s))
    neck = tube([(0.4 * s, 0, 0.68 * s), (0.62 * s, 0, 0.88 * s)], 0.1 * s, 8, fur)
    tail = tube([(-0.52 * s, 0, 0.7 * s), (-0.85 * s, 0, 0.95 * s)], 0.04 * s, 6, fur)
    ears = [
        moved(
            ellipsoid((0.03 * s, 0.05 * s, (0.16 if kind == "rabbit" else 0.07) * s), 5, 8, fur),
            placed(0.56 * s, y * s, 0.95 * s),
        )
        for y in (-0.08, 0.08)
    ]
    return model_of(kind, [*legs, body, head, neck, tail, *ears])


def bough(rng: np.random.Generator) -> Model:
    """Twigs on the lawn, thinner than 3 cm."""
    wood_ = bark(rng)
    parts = []
    for _ in range(int(rng.integers(2, 5))):
        knots = np.cumsum(rng.normal((0.12, 0), 0.12, (4, 2)), axis=0) + rng.normal(0, 0.1, 2)
        r = rng.uniform(0.004, 0.014)
        parts.append(
            tube(np.concatenate([knots, np.full((4, 1), r)], 1), [r, 0.8 * r, 0.6 * r, 0.3 * r], 5, wood_)
        )
    return model_of("twigs", parts)


def _bar(
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    width: float,
    height: float,
    material: Material,
) -> Mesh:
    return beam(start, end, (width, height), material)
