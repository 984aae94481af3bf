"""What differs between the distributions of ROS 2 that swardmap meets; nothing else asks which one it is.

| | Humble | Jazzy | Kilted and later |
|---|---|---|---|
| events of a subscription | `rclpy.qos_event` | `rclpy.event_handler` | as Jazzy |
| relative topics of Nav2's layers | below the costmap | below the costmap | beside it |
| cost 253 through an OccupancyGrid | 251 | 251 | 253 |

The messages themselves (sensor_msgs, nav_msgs, geometry_msgs, tf2_msgs, map_msgs, diagnostic_msgs) are the
same in all of them; a test holds that against their definitions. Humble's own Python is 3.10, older than
swardmap takes: it needs one of another source, such as conda's.
"""

import importlib
from typing import Any

EVENT_MODULES = ("rclpy.event_handler", "rclpy.qos_event")


def subscription_events() -> Any:
    """The class SubscriptionEventCallbacks of this rclpy; None if it has none.

    Humble has it elsewhere. Without it rclpy warns of publishers that offer less than is asked for, which
    `Subscription.follow` mends anyway.
    """
    for name in EVENT_MODULES:
        try:
            return importlib.import_module(name).SubscriptionEventCallbacks
        except (ImportError, AttributeError):
            continue
    return None
