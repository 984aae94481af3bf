"""Who is in the garden: people who stand, sit and lie, and those who walk, ride and run."""

import numpy as np
from numpy.typing import NDArray

from swardmap.labels import PERSON
from swardmap.synth.assets import Assets
from swardmap.synth.model import Actor, Float64Array, Ground, Thing
from swardmap.synth.people.path import Mover, Path, walker
from swardmap.synth.scene.areas import curve
from swardmap.synth.scene.figures import Stroller, figure, seat_under, somebody
from swardmap.synth.scene.place import XY, Footprint, Occupancy, footprint_of, tilted, upright
from swardmap.synth.scene.sites import Sites, jittered
from swardmap.synth.scene.smalls import animal

HIDERS = ("shrub", "tree", "hedge", "fence", "raised bed", "bin", "wall", "trellis")
COUNT_SHARES = (0.05, 0.17, 0.26, 0.26, 0.16, 0.1)  # of gardens with 0-5 people who keep their place
HIDDEN_SHARE = 0.25
WALKER_SHARES = (0.3, 0.45, 0.25)
ROOM_M = 0.45  # on both sides of a way


def people(
    things: list[Thing], sites: Sites, ground: Ground, taken: Occupancy, assets: Assets | None,
    rng: np.random.Generator,
) -> list[Thing]:  # fmt: skip
    """0-5 people who keep their place: on the lawn, lying, sitting, and half behind things.

    Args:
        things: what stands already; somebody may hide behind it.
        sites: of the lot.
        ground: to stand on.
        taken: footprints; those of the people and their seats are added.
        assets: bodies and ready people, or None: plain figures.
        rng: source of chance.
    """
    found: list[Thing] = []
    for _ in range(int(rng.choice(6, p=COUNT_SHARES))):
        model, pose, seat_m = somebody(rng, assets)
        seat = seat_under(rng, model, seat_m) if seat_m > 0 else None
        flat = pose.startswith("lying")
        behind = [t for t in things if t.kind in HIDERS] if rng.random() < HIDDEN_SHARE and not flat else []
        where = sites.of("middle" if rng.random() < 0.6 else "lawn", 0.4)
        for _ in range(14):
            xy, yaw = _spot(rng, sites, where, behind), float(rng.uniform(0, 2 * np.pi))
            foot = footprint_of(model, xy, yaw)
            if taken.gap_m(foot) > 0.05 and on_lawn(sites, xy, 0.3):
                T = (tilted if flat else upright)(ground, model, xy, yaw)
                found.append(Thing(model, "person", T, PERSON, pose))
                found += [Thing(seat, "seat", T)] if seat is not None else []
                taken.take(foot)
                break
    return found


def moving(
    sites: Sites, ground: Ground, taken: Occupancy, assets: Assets | None, rng: np.random.Generator
) -> list[Actor]:
    """0-2 people and at times an animal that go round on the lawn, clear of things."""
    actors: list[Actor] = []
    for _ in range(int(rng.choice(3, p=WALKER_SHARES))):
        way = round_way(sites, taken, rng)
        if way is not None and assets is not None and "people" in assets.array_names():
            running = bool(rng.random() < 0.15)
            actors.append(walker(rng, assets, Path(way, closed=True), ground, running=running))
        elif way is not None:
            model, speed = figure(rng, "standing"), float(rng.uniform(0.4, 1.4))
            actors.append(Stroller(model, Path(way, closed=True), ground, speed))
    if rng.random() < 0.35:
        way = round_way(sites, taken, rng)
        names = (
            [] if assets is None else [n for kind in ("dog", "cat", "chicken") for n in assets.names(kind)]
        )
        names = [n for n in names if assets is not None and assets.entry(n).pose == "standing"]
        pick = int(rng.integers(max(len(names), 1)))
        model = assets.model(names[pick]) if assets is not None and names else animal(rng)
        if way is not None:
            actors.append(
                Mover(model, "animal", Path(way, closed=True), ground, float(rng.uniform(0.3, 1.5)))
            )
    return actors


def round_way(sites: Sites, taken: Occupancy, rng: np.random.Generator) -> Float64Array | None:
    """A closed smooth way on the lawn with room on both sides, or None where there is none.

    Returns:
        k x 2; the first point is not repeated.
    """
    where = sites.of("lawn", ROOM_M)
    for _ in range(30 if len(where) else 0):
        center = np.asarray(jittered(sites.xy[where[rng.integers(len(where))]], rng))
        n, sense, start = 7, rng.choice([-1, 1]), rng.uniform(0, 2 * np.pi)
        angle = start + sense * np.arange(n) * 2 * np.pi / n
        out = np.stack((np.cos(angle), np.sin(angle)), axis=1)
        knots = center + rng.uniform(0.9, 4.0) * rng.uniform(0.6, 1.2, (n, 1)) * out
        way = curve(np.concatenate([knots[-1:], knots, knots[:2]]), 6)[6 : 6 + 6 * n]
        spots = [(float(x), float(y)) for x, y in way[::2]]
        if all(taken.gap_m(Footprint(spot, (ROOM_M, ROOM_M))) > 0 for spot in spots) and all(
            on_lawn(sites, spot, ROOM_M) for spot in spots
        ):
            return way
    return None


def on_lawn(sites: Sites, xy: XY, room_m: float) -> bool:
    """Whether the site nearest to a point lies that far within the lawn and the lot."""
    k = int(np.argmin(np.square(sites.xy - xy).sum(axis=1)))
    close = float(np.hypot(*(sites.xy[k] - xy))) < 0.2
    return bool(close and sites.edge_m[k] > room_m and sites.lawn_m[k] > room_m)


def _spot(rng: np.random.Generator, sites: Sites, where: NDArray[np.intp], behind: list[Thing]) -> XY:
    """Somewhere on the lawn, or an arm's length from something to hide behind."""
    if behind:
        thing, angle, reach = (
            behind[int(rng.integers(len(behind)))],
            rng.uniform(0, 2 * np.pi),
            rng.uniform(0.5, 1.3),
        )
        x, y = thing.T_map_model[:2, 3]
        return float(x + reach * np.cos(angle)), float(y + reach * np.sin(angle))
    if not len(where):
        return 1e6, 1e6
    return jittered(sites.xy[where[rng.integers(len(where))]], rng)
