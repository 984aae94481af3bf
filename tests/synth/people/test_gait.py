"""Walking and running: feet that stay where they are, plausible steps, feet on the ground."""

import numpy as np
import pytest

from swardmap.synth.people.gait import gait_of, leg_m, step_meshes
from tests.synth.people.bodies import figure, points_of

PHASES = 40
WALKS = [("man", 1.3), ("woman", 1.0), ("boy", 0.9), ("old woman", 0.8)]


def slips(group: str, speed: float, running: bool) -> tuple[list[float], float]:
    """How far what touches the ground is moved from phase to phase, and how far the body is."""
    gait = gait_of(figure(group), speed, running)
    phases = [points_of(step_meshes(figure(group), gait, k / PHASES)) for k in range(PHASES)]
    found = []
    for k, now in enumerate(phases):
        after = phases[(k + 1) % PHASES]
        stand = (now[:, 2] < 0.012) & (after[:, 2] < 0.012)
        if stand.sum() > 3:
            found.append(float(np.median(after[stand, 0] - now[stand, 0])) + gait.stride_m / PHASES)
    return found, gait.stride_m / PHASES


@pytest.mark.parametrize(("group", "speed"), WALKS)
def test_feet_on_the_ground_do_not_slide(group: str, speed: float) -> None:
    found, advance = slips(group, speed, running=False)
    assert len(found) == PHASES, "somebody who walks always has a foot on the ground"
    assert np.median(np.abs(found)) < 0.02 * advance
    assert np.max(np.abs(found)) < 0.2 * advance


@pytest.mark.parametrize(("group", "speed"), [("man", 2.6), ("girl", 2.2)])
def test_runners_fly_and_do_not_slide(group: str, speed: float) -> None:
    found, advance = slips(group, speed, running=True)
    assert 0.6 * PHASES < len(found) < 0.95 * PHASES
    assert np.median(np.abs(found)) < 0.05 * advance


@pytest.mark.parametrize(("group", "speed"), WALKS)
def test_soles_are_on_the_ground_and_the_head_hardly_bobs(group: str, speed: float) -> None:
    gait = gait_of(figure(group), speed, running=False)
    phases = [points_of(step_meshes(figure(group), gait, k / 16)) for k in range(16)]
    lowest = [float(points[:, 2].min()) for points in phases]
    assert min(lowest) > -0.02
    assert max(lowest) < 0.01
    assert np.ptp([float(points[:, 2].max()) for points in phases]) < 0.1 * leg_m(figure(group))


@pytest.mark.parametrize(("group", "speed"), WALKS)
def test_cadence_is_that_of_people(group: str, speed: float) -> None:
    """Adults take about 90 to 135 steps a minute (Murtagh et al. 2021), children up to 160."""
    cadence = 120 * speed / gait_of(figure(group), speed, running=False).stride_m
    assert 85 < cadence < (165 if group in ("boy", "girl") else 135)


def test_arms_swing_against_the_legs() -> None:
    who = figure("man")
    gait = gait_of(who, 1.3, running=False)
    points = points_of(step_meshes(who, gait, 0.0))
    low = points[:, 2] < 0.15
    arms = (np.abs(points[:, 1]) > 0.22) & (points[:, 2] < 1.1) & (points[:, 2] > 0.5)
    left_foot, right_foot = (points[low & (sign * points[:, 1] > 0), 0].mean() for sign in (1, -1))
    left_hand, right_hand = (points[arms & (sign * points[:, 1] > 0), 0].mean() for sign in (1, -1))
    assert left_foot > right_foot + 0.4
    assert left_hand < right_hand - 0.1
