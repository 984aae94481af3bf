"""The bond as Nav2's lifecycle manager judges it (bondcpp/src/bond.cpp of ros/bond_core, bondStatusCB)."""

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from swardmap.ros import bond


class Sister:
    """The manager's half: alive by a status of another instance with its id, dead by one not active."""

    def __init__(self, name: str) -> None:
        self.id, self.instance, self.sister, self.state = name, "manager", "", "waiting"

    def take(self, status: dict[str, Any]) -> None:
        if status["id"] != self.id or status["instance_id"] == self.instance:
            return
        self.sister = self.sister or status["instance_id"]
        assert status["instance_id"] == self.sister, "more than two locations use one bond"
        self.state = "alive" if status["active"] else "dead"


class Node:
    """What a bond needs of a node."""

    def __init__(self, name: str, sister: Sister) -> None:
        self.name, self.sister, self.timers = name, sister, list[Any]()
        self.topics = list[tuple[str, int]]()

    def get_name(self) -> str:
        return self.name

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=5_000_000_000))

    def create_publisher(self, _: Any, topic: str, depth: int) -> Any:
        self.topics.append((topic, depth))
        return SimpleNamespace(publish=self.sister.take)

    def destroy_publisher(self, _: Any) -> None:
        self.topics.clear()

    def create_timer(self, period_s: float, callback: Any, clock: Any) -> Any:
        self.timers.append((period_s, callback))
        return callback

    def destroy_timer(self, timer: Any) -> None:
        self.timers = [t for t in self.timers if t[1] != timer]


def test_the_manager_has_it_while_the_node_is_active(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(Clock=lambda clock_type: None, ClockType=SimpleNamespace(STEADY_TIME=1))
    monkeypatch.setitem(sys.modules, "rclpy", SimpleNamespace(clock=clock))
    monkeypatch.setitem(sys.modules, "rclpy.clock", clock)
    monkeypatch.setattr(bond, "ros_message", lambda _, fields: fields)
    sister = Sister("swardmap")
    node = Node("swardmap", sister)
    for _ in range(2):  # the manager makes a new one each time that it activates the node
        sister.sister, sister.state = "", "waiting"
        half = bond.Bond(node, "status")
        ((period_s, beat),) = node.timers
        assert node.topics[0][0] == "bond"
        assert period_s < bond.TIMEOUT_S / 10
        for _ in range(3):
            beat()
        assert sister.state == "alive"
        half.break_()
        assert sister.state == "dead"
        assert not node.timers
