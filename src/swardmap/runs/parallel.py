"""The same work for each of many parts: in this process, in several, or on a Ray cluster.

Whoever asks writes each result under its own name before the next, so that a run that was killed goes on
where it was; here nothing is kept. Workers end with their parent, say nothing, and leave Ctrl-C to it.
"""

import os
import queue
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context
from typing import Any, TypeVar

from swardmap.errors import OutputError, SwardmapError
from swardmap.runs.interrupts import interrupts_wait

Part = TypeVar("Part")
Result = TypeVar("Result")

Tick = Callable[[], None]
"""Called by the work for each small step that is done; it may raise, to stop the work."""
Work = Callable[[Part, Tick], Result]
OnDone = Callable[[int, int], None]
"""Called with what is done and with all there is to do, both in the same unit."""

STOP_S, END_S = 3.0, 5.0
"""That workers have to stop at their next tick, and then to leave their work."""
IN_FLIGHT = 2
"""Parts a worker that are handed out at a time, so that none waits for the parent."""

_worker: dict[str, Any] = {}


def no_tick() -> None:
    """For who does not want to know."""


def each_part(
    work: Work[Part, Result],
    parts: Sequence[Part],
    workers: int | None = None,
    ray_address: str | None = None,
    on_tick: Tick = no_tick,
) -> Iterator[tuple[Part, Result]]:
    """Do the work for each part, and give the results in the order in which they are finished.

    Args:
        work: called with a part and a tick; for several processes a function of a module, or a
            `functools.partial` of one.
        parts: what to work on; plain data.
        workers: processes; None = one a core, 1 = this one.
        ray_address: Ray cluster to use in place of processes; there nobody is told of ticks.
        on_tick: called in this process, once for each tick of the work.

    Raises:
        OutputError: if a process dies.
        SwardmapError: what the work raises.
    """
    if ray_address is not None:
        from swardmap.runs.cluster import on_ray

        return on_ray(work, parts, ray_address)
    workers = min(workers or cores(), len(parts))
    if workers <= 1:
        return ((part, work(part, on_tick)) for part in parts)
    return _in_processes(work, parts, workers, on_tick)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def _in_processes(
    work: Work[Part, Result], parts: Sequence[Part], workers: int, on_tick: Tick
) -> Iterator[tuple[Part, Result]]:
    context = get_context("spawn")
    with interrupts_wait():  # the first of them starts the process that keeps account of them
        ticks, stop = context.Queue(), context.Event()
    waiting, running = iter(parts), dict[Future[Result], Part]()
    pool = ProcessPoolExecutor(workers, context, _start_worker, (os.getpid(), ticks, stop))
    try:
        while True:
            while len(running) < IN_FLIGHT * workers and (part := next(waiting, None)) is not None:
                with interrupts_wait():
                    running[pool.submit(_in_worker, work, part)] = part
            if not running:
                break
            finished, _ = wait(running, timeout=0.5, return_when=FIRST_COMPLETED)
            _tell(ticks, on_tick)
            for future in finished:
                yield running.pop(future), _result(future)
        _tell(ticks, on_tick)
    except BaseException:  # an error, Ctrl-C, or who asked wants no more
        stop.set()
        _end(pool)
        raise
    pool.shutdown(wait=True)


def _end(pool: ProcessPoolExecutor) -> None:
    """End the workers: at their next tick, when asked to, or at last by force.

    A worker that compiles its first kernels or maps a large frame has no tick for a minute, and nobody who
    gave up waits that long. What it holds is whole in any case: results are kept by the parent, and what a
    worker writes itself appears under its name only when it is whole.
    """
    workers = list((getattr(pool, "_processes", None) or {}).values())  # gone after shutdown
    pool.shutdown(wait=False, cancel_futures=True)
    for patience_s, end in ((STOP_S, "terminate"), (END_S, "kill")):
        until = time.monotonic() + patience_s
        for worker in workers:
            worker.join(max(0.0, until - time.monotonic()))
            if worker.is_alive():
                getattr(worker, end)()
    for worker in workers:
        worker.join(END_S)


def _result(future: "Future[Result]") -> Result:
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise OutputError(
            "a process died, perhaps for want of memory; give the same command again, with fewer processes: "
            "what is finished is kept"
        ) from error


def _tell(ticks: Any, on_tick: Tick) -> None:
    """Pass on all that workers have told since the last time."""
    with suppress(queue.Empty):
        while True:
            ticks.get_nowait()
            on_tick()


class _StoppedError(SwardmapError):
    """The parent wants no more."""


def _in_worker(work: Work[Part, Result], part: Part) -> Result:
    _worker["works"] = True
    try:
        return work(part, _tick_in_worker)
    finally:
        _worker["works"] = False


def _asked_to_end(*_: object) -> None:
    """Leave the work as by Ctrl-C, so that nothing half-written stays; without work at once."""
    if not _worker.get("works"):
        os._exit(1)
    raise KeyboardInterrupt


def _tick_in_worker() -> None:
    _worker["ticks"].put(1)
    if _worker["stop"].is_set():
        raise _StoppedError("stopped")


def _start_worker(parent: int, ticks: Any, stop: Any) -> None:
    """End with the parent, even if that is killed: an orphan would wait for work for ever."""
    import threading

    import cv2

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's
    signal.signal(signal.SIGTERM, _asked_to_end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    os.environ["LP_NUM_THREADS"] = "1"  # of Mesa's software driver; read when the context is made
    cv2.setNumThreads(1)
    _worker.update(ticks=ticks, stop=stop)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
