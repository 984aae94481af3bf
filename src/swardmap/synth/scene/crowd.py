"""Who is in the garden: people who stand, sit and lie, and those who walk, ride and run."""

import numpy as np
from numpy.typing import NDArray

from swardmap.labels import PERSON
from swardmap.synth.assets import Assets
from swardmap.synth.model import Actor, Float64Array, Model, Thing
from swardmap.synth.people.path import Mover, Path, cyclist, walker
from swardmap.synth.scene.areas import curve
from swardmap.synth.scene.figures import Stroller, figure, somebody
from swardmap.synth.scene.place import XY, Footprint, Occupancy, footprint_of, sunk_m, tilted, upright
from swardmap.synth.scene.sites import Sites, jittered
from swardmap.synth.scene.small_objects import animal
from swardmap.synth.terrain import Terrain

HIDERS = ("shrub", "tree", "hedge", "fence", "raised bed", "bin", "wall", "trellis")
COUNT_SHARES = (0.04, 0.12, 0.2, 0.24, 0.2, 0.13, 0.07)  # of gardens with 0-6 people who keep their place
HIDDEN_SHARE = 0.25
WALKER_SHARES = (0.3, 0.45, 0.25)
RIDER_SHARE, ANIMAL_SHARE = 0.3, 0.35  # of gardens
ROOM_M = 0.45  # on both sides of a way
SUNK_M = 0.05  # of somebody's lowest points, at most
STEEPEST = 0.17  # of a way: height over length
UPRIGHT = ("standing", "walking", "waving", "pointing", "carrying", "pushing", "crouching", "bending")


def people(
    things: list[Thing], sites: Sites, ground: Terrain, taken: Occupancy, assets: Assets | None,
    rng: np.random.Generator,
) -> list[Thing]:  # fmt: skip
    """0-6 people who keep their place: on the lawn, lying, sitting, and half behind things.

    Args:
        things: what stands already; somebody may hide behind it.
        sites: of the lot.
        ground: to stand on.
        taken: footprints; those of the people and their seats are added.
        assets: bodies and ready people, or None: plain figures.
        rng: source of chance.
    """
    found: list[Thing] = []
    for _ in range(int(rng.choice(len(COUNT_SHARES), p=COUNT_SHARES))):
        who = somebody(rng, assets)
        whole = who.whole
        hides = rng.random() < HIDDEN_SHARE and who.pose in UPRIGHT
        behind = [t for t in things if t.kind in HIDERS] if hides else []
        where = sites.of("middle" if rng.random() < 0.6 else "lawn", 0.4)
        for _ in range(20):
            xy, yaw = _spot(rng, sites, where, behind), float(rng.uniform(0, 2 * np.pi))
            foot = footprint_of(whole, xy, yaw)
            if taken.gap_m(foot) > 0.05 and on_lawn(sites, xy, 0.3):
                T = (upright if who.pose in UPRIGHT else tilted)(ground, whole, xy, yaw)
                if sunk_m(ground, whole, T) > SUNK_M:
                    continue
                found.append(Thing(who.model, "person", T, PERSON, who.pose))
                found += [Thing(who.beside, who.beside_kind, T)] if who.beside is not None else []
                taken.take(foot)
                break
    return found


