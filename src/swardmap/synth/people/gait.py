"""Walking and running as a function of phase.

A foot on the ground stays where it is: its ankle goes back under the body as fast as the body goes forward;
legs reach their ankles by two-bone inverse kinematics. Phase 0 is the left heel's touch.
"""

from dataclasses import dataclass

import numpy as np

from swardmap.synth.model import Float64Array, Mesh
from swardmap.synth.people.poses import Angles, turns_of
from swardmap.synth.people.skeleton import Bones, bones_of, turn
from swardmap.synth.people.worn import Figure, meshes_of, put_down


@dataclass(frozen=True, slots=True)
class Gait:
    """How somebody goes.

    Attributes:
        stride_m: way of a whole cycle (two steps).
        stance: share of the cycle that a foot is on the ground.
        lift_m: of the ankle in the swing.
        swing_deg: of the arms.
        elbow_deg: bend of the elbows.
        lean_deg: of the trunk, forward.
    """

    stride_m: float
    stance: float
    lift_m: float
    swing_deg: float
    elbow_deg: float
    lean_deg: float


def leg_m(figure: Figure) -> float:
    """Hip to ankle, stretched."""
    at = dict(zip(figure.body.bones, figure.body.joints, strict=True))
    hip, knee, ankle = at["thigh.L"], at["calf.L"], at["foot.L"]
    return float(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))


def gait_of(figure: Figure, speed_mps: float, running: bool) -> Gait:
    """A gait at a speed: longer steps for longer legs and at higher speed."""
    leg = leg_m(figure)
    share = float(np.sqrt(speed_mps / (1.35 * np.sqrt(leg / 0.85))))
    if running:
        return Gait(1.35 * leg * share * 1.25, 0.38, 0.32 * leg, 38, 95, 9)
    return Gait(min(1.55 * leg * share, 1.7 * leg), 0.62, 0.1 * leg, 24 * share, 22, 3)


def ankle(figure: Figure, gait: Gait, phase: float) -> tuple[float, float, float]:
    """Of one foot: ankle ahead of the hip and above its height at rest (m), its pitch (deg, toes down)."""
    at = dict(zip(figure.body.bones, figure.body.joints, strict=True))
    ball = np.linalg.norm((at["toes.L"] - at["foot.L"])[:2])
    height = at["foot.L"][2]
    phase %= 1.0
    strike, push = -16.0, 42.0

    def pivoted(about_m: float, pitch: float) -> Float64Array:
        """Shift of the ankle when the foot turns about a point `about_m` ahead of it on the sole."""
        arm = np.array([-about_m, 0, height])
        shift: Float64Array = turn("y", pitch) @ arm - arm
        return shift

    def standing(p: float) -> tuple[Float64Array, float]:
        base = np.array([gait.stride_m * (gait.stance / 2 - p), 0, 0])
        if p < 0.1:
            pitch = strike * (1 - p / 0.1)
            return base + pivoted(-0.25 * float(ball), pitch), pitch
        late = np.clip((p - 0.62 * gait.stance) / (0.38 * gait.stance), 0, 1)
        pitch = push * float(late) ** 1.6
        return base + pivoted(float(ball), pitch), pitch

    if phase <= gait.stance:
        place, pitch = standing(phase)
        return float(place[0]), float(place[2]), pitch
    (start, _), (end, _) = standing(gait.stance), standing(0.0)
    t = (phase - gait.stance) / (1 - gait.stance)
    # leaves and lands with the speed of the ground, so that the path has no corner
    slope = -gait.stride_m * (1 - gait.stance)
    h = np.array([2 * t**3 - 3 * t**2 + 1, t**3 - 2 * t**2 + t, -2 * t**3 + 3 * t**2, t**3 - t**2])
    x = h @ [start[0], slope, end[0], slope]
    z = (1 - t) * start[2] + t * end[2] + gait.lift_m * np.sin(np.pi * t) * (1 - 0.4 * t)
    smooth = t * t * (3 - 2 * t)
    return float(x), float(z), push * (1 - smooth) + strike * smooth + 12 * float(np.sin(np.pi * t)) * (1 - t)


def stepping(figure: Figure, gait: Gait, phase: float) -> tuple[Bones, float]:
    """Bones at a phase, and the height of the pelvis' joint above the sole of a flat foot at rest."""
    at = dict(zip(figure.body.bones, figure.body.joints, strict=True))
    feet = {"L": ankle(figure, gait, phase), "R": ankle(figure, gait, phase + 0.5)}
    leg = leg_m(figure)
    hip = at["thigh.L"]
    room = [np.sqrt(max((0.993 * leg) ** 2 - x * x, 0.1)) + z + at["foot.L"][2] for x, z, _ in feet.values()]
    if gait.stance < 0.5:
        high = (
            0.93 * leg
            + at["foot.L"][2]
            + 0.03 * leg * float(np.cos(4 * np.pi * (phase - gait.stance - 0.06)))
        )
    else:
        high = min(0.985 * leg + at["foot.L"][2], *room)
    pelvis_z = high - (hip[2] - at["pelvis"][2])
    swing = gait.swing_deg * float(np.cos(2 * np.pi * phase))
    arm = (8.0, 12.0, gait.elbow_deg + 0.25 * abs(swing), 10.0)
    angles = Angles(
        root=(gait.lean_deg, 0, 0), trunk=(gait.lean_deg / 2, 0, swing * 0.25),
        head=(-gait.lean_deg, 0, -swing * 0.2),
        arm_l=(2 - swing, arm[0], arm[1], arm[2] - 0.4 * swing, arm[3]),
        arm_r=(2 + swing, arm[0], arm[1], arm[2] + 0.4 * swing, arm[3]),
        curl=40,
    )  # fmt: skip
    turns, _ = turns_of(angles)
    goals, level = {}, {}
    for side, (x, z, pitch) in feet.items():
        place = at[f"thigh.{side}"]
        goal = np.array([x, place[1] * 0.75, z + at["foot.L"][2] - pelvis_z])
        goals[f"thigh.{side}"] = (goal, np.array([1.0, 0.06 * np.sign(place[1]), 0]))
        level[f"foot.{side}"] = turn("z", 6 * np.sign(place[1])) @ turn("y", pitch)
        level[f"toes.{side}"] = turn("z", 6 * np.sign(place[1])) @ turn(
            "y", min(pitch, 4.0) if pitch > 0 else pitch
        )
    return bones_of(figure.body, turns, goals, level), float(pelvis_z)


def floor_m(figure: Figure) -> float:
    """Lowest point of the figure at rest: the sole."""
    return float(min(worn.shell.xyz[:, 2].min() for worn in figure.worn))


def step_meshes(figure: Figure, gait: Gait, phase: float) -> tuple[Mesh, ...]:
    """Meshes of somebody going to +x, the pelvis above the origin, the sole of a standing foot at z = 0."""
    bones, pelvis_z = stepping(figure, gait, phase)
    meshes, points = meshes_of(figure, bones)
    return put_down(meshes, points, (0.0, 0.0), pelvis_z - floor_m(figure))
