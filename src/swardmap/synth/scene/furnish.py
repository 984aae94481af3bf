"""Put the things of the recipes into a lot."""

from collections.abc import Mapping, Sequence

import numpy as np

from swardmap.synth.assets import Assets
from swardmap.synth.model import Model, Thing
from swardmap.synth.scene.materials import leaves
from swardmap.synth.scene.place import Footprint, Occupancy, footprint_of, sunk_m, tilted, upright
from swardmap.synth.scene.plants import ground_cover
from swardmap.synth.scene.recipes import ThingKind
from swardmap.synth.scene.sites import Sites, jittered
from swardmap.synth.terrain import Terrain

TRIES = 14
MAX_ASSET_TRIANGLES = 24_000
DRAWN_WEIGHT = 1.0  # a drawn kind counts like so many models of the bundle
SUNK_M = 0.06  # of the lowest points of what does not grow, at most
PLAIN = ("animal",)  # drawn only where the bundle has none
UNFIT = ("broom",)  # stands on its bristles


def furnished(
    recipes: Sequence[ThingKind],
    sites: Sites,
    ground: Terrain,
    taken: Occupancy,
    assets: Assets | None,
    seed: int,
    tag: int,
    more: Mapping[str, float],
) -> list[Thing]:
    """Things of each recipe where there is room; each recipe draws from a stream of its own.

    Args:
        recipes: what, in the order in which they choose their place.
        sites: where.
        ground: to stand on.
        taken: footprints; those of the new things are added, unless they are labelled grass.
        assets: ready-made models, or None.
        seed: of the garden.
        tag: of this group of recipes.
        more: how many times as often a kind is wished for; once where it is not named.
    """
    area = len(sites.xy) * 0.12**2
    things = []
    for k, recipe in enumerate(recipes):
        rng = np.random.default_rng([seed, tag, k])
        mean = recipe.mean * more.get(recipe.kind, 1.0)
        count = int(min(rng.poisson(mean * np.sqrt(area / 500)), 3 * mean + 2))
        models = [_model(recipe, assets, rng) for _ in range(min(recipe.variants, count))]
        for i in range(count):
            model = models[i % len(models)]
            thing = None if model is None else _placed(recipe, model, sites, ground, taken, rng)
            if thing is not None:
                things.append(thing)
    return things


def covered(sites: Sites, ground: Terrain, taken: Occupancy, seed: int) -> list[Thing]:
    """Low plants all over the ground cover."""
    rng = np.random.default_rng([seed, 35])
    where, foliage = sites.of("cover", 0.0), leaves(rng, 0.1)
    models = [ground_cover(rng, foliage) for _ in range(3)]
    things = []
    for i in rng.permutation(where)[: min(len(where) // 7, 90)]:
        xy = jittered(sites.xy[i], rng)
        if taken.gap_m(Footprint(xy, (0.05, 0.05))) > 0:
            T = tilted(ground, models[int(rng.integers(3))], xy, float(rng.uniform(0, 6.28)))
            things.append(Thing(models[int(rng.integers(3))], "ground cover", T))
    return things


def _placed(
    recipe: ThingKind, model: Model, sites: Sites, ground: Terrain, taken: Occupancy, rng: np.random.Generator
) -> Thing | None:
    """The thing at the first site with room, or None."""
    scale = float(rng.uniform(*recipe.scale))
    size = footprint_of(model, (0, 0), 0.0, scale, recipe.foot_m)
    where = sites.of(recipe.where, float(np.hypot(*size.half_m)) if recipe.label.name != "grass" else 0.5)
    for _ in range(TRIES if len(where) else 0):
        xy, yaw = jittered(sites.xy[where[rng.integers(len(where))]], rng), float(rng.uniform(0, 2 * np.pi))
        foot = footprint_of(model, xy, yaw, scale, recipe.foot_m)
        if taken.gap_m(foot) > recipe.room_m:
            stand = upright if recipe.upright else tilted
            T = stand(ground, model, xy, yaw, scale)
            if not recipe.rooted and sunk_m(ground, model, T) > SUNK_M:
                continue
            if recipe.label.name != "grass":
                taken.take(foot)
            return Thing(model, recipe.kind, T, recipe.label, tint=_tint(recipe, rng))
    return None


def _tint(recipe: ThingKind, rng: np.random.Generator) -> tuple[float, float, float]:
    """Plants of one model differ a little in colour."""
    if recipe.variants < 2 or recipe.label.name == "grass":
        return 1.0, 1.0, 1.0
    shade, warm = rng.uniform(0.85, 1.1), rng.uniform(-0.06, 0.06)
    return float(shade * (1 + warm)), float(shade), float(shade * (1 - warm))


def _model(recipe: ThingKind, assets: Assets | None, rng: np.random.Generator) -> Model | None:
    """From the bundle where it has the kind, else drawn; the share from the bundle grows with what it has."""
    names: list[str] = []
    if assets is not None:
        known = [name for kind in recipe.assets for name in assets.names(kind) if name not in UNFIT]
        names = [name for name in known if assets.entry(name).triangles < MAX_ASSET_TRIANGLES]
    weight = 0.0 if recipe.kind in PLAIN else DRAWN_WEIGHT
    pick, drawn = rng.random(), rng.random() >= len(names) / max(len(names) + weight, 1e-9)
    if recipe.make is not None and (assets is None or not names or drawn):
        return recipe.make(rng)
    return assets.model(names[int(pick * len(names))]) if assets is not None and names else None
