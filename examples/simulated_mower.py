"""A mower in a simulated garden, to try node and gate without a robot: it drives, a person stands ahead.

Start `swardmap ros` and `python -m swardmap.ros.gate_node` first (docs/robot.md). The mower publishes the
images of its camera and its odometry, asks for 0.4 m/s, and does what comes back on cmd_vel. Its world waits
for the answer, so that on a busy machine it drives the same way later. It ends once it has stood for three
seconds for an obstacle, for twenty for anything else, or has run into the person.
"""

import sys
import time
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String

from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.io.bags.ros_fields import camera_info_fields, image_fields, odometry_fields
from swardmap.ros.messages import ros_message
from swardmap.synth.analytic import StereoNoise, render, with_sensor_noise
from swardmap.synth.analytic_scene import Scene, Walker

CAMERA = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
T_base_camera = mount_pose(0.9, 25.0, xy_m=(0.3, 0.0), parent="base_link", child="camera_optical")
PERSON_X_M, FRONT_M = 6.0, 0.5
SPEED_MPS, PERIOD_S = 0.4, 0.1
STANDS_S, WAITS_S, TURN_UP_S = 3.0, 20.0, 60.0
"""It ends after standing so long for an obstacle, for another reason, and before it has set out."""

ANSWERS_S = 2.0
"""So long at most it waits for an answer; without one it stands."""

GARDEN = Scene(persons=(Walker((PERSON_X_M, 0.1)),), name="lawn")


class Mower:
    """Where it is, and what it was told last."""

    def __init__(self, node: Any) -> None:
        self.node, self.x_m, self.told_mps, self.answered = node, 0.0, 0.0, False
        self.reason = ""
        self.rng = np.random.default_rng(0)
        self.odometry = node.create_publisher(Odometry, "odom", 10)
        self.wish = node.create_publisher(Twist, "cmd_vel_in", 1)
        kinds = {"color/image_raw": Image, "depth/image_raw": Image,
                 "color/camera_info": CameraInfo, "depth/camera_info": CameraInfo}  # fmt: skip
        self.camera = {topic: node.create_publisher(kind, topic, 5) for topic, kind in kinds.items()}
        node.create_subscription(Twist, "cmd_vel", self.on_told, 1)
        node.create_subscription(String, "swardmap_gate/reason", self.on_reason, 1)

    def on_told(self, message: Twist) -> None:
        self.told_mps, self.answered = message.linear.x, True

    def on_reason(self, message: String) -> None:
        self.reason = message.data

    @property
    def patience_s(self) -> float:
        """How long it stands before it ends."""
        if self.reason.startswith("an obstacle"):
            return STANDS_S
        return WAITS_S if self.x_m > 0 else TURN_UP_S

    def step(self) -> None:
        """A tenth of a second of this world: drive, look, ask to go on, and wait for what comes back."""
        until = time.monotonic() + PERIOD_S
        self.x_m += self.told_mps * PERIOD_S
        self.told_mps, self.answered = 0.0, False
        stamp_ns = time.time_ns()
        T_map_base = Pose("map", "base_link", np.eye(4) + self.x_m * np.eye(4, k=3))
        frame = render(GARDEN, CAMERA, T_map_base @ T_base_camera)
        frame = with_sensor_noise(frame, self.rng, StereoNoise())
        rgb = np.clip(frame.rgb + self.rng.normal(0, 2, frame.rgb.shape), 0, 255).astype(np.uint8)
        info = camera_info_fields(CAMERA, stamp_ns, "camera_optical")
        images = {"color/camera_info": info, "depth/camera_info": info,
                  "color/image_raw": image_fields(rgb, stamp_ns, "camera_optical"),
                  "depth/image_raw": image_fields(frame.depth, stamp_ns, "camera_optical")}  # fmt: skip
        self.odometry.publish(ros_message(Odometry, odometry_fields(T_map_base, stamp_ns)))
        for topic, fields in images.items():
            publisher = self.camera[topic]
            publisher.publish(ros_message(publisher.msg_type, fields))
        wish = Twist()
        wish.linear.x = SPEED_MPS
        self.wish.publish(wish)
        while (left := until - time.monotonic()) > 0 or (not self.answered and left > -ANSWERS_S):
            rclpy.spin_once(self.node, timeout_sec=max(left, 0.01))


def main() -> int:
    rclpy.init(args=sys.argv)
    mower = Mower(rclpy.create_node("simulated_mower"))
    start_s = moved_s = time.monotonic()
    while mower.x_m + FRONT_M < PERSON_X_M:
        before_m = mower.x_m
        mower.step()
        now_s = time.monotonic()
        if mower.x_m != before_m:
            moved_s = now_s
        if int(mower.x_m) != int(before_m):
            print(f"at {mower.x_m:.2f} m")
        if now_s - moved_s > mower.patience_s:
            break
    left_m = PERSON_X_M - mower.x_m - FRONT_M
    print(f"drove {mower.x_m:.2f} m in {time.monotonic() - start_s:.0f} s, {left_m:.2f} m left to the person")
    rclpy.shutdown()
    return 0 if mower.x_m > 0 and left_m > 0 else 1


if __name__ == "__main__":
    sys.exit(main())
