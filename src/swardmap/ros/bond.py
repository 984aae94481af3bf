"""The bond with Nav2's lifecycle manager: a sign of life, ten times a second, while the node is active.

The manager makes one half with the node's name as id, and takes the robot down when the other half falls
silent (bond_core/bondcpp/src/bond.cpp, bondStatusCB; nav2_lifecycle_manager, createBondConnection). A node of
Nav2 makes the other half in `LifecycleNode::createBond`, with the same numbers.
"""

import uuid
from typing import Any

from swardmap.io.bags.ros_fields import Fields, header_fields
from swardmap.ros.messages import ros_message

PERIOD_S = 0.1
TIMEOUT_S = 4.0
TOPIC = "bond"


class Bond:
    """The node's half; it does not listen to the manager's.

    Args:
        node: of rclpy.
        status_type: bond.msg.Status.
    """

    def __init__(self, node: Any, status_type: Any) -> None:
        from rclpy.clock import Clock, ClockType

        self._node, self._type = node, status_type
        self._instance = str(uuid.uuid4())
        self._publisher = node.create_publisher(status_type, TOPIC, 5)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # the manager's timeouts are of a steady clock too
        self._timer = node.create_timer(PERIOD_S, self.beat, clock=steady)

    def beat(self) -> None:
        """A sign of life."""
        self._send(True)

    def break_(self) -> None:
        """End it in order: the manager is told, and need not wait for the silence."""
        self._node.destroy_timer(self._timer)
        self._send(False)
        self._node.destroy_publisher(self._publisher)

    def _send(self, active: bool) -> None:
        now_ns = int(self._node.get_clock().now().nanoseconds)
        fields = status_fields(self._node.get_name(), self._instance, active, now_ns)
        self._publisher.publish(ros_message(self._type, fields))


def status_fields(node_name: str, instance: str, active: bool, stamp_ns: int) -> Fields:
    """bond/msg/Status."""
    return {
        "header": header_fields(stamp_ns, ""), "id": node_name, "instance_id": instance, "active": active,
        "heartbeat_timeout": TIMEOUT_S, "heartbeat_period": PERIOD_S,
    }  # fmt: skip
