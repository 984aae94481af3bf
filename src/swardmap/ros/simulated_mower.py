"""A mower without a robot: it drives a garden, publishes camera, odometry, tf and clock, and obeys the node.

It is the clock, too: simulated time waits for the node, so that a slow machine sees the same drive later.
"""

import json
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

from swardmap.geometry import Intrinsics, Pose
from swardmap.io.bags.ros_fields import (
    camera_info_fields,
    image_fields,
    odometry_fields,
    tf_fields,
    time_fields,
)
from swardmap.ros.driver import NOWHERE, STILL, Driver
from swardmap.ros.driver_ears import DriverEars
from swardmap.ros.gate import Command
from swardmap.ros.grants import AWAITED, Grants
from swardmap.ros.messages import ros_message
from swardmap.ros.topics import find_types, latched_qos, rclpy_module
from swardmap.types import Frame

PERIOD_NS = 100_000_000
LAG_NS = 200_000_000
"""So much older than the newest image at most is the costmap that the mower drives by."""

BEHIND_NS = 500_000_000
"""And so much at most is the clock behind that the node has heard of."""

KEEPS_UP_S = 20.0
"""So long at most time stands still for the node; for one that is dead the silent stop flag stands in."""

REACHED_M, SETS_OUT_M = 0.6, 0.2
HISTORY = 100
"""Of what it says of itself, the last ten seconds reach those who come later."""

LAST_WORD_S = 5.0
"""So long at most it waits until its last word is heard."""

OPTICAL = "camera"
REMEMBERED = 50
"""Images whose poses are known."""


class Passerby(Protocol):
    """Somebody who walks in."""

    def position_m(self, stamp_ns: int) -> tuple[float, float]:
        """(x, y) at a time."""


class MowerWorld(Protocol):
    """What it drives through, in the frame `map`; it starts at (0, 0), heading along +x.

    Attributes:
        name: in words.
        intrinsics: of the camera.
        T_base_camera: where the camera sits.
        rate_hz: images a second.
        via_m: (x, y) to pass on the way there.
        goal_m: (x, y) to go to, and come back from.
    """

    name: str
    intrinsics: Intrinsics
    T_base_camera: Pose
    rate_hz: float
    via_m: tuple[float, float]
    goal_m: tuple[float, float]

    @property
    def visit(self) -> Passerby:
        """Who walks in."""

    def begin_visit(self, stamp_ns: int | None) -> None:
        """Let them set out at a time; None = they wait."""

    def base_at(self, x_m: float, y_m: float, yaw_rad: float) -> Pose:
        """T_map_base of a mower that stands there."""

    def look(self, T_map_base: Pose, stamp_ns: int) -> Frame:
        """What the camera sees."""


