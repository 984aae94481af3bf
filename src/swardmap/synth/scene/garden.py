"""A garden from a seed."""

from collections.abc import Mapping

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.synth.assets import Assets
from swardmap.synth.model import Garden
from swardmap.synth.scene.borders import buildings, edgings
from swardmap.synth.scene.crowd import moving, people
from swardmap.synth.scene.furnish import covered, furnished
from swardmap.synth.scene.ground import build_ground
from swardmap.synth.scene.lawn_look import lawn_look
from swardmap.synth.scene.lot import plan_lot
from swardmap.synth.scene.place import Occupancy
from swardmap.synth.scene.recipes import GRASSY, RECIPES
from swardmap.synth.scene.sites import sites_of


def build_garden(seed: int, assets: Assets | None = None, more: Mapping[str, float] | None = None) -> Garden:
    """A lot with its ground and all that is on it; the same seed and assets give the same garden.

    Every part draws from a stream of its own, `default_rng([seed, tag])`, so that a change to one leaves the
    chance of the others alone.

    Args:
        seed: 0 or more.
        assets: ready-made models; None = all is drawn from simple shapes.
        more: how many times as often kinds of things are wished for (see recipes.KINDS); None = once each.

    Raises:
        InvalidValueError: for a negative seed.
    """
    if seed < 0:
        raise InvalidValueError(f"garden: expected a seed of 0 or more, got {seed}")
    more = more or {}
    lot = plan_lot(np.random.default_rng([seed, 1]), more.get("ground cover", 1.0))
    ground = build_ground(lot, lawn_look(np.random.default_rng([seed, 2])), seed)
    sites, taken = sites_of(lot, ground), Occupancy()
    things = buildings(lot, ground, taken, np.random.default_rng([seed, 21]))
    things += edgings(lot, ground, taken, np.random.default_rng([seed, 22]))
    things += furnished(RECIPES, sites, ground, taken, assets, seed, 30, more)
    things += people(things, sites, ground, taken, assets, np.random.default_rng([seed, 23]))
    actors = moving(sites, ground, taken, assets, np.random.default_rng([seed, 24]))
    things += covered(sites, ground, taken, seed)
    things += furnished(GRASSY, sites, ground, taken, None, seed, 31, more)
    return Garden(f"garden-{seed:04d}", seed, ground, tuple(things), lot.corners_m, tuple(actors))
