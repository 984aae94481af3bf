"""Poses as tables of joint angles, and their small variations.

All angles are degrees, from a body that stands straight with hanging arms. Arms: forward, out to the side,
turned inward, elbow, palm turned back. Legs: forward, out, turned outward, knee, foot pulled up.
"""

from dataclasses import dataclass

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.synth.model import Float64Array
from swardmap.synth.people.skeleton import turn

Five = tuple[float, float, float, float, float]
Three = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Angles:
    """A pose.

    Attributes:
        root: the pelvis: pitch forward, roll to the right, turn to the left (before the pitch).
        trunk: spine: bend forward, to the right, turn to the left.
        head: nod, tilt to the right, turn to the left.
        arm_l, arm_r: forward, out, inward, elbow, palm back.
        leg_l, leg_r: forward, out, outward, knee, foot up.
        curl: fingers, 0 straight, 90 a fist.
        vary: standard deviation of what chance adds to each angle.
        flat: feet are level, whatever the legs do.
        hands: where both wrists reach to, seen from the pelvis: ahead, to each side, up; in shares of the
            height of the body. Instead of arm_l and arm_r.
    """

    root: Three = (0, 0, 0)
    trunk: Three = (2, 0, 0)
    head: Three = (4, 0, 0)
    arm_l: Five = (6, 9, 10, 14, 10)
    arm_r: Five = (6, 9, 10, 14, 10)
    leg_l: Five = (1, 3, 7, 2, 0)
    leg_r: Five = (1, 3, 7, 2, 0)
    curl: float = 32
    vary: float = 3.0
    flat: bool = True
    hands: Three | None = None