class SimulatedMower:
    """Drives to the goal and back, round after round.

    Args:
        node: of rclpy.
        garden: where.
        pace: at most so many times as fast as it would be.

    Attributes:
        rounds: driven.
    """

    def __init__(self, node: Any, garden: MowerWorld, pace: float = 1.0) -> None:
        self.node, self.garden, self.rounds = node, garden, 0
        self._wall_s = PERIOD_NS / 1e9 / pace
        self._place = [0.0, 0.0, 0.0]
        self._now_ns, self._imaged_ns = time.time_ns(), 0
        self._goals_m = [garden.via_m, garden.goal_m, (0.0, 0.0)]
        self._meets, self._reason = False, "it waits for the node"
        self._driver, self._command = Driver(), Command(0.0, 0.0)
        self._looked_from: dict[int, Pose] = {}
        self._ears = DriverEars(node, lambda: self._now_ns / 1e9, self._looked_from.get, garden.T_base_camera)
        self._round_ns, self._way_m, self._nearest_m = self._now_ns, 0.0, math.inf
        self._grants = Grants(node)
        self._tf = find_types()["tf"]
        self._publish_to = _publishers(node, self._tf)

    @property
    def T_map_base(self) -> Pose:
        """Where it is."""
        return self.garden.base_at(*self._place)

    def step(self) -> None:
        """A tenth of a second: look, listen, drive."""
        due = time.monotonic() + self._wall_s
        self._publish()
        self._listen(due)
        heard = self._ears.heard
        heard.gate.T_map_base, heard.gate.pose_s = self.T_map_base, self._now_ns / 1e9
        goal_m = self._goals_m[0]
        self._command, reason = self._driver.command(goal_m, heard, self._now_ns / 1e9)
        if reason == NOWHERE and self._way_m < SETS_OUT_M:
            self._grants.ask(self._now_ns)
        if self._grants.awaited(self._now_ns):
            self._command, reason = STILL, reason or AWAITED
        self._say(reason)
        self._move()
        self._tell()
        self._now_ns += PERIOD_NS

    def wait_until_heard(self) -> None:
        """Wait until who listens has its last word: a publisher that goes takes it along."""
        from rclpy.duration import Duration

        self._publish_to["~/status_json"].wait_for_all_acked(Duration(seconds=LAST_WORD_S))

    def _publish(self) -> None:
        """Clock, pose, and images when they are due."""
        now_ns, T_map_base = self._now_ns, self.T_map_base
        self._send("clock", {"clock": time_fields(now_ns)})
        self._send("odom", odometry_fields(T_map_base, now_ns))
        if self._tf is not None:
            mount = replace(self.garden.T_base_camera, child=OPTICAL)
            self._send("/tf", tf_fields([T_map_base], now_ns))
            self._send("/tf_static", tf_fields([mount], now_ns))
        if now_ns - self._imaged_ns < 1e9 / self.garden.rate_hz - 1:
            return
        self._imaged_ns = now_ns
        frame = self.garden.look(T_map_base, now_ns)
        self._looked_from[now_ns] = T_map_base
        if len(self._looked_from) > REMEMBERED:
            self._looked_from.pop(min(self._looked_from))
        info = camera_info_fields(frame.intrinsics, now_ns, OPTICAL)
        for kind, image in (("color", frame.rgb), ("depth", frame.depth)):
            self._send(f"{kind}/camera_info", info)
            self._send(f"{kind}/image_raw", image_fields(image, now_ns, OPTICAL))

    def _send(self, topic: str, fields: Any) -> None:
        publisher = self._publish_to[topic]
        publisher.publish(ros_message(publisher.msg_type, fields))

    def _listen(self, due_s: float) -> None:
        """Until the next step is due, and the node has mapped what it was shown."""
        rclpy, begun_s = rclpy_module(), time.monotonic()
        while rclpy.ok():
            now_s = time.monotonic()
            if now_s >= due_s and not (self._runs_ahead() and now_s - begun_s < KEEPS_UP_S):
                return
            rclpy.spin_once(self.node, timeout_sec=max(0.005, due_s - now_s))

    def _runs_ahead(self) -> bool:
        """Whether the node is there, and behind with its clock or its map."""
        ears = self._ears
        if not ears.node_ns:
            return False
        unmapped_ns = self._imaged_ns - ears.mapped_ns if ears.mapped_ns else 0
        return self._now_ns - ears.node_ns > BEHIND_NS or unmapped_ns > LAG_NS

    def _move(self) -> None:
        """As a unicycle does for a tenth of a second."""
        x, y, yaw = self._place
        seconds, forward = PERIOD_NS / 1e9, self._command.forward_mps
        yaw += self._command.turn_rps * seconds
        x, y = x + forward * seconds * math.cos(yaw), y + forward * seconds * math.sin(yaw)
        self._place = [x, y, math.remainder(yaw, 2 * math.pi)]
        self._way_m += abs(forward) * seconds
        self._nearest_m = min(self._nearest_m, math.dist((x, y), self.garden.visit.position_m(self._now_ns)))
        if len(self._goals_m) > 1 and not self._meets and math.hypot(x, y) > SETS_OUT_M:
            self._meets = True
            self.garden.begin_visit(self._now_ns)
        if math.dist((x, y), self._goals_m[0]) < REACHED_M:
            self._goals_m = self._goals_m[1:]
            self._arrive()

    def _arrive(self) -> None:
        log, left = self.node.get_logger(), len(self._goals_m)
        if left == 1:
            log.info("at the goal: it comes back")
        if left:
            return
        seconds = (self._now_ns - self._round_ns) / 1e9
        log.info(
            f"back at the start: {self._way_m:.1f} m in {seconds:.0f} s, "
            f"the person never nearer to the base than {self._nearest_m:.2f} m"
        )
        self.rounds += 1
        self._goals_m = [self.garden.via_m, self.garden.goal_m, (0.0, 0.0)]
        self._round_ns, self._way_m, self._nearest_m, self._meets = self._now_ns, 0.0, math.inf, False
        self.garden.begin_visit(None)

    def _say(self, reason: str) -> None:
        """A line for each change; not for every change of a distance."""
        if reason.partition(" is ")[0] != self._reason.partition(" is ")[0]:
            self.node.get_logger().info(f"stands: {reason}" if reason else "drives")
        self._reason = reason

    def _tell(self) -> None:
        """Where it is and why it stands, for tests and viewers."""
        twist = self._publish_to["cmd_vel"].msg_type()
        twist.linear.x, twist.angular.z = self._command.forward_mps, self._command.turn_rps
        self._publish_to["cmd_vel"].publish(twist)
        told = {
            "stamp_ns": self._now_ns, "place": self._place, "reason": self._reason, "rounds": self.rounds,
            "goes_out": len(self._goals_m) > 1, "person_m": self.garden.visit.position_m(self._now_ns),
            "start_areas": self._grants.count,
        }  # fmt: skip
        status = self._publish_to["~/status_json"]
        status.publish(status.msg_type(data=json.dumps(told)))


