"""Somebody on a bicycle that fits: the rider by the turn of the cranks, and the bicycle.

Both have the bicycle's frame: x forward, the ground at z = 0, the middle between the wheels at x = 0. Lengths
are those of a city bicycle for legs of 0.85 m, and grow with the legs.
"""

from dataclasses import dataclass

import numpy as np

from swardmap.synth.model import Float64Array, Material, Mesh, Model
from swardmap.synth.people.cloth import linear, picked
from swardmap.synth.people.gait import leg_m
from swardmap.synth.people.poses import Angles, turns_of
from swardmap.synth.people.skeleton import bones_of, turn
from swardmap.synth.people.worn import Figure, meshes_of
from swardmap.synth.shapes import ellipsoid, joined, model_of, moved, placed, tube

LEG_M = 0.85  # hip to ankle, of whom the lengths below fit
WHEEL_M, BASE_M, CRANK_M, PEDAL_M = (
    0.33,
    1.04,
    0.165,
    0.105,
)  # radius, wheelbase, crank, pedal from the middle
BRACKET_M = (-0.08, 0.29)  # x and z of the crank's axle
SEAT_TUBE_DEG, STRETCH = 72.0, 0.965  # slope; share of the leg's length when a pedal is lowest
GRIP_M = (0.30, 0.25, 1.03)  # x, half the width, z
HIP_ABOVE_SADDLE_M = 0.1
WAY_M = 3.2  # of one turn of the cranks
PAINTS = ((40, 60, 110), (150, 36, 36), (30, 34, 36), (190, 190, 186), (46, 92, 70), (196, 120, 40))


@dataclass(frozen=True, slots=True)
class Fit:
    """A bicycle's size for somebody.

    Attributes:
        scale: of all lengths.
        saddle_m: x and z of the saddle's top.
    """

    scale: float
    saddle_m: tuple[float, float]

    @property
    def wheelbase_m(self) -> float:
        """Between the axles."""
        return BASE_M * self.scale

    @property
    def stride_m(self) -> float:
        """Way of one turn of the cranks."""
        return WAY_M * self.scale


def fit_of(figure: Figure) -> Fit:
    """The bicycle for somebody: the leg is all but stretched when its pedal is lowest."""
    scale = leg_m(figure) / LEG_M
    reach = STRETCH * leg_m(figure)
    back, up = np.cos(np.radians(SEAT_TUBE_DEG)), np.sin(np.radians(SEAT_TUBE_DEG))
    axle = np.array(BRACKET_M) * scale
    ankle = _ankle(figure, axle - [0, CRANK_M * scale])
    for along in np.linspace(0.3, 1.1, 161) * scale:  # up the seat tube until the hip is far enough
        hip = axle + along * np.array([-back, up])
        if np.linalg.norm(hip - ankle) >= reach:
            break
    return Fit(scale, (float(hip[0]), float(hip[1]) - HIP_ABOVE_SADDLE_M * scale))


def rider(figure: Figure, fit: Fit, phase: float) -> tuple[Mesh, ...]:
    """Meshes of somebody who pedals, at a phase of the cranks; at 0 the left pedal is foremost."""
    at = dict(zip(figure.body.bones, figure.body.joints, strict=True))
    hip = np.array([fit.saddle_m[0], 0.0, fit.saddle_m[1] + HIP_ABOVE_SADDLE_M * fit.scale])
    pelvis = hip - [0.0, 0.0, at["thigh.L"][2] - at["pelvis"][2]]
    angles = Angles(root=(14, 0, 0), trunk=(16, 0, 0), head=(-16, 0, 0), curl=78, vary=0)
    turns, _ = turns_of(angles)
    goals: dict[str, tuple[Float64Array, Float64Array]] = {}
    level: dict[str, Float64Array] = {}
    for side, sign, shift in (("L", 1.0, 0.0), ("R", -1.0, 0.5)):
        x, z = _ankle(figure, _pedal(fit, phase + shift))
        ankle = np.array([x, sign * PEDAL_M * fit.scale, z])
        goals[f"thigh.{side}"] = (ankle - pelvis, np.array([1.0, 0.08 * sign, 0.25]))
        goals[f"upperarm.{side}"] = (_wrist(fit, sign) - pelvis, np.array([-0.3, 0.5 * sign, -1.0]))
        level[f"foot.{side}"] = level[f"toes.{side}"] = turn("z", 4 * sign) @ turn("y", 6.0)
    meshes, _ = meshes_of(figure, bones_of(figure.body, turns, goals, level))
    return _shifted(meshes, pelvis)


