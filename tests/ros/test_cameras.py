"""Cameras of a rig as they are in the field: one dies and comes back, rates differ, and so do images."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swardmap.geometry import Intrinsics
from swardmap.labels import MapClass
from swardmap.monitor.diagnostics import Fault
from swardmap.rig.rig import Rig
from swardmap.ros.frame_queue import FrameQueue
from swardmap.synth.analytic import StereoNoise, garden_scene, render, with_sensor_noise
from swardmap.types import Frame
from tests.ros import drive
from tests.ros.drive import PERIOD_NS, RIG, START_NS
from tests.ros.test_live_pipeline import LATENCY_NS, Robot, free_cells, parameters, pipeline_of

PAIR: dict[str, Any] = {
    **RIG, "cameras": {name: RIG["cameras"][name] for name in ("front_left", "front_right")},
}  # fmt: skip
LARGE = Intrinsics(320, 200, 230.0, 230.0, 159.5, 99.5)


def pair_robot() -> Robot:
    rig = drive.rig_of(PAIR)
    return Robot(pipeline_of(parameters(), rig), rig)


def tick(robot: Robot, i: int, *names: str, view: Any = drive.view) -> None:
    """The i-th tenth of a second with images of some cameras."""
    stamp_ns, x_m = START_NS + i * PERIOD_NS, 0.02 * i
    robot.now_ns = stamp_ns + LATENCY_NS
    robot.pose(x_m, stamp_ns)
    for name in names:
        robot.look(name, view(robot.rig, name, x_m, i % 20), stamp_ns)
    robot.work()


def mapped(robot: Robot) -> dict[str, int]:
    return dict(robot.pipeline.mapper.mapped)


def test_a_camera_that_dies_stops_the_robot_and_one_that_comes_back_lets_it_go() -> None:
    robot = pair_robot()
    both = tuple(robot.rig.names)
    for i in range(30):
        tick(robot, i, *both)
    assert not robot.reports[-1].stop
    for i in range(30, 60):
        tick(robot, i, "front_left")
    assert robot.reports[-1].faults("front_right") == {Fault.STOPPED}
    assert not robot.reports[-1].faults("front_left")
    assert robot.reports[-1].stop
    assert mapped(robot) == {"front_left": 60, "front_right": 30}  # the other one is mapped all the while
    for i in range(60, 100):
        tick(robot, i, *both)
    assert not robot.reports[-1].stop
    assert not robot.reports[-1].diagnoses
    assert mapped(robot)["front_right"] == 70
    lines = [text for _, text in robot.pipeline.events]
    assert [line for line in lines if line.startswith("stop: front_right: stale")]
    assert [line for line in lines if line.startswith("front_right: stopped")]
    assert sum("go: the stop flag is taken back" in line for line in lines) == 2


def test_cameras_of_unequal_rates_are_all_mapped() -> None:
    """Ten frames a second beside five: neither waits for the other, none is dropped."""
    robot = pair_robot()
    for i in range(40):
        tick(robot, i, *(robot.rig.names if i % 2 == 0 else ("front_left",)))
    assert mapped(robot) == {"front_left": 40, "front_right": 20}
    assert not robot.reports[-1].stop
    assert robot.pipeline.facts["dropped_by_queue"] == {}
    rates = robot.reports[-1].rates_hz
    assert rates["front_left"] == pytest.approx(10, abs=1)
    assert rates["front_right"] == pytest.approx(5, abs=1)


def test_a_fast_camera_does_not_starve_a_slow_one() -> None:
    """More frames than can be mapped: cameras are served in turn, the fast one's oldest are dropped."""
    queue = FrameQueue[tuple[str, int]](2)
    served = []
    for i in range(60):
        queue.put("fast", ("fast", i))
        if i % 6 == 0:
            queue.put("slow", ("slow", i))
        if i % 3 == 0:
            served.append(queue.get(0))
    slow = [item for item in served if item is not None and item[0] == "slow"]
    assert len(slow) >= 9  # of 10; the last may wait
    assert queue.dropped["slow"] == 0
    assert queue.dropped["fast"] > 20


def other_view(rig: Rig, name: str, x_m: float, seed: int) -> Frame:
    """The right camera gives images of another size, lens, and unit of depth."""
    if name == "front_left":
        return drive.view(rig, name, x_m, seed)
    T = (drive.base_at(x_m) @ rig.T_base_camera(name)).of_child(drive.optical(name))
    frame = with_sensor_noise(render(garden_scene(0), LARGE, T), np.random.default_rng(seed), StereoNoise())
    return replace(frame, depth=frame.depth_m.astype(np.float32), depth_unit_m=1.0)


def test_a_camera_of_another_resolution_maps_the_same_garden() -> None:
    same, other = pair_robot(), pair_robot()
    for i in range(24):
        tick(same, i, *same.rig.names)
        tick(other, i, *other.rig.names, view=other_view)
    assert mapped(other) == {"front_left": 24, "front_right": 24}
    assert other.pipeline.skipped == {}
    one, two = same.pipeline.mapper.snapshot(None), other.pipeline.mapper.snapshot(None)
    assert one is not None
    assert two is not None
    assert free_cells(other.pipeline) > 0.8 * free_cells(same.pipeline)
    # where both know a cell they agree but for a few at the edges of things
    x0, x1 = max(one.spec.extent_m[0], two.spec.extent_m[0]), min(one.spec.extent_m[1], two.spec.extent_m[1])
    y0, y1 = max(one.spec.extent_m[2], two.spec.extent_m[2]), min(one.spec.extent_m[3], two.spec.extent_m[3])
    xs, ys = np.meshgrid(np.arange(x0 + 0.025, x1, 0.05), np.arange(y0 + 0.025, y1, 0.05))
    points = np.stack([xs, ys], axis=-1)
    a, b = (g.classes[tuple(g.spec.cell_of(points)[..., k] for k in (1, 0))] for g in (one, two))
    known = (a != MapClass.UNKNOWN) & (b != MapClass.UNKNOWN)
    assert known.sum() > 2000
    assert (a[known] == b[known]).mean() > 0.97