def _publishers(node: Any, tf: Any) -> dict[str, Any]:
    from geometry_msgs.msg import Twist
    from nav_msgs.msg import Odometry
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import CameraInfo, Image
    from std_msgs.msg import String

    kinds: dict[str, tuple[Any, Any]] = {
        "clock": (Clock, 10), "odom": (Odometry, 50), "cmd_vel": (Twist, 1),
        "~/status_json": (String, latched_qos(HISTORY)),
        "color/image_raw": (Image, 5), "depth/image_raw": (Image, 5),
        "color/camera_info": (CameraInfo, 5), "depth/camera_info": (CameraInfo, 5),
    }  # fmt: skip
    if tf is not None:
        kinds |= {"/tf": (tf, 50), "/tf_static": (tf, latched_qos())}
    return {topic: node.create_publisher(kind, topic, qos) for topic, (kind, qos) in kinds.items()}


def run_mower(garden: MowerWorld, arguments: Sequence[str], rounds: int | None, pace: float) -> None:
    """Drive until so many rounds are driven, or ROS is shut down.

    Args:
        garden: where.
        arguments: `--ros-args` and what follows.
        rounds: None = for ever.
        pace: at most so many times as fast as it would be.
    """
    rclpy = rclpy_module()
    from rclpy.executors import ExternalShutdownException

    rclpy.init(args=["simulated_mower", *arguments])
    mower = SimulatedMower(rclpy.create_node("simulated_mower"), garden, pace)
    mower.node.get_logger().info(f"a mower in {garden.name}, {garden.rate_hz:g} images a second")
    try:
        while rclpy.ok() and (rounds is None or mower.rounds < rounds):
            mower.step()
        if rclpy.ok():
            mower.wait_until_heard()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass  # how it is stopped
    except RuntimeError:  # RCLError is one: in the middle of a step there is no ROS any more
        if rclpy.ok():
            raise
    finally:
        rclpy.try_shutdown()
