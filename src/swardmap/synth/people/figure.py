"""A whole person by chance, and a person in a pose."""

from dataclasses import dataclass

import numpy as np

from swardmap.synth.model import Float64Array, Model
from swardmap.synth.people.body import Assets, Body, body_of
from swardmap.synth.people.cloth import picked
from swardmap.synth.people.head import (
    GREY,
    HAIR,
    SKIN,
    cap_of_hair,
    face,
    hair_material,
    hat,
    long_hair,
    skin_of,
    tail,
)
from swardmap.synth.people.outfit import clothes, cut_of, skin_left
from swardmap.synth.people.poses import angles_of, reaches, turns_of
from swardmap.synth.people.skeleton import bones_of
from swardmap.synth.people.worn import Figure, meshes_of, put_down

GROUPS = ("boy", "girl", "man", "woman", "old man", "old woman")
SHARES = (0.17, 0.17, 0.23, 0.23, 0.1, 0.1)


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """Somebody in a pose.

    Attributes:
        model: x to the front, the lowest point at z = 0.
        pose: as asked for.
        seat_m: height of the seat that must be beneath somebody who sits; 0 = none.
        height_m: standing, without shoes and hat.
        group: boy, girl, man, woman, old man or old woman.
    """

    model: Model
    pose: str
    seat_m: float
    height_m: float
    group: str


def figure_of(
    rng: np.random.Generator,
    assets: Assets,
    group: str | None = None,
    hatted: str | None = None,
    lies: bool = False,
) -> Figure:
    """Somebody dressed, at rest.

    Args:
        rng: everything by chance comes from it.
        assets: have the arrays `people`.
        group: of GROUPS; None = by chance.
        hatted: cap, straw, beanie, helmet; "" = none; None = by chance.
        lies: no hat, and no long hair, on which a head would not lie.
    """
    body = body_of(assets, group or str(rng.choice(GROUPS, p=SHARES)), rng)
    tone = picked(rng, SKIN)
    old = body.group.startswith("old")
    hair = picked(rng, GREY if old and rng.random() < 0.85 else (HAIR if sum(tone) > 420 else HAIR[:3]))
    cut = cut_of(rng, body)
    bearded = body.group in ("man", "old man") and rng.random() < 0.35
    worn = skin_of(body, skin_left(body, cut), tone, face(rng, body, tone, hair, bearded))
    worn += clothes(rng, body, cut)
    if hatted is None and lies:
        hatted = ""  # a hat would lift the head
    elif hatted is None:
        hatted = str(rng.choice(["", "cap", "straw", "beanie"], p=(0.7, 0.13, 0.13, 0.04)))
    material = hair_material(rng, hair)
    high = float(rng.uniform(0.0, 0.012)) + (
        float(rng.choice([0.0, 0.03])) if body.group == "old man" else 0.0
    )
    thick = 0.004 if hatted else float(rng.uniform(0.008, 0.024))
    worn.append(cap_of_hair(rng, body, material, thick, high, -0.01 if body.is_female else 0.01))
    if not lies and (body.is_female or (body.is_child and rng.random() < 0.1)):
        style = str(rng.choice(["long", "bob", "bun", "tail", "short"], p=(0.28, 0.2, 0.14, 0.23, 0.15)))
        if style in ("bun", "tail"):
            worn.append(tail(body, material, bun=style == "bun"))
        elif style in ("long", "bob"):
            worn.append(long_hair(body, material, 0.16 if style == "bob" else float(rng.uniform(0.2, 0.34))))
    if hatted:
        worn.append(hat(rng, body, hatted))
    return Figure(body, tuple(worn))


def person(rng: np.random.Generator, assets: Assets, pose: str, group: str | None = None) -> Person:
    """Somebody of any age and build, dressed, in a pose.

    Args:
        rng: everything by chance comes from it; the same state gives the same person.
        assets: have the arrays `people`.
        pose: of POSES.
        group: of GROUPS; None = by chance.

    Raises:
        InvalidValueError: there is no such pose or group.
    """
    figure = figure_of(rng, assets, group, lies=pose.startswith("lying"))
    angles = angles_of(pose, rng)
    turns, level = turns_of(angles)
    bones = bones_of(figure.body, turns, reaches(angles, figure.body.height_m), level)
    meshes, points = meshes_of(figure, bones)
    seat = _seat_m(figure.body, points) if pose == "sitting" else 0.0
    model = Model(f"person-{pose}-{int(rng.integers(2**62)):x}", put_down(meshes, points))
    return Person(model, pose, seat, figure.body.height_m, figure.body.group)


def _seat_m(body: Body, points: Float64Array) -> float:
    """Height of what somebody sits on: the lowest point near the pelvis above the lowest of all."""
    near = (np.abs(points[:, 0]) < 0.1 * body.height_m) & (np.abs(points[:, 1]) < 0.1 * body.height_m)
    near &= points[:, 2] > -0.15 * body.height_m
    return float(points[near, 2].min() - points[:, 2].min())
