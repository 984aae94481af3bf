"""The gate as a ROS 2 node: `cmd_vel_in` goes to `cmd_vel` while nothing speaks against it.

python -m swardmap.ros.gate_node --ros-args -p margin_m:=0.28 -r odom:=/odometry/global
"""

import dataclasses
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swardmap.config.settings import build
from swardmap.errors import ConfigError, SwardmapError
from swardmap.io.bags.ros_messages import pose_from_odometry
from swardmap.ros.gate import Command, GateConfig, GateInputs, refusal
from swardmap.ros.near_frame import in_frame
from swardmap.ros.subscription import AUTO, FOLLOW_S, Subscription
from swardmap.ros.topics import rclpy_module

ZEROS_HZ = 20.0
"""While the robot must not move it is told so as often, whether commands come or not."""


class GateNode:
    """Topics in: cmd_vel_in, odom, swardmap/stop, swardmap/obstacle_cells. Out: cmd_vel, ~/reason.

    Parameters are those of `GateConfig`, and `stamped`: TwistStamped in place of Twist.
    """

    def __init__(self) -> None:
        from geometry_msgs.msg import Twist, TwistStamped
        from nav_msgs.msg import Odometry
        from rclpy.node import Node
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import Bool, String

        self.node = Node("swardmap_gate")
        fields = dataclasses.fields(GateConfig)
        values = {f.name: self.node.declare_parameter(f.name, f.default).value for f in fields}
        self.config: GateConfig = build(GateConfig, values)
        self.stamped = bool(self.node.declare_parameter("stamped", False).value)
        self.inputs, self.frames = GateInputs(), {"map": "", "pose": ""}
        self.command, self.reason = Command(0.0, 0.0), ""
        self._twist, self._string = TwistStamped if self.stamped else Twist, String
        self._out = self.node.create_publisher(self._twist, "cmd_vel", 1)
        self._reasons = self.node.create_publisher(String, "~/reason", 1)
        self.node.create_subscription(self._twist, "cmd_vel_in", self.on_command, 1)
        odometry = Subscription(self.node, Odometry, "odom", self.on_odometry, AUTO, 10)
        self.node.create_subscription(
            Bool, "swardmap/stop", self.on_flag, 1
        )  # not the latched one: it is old
        self.node.create_subscription(PointCloud2, "swardmap/obstacle_cells", self.on_cells, 1)
        self.node.create_timer(1 / ZEROS_HZ, self.hold)
        self.node.create_timer(FOLLOW_S, odometry.follow)

    def on_command(self, message: Any) -> None:
        """Let a command through, or say why not."""
        twist = message.twist if self.stamped else message
        self.command = Command(twist.linear.x, twist.angular.z)
        reason = self._refusal()
        self._say(reason)
        if not reason:
            self._out.publish(message)
        else:
            self.hold()

    def on_flag(self, message: Any) -> None:
        """Take the stop flag."""
        self.inputs.stop, self.inputs.flag_s = bool(message.data), time.monotonic()

    def on_odometry(self, message: Any) -> None:
        """Take the robot's pose."""
        self.inputs.T_map_base, self.inputs.pose_s = pose_from_odometry(message), time.monotonic()
        self.frames["pose"] = message.header.frame_id.strip("/")

    def on_cells(self, message: Any) -> None:
        """Take the obstacles of the map, which far from its origin come in a frame near the robot."""
        frame = message.header.frame_id.strip("/")
        points, self.frames["map"] = in_frame(cloud_points_m(message), frame, self.frames["pose"])
        self.inputs.cells_m, self.inputs.cells_s = points[:, :2], time.monotonic()

    def hold(self) -> None:
        """Zeros, while the last command is refused."""
        if self._refusal():
            message = self._twist()
            if self.stamped:
                message.header.stamp = self.node.get_clock().now().to_msg()
            self._out.publish(message)

    def _refusal(self) -> str:
        reason = refusal(self.command, self.inputs, time.monotonic(), self.config)
        if not reason and self.command.moves and self.frames["map"] != self.frames["pose"]:
            return f"the map is in the frame '{self.frames['map']}', the pose in '{self.frames['pose']}'"
        return reason

    def _say(self, reason: str) -> None:
        if reason.partition(" is ")[0] != self.reason.partition(" is ")[0]:  # not every change of a distance
            self.node.get_logger().info(reason or "the way is free")
        self.reason = reason
        self._reasons.publish(self._string(data=reason))


def cell_centres_m(message: Any, frame: str = "") -> np.ndarray[Any, np.dtype[np.float64]]:
    """(N, 2) x and y of a sensor_msgs/PointCloud2 with float32 coordinates, in `frame` if it is near that."""
    return in_frame(cloud_points_m(message), message.header.frame_id.strip("/"), frame)[0][:, :2]


def cloud_points_m(message: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(N, 3) points of a sensor_msgs/PointCloud2 with float32 coordinates."""
    points = _points(message, dict.fromkeys("xyz", "<f4"))
    return np.column_stack([points[axis] for axis in "xyz"]).astype(np.float64)


def point_labels(message: Any) -> np.ndarray[Any, np.dtype[np.uint32]]:
    """(N,) labels of a sensor_msgs/PointCloud2 with uint32 labels."""
    return _points(message, {"label": "<u4"})["label"].copy()


def _points(message: Any, formats: Mapping[str, str]) -> np.ndarray[Any, np.dtype[np.void]]:
    offsets = {field.name: field.offset for field in message.fields}
    layout = np.dtype(
        {"names": list(formats), "formats": list(formats.values()),
         "offsets": [offsets[name] for name in formats], "itemsize": message.point_step}
    )  # fmt: skip
    return np.frombuffer(message.data, layout, count=message.width * message.height)


def run_gate(arguments: Sequence[str] = ()) -> None:
    """Run the gate until Ctrl-C or a shutdown of ROS.

    Args:
        arguments: `--ros-args` and what follows.

    Raises:
        MissingExtraError: if there is no rclpy.
        ConfigError: if a parameter is out of range, or a ROS argument wrong.
    """
    rclpy = rclpy_module()
    from rclpy.executors import ExternalShutdownException

    try:
        rclpy.init(args=[sys.argv[0], *arguments])
    except RuntimeError as error:  # a parameter file that is none, a remapping that is misspelt
        raise ConfigError(f"ROS arguments: {' '.join(str(error).split())}") from error
    try:
        rclpy.spin(GateNode().node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass  # how a node is stopped
    finally:
        rclpy.try_shutdown()


def main() -> None:
    """Entry point of `ros2 run swardmap_ros gate`."""
    try:
        run_gate(sys.argv[1:])
    except SwardmapError as error:
        raise SystemExit(f"swardmap: {error}") from error


if __name__ == "__main__":
    main()
