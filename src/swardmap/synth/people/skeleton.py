"""From joint angles to bones in space, and the skin that follows them.

Limbs are told from a neutral body: arms and legs hang straight down, feet point forward. Each bone has
a turn in that neutral frame, relative to its parent; what the baked rest pose looks like does not matter.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from swardmap.synth.model import Float64Array
from swardmap.synth.people.body import Body

DOWN = np.array([0.0, 0.0, -1.0])
# bone: the next joint along the limb, which gives its direction at rest
NEXT = {f"{a}.{s}": f"{b}.{s}" for s in "LR" for a, b in (
    ("upperarm", "forearm"), ("forearm", "hand"), ("hand", "fingers"), ("fingers", "tips"),
    ("thigh", "calf"), ("calf", "foot"))}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Bones:
    """Where each bone is: x = rotation @ (rest - joint) + position.

    Attributes:
        rotation: bones x 3 x 3.
        position: bones x 3, metres: of its joint.
    """

    rotation: Float64Array
    position: Float64Array


def turn(axis: str, degrees: float) -> Float64Array:
    """3 x 3: right-handed turn about x (to the right side), y (forward) or z (to the left)."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    R = np.eye(3)
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def between(a: Float64Array, b: Float64Array) -> Float64Array:
    """3 x 3: the smallest turn that takes direction a to direction b (Rodrigues); they are not opposite."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    v = np.cross(a, b)
    K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    out: Float64Array = np.eye(3) + K + K @ K / (1 + a @ b)
    return out


def neutral(body: Body) -> dict[str, Float64Array]:
    """For each bone of a limb the turn from rest to hanging straight down."""
    at = dict(zip(body.bones, body.joints, strict=True))
    turns = {name: between(at[after] - at[name], DOWN) for name, after in NEXT.items()}
    for side in "LR":
        turns[f"tips.{side}"] = turns[f"fingers.{side}"]
        turns[f"thumb.{side}"] = turns[f"hand.{side}"]
    return turns


def bones_of(
    body: Body,
    turns: Mapping[str, Float64Array],
    goals: Mapping[str, tuple[Float64Array, Float64Array]] | None = None,
    level: Mapping[str, Float64Array] | None = None,
) -> Bones:
    """Put the bones in place.

    Args:
        body: gives lengths.
        turns: bone -> 3 x 3 relative to its parent, in the neutral frame; absent = straight.
        goals: upperarm or thigh -> where its wrist or ankle goes, and the way its elbow or knee points;
            both from the joint of the pelvis in the axes of the model. Two bones reach it (law of
            cosines), or stretch towards it.
        level: bone -> 3 x 3 in the axes of the model, whatever its parent does: feet flat on the ground.

    Returns:
        With the pelvis' joint at the origin.
    """
    rest = neutral(body)
    index = {name: k for k, name in enumerate(body.bones)}
    frame = np.zeros((len(index), 3, 3))
    place = np.zeros((len(index), 3))
    rotation = np.zeros_like(frame)
    solved: dict[str, Float64Array] = {}
    for k, name in enumerate(body.bones):
        parent = body.parents[k]
        up = frame[parent] if parent >= 0 else np.eye(3)
        if parent >= 0:
            place[k] = place[parent] + rotation[parent] @ (body.joints[k] - body.joints[parent])
        frame[k] = up @ turns[name] if name in turns else up
        if goals and name in goals:
            chain = [index[name], index[NEXT[name]], index[NEXT[NEXT[name]]]]
            first, second = _reached(place[k], body.joints[chain], *goals[name], "arm" in name)
            frame[k], solved[NEXT[name]] = first, second
        if name in solved:
            frame[k] = solved[name]
        if level and name in level:
            frame[k] = level[name]
        rotation[k] = frame[k] @ rest.get(name, np.eye(3))
    return Bones(rotation, place)


def _reached(
    start: Float64Array, joints: Float64Array, goal: Float64Array, pole: Float64Array, arm: bool
) -> tuple[Float64Array, Float64Array]:
    """Frames of the two bones of a limb that starts at `start` and ends at `goal`."""
    a, b = (float(length) for length in np.linalg.norm(np.diff(joints, axis=0), axis=1))
    reach = goal - start
    d = float(np.clip(np.linalg.norm(reach), abs(a - b) + 1e-3, (a + b) * 0.9995))
    along = reach / np.linalg.norm(reach)
    side = pole - (pole @ along) * along
    side /= np.linalg.norm(side)
    c = (a * a + d * d - b * b) / (2 * a * d)
    knee = along * c * a + side * np.sqrt(max(0.0, 1 - c * c)) * a
    first, second = knee / a, (along * d - knee) / b
    hinge = np.cross(along, side) * (1 if arm else -1)
    return _frame(first, hinge), _frame(second, hinge)


def _frame(down: Float64Array, hinge: Float64Array) -> Float64Array:
    """3 x 3 that takes -z to `down` and y to the axis of the joint."""
    z = -down / np.linalg.norm(down)
    y = hinge - (hinge @ z) * z
    y /= np.linalg.norm(y)
    return np.stack((np.cross(y, z), y, z), axis=1)


def skinned(xyz: Float64Array, weights: Float64Array, body: Body, bones: Bones) -> Float64Array:
    """Linear blend skinning, n x 3: each point moves with the weighted mean of its bones."""
    shift = bones.position - np.einsum("bij,bj->bi", bones.rotation, body.joints)
    matrix = np.concatenate([bones.rotation, shift[:, :, None]], axis=2).reshape(len(shift), 12)
    blended = (weights @ matrix).reshape(-1, 3, 4)
    out: Float64Array = np.einsum("nij,nj->ni", blended[:, :, :3], xyz) + blended[:, :, 3]
    return out
