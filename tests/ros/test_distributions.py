"""The messages of Humble, Jazzy, Kilted and later are the same as far as the node uses them."""

import subprocess
import sys
from importlib.util import find_spec
from types import ModuleType, SimpleNamespace

import pytest
from rosbags.typesys import Stores, get_typestore

from swardmap.ros.distributions import subscription_events
from swardmap.ros.map_outputs import OF_MAP
from swardmap.ros.outputs import OF_CAMERA, OF_NODE
from tests.ros.node_process import environment

OLDER = {"ROS2_DASHING", "ROS2_ELOQUENT", "ROS2_FOXY", "ROS2_GALACTIC"}
STORES = {
    store.name.removeprefix("ROS2_").lower(): get_typestore(store)
    for store in Stores
    if store.name.startswith("ROS2_") and store.name not in OLDER
}
HEARD = (
    "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo",
    "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/Twist",
    "geometry_msgs/msg/TwistStamped",
)  # fmt: skip
SENT = {*OF_CAMERA.values(), *OF_NODE.values(), *OF_MAP.values(), "diagnostic_msgs/msg/DiagnosticArray"}
USED = sorted({name for name in (*HEARD, *SENT) if not name.startswith(("vision_msgs", "map_msgs"))})
"""rosbags carries no definitions of these two packages."""


@pytest.mark.parametrize("name", USED)
def test_a_message_is_the_same_in_all_distributions(name: str) -> None:
    """By its hash (REP-2011), which all fields and those of the messages within go into."""
    assert {"humble", "jazzy", "kilted"} <= set(STORES)
    hashes = {each: store.hash_rihs01(name) for each, store in STORES.items() if name in store.types}
    assert {"humble", "jazzy", "kilted"} <= set(hashes)
    assert len(set(hashes.values())) == 1, hashes


PROGRAM = """
import importlib, sys
import rclpy
rclpy.init()
node = rclpy.create_node("hashes")
for name in sys.argv[1:]:
    package, _, cls = name.split("/")
    try:
        kind = getattr(importlib.import_module(f"{package}.msg"), cls)
    except ImportError:
        continue
    publisher = node.create_publisher(kind, f"hash_{cls}", 1)
    for _ in range(100):
        infos = node.get_publishers_info_by_topic(f"hash_{cls}")
        if infos:
            break
        rclpy.spin_once(node, timeout_sec=0.05)
    print(name, infos[0].topic_type_hash)
rclpy.shutdown()
"""


@pytest.mark.slow
def test_this_ros_announces_the_hashes_of_the_definitions() -> None:
    if find_spec("rclpy") is None:
        pytest.skip("rclpy is not installed (pip install 'swardmap[ros]')")
    command = [sys.executable, "-c", PROGRAM, *USED]
    done = subprocess.run(command, env=environment(), check=True, capture_output=True, text=True, timeout=100)
    told = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert {"sensor_msgs/msg/Image", "nav_msgs/msg/OccupancyGrid"} <= set(told)
    for name, said in told.items():
        assert STORES["jazzy"].hash_rihs01(name).lower() in said.lower().replace(" ", ""), name


@pytest.mark.parametrize("module", ["event_handler", "qos_event"])
def test_events_are_found_where_the_distribution_has_them(
    module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("rclpy", "rclpy.event_handler", "rclpy.qos_event"):
        monkeypatch.setitem(sys.modules, name, None)  # an import of it fails
    assert subscription_events() is None
    found = ModuleType(f"rclpy.{module}")
    monkeypatch.setattr(found, "SubscriptionEventCallbacks", SimpleNamespace, raising=False)
    monkeypatch.setitem(sys.modules, "rclpy", ModuleType("rclpy"))
    monkeypatch.setitem(sys.modules, f"rclpy.{module}", found)
    assert subscription_events() is SimpleNamespace
