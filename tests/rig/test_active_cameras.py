"""The direction of travel: hysteresis, noise, turns, jumps; and the load that is dropped because of it."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.errors import InvalidValueError
from swardmap.geometry import Pose
from swardmap.rig.active_cameras import ActiveCameras, DirectionSelector, forward_step_m
from swardmap.rig.rig import Direction, SelectorConfig, rig_from_dict
from tests.rig.test_rig import tree

S = 1_000_000_000
FORWARD, BACKWARD = Direction.FORWARD, Direction.BACKWARD


def pose(x: float, y: float = 0.0, yaw_deg: float = 0.0) -> Pose:
    c, s = np.cos(np.deg2rad(yaw_deg)), np.sin(np.deg2rad(yaw_deg))
    return Pose("map", "base", np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]]))


def test_the_other_direction_is_taken_after_the_hold_time() -> None:
    selector = DirectionSelector(SelectorConfig(min_speed_mps=0.1, hold_s=0.3))
    stamps = [round(i * 0.1 * S) for i in range(10)]
    found = [selector.step_speed(t, -0.5) for t in stamps]
    assert found == [FORWARD] * 3 + [BACKWARD] * 7  # 0.3 s after the first


def test_standing_still_keeps_the_last_direction() -> None:
    selector = DirectionSelector(SelectorConfig(initial="backward"))
    for i in range(1000):
        speed = 0.079 * np.sin(i)
        assert selector.step_speed(i * S // 10, speed) == BACKWARD


def test_a_swing_shorter_than_the_hold_time_changes_nothing() -> None:
    selector = DirectionSelector(SelectorConfig(hold_s=0.3))
    for i in range(200):
        speed = -0.5 if i % 4 else 0.0  # three of four readings backward, 0.2 s on end
        assert selector.step_speed(round(i * 0.1 * S), speed) == FORWARD


@given(st.lists(st.tuples(st.integers(-(10**9), 10**9), st.floats(-2, 2)), max_size=60))
def test_whatever_the_speeds_a_change_takes_the_hold_time_of_speeds_that_way(
    steps: list[tuple[int, float]],
) -> None:
    config = SelectorConfig(min_speed_mps=0.1, hold_s=0.5)
    selector, now, history = DirectionSelector(config), 0, []
    for dt, speed in steps:
        before, now = selector.direction, now + dt
        history.append((now, speed))
        after = selector.step_speed(now, speed)
        if after == before:
            continue
        sign = 1 if after == FORWARD else -1
        run: list[int] = []
        for t, v in reversed(history):
            if v * sign < 0.1 or (run and t > run[-1]):
                break
            run.append(t)
        assert run[0] - run[-1] >= 0.5 * S


@pytest.mark.parametrize("heading_deg", [0.0, 77.0, 180.0, -135.0])
def test_poses_give_the_way_along_the_robots_own_axis(heading_deg: float) -> None:
    c, s = np.cos(np.deg2rad(heading_deg)), np.sin(np.deg2rad(heading_deg))
    ahead, aside = pose(3 * c, 3 * s, heading_deg), pose(-3 * s, 3 * c, heading_deg)
    start = pose(0, 0, heading_deg)
    assert forward_step_m(start, ahead) == pytest.approx(3)
    assert forward_step_m(ahead, start) == pytest.approx(-3)
    assert forward_step_m(start, aside) == pytest.approx(0)


def test_an_arc_counts_its_way_and_a_turn_on_the_spot_nothing() -> None:
    steps = np.deg2rad(np.arange(0, 91, 1.0))
    arc = [pose(2 * np.sin(a), 2 - 2 * np.cos(a), np.rad2deg(a)) for a in steps]
    way = sum(forward_step_m(a, b) for a, b in pairwise(arc))
    assert way == pytest.approx(np.pi, rel=1e-4)  # a quarter of a circle of 2 m
    assert forward_step_m(pose(1, 1, 0), pose(1, 1, 170)) == 0
    with pytest.raises(InvalidValueError, match="same frames"):
        forward_step_m(pose(0), Pose.identity("odom", "base"))


def test_reversing_is_seen_in_noisy_rtk_poses_and_standing_is_not() -> None:
    rng = np.random.default_rng(0)
    selector = DirectionSelector()
    x, directions = 0.0, []
    for i in range(1500):  # 10 Hz: forward 50 s, still 50 s, backward 50 s; RTK noise of 7 mm
        x += 0.05 * (1 if i < 500 else 0 if i < 1000 else -1)
        noise = rng.normal(0, 0.007, 2)
        directions.append(selector.step_pose(i * S // 10, pose(x + noise[0], noise[1], rng.normal(0, 0.5))))
    assert set(directions[:1000]) == {FORWARD}
    assert directions[1010:] == [BACKWARD] * 490  # within a second


def test_a_jump_of_the_pose_or_of_time_is_no_drive() -> None:
    selector = DirectionSelector()
    for i in range(100):
        x = 0.05 * i - (30.0 if i == 40 else 0)  # RTK loses its fix for one reading
        assert selector.step_pose(i * S // 10, pose(x)) == FORWARD
    assert selector.step_pose(0, pose(0)) == FORWARD  # the clock went back
    with pytest.raises(InvalidValueError, match="finite"):
        selector.step_speed(0, float("nan"))


def test_only_the_pair_that_faces_the_travel_is_processed_and_the_rest_counted() -> None:
    active = ActiveCameras(rig_from_dict(tree()))
    for i in range(100):
        active.selector.step_speed(i * S // 15, 0.5 if i < 60 else -0.5)
        for name in active.rig.names:
            assert active.admits(name) == (name in active.names)
    assert active.names == ("rear_left", "rear_right")
    assert active.processed["front_left"] == active.dropped["rear_left"] == 63  # 0.2 s of hold at 15 Hz
    assert all(active.processed[n] + active.dropped[n] == 100 for n in active.rig.names)
    with pytest.raises(InvalidValueError, match="no camera 'side'"):
        active.admits("side")


def test_a_robot_without_cameras_that_way_uses_all_it_has_and_says_so() -> None:
    front = {"cameras": {k: v for k, v in tree()["cameras"].items() if k.startswith("front")}}
    active = ActiveCameras(rig_from_dict(front))
    assert not active.blind
    for i in range(10):
        active.selector.step_speed(i * S, -1.0)
    assert active.blind
    assert active.names == ("front_left", "front_right")
