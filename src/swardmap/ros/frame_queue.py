"""Between the callbacks and the mapper: each camera's oldest frame goes first, never the newest of any.

A queue shared by all cameras would starve one of them: of two that give frames at the same time, the second
would always push the first one's out.
"""

import threading
from collections import Counter, deque
from typing import Generic, TypeVar

Item = TypeVar("Item")


class FrameQueue(Generic[Item]):
    """A short queue for each camera, and one consumer; `put` never waits.

    Args:
        capacity: how many of one camera may wait.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.dropped: Counter[str] = Counter()
        self._items: dict[str, deque[tuple[int, Item]]] = {}
        self._count = 0
        self._changed = threading.Condition()

    def __len__(self) -> int:
        with self._changed:
            return sum(map(len, self._items.values()))

    @property
    def longest(self) -> int:
        """How many frames of one camera wait at most."""
        with self._changed:
            return max(map(len, self._items.values()), default=0)

    def put(self, camera: str, item: Item) -> None:
        """Append; if the camera's queue is full its oldest item is dropped and counted."""
        with self._changed:
            waiting = self._items.setdefault(camera, deque())
            if len(waiting) >= self.capacity:
                waiting.popleft()
                self.dropped[camera] += 1
            self._count += 1
            waiting.append((self._count, item))
            self._changed.notify()

    def get(self, timeout_s: float | None = None) -> Item | None:
        """Take the item that came first of all; None if none comes in time."""
        with self._changed:
            if not self._changed.wait_for(lambda: len(self), timeout_s):
                return None
            waiting = (items for items in self._items.values() if items)
            return min(waiting, key=lambda items: items[0][0]).popleft()[1]

    def clear(self) -> None:
        """Drop all that waits, uncounted: the map it was for is gone."""
        with self._changed:
            self._items.clear()
