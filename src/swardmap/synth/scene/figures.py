"""People by chance: of bodies with clothes, ready-made, or plain figures where there are no assets."""

from dataclasses import dataclass

import numpy as np

from swardmap.labels import PERSON
from swardmap.synth.assets import Assets
from swardmap.synth.model import Material, Model, Thing
from swardmap.synth.people.figure import person
from swardmap.synth.people.path import Path, beside_bicycle
from swardmap.synth.people.poses import POSES
from swardmap.synth.scene.furniture import BENCH_SEAT_M, CHAIR_SEAT_M, bench, chair
from swardmap.synth.scene.lawn_look import linear_of_hsv
from swardmap.synth.scene.materials import wood
from swardmap.synth.scene.place import upright
from swardmap.synth.shapes import box, cylinder, ellipsoid, model_of, moved, placed, sphere, tube
from swardmap.synth.terrain import Terrain

BODY_SHARE = 0.7  # of people are bodies with clothes, the rest ready-made
ASTRIDE_SHARE = 0.07  # of those with a body stand over a bicycle
STANDING_SHARE = 0.4  # the other poses share the rest
GREEN_SHARE = 0.15  # of plain figures are dressed in the lawn's colour


@dataclass(frozen=True, slots=True, eq=False)
class Stroller:
    """A stiff figure that glides along a path.

    Attributes:
        model: its shape.
        path: where to.
        ground: to go on.
        speed_mps: along the path.
    """

    model: Model
    path: Path
    ground: Terrain
    speed_mps: float

    def at(self, stamp_ns: int) -> Thing:
        """The figure at a time."""
        distance = self.speed_mps * stamp_ns * 1e-9
        x, y = self.path.at(distance)
        T = upright(self.ground, self.model, (float(x), float(y)), self.path.heading_rad(distance))
        return Thing(self.model, "person", T, PERSON, "walking")


@dataclass(frozen=True, slots=True, eq=False)
class Somebody:
    """A person with what belongs to the pose.

    Attributes:
        model: of the person.
        pose: of the person.
        beside: in the same frame: the seat beneath, or the bicycle; None = nothing.
        beside_kind: of that thing.
    """

    model: Model
    pose: str
    beside: Model | None = None
    beside_kind: str = "seat"

    @property
    def whole(self) -> Model:
        """Both as one."""
        more = () if self.beside is None else self.beside.meshes
        return Model(self.model.name, (*self.model.meshes, *more))


def somebody(rng: np.random.Generator, assets: Assets | None) -> Somebody:
    """Somebody by chance: a body with clothes, ready-made, or a plain figure where there are no assets."""
    body, pick, astride = rng.random() < BODY_SHARE, rng.random(), rng.random() < ASTRIDE_SHARE
    pose = "standing" if rng.random() < STANDING_SHARE else str(rng.choice(list(POSES)))
    ready = () if assets is None else assets.names("person")
    if assets is not None and "people" in assets.array_names() and (body or not ready):
        if astride:
            model, bicycle = beside_bicycle(rng, assets)
            return Somebody(model, "astride", bicycle, "bicycle")
        who = person(rng, assets, pose)
        return _seated(rng, who.model, pose, who.seat_m)
    if assets is not None and ready:
        entry = assets.entry(ready[int(pick * len(ready))])
        return _seated(rng, assets.model(entry.name), entry.pose, entry.seat_m)
    plain = {"crouching": "crouching", "kneeling": "crouching"}.get(pose, "standing")
    plain = "lying" if pose.startswith("lying") else plain
    return Somebody(figure(rng, plain), plain)


def _seated(rng: np.random.Generator, model: Model, pose: str, seat_m: float) -> Somebody:
    return Somebody(model, pose, seat_under(rng, model, seat_m) if seat_m > 0 else None)


def seat_under(rng: np.random.Generator, model: Model, seat_m: float) -> Model:
    """A chair, a bench or a block of wood beneath somebody who sits, in that model's frame."""
    xyz = np.concatenate([mesh.xyz for mesh in model.meshes]).astype(np.float64)
    around = xyz[(xyz[:, 2] > seat_m - 0.02) & (xyz[:, 2] < seat_m + 0.12)]
    back = float(around[:, 0].min()) if len(around) else 0.0
    middle = float(np.median(around[:, 1])) if len(around) else 0.0
    pick = rng.random()
    if pick < 0.35:
        block = box((0.36, 0.42, seat_m + 0.03), wood(rng))
        return Model("seat", (moved(block, placed(back + 0.2, middle, -0.04)),))
    made, high, ahead = (chair(rng), CHAIR_SEAT_M, 0.19) if pick < 0.75 else (bench(rng), BENCH_SEAT_M, 0.17)
    T = placed(back + ahead, middle, 0, 0, (1, 1, (seat_m - 0.005) / high))
    return Model("seat", tuple(moved(mesh, T) for mesh in made.meshes))


def figure(rng: np.random.Generator, pose: str) -> Model:
    """A plain figure of simple solids, 1.0-1.9 m tall."""
    h = float(rng.choice([1.0, 1.3, 1.6, 1.75, 1.88]) * rng.uniform(0.96, 1.04))
    skin = Material(((0.55, 0.33, 0.22), (0.3, 0.16, 0.09), (0.12, 0.06, 0.04))[int(rng.integers(3))])
    low, high = (
        ((75, 0.3, 0.3), (110, 0.6, 0.5)) if rng.random() < GREEN_SHARE else ((0, 0, 0.2), (360, 0.7, 0.8))
    )
    shirt, trousers = (
        Material(linear_of_hsv(*(float(c) for c in hsv))) for hsv in rng.uniform(low, high, (2, 3))
    )
    legs = [tube([(0, y * h, 0), (0, y * h, 0.48 * h)], 0.045 * h, 8, trousers) for y in (-0.055, 0.055)]
    body = moved(ellipsoid((0.08 * h, 0.12 * h, 0.2 * h), 8, 14, shirt), placed(0, 0, 0.44 * h))
    reach = [[(0, y * h, 0.78 * h), (0.03 * h, 1.1 * y * h, 0.45 * h)] for y in (-0.13, 0.13)]
    arms = [tube(line, 0.028 * h, 7, skin) for line in reach]
    head = moved(sphere(0.065 * h, 8, 12, skin), placed(0, 0, 0.86 * h))
    neck = moved(cylinder(0.03 * h, 0.08 * h, 8, None, skin), placed(0, 0, 0.8 * h))
    parts = [*legs, body, *arms, head, neck]
    if pose == "crouching":
        parts = [moved(part, placed(0, 0, 0, 0, (1.3, 1.2, 0.62))) for part in parts]
    if pose == "lying":
        down = np.array([[0, 0, 1.0, -h / 2], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
        parts = [moved(part, down) for part in parts]
        lowest = min(float(part.xyz[:, 2].min()) for part in parts)
        parts = [moved(part, placed(0, 0, -lowest)) for part in parts]
    return model_of("figure", parts)