def moving(
    sites: Sites, ground: Terrain, taken: Occupancy, assets: Assets | None, rng: np.random.Generator
) -> list[Actor]:
    """0-2 people, at times somebody on a bicycle and an animal, going round on the lawn, clear of things."""
    actors: list[Actor] = []
    bodies = assets if assets is not None and "people" in assets.array_names() else None
    for _ in range(int(rng.choice(len(WALKER_SHARES), p=WALKER_SHARES))):
        way = round_way(sites, ground, taken, rng)
        if way is not None and bodies is not None:
            running = bool(rng.random() < 0.2)
            actors.append(walker(rng, bodies, Path(way, closed=True), ground, running=running))
        elif way is not None:
            model, speed = figure(rng, "standing"), float(rng.uniform(0.4, 1.4))
            actors.append(Stroller(model, Path(way, closed=True), ground, speed))
    if rng.random() < RIDER_SHARE and bodies is not None:
        way = round_way(sites, ground, taken, rng, (1.2, 2.4), 3.0, 300)
        if way is not None:
            actors += cyclist(rng, bodies, Path(way, closed=True), ground)
    if rng.random() < ANIMAL_SHARE:
        way, model = round_way(sites, ground, taken, rng), _animal(assets, rng)
        if way is not None:
            path, speed = Path(way, closed=True), float(rng.uniform(0.3, 1.5))
            actors.append(Mover(model, "animal", path, ground, speed))
    return actors


def round_way(
    sites: Sites, ground: Terrain, taken: Occupancy, rng: np.random.Generator,
    radius_m: tuple[float, float] = (0.8, 3.0), longest: float = 1.7, tries: int = 100,
) -> Float64Array | None:  # fmt: skip
    """A closed smooth way on the lawn with room on both sides, nowhere steep; None where there is none.

    Args:
        sites: of the lot.
        ground: to go on.
        taken: footprints that it keeps clear of.
        rng: source of chance.
        radius_m: least and greatest, of the narrow way.
        longest: the way is up to so many times as long as wide.
        tries: how many ways are tried.

    Returns:
        k x 2; the first point is not repeated.
    """
    where = sites.of("lawn", ROOM_M)
    for _ in range(tries if len(where) else 0):
        center = np.asarray(jittered(sites.xy[where[rng.integers(len(where))]], rng))
        n, sense, start = 7, rng.choice([-1, 1]), rng.uniform(0, 2 * np.pi)
        angle = start + sense * np.arange(n) * 2 * np.pi / n
        out = np.stack((np.cos(angle), np.sin(angle)), axis=1)
        turn, long = rng.uniform(0, np.pi), rng.uniform(1.0, longest)
        stretch = np.array([(np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn))])
        out = out @ stretch.T * (long, 1.0) @ stretch
        knots = center + rng.uniform(*radius_m) * rng.uniform(0.8, 1.15, (n, 1)) * out
        way = curve(np.concatenate([knots[-1:], knots, knots[:2]]), 6)[6 : 6 + 6 * n]
        spots = [(float(x), float(y)) for x, y in way[::2]]
        if (
            all(taken.gap_m(Footprint(spot, (ROOM_M, ROOM_M))) > 0 for spot in spots)
            and all(on_lawn(sites, spot, ROOM_M) for spot in spots)
            and _steepest(ground, way) < STEEPEST
        ):
            return way
    return None


def on_lawn(sites: Sites, xy: XY, room_m: float) -> bool:
    """Whether the site nearest to a point lies that far within the lawn and the lot."""
    k = int(np.argmin(np.square(sites.xy - xy).sum(axis=1)))
    close = float(np.hypot(*(sites.xy[k] - xy))) < 0.2
    return bool(close and sites.edge_m[k] > room_m and sites.lawn_m[k] > room_m)


def _steepest(ground: Terrain, way: Float64Array) -> float:
    """Steepest slope along and across a closed way, over half a metre."""
    reach = 0.25 * np.array([(1, 0), (0, 1)])
    rise = [ground.height_at(way + d) - ground.height_at(way - d) for d in reach]
    return float(np.hypot(*rise).max() / 0.5)


def _animal(assets: Assets | None, rng: np.random.Generator) -> Model:
    """A dog, cat or hen that stands."""
    names: list[str] = []
    if assets is not None:
        names = [name for kind in ("dog", "cat", "chicken") for name in assets.names(kind)]
        names = [name for name in names if assets.entry(name).pose == "standing"]
    pick = int(rng.integers(max(len(names), 1)))
    return assets.model(names[pick]) if assets is not None and names else animal(rng)


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