POSES: dict[str, tuple[Angles, ...]] = {
    "standing": (
        Angles(),
        Angles(arm_l=(18, 22, 60, 95, 30), arm_r=(18, 22, 60, 95, 30), trunk=(-2, 0, 0)),  # arms in front
        Angles(arm_r=(-12, 38, 62, 92, 0), leg_l=(4, 5, 14, 8, 0), trunk=(0, 4, 0)),  # hand on the hip
        Angles(arm_l=(45, 12, 35, 115, 0), head=(22, 0, 5), curl=60),  # looks at a telephone
    ),
    "crouching": (
        Angles((22, 0, 0), (22, 0, 0), (-10, 0, 0), (62, 10, 20, 35, 20), (58, 10, 20, 45, 20),
               (112, 14, 14, 126, 0), (106, 14, 14, 128, 0)),
        Angles((10, 0, 0), (28, 0, 0), (5, 0, 0), (70, 4, 30, 30, 20), (66, 4, 30, 36, 20),
               (118, 6, 8, 132, 0), (84, 8, 8, 142, 0), flat=False),
    ),
    "kneeling": (
        Angles((8, 0, 0), (14, 0, 0), (10, 0, 0), (45, 8, 15, 40, 20), (40, 8, 15, 50, 20),
               (0, 6, 0, 92, -42), (6, 6, 0, 98, -42), flat=False),
        Angles((2, 0, 0), (16, 0, 0), (12, 0, 0), (42, 8, 15, 55, 20), (55, 8, 15, 40, 20),
               (88, 8, 8, 92, 4), (-2, 4, 0, 88, 20), flat=False),
        Angles((30, 0, 0), (20, 0, 0), (-5, 0, 0), (78, 10, 10, 20, 40), (70, 10, 10, 30, 40),
               (72, 8, 0, 142, -42), (72, 8, 0, 142, -42), flat=False),
    ),
    "bending": (
        Angles((42, 0, 0), (40, 0, 0), (-12, 0, 0), (80, 8, 10, 12, 20), (88, 8, 10, 18, 20),
               (52, 6, 8, 16, 0), (50, 6, 8, 14, 0)),
        Angles((34, 0, 0), (44, 6, 12), (-5, 0, 0), (70, 10, 10, 25, 20), (30, 20, 50, 90, 0),
               (70, 8, 8, 52, 0), (28, 8, 8, 20, 0)),
    ),
    "sitting_ground": (
        Angles((-14, 0, 0), (10, 0, 0), (8, 0, 0), (-38, 16, -10, 6, 70), (-36, 16, -10, 8, 70),
               (74, 8, 12, 8, -20), (70, 8, 12, 6, -20), flat=False, curl=10),
        Angles((-12, 0, 0), (30, 0, 0), (-4, 0, 0), (70, 10, 25, 50, 20), (68, 10, 25, 55, 20),
               (122, 12, 6, 108, 0), (112, 12, 6, 100, 0), flat=True),
        Angles((-10, 0, 0), (22, 0, 0), (6, 0, 0), (42, 12, 25, 60, 20), (42, 12, 25, 60, 20),
               (72, 38, 46, 118, -25), (72, 38, 46, 122, -25), flat=False),
    ),
    "sitting": (
        Angles((-4, 0, 0), (8, 0, 0), (6, 0, 0), (36, 8, 15, 55, 60), (36, 8, 15, 55, 60),
               (84, 8, 6, 84, 0), (84, 8, 6, 86, 0)),
        Angles((2, 0, 0), (26, 0, 0), (8, 0, 0), (48, 8, 30, 72, 20), (46, 8, 30, 78, 20),
               (82, 12, 10, 72, 0), (84, 12, 10, 92, 0)),
    ),
    "lying_back": (
        Angles((-90, 0, 0), (2, 0, 0), (12, 0, 8), (4, 24, 0, 10, 20), (4, 30, 0, 16, 20),
               (2, 8, 22, 4, -25), (3, 8, 20, 6, -25), flat=False),
        Angles((-90, 0, 0), (2, 0, 0), (14, 0, 0), (6, 36, 0, 18, 20), (28, 28, 60, 100, 20),
               (26, 8, 4, 52, -2), (2, 8, 18, 4, -25), flat=False),
    ),
    "lying_side": (
        Angles((-90, 0, 90), (10, 0, 0), (10, 0, 0), (82, 8, 0, 60, 0), (46, -6, 10, 50, 20),
               (50, 2, 0, 72, -15), (30, 0, 0, 48, -20), flat=False),
        Angles((-90, 0, -90), (16, 0, 0), (12, 0, 0), (40, -6, 10, 60, 20), (84, 8, 0, 70, 0),
               (26, 0, 0, 40, -20), (64, 2, 0, 84, -15), flat=False),
    ),
    "lying_front": (
        Angles((90, 0, 0), (-3, 0, 0), (-18, 0, 50), (40, 128, 0, 48, 0), (0, 22, 0, 12, 60),
               (-2, 10, 12, 8, -48), (-2, 12, 20, 14, -48), flat=False),
        Angles((90, 0, 0), (-9, 0, 0), (-16, 0, 0), (112, 22, 30, 84, 40), (112, 22, 30, 88, 40),
               (-4, 8, 6, 6, -50), (-4, 8, 6, 24, -45), flat=False),
    ),
    "waving": (
        Angles(arm_r=(20, 96, -95, 82, 0), head=(2, 0, -6), curl=8),
        Angles(arm_l=(30, 138, -60, 30, 0), head=(-2, 0, 6), leg_l=(8, 4, 8, 8, 0), curl=8),
    ),
    "pointing": (
        Angles(arm_r=(82, 10, 0, 6, 60), head=(6, 0, -8), curl=45),
        Angles(arm_l=(64, 42, 0, 8, 60), head=(4, 0, 22), leg_r=(-8, 4, 8, 4, 0), curl=45),
    ),
    "carrying": (
        Angles(trunk=(-3, 0, 0), curl=35, vary=1.5, hands=(0.2, 0.1, 0.1)),
        Angles(trunk=(-4, 0, 0), leg_l=(8, 3, 6, 10, 0), curl=35, vary=1.5, hands=(0.19, 0.11, 0.05)),
    ),
    "pushing": (
        Angles((9, 0, 0), (6, 0, 0), (0, 0, 0), leg_l=(20, 3, 5, 14, 0), leg_r=(-14, 3, 5, 12, 0), curl=75,
               vary=1.5, hands=(0.3, 0.13, 0.04)),
        Angles((14, 0, 0), (10, 0, 0), (-6, 0, 0), leg_l=(-18, 3, 5, 10, 0), leg_r=(28, 3, 5, 28, 0), curl=75,
               vary=1.5, hands=(0.34, 0.12, 0.03)),
    ),
}  # fmt: skip