def astride(figure: Figure, fit: Fit) -> tuple[Mesh, ...]:
    """Meshes of somebody who stands over the bicycle with both feet on the ground, hands at the grips."""
    angles = Angles(
        root=(10, 0, 0), trunk=(22, 0, 0), head=(-6, 0, 12), leg_l=(12, 8, 10, 6, 0), leg_r=(12, 8, 10, 6, 0),
        curl=78, vary=0,
    )  # fmt: skip
    turns, level = turns_of(angles)
    _, points = meshes_of(figure, bones_of(figure.body, turns, level=level))
    pelvis = np.array([-0.08 * fit.scale, 0.0, -points[:, 2].min()])
    goals = {}
    for side, sign in (("L", 1.0), ("R", -1.0)):
        goals[f"upperarm.{side}"] = (_wrist(fit, sign) - pelvis, np.array([-0.3, 0.5 * sign, -1.0]))
    meshes, _ = meshes_of(figure, bones_of(figure.body, turns, goals, level))
    return _shifted(meshes, pelvis)


def bicycles(rng: np.random.Generator, fit: Fit, phases: int) -> tuple[Model, ...]:
    """A bicycle by phase of its cranks: a low frame in some colour, black tyres."""
    paint = Material(linear(picked(rng, PAINTS)), specular=0.35, roughness=0.35)
    steel = Material((0.4, 0.41, 0.42), specular=0.5, roughness=0.35)
    rubber = Material((0.02, 0.02, 0.021))
    name = f"bicycle-{int(rng.integers(2**62)):x}"
    still = [*_wheels(rubber, steel), *_frame(fit, paint, steel, rubber)]
    big = placed(0, 0, 0, 0, fit.scale)
    return tuple(
        model_of(f"{name}-{k}", [moved(mesh, big) for mesh in (*still, *_cranks(k / phases, steel, rubber))])
        for k in range(phases)
    )


def _shifted(meshes: list[Mesh], by_m: Float64Array) -> tuple[Mesh, ...]:
    by = by_m.astype(np.float32)
    return tuple(Mesh(m.xyz + by, m.normals, m.uv, m.faces, m.material) for m in meshes)


def _wrist(fit: Fit, sign: float) -> Float64Array:
    """(3,): of a hand that holds its grip."""
    return np.array([GRIP_M[0] - 0.06, sign * (GRIP_M[1] - 0.015), GRIP_M[2] + 0.035]) * fit.scale


def _pedal(fit: Fit, phase: float) -> Float64Array:
    """(2,): x and z of a pedal's axle."""
    angle = 2 * np.pi * phase
    return (np.array(BRACKET_M) + CRANK_M * np.array([np.cos(angle), -np.sin(angle)])) * fit.scale


def _ankle(figure: Figure, pedal: Float64Array) -> Float64Array:
    """(2,): x and z of the ankle whose ball of the foot is on the pedal."""
    at = dict(zip(figure.body.bones, figure.body.joints, strict=True))
    ball = float(np.linalg.norm((at["toes.L"] - at["foot.L"])[:2]))
    above = float(at["foot.L"][2]) - min(float(worn.shell.xyz[:, 2].min()) for worn in figure.worn)
    place: Float64Array = pedal + np.array([-0.85 * ball, above + 0.012])
    return place


