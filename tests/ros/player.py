"""A program of its own, with plain rclpy: plays a recording to the node, writes down all it publishes.

python -m tests.ros.player BAG OUT.npz NAMESPACE [--drop 0.3] [--best-effort] [--late 0.0] [--count N]
"""

import argparse
import importlib
import json
import random
import struct
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Bool, String


def optional(module: str, name: str) -> Any:
    """A message type, or None where this ROS lacks it."""
    try:
        return getattr(importlib.import_module(module), name)
    except ImportError:
        return None


LabelInfo = optional("vision_msgs.msg", "LabelInfo")
OccupancyGridUpdate = optional("map_msgs.msg", "OccupancyGridUpdate")

TYPES = {
    "tf2_msgs/msg/TFMessage": optional("tf2_msgs.msg", "TFMessage"),
    "sensor_msgs/msg/Image": Image,
    "sensor_msgs/msg/CameraInfo": CameraInfo,
    "nav_msgs/msg/Odometry": Odometry,
}
COMES_UP_S = 150.0
"""The node compiles its kernels first, on a machine that has none of them yet."""

SETTLED = 10
"""Reports in which nothing more is mapped: a second."""

OF_FRAMES = ("mask", "confidence", "cloud", "obstacles")
UPDATES = set() if OccupancyGridUpdate is None else {"map_updates", "costmap_updates"}
"""One that was missed would be missing for ever."""

STAMP = struct.Struct("<iI")
TF_COUNT = 4
"""Bytes before the stamp of the first of a message of transforms: how many there are."""

LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