def angles_of(pose: str, rng: np.random.Generator) -> Angles:
    """One variant of a pose, each angle a little off.

    Raises:
        InvalidValueError: there is no such pose.
    """
    if pose not in POSES:
        raise InvalidValueError(f"expected a pose of {', '.join(POSES)}; got '{pose}'")
    base = POSES[pose][int(rng.integers(len(POSES[pose])))]

    def off(values: tuple[float, ...]) -> tuple[float, ...]:
        noise = base.vary * np.clip(rng.standard_normal(len(values)), -2, 2)
        return tuple(float(v + n) for v, n in zip(values, noise, strict=True))

    lying = abs(base.root[0]) == 90
    root = base.root if lying else (base.root[0] + float(rng.normal(0, 1.5)), *base.root[1:])
    return Angles(
        root, off(base.trunk), off(base.head), off(base.arm_l), off(base.arm_r),  # type: ignore[arg-type]
        off(base.leg_l), off(base.leg_r), base.curl + float(rng.normal(0, 8)),  # type: ignore[arg-type]
        base.vary, base.flat, base.hands,
    )  # fmt: skip


def turns_of(angles: Angles) -> tuple[dict[str, Float64Array], dict[str, Float64Array]]:
    """Turns of the bones relative to their parents, and those of the level feet, for `bones_of`."""
    pitch, roll, twist = angles.root
    bend, side, yaw = angles.trunk
    third = turn("y", bend / 3) @ turn("x", side / 3) @ turn("z", yaw / 3)
    nod, tilt, look = angles.head
    half = turn("y", nod / 2) @ turn("x", tilt / 2) @ turn("z", look / 2)
    root = turn("y", pitch) @ turn("x", roll) @ turn("z", twist)
    turns = {"pelvis": root, "spine": third, "waist": third, "chest": third, "neck": half, "head": half}
    level = {}
    for s, sign, arm, leg in (("L", 1, angles.arm_l, angles.leg_l), ("R", -1, angles.arm_r, angles.leg_r)):
        forward, out, inward, elbow, palm = arm
        upper = turn("y", -forward) @ turn("x", sign * out) @ turn("z", -sign * inward)
        raised = np.degrees(np.arccos(np.clip(upper[2, 2], -1, 1)))
        lift = max(0.0, raised - 50) * 0.3
        turns[f"clavicle.{s}"] = turn("x", sign * lift)
        turns[f"upperarm.{s}"] = turn("x", -sign * lift) @ upper
        turns[f"forearm.{s}"] = turn("y", -elbow) @ turn("z", -sign * palm * 0.5)
        turns[f"hand.{s}"] = turn("z", -sign * palm * 0.5)
        turns |= curled(s, angles.curl)
        forward, out, outward, knee, foot = leg
        turns[f"thigh.{s}"] = turn("y", -forward) @ turn("x", sign * out) @ turn("z", sign * outward)
        turns[f"calf.{s}"] = turn("y", knee)
        turns[f"foot.{s}"] = turn("y", -foot)
        if angles.flat:
            level[f"foot.{s}"] = turn("z", sign * outward)
    return turns, level


def curled(side: str, degrees: float) -> dict[str, Float64Array]:
    """Turns of the fingers of a hand whose palm faces the thigh."""
    sign = 1 if side == "L" else -1
    return {
        f"fingers.{side}": turn("x", -sign * degrees * 0.8),
        f"tips.{side}": turn("x", -sign * degrees),
        f"thumb.{side}": turn("x", -sign * degrees * 0.4),
    }


def reaches(angles: Angles, height_m: float) -> dict[str, tuple[Float64Array, Float64Array]]:
    """Goals of the arms for `bones_of`: hands at a bar or a box, elbows down and out."""
    if angles.hands is None:
        return {}
    ahead, out, up = angles.hands
    return {
        f"upperarm.{s}": (np.array([ahead, sign * out, up]) * height_m, np.array([-0.3, sign * 0.5, -1.0]))
        for s, sign in (("L", 1.0), ("R", -1.0))
    }