def _wheels(rubber: Material, steel: Material) -> list[Mesh]:
    """Two wheels of radius WHEEL_M."""
    angle, spoke = np.linspace(0, 2 * np.pi, 33), np.linspace(0, 2 * np.pi, 15)[:-1]
    parts = []
    for x in (-BASE_M / 2, BASE_M / 2):
        for radius, thick, material in ((WHEEL_M - 0.019, 0.019, rubber), (WHEEL_M - 0.04, 0.009, steel)):
            ring = np.stack((x + radius * np.cos(angle), 0 * angle, WHEEL_M + radius * np.sin(angle)), axis=1)
            parts.append(tube(ring, thick, 7, material))
        rim = WHEEL_M - 0.045
        for a, side in zip(spoke, np.tile((-0.03, 0.03), 7), strict=True):
            end = (x + rim * np.cos(a), 0.0, WHEEL_M + rim * np.sin(a))
            parts.append(tube([(x, side, WHEEL_M), end], 0.0016, 3, steel))
        parts.append(tube([(x, -0.05, WHEEL_M), (x, 0.05, WHEEL_M)], 0.018, 8, steel))
    return parts


def _frame(fit: Fit, paint: Material, steel: Material, rubber: Material) -> list[Mesh]:
    """Tubes, fork, handlebar, grips and saddle, for a scale of 1."""
    x, z = (value / fit.scale for value in fit.saddle_m)
    axle, head, crown = (BRACKET_M[0], 0.0, BRACKET_M[1]), (0.33, 0.0, 0.86), (0.37, 0.0, 0.7)
    middle = ((axle[0] + x) / 2, 0.0, (axle[2] + z) / 2)
    rear, front, stem = (-BASE_M / 2, WHEEL_M), (BASE_M / 2, WHEEL_M), (0.27, 0.0, GRIP_M[2])
    lines = [(axle, middle, 0.017), (axle, crown, 0.019), (middle, crown, 0.016), (head, crown, 0.02)]
    parts = [tube([a, b], r, 8, paint) for a, b, r in lines]
    for y in (-0.055, 0.055):
        parts += [
            tube([(axle[0], 0.5 * y, axle[2]), (rear[0], y, rear[1])], 0.01, 6, paint),
            tube([(middle[0], 0.3 * y, middle[2]), (rear[0], y, rear[1])], 0.009, 6, paint),
            tube([(crown[0], 0.8 * y, crown[2]), (front[0], y, front[1])], 0.012, 6, paint),
            tube([(stem[0], 0, stem[2]), (GRIP_M[0] + 0.05, 3 * y, stem[2]),
                  (GRIP_M[0] - 0.12, np.sign(y) * GRIP_M[1], GRIP_M[2])], 0.012, 7, steel),
            tube([(GRIP_M[0] - 0.01, np.sign(y) * 0.235, GRIP_M[2]),
                  (GRIP_M[0] - 0.14, np.sign(y) * GRIP_M[1], GRIP_M[2])], 0.017, 7, rubber),
        ]  # fmt: skip
    parts += [tube([middle, (x, 0, z - 0.05)], 0.013, 7, steel), tube([head, stem], 0.014, 7, steel)]
    parts.append(moved(ellipsoid((0.14, 0.075, 0.04), 8, 14, rubber), placed(x + 0.02, 0, z - 0.075)))
    return parts


def _cranks(phase: float, steel: Material, rubber: Material) -> list[Mesh]:
    """Cranks, pedals and the chain wheel."""
    parts = [tube([(BRACKET_M[0], -0.07, BRACKET_M[1]), (BRACKET_M[0], 0.07, BRACKET_M[1])], 0.02, 8, steel)]
    angle = np.linspace(0, 2 * np.pi, 25)
    wheel = np.stack((BRACKET_M[0] + 0.085 * np.cos(angle), np.full(25, -0.05),
                      BRACKET_M[1] + 0.085 * np.sin(angle)), axis=1)  # fmt: skip
    parts.append(tube(wheel, 0.008, 5, steel))
    for sign, shift in ((1.0, 0.0), (-1.0, 0.5)):
        x, z = _pedal(Fit(1.0, (0.0, 0.0)), phase + shift)
        parts.append(tube([(BRACKET_M[0], 0.06 * sign, BRACKET_M[1]), (x, 0.065 * sign, z)], 0.011, 6, steel))
        parts.append(tube([(x, 0.065 * sign, z), (x, 0.155 * sign, z)], 0.014, 6, rubber))
    return [joined(parts[:2]), *parts[2:]]