def restamped(data: bytes, shift_ns: int, tf: bool = False) -> bytes:
    """The same message at another time: the stamp is the first field of its header, behind 4 bytes of CDR.

    Of a message of transforms there must be one alone.
    """
    at = 4 + (TF_COUNT if tf else 0)
    sec, nanosec = STAMP.unpack_from(data, at)
    stamp = sec * 1_000_000_000 + nanosec + shift_ns
    out = bytearray(data)
    STAMP.pack_into(out, at, stamp // 1_000_000_000, stamp % 1_000_000_000)
    return bytes(out)


class Ears:
    """Everything the node says."""

    def __init__(self, node: Any, cameras: list[str]) -> None:
        self.heard: dict[str, Any] = {}
        self.stops: list[tuple[float, bool]] = []
        self.health: list[dict[str, Any]] = []
        self.diagnostics = self.updates = 0
        self.shift_ns = 0
        self.before: dict[str, int] = {}
        for camera in cameras:
            at = "" if camera == "camera" else f"{camera}/"
            for kind in ("mask", "confidence"):
                node.create_subscription(Image, f"swardmap/{camera}/{kind}", self.image(f"{at}{kind}"), 50)
            for kind in ("cloud", "obstacles"):
                node.create_subscription(
                    PointCloud2, f"swardmap/{camera}/{kind}", self.cloud(f"{at}{kind}"), 50
                )
        for kind in ("map", "costmap"):
            node.create_subscription(OccupancyGrid, f"swardmap/{kind}", self.grid(kind), LATCHED)
        node.create_subscription(Bool, "swardmap/stop", self.stop, LATCHED)
        node.create_subscription(String, "swardmap/health_json", self.say, 50)
        node.create_subscription(String, "swardmap/labels_json", self.labels, LATCHED)
        if LabelInfo is not None:
            node.create_subscription(LabelInfo, "swardmap/label_info", self.label_info, LATCHED)
        if OccupancyGridUpdate is not None:
            for kind in ("map", "costmap"):
                node.create_subscription(
                    OccupancyGridUpdate, f"swardmap/{kind}_updates", self.update(kind), 50
                )
        node.create_subscription(DiagnosticArray, "/diagnostics", self.diagnose, 50)

    def complete(self, cameras: list[str], last_ns: int) -> bool:
        """Whether the node is done with all that was sent, and all that it said of it has come."""
        if len(self.health) < SETTLED:
            return False
        before, now = self.health[-SETTLED], self.health[-1]
        if before["stamp_ns"] - self.shift_ns <= last_ns or before["mapped"] != now["mapped"]:
            return False
        for camera in cameras:
            at = "" if camera == "camera" else f"{camera}/"
            for kind in OF_FRAMES:
                heard = sum(name.startswith(f"{at}{kind}/") for name in self.heard)
                if heard != now["mapped"].get(camera, 0) - self.before.get(camera, 0):
                    return False
        newest = max((self.newest(f"{c}/mask/") for c in cameras), default=0)
        newest = max(newest, self.newest("mask/"))
        return newest == 0 or {f"map/{newest}", f"costmap/{newest}"} <= set(self.heard)

    def newest(self, prefix: str) -> int:
        return max((int(n.rpartition("/")[2]) for n in self.heard if n.startswith(prefix)), default=0)

    def stamp(self, message: Any) -> int:
        return int(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec - self.shift_ns)

    def image(self, kind: str) -> Any:
        def take(m: Any) -> None:
            pixels = np.frombuffer(m.data, np.uint8).reshape(m.height, m.width)
            self.heard[f"{kind}/{self.stamp(m)}"] = pixels

        return take

    def cloud(self, kind: str) -> Any:
        def take(m: Any) -> None:
            at = {field.name: field.offset for field in m.fields}
            layout = np.dtype({"names": ["xyz", "label"], "formats": ["(3,)<f4", "<u4"],
                               "offsets": [at["x"], at["label"]], "itemsize": m.point_step})  # fmt: skip
            points = np.frombuffer(m.data, layout)
            self.heard[f"{kind}/{self.stamp(m)}"] = np.column_stack([points["xyz"], points["label"]])

        return take

    def grid(self, kind: str) -> Any:
        def take(m: Any) -> None:
            values = np.array(m.data, np.int8).reshape(m.info.height, m.info.width)
            origin = m.info.origin.position
            stamp = self.stamp(m)
            self.heard[f"{kind}/{stamp}"] = values
            self.heard[f"{kind}_at/{stamp}"] = np.array([origin.x, origin.y, m.info.resolution])
            self.heard[f"{kind}_last"] = values
            self.heard[f"{kind}_at_last"] = np.array([origin.x, origin.y, m.info.resolution])
            self.heard[f"{kind}_patched"] = values.copy()
            most = self.heard.get(f"{kind}_most", values)  # the one with the most free cells
            self.heard[f"{kind}_most"] = max(most, values, key=lambda v: int((v == 0).sum()))

        return take

    def update(self, kind: str) -> Any:
        def take(m: Any) -> None:
            part = np.array(m.data, np.int8).reshape(m.height, m.width)
            self.heard[f"{kind}_patched"][m.y : m.y + m.height, m.x : m.x + m.width] = part
            self.updates += 1

        return take

    def label_info(self, m: Any) -> None:
        named = [{"class_id": c.class_id, "class_name": c.class_name} for c in m.class_map]
        self.heard["labels"] = np.array(json.dumps(named))

    def stop(self, m: Any) -> None:
        self.stops.append((time.time(), m.data))

    def say(self, m: Any) -> None:
        self.health.append(json.loads(m.data))

    def labels(self, m: Any) -> None:
        self.heard["labels"] = np.array(m.data)

    def diagnose(self, m: Any) -> None:
        self.diagnostics += any(s.name == "swardmap" for s in m.status)


def until(node: Any, done: Any, seconds: float) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.02)
        if done():
            return True
    return False


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("bag", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("namespace")
    parser.add_argument("--drop", type=float, default=0.0)
    parser.add_argument("--best-effort", action="store_true", help="offer images and odometry as best effort")
    parser.add_argument("--late", type=float, default=0.0, help="poses come so long after their images")
    parser.add_argument("--cameras", default="camera", help="names, with commas between")
    parser.add_argument("--wait", type=float, default=60.0, help="so long at most for all that is to come")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=10_000)
    args = parser.parse_args()
    rclpy.init()
    node = rclpy.create_node("player", namespace=args.namespace)
    cameras = args.cameras.split(",")
    ears = Ears(node, cameras)
    with AnyReader([args.bag]) as reader:
        messages = [(t, c.topic, c.msgtype, bytes(data)) for c, t, data in reader.messages()]
    sends = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)
    loses = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
    of_sensors = loses if args.best_effort else sends
    sensors = {topic for _, topic, kind, _ in messages if kind.endswith(("Image", "Odometry"))}
    pubs = {
        topic: node.create_publisher(
            TYPES[kind],
            topic.lstrip("/"),
            LATCHED if topic == "/tf_static" else of_sensors if topic in sensors else sends,
        )
        for _, topic, kind, _ in messages
    }
    wanted = {f"{camera}/{kind}" for camera in cameras for kind in OF_FRAMES} | UPDATES

    def heard_as_offered(topic: str) -> bool:
        asked = [
            info.qos_profile.reliability for info in node.get_subscriptions_info_by_topic(topic.lstrip("/"))
        ]
        return asked == [of_sensors.reliability]

    def ready() -> bool:
        heard = bool(ears.health) and wanted <= set(ears.health[-1]["listened_to"])
        heard = heard and all(p.get_subscription_count() for p in pubs.values())
        return heard and all(heard_as_offered(topic) for topic in sensors)

    if not until(node, ready, COMES_UP_S):
        sys.stderr.write("the node did not come up\n")
        return 1
    ears.before = ears.health[-1]["mapped"]  # by the node, of what was played to it before
    times = sorted({t for t, *_ in messages})[args.first : args.first + args.count]
    ears.shift_ns = time.time_ns() - times[0]
    random.seed(0)
    later: list[tuple[float, str, bytes]] = []
    for at in times:
        until(node, lambda at=at: time.time_ns() >= at + ears.shift_ns, 60)
        for t, topic, _, data in messages:
            if t != at or random.random() < args.drop:
                continue
            if args.late and "odom" in topic:
                later.append((time.time() + args.late, topic, data))
            else:
                pubs[topic].publish(restamped(data, ears.shift_ns, topic.startswith("/tf")))
        for due, topic, data in [item for item in later if item[0] <= time.time()]:
            pubs[topic].publish(restamped(data, ears.shift_ns))
            later.remove((due, topic, data))
    for due, topic, data in later:
        until(node, lambda due=due: time.time() >= due, 10)
        pubs[topic].publish(restamped(data, ears.shift_ns))
    until(node, lambda: ears.complete(cameras, max(times)), args.wait)
    told = {"health": ears.health, "stops": ears.stops, "diagnostics": ears.diagnostics,
            "updates": ears.updates}  # fmt: skip
    np.savez(args.out, told=json.dumps(told), **ears.heard)
    node.destroy_node()
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
