"""The small controller: it stands for the flag, for silence and for persons, and drives around the rest."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swardmap.geometry import Pose
from swardmap.grid import GridSpec
from swardmap.ros.driver import COSTMAP_TIMEOUT_S, FOR_PERSONS, GATE, PATIENCE_S, STILL, Driver, Heard
from swardmap.ros.driver_ears import upright_m
from swardmap.ros.gate import Command, GateInputs

SPEC = GridSpec(0.1, 100, 60, (-2.0, -3.0))
NOW_S = 50.0
GOAL_M = (6.0, 0.0)


def at(x: float, y: float, yaw: float = 0.0) -> Pose:
    c, s = math.cos(yaw), math.sin(yaw)
    return Pose("map", "base_link", np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]]))


def well(T: Pose | None = None) -> Heard:
    """All is heard, the flag is false and the lawn is free."""
    gate = GateInputs(False, T_map_base=T or at(0, 0.05), flag_s=NOW_S, cells_s=NOW_S, pose_s=NOW_S)
    return Heard(gate, costs=np.zeros(SPEC.shape, np.int8), spec=SPEC, costs_s=NOW_S)


def test_it_drives_while_all_is_well() -> None:
    command, reason = Driver(speed_mps=0.5).command(GOAL_M, well(), NOW_S)
    assert not reason
    assert command.forward_mps == pytest.approx(0.5, abs=0.01)
    assert abs(command.turn_rps) < 0.1


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda h: setattr(h.gate, "stop", True), "stop flag is set"),
        (lambda h: setattr(h.gate, "stop", None), "no stop flag"),
        (lambda h: setattr(h.gate, "flag_s", NOW_S - 1.1), "no stop flag"),
        (lambda h: setattr(h.gate, "cells_s", NOW_S - 1.1), "no map"),
        (lambda h: setattr(h, "costs_s", NOW_S - COSTMAP_TIMEOUT_S - 0.1), "costmap is old"),
        (lambda h: setattr(h, "costs", None), "no costmap"),
        (lambda h: setattr(h.gate, "T_map_base", None), "no costmap"),
        (lambda h: h.costs.fill(-1), "no free cell"),
        (lambda h: setattr(h.gate, "cells_m", np.array([(0.8, 0.0)])), "an obstacle is 0.70 m"),
        (lambda h: setattr(h, "persons_m", np.array([(1.8, 0.0)])), "a person is 1.7 m"),
    ],
)  # fmt: skip
def test_it_stands_for_each_reason(change: object, expected: str) -> None:
    heard = well(at(0.1, 0))
    change(heard)  # type: ignore[operator]
    command, reason = Driver().command(GOAL_M, heard, NOW_S)
    assert command == STILL
    assert expected in reason


def test_where_no_way_is_known_it_looks_around() -> None:
    heard = well()
    assert heard.costs is not None
    heard.costs[:, 22:] = -1
    command, reason = Driver().command(GOAL_M, heard, NOW_S)
    assert (command.forward_mps, reason) == (0, "no way through free cells is known: it looks around")
    assert command.turn_rps > 0


@pytest.mark.parametrize("place", [(1.8, 1.2), (-1.0, 0.0), (4.0, 0.0)])
def test_a_person_beside_behind_or_far_ahead_does_not_stop_it(place: tuple[float, float]) -> None:
    heard = replace(well(), persons_m=np.array([place]))
    command, reason = Driver().command(GOAL_M, heard, NOW_S)
    assert not reason
    assert command.forward_mps > 0.4


def test_persons_are_given_more_room_than_things() -> None:
    assert FOR_PERSONS.margin_m > GATE.margin_m
    assert FOR_PERSONS.reaction_s > GATE.reaction_s


def test_once_it_stands_for_somebody_they_must_be_farther_away_and_after_a_while_it_turns_from_them() -> None:
    heard, driver = well(), Driver()

    def stands(x: float, now_s: float) -> bool:
        heard.persons_m = np.array([(x, 0.05)])
        heard.gate.flag_s = heard.gate.cells_s = heard.gate.pose_s = heard.costs_s = now_s
        return driver.command(GOAL_M, heard, now_s)[0] == STILL

    assert not stands(2.9, NOW_S)
    assert stands(2.4, NOW_S + 1)
    assert stands(2.9, NOW_S + 2)
    assert not stands(4.0, NOW_S + 3)
    assert not stands(2.9, NOW_S + 4)
    heard.gate.T_map_base = at(0, 0.05, 1.2)  # the way leads to the right of where it looks
    heard.persons_m = np.array([(0.6, 1.6)])  # and there somebody stands
    for seconds, still in ((5, True), (19, True), (21, False)):
        now_s = NOW_S + seconds
        heard.gate.flag_s = heard.gate.cells_s = heard.gate.pose_s = heard.costs_s = now_s
        command, _ = driver.command(GOAL_M, heard, now_s)
        assert (command == STILL) == still, seconds
    assert command.forward_mps == 0
    assert command.turn_rps < 0


def stands_from_someone(place: tuple[float, float]) -> tuple[Heard, Driver]:
    """A mower that has lost its patience with somebody, and turns from them."""
    heard, driver = well(at(0, 0.05, 1.2)), Driver()
    for now_s in (NOW_S, NOW_S + PATIENCE_S):
        still = told(driver, heard, [place], now_s) == STILL
        assert still == (now_s == NOW_S)
    return heard, driver


def told(driver: Driver, heard: Heard, persons_m: list[tuple[float, float]], now_s: float) -> Command:
    """What it does when all is well but for these persons."""
    heard.persons_m = np.array(persons_m).reshape(-1, 2)
    heard.gate.flag_s = heard.gate.cells_s = heard.gate.pose_s = heard.costs_s = now_s
    return driver.command(GOAL_M, heard, now_s)[0]


AHEAD_M = (0.6, 1.6)
"""In the way of a mower at (0, 0.05) that looks along 1.2 rad."""


@pytest.mark.parametrize(
    "persons_m",
    [[], [AHEAD_M], [(8.0, 8.0)]],
    ids=["out of sight", "they stayed", "far away"],
)
def test_it_waits_anew_for_one_who_comes_back(persons_m: list[tuple[float, float]]) -> None:
    heard, driver = stands_from_someone(AHEAD_M)
    now_s, gone = NOW_S + PATIENCE_S + 1, persons_m != [AHEAD_M]
    assert told(driver, heard, persons_m, now_s) != STILL  # without them it goes on, past them it turns
    for after_s in (0.1, PATIENCE_S - 0.1):
        assert (told(driver, heard, [AHEAD_M], now_s + after_s) == STILL) == gone
    assert told(driver, heard, [AHEAD_M], now_s + 0.1 + PATIENCE_S) != STILL


def test_it_waits_anew_for_a_second_person_beside_the_first() -> None:
    heard, driver = stands_from_someone(AHEAD_M)
    now_s = NOW_S + PATIENCE_S + 1
    second = (1.1, 2.7)
    assert told(driver, heard, [AHEAD_M, second], now_s) == STILL
    assert told(driver, heard, [AHEAD_M, second], now_s + PATIENCE_S - 0.1) == STILL
    assert told(driver, heard, [AHEAD_M, second], now_s + PATIENCE_S) != STILL


def test_one_who_walks_about_ahead_is_one_person() -> None:
    heard, driver = well(at(0, 0.05, 1.2)), Driver()
    steps = [(0.6 + 0.02 * i, 1.6 + 0.05 * i) for i in range(20)]
    for i in range(1 + round(10 * PATIENCE_S)):
        command = told(driver, heard, [steps[min(i % 40, 39 - i % 40)]], NOW_S + 0.1 * i)
        assert (command == STILL) == (i < 10 * PATIENCE_S)


def test_it_turns_on_the_spot_towards_what_lies_behind() -> None:
    command, reason = Driver().command(GOAL_M, well(at(0, 0, 3.0)), NOW_S)
    assert not reason
    assert command.forward_mps == 0
    assert command.turn_rps < 0  # the short way round


def test_it_drives_around_a_bed_and_arrives() -> None:
    heard, driver = well(), Driver()
    assert heard.costs is not None
    heard.costs[20:40, 45:52] = 100  # 2.5 to 3.2 m ahead, a metre to each side
    iy, ix = np.indices(SPEC.shape)
    away = np.hypot(np.maximum(np.abs(ix - 48) - 3, 0), np.maximum(np.abs(iy - 29.5) - 9.5, 0))
    heard.costs[(away > 0) & (away < 5)] = 99  # inscribed: half a metre
    x = y = yaw = 0.0
    nearest_m = math.inf
    for _ in range(300):
        heard.gate.T_map_base = at(x, y, yaw)
        command, reason = driver.command(GOAL_M, heard, NOW_S)
        assert not reason
        yaw += 0.1 * command.turn_rps
        x, y = x + 0.1 * command.forward_mps * math.cos(yaw), y + 0.1 * command.forward_mps * math.sin(yaw)
        dx, dy = max(2.5 - x, x - 3.2, 0), max(-1.0 - y, y - 1.0, 0)
        nearest_m = min(nearest_m, math.hypot(dx, dy))
        if math.dist((x, y), GOAL_M) < 0.3:
            break
    else:
        pytest.fail(f"it ended at {x:.2f}, {y:.2f}")
    assert nearest_m > 0.4


def test_a_spot_on_the_lawn_is_nobody_however_it_is_labelled() -> None:
    rng = np.random.default_rng(0)
    spot = np.column_stack([rng.uniform(1, 2, (200, 2)), rng.uniform(-0.1, 0.1, 200)])
    shoes = np.column_stack([rng.uniform(1, 2, (200, 2)), rng.uniform(-0.05, 0.25, 200)])
    assert len(upright_m(spot)) == 0
    assert len(upright_m(spot[:0])) == 0
    assert len(upright_m(shoes)) > 50
    assert len(upright_m(np.array([(1.0, 0.0, 0.5)] * 9))) == 0  # a few points float
