"""Start areas for a simulated mower, asked for by the node's service."""

from typing import Any

ASKS_NS, ANSWERS_NS = 3_000_000_000, 30_000_000_000
"""It is not asked for more often than this, and so long at most an answer is waited for."""

AWAITED = "a start area was asked for"


class Grants:
    """The operator beside the mower, who grants it a start area when it cannot set out.

    Args:
        node: of rclpy.

    Attributes:
        count: start areas that the node has granted.
    """

    def __init__(self, node: Any) -> None:
        from std_srvs.srv import Trigger

        self._client = node.create_client(Trigger, "swardmap/grant_start_area")
        self._request, self._asked_ns, self.count = Trigger.Request(), 0, 0
        self._answer: Any = None

    def ask(self, now_ns: int) -> None:
        """Ask for one, unless that was done just now or nobody would hear it."""
        again = now_ns - self._asked_ns > ASKS_NS and not self.awaited(now_ns)
        if again and self._client.service_is_ready():
            self._asked_ns = now_ns
            self._answer = self._client.call_async(self._request)
            self._answer.add_done_callback(self._take)

    def awaited(self, now_ns: int) -> bool:
        """Whether the node has been asked and may still answer: till then nobody waves the mower on."""
        asked = self._answer is not None and not self._answer.done()
        return asked and now_ns - self._asked_ns <= ANSWERS_NS

    def _take(self, answer: Any) -> None:
        self.count += bool(answer.result().success)
