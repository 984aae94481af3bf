"""From the robot's start cell a planner that plans through no unknown cell finds a way, once granted."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.mapping.costmap import INSCRIBED, NO_INFORMATION
from swardmap.ros.start_area import gap_m, start_area, with_start_area
from tests.ros import drive
from tests.ros.drive import START_NS
from tests.ros.test_live_pipeline import Robot, one_robot, parameters, pipeline_of

NS = 1_000_000_000


def pose(x: float, y: float, yaw: float = 0.0) -> Pose:
    matrix = np.eye(4)
    matrix[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    matrix[:2, 3] = x, y
    return Pose("map", drive.BASE, matrix)


def reached(costs: NDArray[np.uint8], start: tuple[int, int]) -> NDArray[np.bool_]:
    """Cells that NavFn reaches with allow_unknown false (nav2_navfn_planner/src/navfn.cpp, setCostmap:

    cells of COST_OBS_ROS 253 and more, and unknown ones, are obstacles; waves go to four neighbours).
    """
    passable = (costs < INSCRIBED) & (costs != NO_INFORMATION)
    patches, _ = ndimage.label(passable)
    ix, iy = start
    return patches == patches[iy, ix] if passable[iy, ix] else np.zeros_like(passable)


def way_ahead(robot: Robot, to_x_m: float) -> tuple[bool, NDArray[np.bool_], OccupancyGrid]:
    """Whether NavFn comes from the robot's cell to one ahead, cells it may use, and what was given out."""
    pipeline = robot.pipeline
    given_out = pipeline.given_out(None if pipeline.report is None else pipeline.report.forget_before_ns)
    assert given_out is not None
    costmap = pipeline.mapper.costmap(given_out)
    assert costmap is not None
    assert pipeline.robot is not None
    x, y, _ = pipeline.robot[1].position_m.tolist()
    cells = reached(costmap.costs, tuple(given_out.spec.cell_of([x, y]).tolist()))
    goal = given_out.spec.cell_of([to_x_m, y])
    return bool(cells[goal[1], goal[0]]), cells, given_out


def well(robot: Robot, steps: int = 30) -> None:
    """The robot stands, but for the shaking of its motor, until the stop flag is taken back."""
    for i in range(steps):
        robot.step(i, 0.002 * (i % 10))
    assert not robot.reports[-1].stop


@pytest.mark.parametrize("mode", ["last_seen", "log_odds"])
def test_after_the_grant_and_the_first_frame_there_is_a_way_of_free_cells(mode: str) -> None:
    robot = one_robot({"grid": {"mode": mode}})
    well(robot)
    found, cells, before = way_ahead(robot, 2.0)
    assert not found  # the robot stands in its blind zone
    assert not cells.any()
    told = robot.pipeline.grant_start_area(robot.now_ns)
    assert "granted" in told
    assert "too small" not in told
    found, cells, after = way_ahead(robot, 2.0)
    assert found
    assert (after.classes[cells] == MapClass.GRASS).all()  # none leads through unknown cells
    area = robot.pipeline.given.area
    assert area is not None
    iy, ix = np.nonzero(after.classes != before.classes)
    assert (area.distance_m(after.spec.center_of(np.column_stack([ix, iy]))) == 0).all()
    assert (before.classes[iy, ix] == MapClass.UNKNOWN).all()
    # the map itself holds what was seen
    inner = robot.pipeline.mapper.snapshot(None)
    assert inner is not None
    assert inner.count(MapClass.GRASS) == before.count(MapClass.GRASS)


def test_the_robot_lies_in_the_map_it_is_given() -> None:
    robot = one_robot()
    robot.step(0, 0.0)
    seen, given_out = robot.pipeline.mapper.snapshot(None), robot.pipeline.given_out(None)
    assert seen is not None
    assert given_out is not None
    assert not seen.spec.contains(seen.spec.cell_of([0.0, 0.0]))  # why
    for corner in ([-1.0, -1.0], [1.0, 1.0]):
        assert given_out.spec.contains(given_out.spec.cell_of(corner))
    assert given_out.count(MapClass.GRASS) == seen.count(MapClass.GRASS)


def test_an_area_that_ends_before_the_ground_that_is_seen_says_so() -> None:
    robot = one_robot(start_area_ahead_m=0.0, start_area_radius_m=0.1)
    well(robot)
    assert "start_area_ahead_m is too small" in robot.pipeline.grant_start_area(robot.now_ns)
    assert not way_ahead(robot, 2.0)[0]


def ended(robot: Robot) -> str:
    assert robot.pipeline.given.area is None
    (line,) = [text for _, text in robot.pipeline.events if text.startswith("start area ended")]
    return line


def test_it_ends_by_time() -> None:
    robot = one_robot(start_area_s=1.0)
    well(robot)
    robot.pipeline.grant_start_area(robot.now_ns)
    for i in range(30, 45):
        robot.step(i, 0.002 * (i % 10))
    assert "time is over" in ended(robot)
    assert not way_ahead(robot, 2.0)[0]


