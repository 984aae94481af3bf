"""What a driver hears of the node: costmap with its updates, obstacles, persons, stop flag."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Pose
from swardmap.grid import GridSpec
from swardmap.io.bags.ros_messages import stamp_ns
from swardmap.labels import PERSON
from swardmap.ros.driver import Heard
from swardmap.ros.gate_node import cell_centres_m, cloud_points_m, point_labels
from swardmap.ros.topics import find_types, latched_qos

LOW_M, FEW = 0.12, 10
"""Somebody shows so many points at least that lie higher than that above the ground of the robot."""


def upright_m(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the points (N, 3) of persons, in the robot's base, those of somebody: not of a spot on the lawn."""
    high = points_m[points_m[:, 2] > LOW_M]
    return high if len(high) >= FEW else high[:0]


class DriverEars:
    """Subscribes to the node's outputs.

    Args:
        node: of rclpy, in the namespace of the node that is heard.
        now_s: the clock that says when something came.
        T_map_base_at: pose of the robot at the stamp of an image; None where it is not known.
        T_base_camera: where the camera sits.

    Attributes:
        heard: what came, and when.
        mapped_ns: stamp of the newest costmap; 0 = none came.
        node_ns: what time the node's last report was of; 0 = none came.
    """

    def __init__(
        self,
        node: Any,
        now_s: Callable[[], float],
        T_map_base_at: Callable[[int], Pose | None],
        T_base_camera: Pose,
    ) -> None:
        from nav_msgs.msg import OccupancyGrid
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import Bool, String

        self.heard, self.mapped_ns, self.node_ns = Heard(), 0, 0
        self._now_s, self._T_map_base_at, self._T_base_camera = now_s, T_map_base_at, T_base_camera
        update = find_types()["updates"]
        node.create_subscription(OccupancyGrid, "swardmap/costmap", self.on_costmap, latched_qos())
        node.create_subscription(PointCloud2, "swardmap/obstacle_cells", self.on_cells, 1)
        node.create_subscription(PointCloud2, "swardmap/camera/obstacles", self.on_seen, 5)
        node.create_subscription(Bool, "swardmap/stop", self.on_stop, 1)  # not the latched one: it is old
        node.create_subscription(String, "swardmap/health_json", self.on_health, 1)
        if update is not None:
            node.create_subscription(update, "swardmap/costmap_updates", self.on_update, 10)

    def on_stop(self, message: Any) -> None:
        """Take the stop flag."""
        self.heard.gate.stop, self.heard.gate.flag_s = bool(message.data), self._now_s()

    def on_health(self, message: Any) -> None:
        """Take what time it is for the node; before it has heard of a clock it is 0."""
        self.node_ns = int(json.loads(message.data)["stamp_ns"])

    def on_cells(self, message: Any) -> None:
        """Take the obstacles of the map."""
        T_map_base = self.heard.gate.T_map_base
        frame = "" if T_map_base is None else T_map_base.parent
        self.heard.gate.cells_m, self.heard.gate.cells_s = cell_centres_m(message, frame), self._now_s()

    def on_seen(self, message: Any) -> None:
        """Take the persons that the last image shows; the map remembers those who left its view, too."""
        T_map_base = self._T_map_base_at(stamp_ns(message.header.stamp))
        if T_map_base is not None:
            seen = cloud_points_m(message)[point_labels(message) == PERSON.id]
            self.heard.persons_m = T_map_base.apply(upright_m(self._T_base_camera.apply(seen)))[:, :2]

    def on_costmap(self, message: Any) -> None:
        """Take a whole costmap."""
        info, origin = message.info, message.info.origin.position
        spec = GridSpec(info.resolution, info.width, info.height, (origin.x, origin.y))
        self.heard.spec = spec
        self.heard.costs = np.array(message.data, np.int8).reshape(spec.shape)
        self._costs_came(message)

    def on_update(self, message: Any) -> None:
        """Take what of it has changed."""
        if self.heard.costs is not None:
            part = np.array(message.data, np.int8).reshape(message.height, message.width)
            x, y = message.x, message.y
            self.heard.costs[y : y + message.height, x : x + message.width] = part
            self._costs_came(message)

    def _costs_came(self, message: Any) -> None:
        self.heard.costs_s = self._now_s()
        self.mapped_ns = max(self.mapped_ns, stamp_ns(message.header.stamp))
