"""A program of its own, with plain rclpy: a live robot with one camera, whose faults are injected one by one.

python -m tests.ros.faults OUT.json NAMESPACE PID FAULT ...

For each fault: streams until all is well, injects it until it is named, the robot stopped and nothing given
as free (where the fault demands that), then streams well again until the node has recovered. What happened
goes into OUT.json. Waits are for events; how long they may take is generous, as the machine may be busy.
"""

import json
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Bool, String

from swardmap.io.bags.ros_fields import Fields, odometry_fields
from swardmap.ros.messages import ros_message
from tests.ros import drive
from tests.ros.drive import ONE, base_at, camera_fields, view

LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
LONG_S = 60.0
TICK_S = 0.1
FREE_CELLS = 1000
VIEWS = 20


class Robot:
    """Streams images and poses, ten a second, and listens."""

    def __init__(self, node: Any) -> None:
        self.node, self.ticks = node, 0
        self.health: dict[str, Any] = {"faults": [], "stop": True}
        self.diagnosed: set[str] = set()
        self.stop, self.free, self.lethal, self.masks = True, 0, 0, list[int]()
        self.fault = ""
        self.late: deque[tuple[float, dict[str, Fields]]] = deque()
        sends = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)
        self.odometry = node.create_publisher(Odometry, "odom", sends)
        self.images = {
            topic: node.create_publisher(CameraInfo if "info" in topic else Image, topic, sends)
            for topic in ("color/camera_info", "depth/camera_info", "color/image_raw", "depth/image_raw")
        }
        node.create_subscription(String, "swardmap/health_json", self.take_health, 50)
        node.create_subscription(DiagnosticArray, "/diagnostics", self.take_diagnostics, 50)
        node.create_subscription(Bool, "swardmap/stop", self.take_stop, LATCHED)
        node.create_subscription(OccupancyGrid, "swardmap/costmap", self.take_costs, LATCHED)
        node.create_subscription(Image, "swardmap/camera/mask", self.take_mask, 50)

    def take_health(self, m: Any) -> None:
        self.health = json.loads(m.data)

    def take_diagnostics(self, m: Any) -> None:
        self.diagnosed = {s.message for s in m.status if s.level != b"\x00"}

    def take_stop(self, m: Any) -> None:
        self.stop = m.data

    def take_costs(self, m: Any) -> None:
        costs = np.array(m.data, np.int8)
        self.free, self.lethal = int((costs == 0).sum()), int((costs == 100).sum())

    def take_mask(self, m: Any) -> None:
        self.masks.append(m.header.stamp.sec * 1_000_000_000 + m.header.stamp.nanosec)

    def named(self, fault: str) -> bool:
        """Whether the fault is told as JSON, and on /diagnostics."""
        told = any(f["fault"] == fault for f in self.health["faults"])
        return told and any(fault in message for message in self.diagnosed)

    def until(self, done: Callable[[], bool], seconds: float = LONG_S) -> float | None:
        """Stream until something holds; how many seconds it took, or None."""
        begin = time.monotonic()
        while time.monotonic() - begin < seconds:
            self.tick()
            if done():
                return time.monotonic() - begin
        return None

    def tick(self, period_s: float = TICK_S) -> int:
        end = time.monotonic() + period_s
        stamp_ns = time.time_ns()
        i = self.ticks % VIEWS
        x_m = 0.05 * min(i, VIEWS - i)
        if self.fault != "lost pose":
            self.odometry.publish(ros_message(Odometry, odometry_fields(base_at(x_m), stamp_ns)))
        if self.fault in SPOILS:
            self.send(SPOILS[self.fault](self, i, x_m, stamp_ns))
        else:
            self.send(look(i, x_m, stamp_ns))
        self.ticks += 1
        while (left := end - time.monotonic()) > 0:
            rclpy.spin_once(self.node, timeout_sec=left)
        return stamp_ns

    def send(self, images: dict[str, Fields] | None) -> None:
        for topic, fields in (images or {}).items():
            publisher = self.images[topic]
            publisher.publish(ros_message(publisher.msg_type, fields))


def look(i: int, x_m: float, stamp_ns: int, change: Callable[[Any], Any] | None = None) -> dict[str, Fields]:
    frame = view(drive.rig_of(ONE), "camera", x_m, i)
    frame = frame if change is None else change(frame)
    return {topic: fields for topic, (_, fields) in camera_fields(frame, "camera", stamp_ns).items()}


def late(robot: Robot, i: int, x_m: float, stamp_ns: int) -> dict[str, Fields] | None:
    """Images that come 1.6 s late, one after another."""
    robot.late.append((time.monotonic() + 1.6, look(i, x_m, stamp_ns)))
    return robot.late.popleft()[1] if robot.late[0][0] <= time.monotonic() else None


