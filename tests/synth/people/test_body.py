"""Bodies are as tall and as heavy as people of their age, whole and turned outward."""

import numpy as np
import pytest

from swardmap.errors import InvalidValueError
from swardmap.synth.people.body import ARM, LEG, body_of
from swardmap.synth.people.figure import GROUPS
from swardmap.synth.people.shell import border
from tests.synth.people.bodies import assets, volume_m3

# Metres: of children from one to fifteen years, the 3rd centile of the youngest to the 97th of the oldest
# (WHO growth references); of adults about the 5th to the 99th centile (CDC, NHANES 2015-2018)
HEIGHT_M = {
    "boy": (0.71, 1.85), "girl": (0.69, 1.75), "man": (1.63, 1.91), "woman": (1.50, 1.76),
    "old man": (1.60, 1.90), "old woman": (1.46, 1.72),
}  # fmt: skip
BMI = {"boy": (12, 26), "girl": (12, 26)}


@pytest.mark.parametrize("group", GROUPS)
def test_height_and_mass_are_those_of_people(group: str) -> None:
    low, high = HEIGHT_M[group]
    for seed in range(6):
        body = body_of(assets(), group, np.random.default_rng(seed))
        assert low < body.height_m < high
        mass_kg = 1000 * volume_m3(body.skin.xyz, body.skin.faces)  # people are about as dense as water
        least, most = BMI.get(group, (17, 37))
        assert least < mass_kg / body.height_m**2 < most


def test_children_come_in_all_sizes() -> None:
    heights = [body_of(assets(), "boy", np.random.default_rng(seed)).height_m for seed in range(40)]
    assert min(heights) < 1.0
    assert max(heights) > 1.5


@pytest.mark.parametrize("group", ["girl", "man", "old woman"])
def test_a_body_is_closed_but_for_mouth_and_eyes(group: str) -> None:
    body = body_of(assets(), group, np.random.default_rng(0))
    edges = border(body.skin)
    assert len(edges) < 0.02 * len(body.skin.faces)
    assert (body.skin.mean[edges.ravel(), 2] > body.head_mean[2] - 0.1).all()
    both = np.concatenate([body.skin.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    _, times = np.unique(both, axis=0, return_counts=True)
    assert times.max() == 1, "an edge is run twice in one sense: some faces are turned the other way"


def test_shells_say_where_they_lie() -> None:
    body = body_of(assets(), "woman", np.random.default_rng(1))
    at = dict(zip(body.bones, body.joints, strict=True))
    for shell in (body.skin, body.tights):
        assert np.allclose(shell.weights.sum(axis=1), 1)
        knee = np.abs(shell.along[:, LEG] - 1) < 0.05
        assert np.abs(shell.xyz[knee, 2] - at["calf.L"][2]).max() < 0.06
        elbow = shell.xyz[np.abs(shell.along[:, ARM] - 1) < 0.05]
        assert np.linalg.norm(elbow * [1, 0, 1] - at["forearm.L"] * [1, 0, 1], axis=1).max() < 0.15


def test_an_unknown_group_is_one_clear_error() -> None:
    with pytest.raises(InvalidValueError, match=r"expected a group of people in .*'woman'.*got 'robot'"):
        body_of(assets(), "robot", np.random.default_rng(0))