def test_it_ends_when_the_robot_has_left_it() -> None:
    robot = one_robot()
    well(robot)
    robot.pipeline.grant_start_area(robot.now_ns)
    for i in range(30, 70):
        robot.step(i, 0.05 * (i - 30))
    assert "has left it" in ended(robot)


def test_it_ends_when_the_stop_flag_is_set() -> None:
    robot = one_robot()
    well(robot)
    robot.pipeline.grant_start_area(robot.now_ns)
    for i in range(30, 45):
        robot.step(i, 0.002 * (i % 10), posed=False)
    assert robot.reports[-1].stop
    assert "stop flag" in ended(robot)


def test_it_ends_when_the_map_is_cleared() -> None:
    robot = one_robot()
    well(robot)
    robot.pipeline.grant_start_area(robot.now_ns)
    robot.pipeline.clear()
    assert "cleared" in ended(robot)
    robot.step(30, 0.0)
    robot.pipeline.grant_start_area(robot.now_ns)
    assert way_ahead(robot, 2.0)[0]


def test_the_last_word_of_the_node_leaves_it_out() -> None:
    robot = one_robot()
    well(robot)
    robot.pipeline.grant_start_area(robot.now_ns)
    given_out = robot.pipeline.given_out(2**62, nothing_free=True)
    assert given_out is not None
    assert given_out.count(MapClass.GRASS) == 0


def test_the_parameter_grants_it_once_the_pose_is_known() -> None:
    robot = one_robot(start_area_at_start=True)
    robot.pipeline.begin()
    robot.pipeline.check(START_NS)
    assert robot.pipeline.given.area is None
    well(robot)
    assert way_ahead(robot, 2.0)[0]
    grants = [text for _, text in robot.pipeline.events if "granted" in text]
    assert len(grants) == 1


@pytest.mark.parametrize(
    ("settings", "node", "expected"),
    [
        ({}, {}, "not known yet"),
        ({"source": {}, "mount": drive.MOUNT}, {"pose_source": "none"}, "pose_source"),
    ],
)
def test_without_a_pose_there_is_none(settings: dict[str, Any], node: dict[str, Any], expected: str) -> None:
    pipeline = pipeline_of(parameters(settings, **node))
    pipeline.check(START_NS)
    with pytest.raises(InputError, match=expected):
        pipeline.grant_start_area(START_NS)


def test_an_old_pose_is_none() -> None:
    robot = one_robot()
    well(robot)
    with pytest.raises(InputError, match=r"2\.\d+ s old"):
        robot.pipeline.grant_start_area(robot.now_ns - drive.MS * 20 + 2 * NS)


@given(
    st.floats(-3, 3),
    st.floats(-3, 3),
    st.floats(-4, 4),
    st.floats(0.05, 1.5),
    st.floats(-3, 3),
    st.integers(0, 9),
)
def test_only_unknown_cells_within_the_size_turn_free(
    x: float, y: float, yaw: float, radius_m: float, ahead_m: float, seed: int
) -> None:
    spec = GridSpec(0.1, 60, 50, (-3.0, -2.5))
    classes = np.random.default_rng(seed).integers(0, 4, spec.shape).astype(np.uint8)
    grid = OccupancyGrid(spec, classes)
    area = start_area(pose(x, y, yaw), radius_m, ahead_m, 60.0, 0)
    after = with_start_area(grid, area).classes
    changed = after != classes
    assert (classes[changed] == MapClass.UNKNOWN).all()
    assert (after[changed] == MapClass.GRASS).all()
    iy, ix = np.nonzero(changed)
    centres = spec.center_of(np.column_stack([ix, iy]))
    assert (np.hypot(*(centres - (x, y)).T) <= abs(ahead_m) + radius_m + 1e-9).all()
    # a stadium: along the robot's axis from the base to the end, and half the width beside it
    axis = np.array([math.cos(yaw), math.sin(yaw)])
    along, beside = (centres - (x, y)) @ axis, (centres - (x, y)) @ np.array([-axis[1], axis[0]])
    assert (np.abs(beside) <= radius_m + 1e-9).all()
    assert (along >= min(0.0, ahead_m) - radius_m - 1e-9).all()
    assert (along <= max(0.0, ahead_m) + radius_m + 1e-9).all()


def test_the_gap_to_the_ground_that_is_seen() -> None:
    spec = GridSpec(0.1, 60, 50, (-3.0, -2.5))
    grid = OccupancyGrid.unknown(spec)
    area = start_area(pose(0.0, 0.0), 0.5, 1.0, 60.0, 0)
    assert gap_m(grid, area) is None
    grid.classes[:, 50:] = MapClass.GRASS  # from x = 2 on; the area ends at 1.5
    assert gap_m(grid, area) == pytest.approx(0.45, abs=0.02)
    grid.classes[:, 45:] = MapClass.GRASS
    assert gap_m(grid, area) == 0
