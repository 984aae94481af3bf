"""A bicycle that fits: feet on its pedals, hands at its grips, wheels on the ground."""

import numpy as np
import pytest

from swardmap.synth.people import riding
from swardmap.synth.people.gait import leg_m
from swardmap.synth.people.riding import astride, bicycles, fit_of, rider
from tests.synth.people.bodies import figure, points_of

GROUPS = ("man", "woman", "girl", "old man")


@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("phase", [0.0, 0.25, 0.6])
def test_soles_are_on_the_pedals(group: str, phase: float) -> None:
    who = figure(group)
    fit = fit_of(who)
    points = points_of(rider(who, fit, phase))
    for sign, shift in ((1, 0.0), (-1, 0.5)):
        angle = 2 * np.pi * (phase + shift)
        pedal = np.array([
            (riding.BRACKET_M[0] + riding.CRANK_M * np.cos(angle)) * fit.scale,
            sign * riding.PEDAL_M * fit.scale,
            (riding.BRACKET_M[1] - riding.CRANK_M * np.sin(angle)) * fit.scale,
        ])  # fmt: skip
        assert np.linalg.norm(points - pedal, axis=1).min() < 0.06
        foot = points[(sign * points[:, 1] > 0) & (np.abs(points[:, 0] - pedal[0]) < 0.03)]
        assert abs(foot[:, 2].min() - pedal[2]) < 0.05


@pytest.mark.parametrize("group", GROUPS)
def test_hands_are_at_the_grips_and_the_seat_is_on_the_saddle(group: str) -> None:
    who = figure(group)
    fit = fit_of(who)
    points = points_of(rider(who, fit, 0.1))
    for sign in (1, -1):
        grip = np.array([riding.GRIP_M[0] - 0.05, sign * 0.24, riding.GRIP_M[2]]) * fit.scale
        assert np.linalg.norm(points - grip, axis=1).min() < 0.06
    saddle = np.array([fit.saddle_m[0], 0, fit.saddle_m[1]])
    assert np.linalg.norm(points - saddle, axis=1).min() < 0.05


@pytest.mark.parametrize("group", GROUPS)
def test_a_bicycle_stands_on_its_wheels_and_grows_with_the_legs(group: str) -> None:
    who = figure(group)
    fit = fit_of(who)
    assert fit.scale == pytest.approx(leg_m(who) / riding.LEG_M)
    models = bicycles(np.random.default_rng(0), fit, 4)
    for model in models:
        low, high = model.bounds_m()
        assert low[2] == pytest.approx(0, abs=0.005)
        assert high[0] - low[0] == pytest.approx((riding.BASE_M + 2 * riding.WHEEL_M) * fit.scale, abs=0.01)
        assert 0.9 * fit.scale < high[2] < 1.15 * fit.scale
    assert not np.array_equal(points_of(models[0].meshes), points_of(models[1].meshes))


@pytest.mark.parametrize("group", GROUPS)
def test_who_stands_over_a_bicycle_has_both_feet_on_the_ground_and_the_bar_between_the_legs(
    group: str,
) -> None:
    who = figure(group)
    fit = fit_of(who)
    points = points_of(astride(who, fit))
    for sign in (1, -1):
        assert 0 <= points[sign * points[:, 1] > 0.05, 2].min() < 0.02
        grip = np.array([riding.GRIP_M[0] - 0.05, sign * 0.24, riding.GRIP_M[2]]) * fit.scale
        assert np.linalg.norm(points - grip, axis=1).min() < 0.06
    bar = points[(np.abs(points[:, 0]) < 0.05) & (np.abs(points[:, 1]) < 0.02), 2]
    assert not bar.size or bar.min() > 0.55 * fit.scale


def test_knees_go_up_and_down_by_turns() -> None:
    who = figure("man")
    fit = fit_of(who)
    top = []
    for phase in (0.25, 0.75):  # a pedal is lowest, then highest
        points = points_of(rider(who, fit, phase))
        knees = (np.abs(points[:, 0] - fit.saddle_m[0] - 0.38) < 0.1) & (np.abs(points[:, 1]) < 0.17)
        knees &= points[:, 2] < 0.95
        top.append([points[knees & (sign * points[:, 1] > 0.03), 2].max() for sign in (1, -1)])
    (left_low, right_high), (left_high, right_low) = top
    assert left_high > left_low + 0.08
    assert right_high > right_low + 0.08
