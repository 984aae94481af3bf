"""What the node takes, and how late it is: cores, milliseconds from an image's stamp to the costmap."""

import os
import time
from collections import deque

import numpy as np

WINDOW_S = 10.0
"""Of the cores used."""

COSTMAPS = 600
"""Latencies are of so many costmaps at most: two minutes of them."""


class Load:
    """Cores that this process used lately, and latencies of the costmaps it gave out."""

    def __init__(self) -> None:
        self._used: deque[tuple[float, float]] = deque()
        self._latency_ms: deque[float] = deque(maxlen=COSTMAPS)
        self._newest_ns = 0

    def published(self, stamp_ns: int, now_ns: int) -> None:
        """Take that a costmap was given out.

        Args:
            stamp_ns: of the newest image in it; one that was in an earlier costmap does not count again.
            now_ns: when it was given out.
        """
        if stamp_ns > self._newest_ns:
            self._latency_ms.append((now_ns - stamp_ns) / 1e6)
        self._newest_ns = stamp_ns

    @property
    def facts(self) -> dict[str, object]:
        """Cores used over the last `WINDOW_S`, of how many; p50 and p99 of the latencies in milliseconds."""
        now, used = time.monotonic(), time.process_time()
        self._used.append((now, used))
        while now - self._used[0][0] > WINDOW_S:
            self._used.popleft()
        before, had = self._used[0]
        cores = None if now - before < 0.5 else round((used - had) / (now - before), 2)
        told: dict[str, object] = {"cores_used": cores, "cores": os.cpu_count()}
        taken = list(self._latency_ms)
        if taken:
            p50, p99 = np.percentile(taken, [50, 99], method="inverted_cdf").tolist()
            told |= {"costmap_latency_p50_ms": round(p50, 1), "costmap_latency_p99_ms": round(p99, 1)}
        return told
