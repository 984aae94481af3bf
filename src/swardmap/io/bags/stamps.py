"""Times of one stream of messages as they can be used: without the single ones that are wrong.

Drivers send a stamp of 0 or from the future now and then, and some never set it. Taken as it is, one image
from the future makes all that follow look late.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Generic, TypeVar

Item = TypeVar("Item")

UNSTAMPED = 3
"""A stream that begins with so many stamps of 0 has none."""

JUMP_NS = 1_000_000_000
"""A stamp that runs ahead of the time of recording by more than this, since the one before, is suspected."""

SUSPECTS = 10
"""So many in a row are no outliers: the clock was set."""


@dataclass(slots=True)
class StampFilter(Generic[Item]):
    """Gives messages with the times to use, in the order they came.

    Attributes:
        dropped: messages left out because their stamp is off.
        first_dropped_ns: the stamp of the first of them.
        unstamped: whether no stamp is set, so that the time of recording is taken.
    """

    dropped: int = 0
    first_dropped_ns: int = 0
    unstamped: bool = False
    _begun: bool = False
    _zeros: list[tuple[int, int, Item]] = field(default_factory=list)
    _last: tuple[int, int] | None = None
    _suspects: list[tuple[int, int, Item]] = field(default_factory=list)

    def add(self, stamp_ns: int, recorded_ns: int, item: Item) -> Iterator[tuple[int, Item]]:
        """Take the next message of the stream; yield what is now certain as time and message."""
        if self.unstamped:
            yield recorded_ns, item
            return
        if not self._begun and stamp_ns == 0:
            self._zeros.append((stamp_ns, recorded_ns, item))
            if len(self._zeros) == UNSTAMPED:
                yield from self._as_recorded()
            return
        if self._begun and stamp_ns == 0:  # not set, in a stream that has times
            self._drop([(stamp_ns, recorded_ns, item)])
            return
        self._begun = True
        for held in self._zeros:
            yield from self._judge(held)
        self._zeros = []
        yield from self._judge((stamp_ns, recorded_ns, item))

    def flush(self) -> Iterator[tuple[int, Item]]:
        """Yield what is left at the end of the stream."""
        if self._zeros and not self._begun:
            yield from self._as_recorded()
        yield from ((stamp, item) for stamp, _, item in self._suspects)
        self._suspects = []

    def _drop(self, messages: list[tuple[int, int, Item]]) -> None:
        self.first_dropped_ns = self.first_dropped_ns if self.dropped else messages[0][0]
        self.dropped += len(messages)

    def _as_recorded(self) -> Iterator[tuple[int, Item]]:
        self.unstamped = True
        yield from ((recorded, item) for _, recorded, item in self._zeros)
        self._zeros = []

    def _judge(self, message: tuple[int, int, Item]) -> Iterator[tuple[int, Item]]:
        if self._suspects:
            if message[0] <= self._suspects[0][0] - JUMP_NS:  # it was an excursion
                self._drop(self._suspects)
                self._suspects = []
            else:
                self._suspects.append(message)
                if len(self._suspects) == SUSPECTS or self._last is None:
                    yield from self._accept_all()
                return
        if self._last is None or self._runs_ahead(message):
            self._suspects.append(message)  # the first message may be the one that is off
            return
        if message[0] > self._last[0]:  # one that is behind is for the reader to judge, and no measure
            self._last = message[:2]
        yield message[0], message[2]

    def _runs_ahead(self, message: tuple[int, int, Item]) -> bool:
        stamp, recorded = self._last or message[:2]
        return message[0] - stamp - max(0, message[1] - recorded) > JUMP_NS

    def _accept_all(self) -> Iterator[tuple[int, Item]]:
        """What was suspected is right; but of the first two the second may yet be off."""
        held, self._suspects = self._suspects, []
        first = self._last is None
        for message in held[:1] if first else held:
            self._last = message[:2]
            yield message[0], message[2]
        if first:
            for message in held[1:]:
                yield from self._judge(message)
