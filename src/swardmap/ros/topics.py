"""Which message types this ROS has, and with which QoS the node speaks; rclpy is imported late."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from swardmap.errors import require

HINT = (
    "That is for a machine without ROS; on one with ROS 2, source its setup.bash and use its Python "
    "(docs/robot.md)."
)

OPTIONAL: Mapping[str, tuple[str, str]] = {
    "tf2_msgs.msg:TFMessage": ("tf", "poses come from odometry only: set source.odometry_topic"),
    "map_msgs.msg:OccupancyGridUpdate": ("updates", "maps are always sent whole"),
    "vision_msgs.msg:LabelInfo": ("label_info", "classes are told as JSON on ~/labels_json"),
    "vision_msgs.msg:Detection3DArray": ("persons", "persons are told as JSON on ~/persons_json"),
    "diagnostic_msgs.msg:DiagnosticArray": ("diagnostics", "faults are told as JSON on ~/health_json only"),
    "std_srvs.srv:Trigger": (
        "services",
        "there are no services such as ~/clear and ~/save",
    ),
    "bond.msg:Status": ("bond", "no bond with Nav2's lifecycle manager: set its bond_timeout to 0.0"),
}
"""Types a ROS may lack: what they are for, and what the node does without them."""


RELIABLE, BEST_EFFORT = "reliable", "best_effort"


def rclpy_module() -> Any:
    """rclpy, or the message that says how to get it.

    Raises:
        MissingExtraError: if there is none.
    """
    return require("rclpy", "ros", HINT)


@dataclass(frozen=True)
class Types:
    """The optional message types that this ROS has.

    Attributes:
        found: by purpose (`tf`, `updates`, `label_info`, `diagnostics`, `services`), class or None.
        without: a sentence for each that is missing.
    """

    found: Mapping[str, Any]
    without: tuple[str, ...]

    def __getitem__(self, purpose: str) -> Any:
        return self.found[purpose]


def find_types() -> Types:
    """Look which optional message types can be imported."""
    found: dict[str, Any] = {}
    without = []
    for name, (purpose, instead) in OPTIONAL.items():
        module, _, cls = name.partition(":")
        try:
            found[purpose] = getattr(importlib.import_module(module), cls)
        except (ImportError, AttributeError):
            found[purpose] = None
            without.append(f"without {module.split('.')[0]}: {instead}")
    return Types(found, tuple(without))


def image_qos(reliability: str, depth: int) -> Any:
    """Sensor data: volatile, `reliable` or `best_effort`, with so many messages held."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    policies = {BEST_EFFORT: ReliabilityPolicy.BEST_EFFORT, RELIABLE: ReliabilityPolicy.RELIABLE}
    return QoSProfile(depth=depth, reliability=policies[reliability], durability=DurabilityPolicy.VOLATILE)


def latched_qos(depth: int = 1) -> Any:
    """Maps and labels: reliable, and the last one reaches those who come later."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
    )
