"""A frame near the robot for clouds of a map whose coordinates are large; the functions need no ROS.

Nav2 and PCL read the points of a cloud as float32, whose steps are half a metre at a UTM northing. Such a
cloud is given in a frame that lies at whole multiples of 10 km in the map. Its name says where: one name
never means two places, so that nobody takes the points of one by the transform of another.
"""

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Pose
from swardmap.io.bags.ros_fields import tf_fields
from swardmap.ros.messages import ros_message
from swardmap.ros.topics import latched_qos

SPACING_M = 10_000
"""Between such frames: within half of it, and some metres, float32 is exact to 0.25 mm."""

NAME = re.compile(r"(?P<parent>.+)_e(?P<x>-?\d+)_n(?P<y>-?\d+)")

STATIC = "/tf_static"

XY = tuple[float, float]


def near_frame(map_frame: str, around_m: XY) -> Pose | None:
    """T_map_near of the frame for points about a place; None = the map's own frame will do.

    Args:
        map_frame: name of the map's frame.
        around_m: (x, y) in the map, where the points are.

    >>> near_frame("map", (500_123.0, 5_000_456.0)).child
    'map_e500000_n5000000'
    >>> near_frame("map", (120.0, -40.0)) is None
    True
    """
    x, y = (SPACING_M * round(v / SPACING_M) for v in around_m)
    if x == y == 0:
        return None
    matrix = np.eye(4)
    matrix[:2, 3] = x, y
    return Pose(map_frame, f"{map_frame}_e{x}_n{y}", matrix)


def in_frame(points_m: NDArray[np.float64], frame: str, wanted: str) -> tuple[NDArray[np.float64], str]:
    """Points in the frame that is wanted, where theirs is a `near_frame` of it by its name; else as they are.

    Args:
        points_m: (N, 3).
        frame: that they are in.
        wanted: the frame they should be in.

    Returns:
        The points, and the frame they are in.
    """
    named = NAME.fullmatch(frame)
    if frame == wanted or named is None or named["parent"] != wanted:
        return points_m, frame
    return points_m + np.array([float(named["x"]), float(named["y"]), 0.0]), wanted


class NearFrames:
    """Tells of frames near the robot on /tf_static.

    Args:
        node: of rclpy.
        tf_type: tf2_msgs.msg.TFMessage, or None.
    """

    def __init__(self, node: Any, tf_type: Any) -> None:
        self._node, self._type = node, tf_type
        self._told: dict[str, Pose] = {}
        self._publisher: Any = None

    def tell(self, T_map_near: Pose | None, stamp_ns: int) -> None:
        """Publish a frame, if it is new; None = there is none to be told of."""
        if T_map_near is None or T_map_near.child in self._told:
            return
        self._told[T_map_near.child] = T_map_near
        if self._type is None:  # the gate reads it from the name, and Nav2 is not without tf
            self._node.get_logger().warning(
                f"obstacle_cells are in '{T_map_near.child}', which nobody is told of without tf2_msgs"
            )
            return
        if self._publisher is None:  # few robots need it
            self._publisher = self._node.create_publisher(self._type, STATIC, latched_qos())
        fields = tf_fields(list(self._told.values()), stamp_ns)  # all: only the last message is latched
        self._publisher.publish(ros_message(self._type, fields))

    def destroy(self) -> None:
        """Take the publisher back."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
