"""How long each stage of a frame takes: means over the last frames, cheap enough to be always on."""

import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

FRAMES = 100
"""Means are over so many."""


class StageTimes:
    """Milliseconds by stage, of the clock and of this thread's share of a core.

    Each stage is measured by one thread; others may read. A network with several threads of its own has more
    of the cores than its stage tells.
    """

    def __init__(self) -> None:
        self._taken: dict[str, deque[tuple[float, float]]] = {}

    @contextmanager
    def measured(self, stage: str) -> Iterator[None]:
        """Measure what is done in the block."""
        started, had = time.perf_counter(), time.thread_time()
        try:
            yield
        finally:
            taken = 1e3 * (time.perf_counter() - started), 1e3 * (time.thread_time() - had)
            self._taken.setdefault(stage, deque(maxlen=FRAMES)).append(taken)

    @property
    def means_ms(self) -> dict[str, tuple[float, float]]:
        """Mean of each stage over the last frames: by the clock, and on the core; rounded to 0.01 ms."""
        taken = {stage: list(times) for stage, times in list(self._taken.items())}
        return {stage: (_mean(times, 0), _mean(times, 1)) for stage, times in taken.items()}


def _mean(times: list[tuple[float, float]], which: int) -> float:
    return round(sum(t[which] for t in times) / len(times), 2)
