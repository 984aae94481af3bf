"""A subscription that is as reliable as those who publish its topic; rclpy is imported late."""

from collections.abc import Callable, Sequence
from typing import Any

from swardmap.ros.distributions import subscription_events
from swardmap.ros.topics import BEST_EFFORT, RELIABLE, image_qos

AUTO = "auto"
FOLLOW_S = 0.5
"""How often to look at what those who publish offer."""


def fitting(offered_reliable: Sequence[bool], now: str) -> str:
    """The most reliable way to hear every publisher of a topic.

    Args:
        offered_reliable: whether each publisher offers to be reliable.
        now: how the topic is heard, which stays where nobody publishes: a driver may just start again.

    Returns:
        `reliable` or `best_effort`.
    """
    if not offered_reliable:
        return now
    return RELIABLE if all(offered_reliable) else BEST_EFFORT


class Subscription:
    """A subscription to images or poses.

    A reliable subscription hears nothing of a publisher that offers best effort. Best effort hears all, but
    loses images that are larger than DDS's shared memory (Fast DDS, as it comes: 0.5 MB) on a busy machine.

    Args:
        node: of rclpy.
        cls: message type.
        topic: its name before remapping.
        callback: is given each message.
        reliability: `reliable`, `best_effort`, or `auto`: reliable where all publishers offer it. Call
            `follow` every `FOLLOW_S`, since a driver may come late, or come back offering something else.
        depth: messages that DDS holds.
    """

    def __init__(
        self,
        node: Any,
        cls: Any,
        topic: str,
        callback: Callable[[Any], None],
        reliability: str,
        depth: int,
    ) -> None:
        self._node, self._cls, self._topic = node, cls, topic
        self._callback, self._depth = callback, depth
        self._follows = reliability == AUTO
        self.reliability = RELIABLE if self._follows else reliability
        self._subscription = self._subscribed()
        self.follow()

    def follow(self) -> None:
        """Subscribe anew if the publishers of now need it; to be called on the thread that spins the node."""
        if not self._follows:
            return
        from rclpy.qos import ReliabilityPolicy

        name = self._subscription.topic_name  # as remapped
        offered = [
            info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
            for info in self._node.get_publishers_info_by_topic(name)
        ]
        wanted = fitting(offered, self.reliability)
        if wanted == self.reliability:
            return
        self.reliability = wanted
        self.destroy()  # before the new one is there, or an image is heard twice
        self._subscription = self._subscribed()
        self._tell(name, sum(offered), len(offered))

    def destroy(self) -> None:
        """Take the subscription back."""
        self._node.destroy_subscription(self._subscription)

    def _subscribed(self) -> Any:
        # rclpy would warn that nothing is heard of who offers less, which `follow` mends
        callbacks = subscription_events() if self._follows else None
        events = None if callbacks is None else callbacks(incompatible_qos=_ignore)
        qos = image_qos(self.reliability, self._depth)
        return self._node.create_subscription(
            self._cls, self._topic, self._callback, qos, event_callbacks=events
        )

    def _tell(self, name: str, reliable: int, publishers: int) -> None:
        log = self._node.get_logger()
        if self.reliability == RELIABLE:
            log.info(f"{name} is offered as reliable now, and heard so")
        elif reliable:
            log.warning(f"{name} has {publishers} publishers, not all of them reliable: heard as best effort")
        else:
            log.warning(f"{name} is offered as best effort: large messages may get lost (docs/robot.md)")


def _ignore(_: Any) -> None:
    pass
