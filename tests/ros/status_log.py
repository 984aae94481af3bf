"""A program of its own, with plain rclpy: writes down what a simulated mower says until it is back.

python -m tests.ros.status_log NAMESPACE OUT.json
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

SILENCE_S = 300.0
FROM_BEFORE = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
"""What was said before this program was discovered is heard, too."""


def main() -> int:
    rclpy.init()
    node, told = rclpy.create_node("status_log", namespace=sys.argv[1]), list[dict[str, Any]]()
    node.create_subscription(
        String, "simulated_mower/status_json", lambda m: told.append(json.loads(m.data)), FROM_BEFORE
    )
    count, heard_s = 0, time.monotonic()
    while not (told and told[-1]["rounds"]):
        rclpy.spin_once(node, timeout_sec=0.5)
        if len(told) > count:
            count, heard_s = len(told), time.monotonic()
        if time.monotonic() - heard_s > SILENCE_S:
            sys.stderr.write(f"nothing is heard of the mower; the last: {told[-1:]}\n")
            return 1
    Path(sys.argv[2]).write_text(json.dumps(told), encoding="utf-8")
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
