"""Images between two processes over Fast DDS: as it comes, and with the profile of the package.

    python benchmarks/bench_dds.py                # about a minute; needs pip install 'swardmap[ros]'

Four streams of 640 x 480 RGB, 15 a second, reliable or best effort, from one process with rclpy to another:
how many arrive, and how long after they were sent.
"""

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.ros.messages import ros_message
from swardmap.ros.topics import BEST_EFFORT, RELIABLE, image_qos

PROFILE = Path(__file__).parent.parent / "src/swardmap/data/nav2/fastdds.xml"
STREAMS, RATE_HZ, COUNT, BYTES = 4, 15.0, 90, 640 * 480 * 3


def listen(reliability: str) -> None:
    """Take images until none comes any more, and print a row."""
    import rclpy
    from sensor_msgs.msg import Image

    rclpy.init()
    node = rclpy.create_node("listener")
    taken_ms: list[float] = []
    last_s = time.monotonic()

    def on_image(message: Any) -> None:
        nonlocal last_s
        last_s = time.monotonic()
        taken_ms.append((time.time_ns() - int(message.header.frame_id)) / 1e6)

    for i in range(STREAMS):
        node.create_subscription(Image, f"stream_{i}", on_image, image_qos(reliability, 5))
    while time.monotonic() - last_s < (3.0 if taken_ms else 30.0):
        rclpy.spin_once(node, timeout_sec=0.1)
    p50, p90, most = np.percentile(taken_ms or [np.nan], [50, 90, 100])
    share = 100 * len(taken_ms) / (STREAMS * COUNT)
    print(f"{share:.0f} % | {p50:.0f} | {p90:.0f} | {most:.0f} |", flush=True)


def send(reliability: str) -> None:
    """Send, evenly in time."""
    import rclpy
    from sensor_msgs.msg import Image

    rclpy.init()
    node = rclpy.create_node("sender")
    publishers = [
        node.create_publisher(Image, f"stream_{i}", image_qos(reliability, 5)) for i in range(STREAMS)
    ]
    image = ros_message(Image, {"data": np.zeros(BYTES, np.uint8)})
    while not all(publisher.get_subscription_count() for publisher in publishers):
        rclpy.spin_once(node, timeout_sec=0.1)
    begin = time.monotonic()
    for i in range(COUNT):
        for publisher in publishers:
            image.header.frame_id = str(time.time_ns())
            publisher.publish(image)
        time.sleep(max(0.0, begin + (i + 1) / RATE_HZ - time.monotonic()))
    time.sleep(2.0)  # what is to be sent again


def run(name: str, reliability: str, more: dict[str, str]) -> None:
    print(f"| {name} | ", end="", flush=True)
    env = os.environ | {"ROS_DOMAIN_ID": str(1 + os.getpid() % 99)} | more
    listener = subprocess.Popen([sys.executable, __file__, "listen", reliability], env=env)
    subprocess.run([sys.executable, __file__, "send", reliability], env=env, check=True, timeout=100)
    listener.wait(timeout=100)


def main() -> None:
    if len(sys.argv) == 3:
        {"listen": listen, "send": send}[sys.argv[1]](sys.argv[2])
        return
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before the run\n")
    print("| | arrived | p50 ms | p90 | most |\n|---|---:|---:|---:|---:|", flush=True)
    profile = {"FASTRTPS_DEFAULT_PROFILES_FILE": str(PROFILE)}
    for reliability in (BEST_EFFORT, RELIABLE):
        run(f"as it comes, {reliability.replace('_', ' ')}", reliability, {})
        run(f"profile, {reliability.replace('_', ' ')}", reliability, profile)


if __name__ == "__main__":
    main()
