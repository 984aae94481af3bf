"""Who is in the garden: people who stand, sit and lie, and those who walk."""

from dataclasses import dataclass

import numpy as np

from swardmap.labels import OTHER, PERSON, LabelClass
from swardmap.synth.model import Actor, Float64Array, Ground, Material, Model, Thing
from swardmap.synth.scene.areas import curve
from swardmap.synth.scene.look import linear_of_hsv
from swardmap.synth.scene.place import Footprint, Occupancy, footprint_of, tilted, upright
from swardmap.synth.scene.sites import Sites, jittered
from swardmap.synth.scene.smalls import animal
from swardmap.synth.shapes import cylinder, ellipsoid, model_of, moved, placed, sphere, tube

HIDERS = ("shrub", "tree", "hedge", "fence", "raised bed", "bin")


@dataclass(frozen=True, slots=True, eq=False)
class Stroller:
    """Somebody or something stiff that goes along a closed way.

    Attributes:
        model: its shape.
        kind: as in Thing.
        label: class.
        way_m: k x 2, closed: the last point is the first again.
        speed_mps: along the way.
        ground: to walk on.
    """

    model: Model
    kind: str
    label: LabelClass
    way_m: Float64Array
    speed_mps: float
    ground: Ground

    def at(self, stamp_ns: int) -> Thing:
        """The thing at a time."""
        steps = np.linalg.norm(np.diff(self.way_m, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        s = (self.speed_mps * stamp_ns * 1e-9) % along[-1]
        k = min(int(np.searchsorted(along, s, side="right")) - 1, len(steps) - 1)
        x, y = self.way_m[k] + (self.way_m[k + 1] - self.way_m[k]) * (s - along[k]) / steps[k]
        yaw = float(np.arctan2(*(self.way_m[k + 1] - self.way_m[k])[::-1]))
        T = upright(self.ground, self.model, (float(x), float(y)), yaw)
        return Thing(self.model, self.kind, T, self.label, "walking")


def people(
    things: list[Thing], sites: Sites, ground: Ground, taken: Occupancy, rng: np.random.Generator
) -> list[Thing]:
    """0-5 people who keep their place: on the lawn, lying, and half behind things."""
    found = []
    for _ in range(int(rng.choice([0, 1, 2, 3, 4, 5], p=(0.05, 0.17, 0.26, 0.26, 0.16, 0.1)))):
        pose = str(rng.choice(["standing", "crouching", "lying"], p=(0.6, 0.2, 0.2)))
        hidden = rng.random() < 0.25 and pose != "lying"
        model = figure(rng, pose)
        where = sites.of("middle" if rng.random() < 0.6 else "lawn", 0.4)
        behind = [t for t in things if t.kind in HIDERS] if hidden else []
        for _ in range(12 if len(where) else 0):
            xy, yaw = jittered(sites.xy[where[rng.integers(len(where))]], rng), float(rng.uniform(0, 6.28))
            if behind:
                spot, angle = behind[int(rng.integers(len(behind)))].T_map_model[:2, 3], rng.uniform(0, 6.28)
                reach = rng.uniform(0.5, 1.1)
                xy = (float(spot[0] + reach * np.cos(angle)), float(spot[1] + reach * np.sin(angle)))
            foot = footprint_of(model, xy, yaw)
            if taken.gap_m(foot) > 0.05 and _inside(sites, xy):
                stand = tilted if pose == "lying" else upright
                found.append(Thing(model, "person", stand(ground, model, xy, yaw), PERSON, pose))
                taken.take(foot)
                break
    return found


def walkers(sites: Sites, ground: Ground, taken: Occupancy, rng: np.random.Generator) -> list[Actor]:
    """0-2 people and at times an animal that go round on the lawn, clear of things."""
    actors: list[Actor] = []
    for _ in range(int(rng.integers(0, 3))):
        way = round_way(sites, taken, rng, 0.45)
        if way is not None:
            actors.append(
                Stroller(figure(rng, "standing"), "person", PERSON, way, float(rng.uniform(0.4, 1.4)), ground)
            )
    if rng.random() < 0.3:
        way = round_way(sites, taken, rng, 0.45)
        if way is not None:
            actors.append(Stroller(animal(rng), "animal", OTHER, way, float(rng.uniform(0.3, 1.5)), ground))
    return actors


def round_way(sites: Sites, taken: Occupancy, rng: np.random.Generator, room_m: float) -> Float64Array | None:
    """A closed smooth way on the lawn with room on both sides, or None where there is none."""
    where = sites.of("lawn", room_m)
    for _ in range(30 if len(where) else 0):
        center = np.asarray(jittered(sites.xy[where[rng.integers(len(where))]], rng))
        radius, n = rng.uniform(0.9, 4.0), 7
        angle = np.linspace(0, 2 * np.pi, n, endpoint=False) * rng.choice([-1, 1]) + rng.uniform(0, 6.28)
        knots = center + (radius * rng.uniform(0.6, 1.2, n))[:, None] * np.stack(
            (np.cos(angle), np.sin(angle)), 1
        )
        way = curve(np.concatenate([knots[-2:], knots, knots[:2]]), 6)[6:-6]
        way = np.concatenate([way[: 6 * n], way[:1]])
        if all(
            taken.gap_m(Footprint((float(x), float(y)), (room_m, room_m))) > 0 for x, y in way[::2]
        ) and all(_inside(sites, (float(x), float(y)), room_m) for x, y in way[::2]):
            return way
    return None


def figure(rng: np.random.Generator, pose: str) -> Model:
    """A plain figure of simple solids, 1.0-1.9 m tall: where no better people are at hand."""
    h = float(rng.choice([1.0, 1.3, 1.6, 1.75, 1.88]) * rng.uniform(0.96, 1.04))
    skin = Material(((0.55, 0.33, 0.22), (0.3, 0.16, 0.09), (0.12, 0.06, 0.04))[int(rng.integers(3))])
    shirt, trousers = (
        Material(linear_of_hsv(rng.uniform(0, 360), rng.uniform(0, 0.7), rng.uniform(0.2, 0.8)))
        for _ in range(2)
    )
    legs = [tube([(0, y * h, 0), (0, y * h, 0.48 * h)], 0.045 * h, 8, trousers) for y in (-0.055, 0.055)]
    body = moved(ellipsoid((0.08 * h, 0.12 * h, 0.2 * h), 8, 14, shirt), placed(0, 0, 0.44 * h))
    arms = [
        tube([(0, y * h, 0.78 * h), (0.03 * h, 1.1 * y * h, 0.45 * h)], 0.028 * h, 7, skin)
        for y in (-0.13, 0.13)
    ]
    head = moved(sphere(0.065 * h, 8, 12, skin), placed(0, 0, 0.86 * h))
    neck = moved(cylinder(0.03 * h, 0.08 * h, 8, None, skin), placed(0, 0, 0.8 * h))
    parts = [*legs, body, *arms, head, neck]
    if pose == "crouching":
        parts = [moved(part, placed(0, 0, 0, 0, (1.3, 1.2, 0.62))) for part in parts]
    if pose == "lying":
        down = np.array([[0, 0, 1.0, -h / 2], [0, 1, 0, 0], [-1, 0, 0, 0.085 * h], [0, 0, 0, 1]])
        parts = [moved(part, down) for part in parts]
        low = min(float(part.xyz[:, 2].min()) for part in parts)
        parts = [moved(part, placed(0, 0, -low)) for part in parts]
    return model_of("figure", parts)


def _inside(sites: Sites, xy: tuple[float, float], room_m: float = 0.3) -> bool:
    """Whether the nearest site lies on the lawn, within the lot."""
    k = int(np.argmin(np.square(sites.xy - xy).sum(axis=1)))
    close = float(np.hypot(*(sites.xy[k] - xy))) < 0.2
    return bool(close and sites.edge_m[k] > room_m and sites.lawn_m[k] > room_m)
