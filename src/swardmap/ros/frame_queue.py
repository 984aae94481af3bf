"""Between the callbacks and the mapper: what waits too long is dropped, never the newest of a camera.

A queue shared by all cameras would starve one of them: of two that give frames at the same time, the second
would always push the first one's out. So each has its own, and they take turns.
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
        self._items: dict[str, deque[Item]] = {}  # the camera that was served last is last
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
            waiting.append(item)
            self._changed.notify()

    def get(self, timeout_s: float | None = None) -> Item | None:
        """Take the oldest item of the camera whose turn it is; None if none comes in time."""
        with self._changed:
            if not self._changed.wait_for(lambda: len(self), timeout_s):
                return None
            camera = next(name for name, items in self._items.items() if items)
            waiting = self._items.pop(camera)
            self._items[camera] = waiting
            return waiting.popleft()

    def clear(self) -> None:
        """Drop all that waits, uncounted: the map it was for is gone."""
        with self._changed:
            self._items.clear()
