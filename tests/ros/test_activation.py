"""The node's threads and last words, in one process with the test."""

import os
import uuid
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

from swardmap.config import config_from_dict
from swardmap.errors import InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.pipeline import ObstacleMapper
from swardmap.ros.node import RobotNode
from swardmap.ros.parameters import NodeConfig, Parameters
from tests.ros.node_process import environment

if find_spec("rclpy") is None:
    pytest.skip("rclpy is not installed (pip install 'swardmap[ros]')", allow_module_level=True)

SETTINGS = {"segmenter": {"name": "colour"}, "source": {"odometry_topic": "odom"}}
SPEC = GridSpec(0.05, 40, 30)


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Iterator[RobotNode]:
    """A node that is active, and publishes a map every 5 s."""
    import rclpy

    for name, value in environment().items():
        if os.environ.get(name) != value:
            monkeypatch.setenv(name, value)
    monkeypatch.setattr("swardmap.ros.node.warm_up", lambda *_: None)
    rclpy.init(args=["test", "--ros-args", "-r", f"__ns:=/test_{uuid.uuid4().hex}"])
    node = RobotNode(Parameters(NodeConfig(map_rate_hz=0.2), config_from_dict(SETTINGS)))
    assert node.start()
    yield node
    node.close()
    rclpy.try_shutdown()


def published(robot: RobotNode, monkeypatch: pytest.MonkeyPatch) -> list[OccupancyGrid]:
    """Maps that are given to the publishers from now on."""
    maps: list[OccupancyGrid] = []
    monkeypatch.setattr(robot._outputs, "publish_map", lambda grid, *_: maps.append(grid))
    return maps


def given_out(robot: RobotNode, monkeypatch: pytest.MonkeyPatch) -> ObstacleMapper:
    """Let a free map be given out; the mapper that holds it."""
    assert robot.pipeline is not None
    mapper = robot.pipeline.mapper._mapper
    free = OccupancyGrid(SPEC, np.full(SPEC.shape, MapClass.GRASS, np.uint8), 1)
    held = {mapper: free}
    monkeypatch.setattr(ObstacleMapper, "map", property(lambda self: held.get(self)))
    assert robot.pipeline.given_out(None) is not None
    return mapper


def test_threads_of_an_activation_end_with_it_and_do_not_come_back(robot: RobotNode) -> None:
    first = list(robot._threads)
    assert len(first) == 2
    robot.node.trigger_deactivate()
    robot.node.trigger_activate()
    for thread in first:
        thread.join(timeout=6.0)  # longer than a map takes to be due again
    assert not [thread for thread in first if thread.is_alive()]
    assert all(thread.is_alive() for thread in robot._threads)


def test_a_map_that_a_thread_of_before_still_makes_is_not_published(
    robot: RobotNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would come after the last word, and call free what nobody looks at any more."""
    given_out(robot, monkeypatch)
    ended, maps = robot._ended, published(robot, monkeypatch)
    robot.node.trigger_deactivate()
    assert maps, "the last word"
    maps.clear()
    assert robot.pipeline is not None
    assert robot._outputs is not None
    robot._publish_map(robot.pipeline, robot._outputs, ended=ended)
    assert not maps
    robot._publish_map(robot.pipeline, robot._outputs)
    assert maps, "of one that has not ended it is"


def test_the_last_map_is_sent_even_if_the_grid_cannot_be_made(
    robot: RobotNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, maps = given_out(robot, monkeypatch), published(robot, monkeypatch)

    def grid_of(mapper: ObstacleMapper) -> Any:
        if mapper is held:
            raise InvalidValueError("grid: expected between 1 and 400000000 cells")

    monkeypatch.setattr(ObstacleMapper, "map", property(grid_of))
    robot.node.trigger_deactivate()
    assert maps[-1].spec == SPEC
    assert (maps[-1].classes == MapClass.UNKNOWN).all()


def test_a_last_map_that_cannot_be_sent_is_told_and_the_node_goes_on(
    robot: RobotNode, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    given_out(robot, monkeypatch)

    def fails(*_: object) -> None:
        raise RuntimeError("publisher is invalid")

    with monkeypatch.context() as patch:
        patch.setattr(robot._outputs, "publish_map", fails)
        robot.node.trigger_deactivate()
    assert "the last map was not published: publisher is invalid" in capfd.readouterr().err
    robot.node.trigger_activate()
    assert all(thread.is_alive() for thread in robot._threads)