def one_of(n: int) -> Callable[..., dict[str, Fields] | None]:
    return lambda robot, i, x_m, stamp_ns: None if robot.ticks % n else look(i, x_m, stamp_ns)


def changed(**fields: Callable[[Any], Any]) -> Callable[..., dict[str, Fields]]:
    from dataclasses import replace

    def change(frame: Any) -> Any:
        return replace(frame, **{name: of(frame) for name, of in fields.items()})

    return lambda _, i, x_m, stamp_ns: look(i, x_m, stamp_ns, change)


def shifted(seconds: float) -> Callable[..., dict[str, Fields]]:
    return lambda _, i, x_m, stamp_ns: look(i, x_m, stamp_ns + round(seconds * 1e9))


SPOILS: dict[str, Callable[..., dict[str, Fields] | None]] = {
    "stopped": lambda *_: None,
    "stale": late,
    "slow": one_of(5),
    "falling frame rate": one_of(2),
    "frozen": lambda _, __, ___, stamp_ns: look(3, 0.15, stamp_ns),
    "black": changed(rgb=lambda f: np.zeros_like(f.rgb)),
    "flipped": changed(rgb=lambda f: f.rgb[::-1, ::-1], depth=lambda f: f.depth[::-1, ::-1]),
    "no depth": changed(depth=lambda f: np.zeros_like(f.depth)),
    "stamp jumped ahead": shifted(2.0),
    "stamp jumped back": shifted(-3.0),
}
WARNINGS = ("slow", "falling frame rate")


def inject(robot: Robot, fault: str) -> dict[str, Any]:
    """One fault, from well to well; seconds until each thing happened, None if it never did."""
    told: dict[str, Any] = {"well": robot.until(lambda: not robot.stop and robot.free > FREE_CELLS)}
    if fault == "falling frame rate":
        robot.until(lambda: False, 5.0)  # a rate to fall from
    robot.fault = fault
    told["named"] = robot.until(lambda: robot.named(fault))
    told["faults"] = robot.health["faults"]
    if fault not in WARNINGS:
        told["stopped"] = robot.until(lambda: robot.stop)
        told["nothing_free"] = robot.until(lambda: robot.free == 0)
        told["lethal_left"] = robot.lethal
    robot.fault = ""
    robot.late.clear()
    recovered = robot.until(lambda: not robot.stop and robot.free > FREE_CELLS and not robot.named(fault))
    return told | {"recovered": recovered}


def flood(robot: Robot) -> dict[str, Any]:
    """More images than any network here can take, then few again: the newest is mapped, the rest counted."""
    robot.until(lambda: len(robot.masks) > 5 and not robot.named("full queue"))
    begin, sent = time.monotonic(), list[int]()
    while not (robot.named("full queue") and len(sent) > 100) and time.monotonic() - begin < LONG_S:
        sent.append(robot.tick(0.01))
    told: dict[str, Any] = {"named": robot.named("full queue")}
    deadline = time.monotonic() + LONG_S
    while (not robot.masks or robot.masks[-1] < sent[-1]) and time.monotonic() < deadline:
        rclpy.spin_once(robot.node, timeout_sec=0.1)
    told |= {"sent": sent, "masks": [stamp for stamp in robot.masks if stamp >= sent[0]]}
    robot.fault = "slow"
    told["recovered"] = robot.until(lambda: not robot.named("full queue"))
    return told | {"left_out": robot.health["left_out"]}


def terminate(robot: Robot, pid: int) -> dict[str, Any]:
    """The node is ended in order: the last it says must be stop, nothing free."""
    told: dict[str, Any] = {"well": robot.until(lambda: not robot.stop and robot.free > FREE_CELLS)}
    os.kill(pid, signal.SIGTERM)
    told["stopped"] = robot.until(lambda: robot.stop and robot.free == 0)
    return told


def results(robot: Robot, faults: list[str], pid: int) -> Iterator[tuple[str, dict[str, Any]]]:
    for fault in faults:
        if fault == "terminated":
            yield fault, terminate(robot, pid)
        else:
            yield fault, flood(robot) if fault == "full queue" else inject(robot, fault)


def main() -> int:
    out, namespace, pid, *faults = sys.argv[1:]
    for i in range(VIEWS):  # rendered before the clock runs
        look(i, 0.05 * min(i, VIEWS - i), 0)
    rclpy.init()
    robot = Robot(rclpy.create_node("robot", namespace=namespace))
    begin = time.monotonic()
    while not robot.odometry.get_subscription_count() and time.monotonic() - begin < LONG_S:
        rclpy.spin_once(robot.node, timeout_sec=0.1)
    Path(out).write_text(json.dumps(dict(results(robot, faults, int(pid)))))
    robot.node.destroy_node()
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
