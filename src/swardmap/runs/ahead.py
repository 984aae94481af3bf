"""Work that runs ahead of who takes it: frames are decoded and segmented while earlier ones are mapped.

What comes out, and its order, is what one thread would give. Everything that reads happens in one thread of
its own (files, databases and generators are used there from beginning to end), the work in some, and neither
runs farther ahead than a few items.
"""

import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from swardmap.config import SegmenterConfig
from swardmap.models.onnx import CPU_PROVIDER
from swardmap.runs.parallel import cores

Item = TypeVar("Item")
Result = TypeVar("Result")

MOST_WORKERS = 8
WAITING = 2
"""Items that may wait beside one for each worker."""
PATIENCE_S = 0.1
"""How often a thread that waits looks whether it is still wanted."""


@dataclass(frozen=True, slots=True)
class _Failed:
    error: BaseException


_END = object()


def in_order(
    read: Callable[[], Iterator[Item]], work: Callable[[Item], Result], workers: int
) -> Iterator[tuple[Item, Result]]:
    """Each item with what the work makes of it, in the order in which they are read.

    Args:
        read: begins to read; called, used and closed in one thread.
        work: called in several threads at once.
        workers: threads that work; 0 = work when an item is taken, in the thread that takes it.

    Raises:
        BaseException: what reading or the work raised, when its place in the order comes.
    """
    ready: queue.Queue[Any] = queue.Queue(max(1, workers) + WAITING)
    stop = threading.Event()
    with (
        ThreadPoolExecutor(max(1, workers), "segment") as pool,
        _reader(read, ready, stop, pool, work, workers),
    ):
        while (found := ready.get()) is not _END:
            if isinstance(found, _Failed):
                raise found.error
            item, future = found
            yield item, work(item) if future is None else future.result()


@contextmanager
def _reader(
    read: Callable[[], Iterator[Item]],
    ready: "queue.Queue[Any]",
    stop: threading.Event,
    pool: ThreadPoolExecutor,
    work: Callable[[Item], Result],
    workers: int,
) -> Iterator[None]:
    """A thread that reads until nothing is left, or nobody wants more; it has ended when the block has."""

    def put(what: Any) -> bool:
        while not stop.is_set():
            try:
                ready.put(what, timeout=PATIENCE_S)
            except queue.Full:
                continue
            return True
        return False

    def run() -> None:
        items: Any = None
        try:
            items = read()
            for item in items:
                future: Future[Result] | None = pool.submit(work, item) if workers else None
                if not put((item, future)):
                    return
            put(_END)
        except BaseException as error:  # noqa: BLE001 - raised again where its place in the order comes
            put(_Failed(error))
        finally:
            if hasattr(items, "close"):
                items.close()

    thread = threading.Thread(target=run, name="read", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        pool.shutdown(wait=False, cancel_futures=True)
        thread.join()


def network_plan(config: SegmenterConfig, available: int | None = None) -> tuple[int, int]:
    """How many frames of a recording are segmented at once, and threads of the network for each of them.

    A frame a core with one thread each leaves no core idle while one frame is decoded, or its layers do not
    divide; in a recording no frame is waited for. With threads given, or another provider than the CPU,
    it takes one frame at a time, beside the mapping of the one before.

    Args:
        config: of the segmenter.
        available: cores; None = those that this process may use.

    >>> [network_plan(SegmenterConfig(), n) for n in (1, 2, 4, 16)]
    [(1, 1), (2, 1), (4, 1), (8, 1)]
    """
    if config.threads or config.provider != CPU_PROVIDER:
        return 1, config.threads
    return min(available or cores(), MOST_WORKERS), 1


def may_run_at_once(segmenter: Any) -> bool:
    """Whether a segmenter says that several threads may call it at once (`concurrent`)."""
    return bool(getattr(segmenter, "concurrent", False))
