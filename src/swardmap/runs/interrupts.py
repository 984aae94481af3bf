"""Ctrl-C that waits while a process is started."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interrupts_wait() -> Iterator[None]:
    """Let Ctrl-C wait until this is left, here and for ever in the processes that are started meanwhile.

    A child inherits the blocked signal, so that it does not die of it, noisily, before it can say what it
    wants. Blocking alone does not do here: another thread of this process may still get the signal, and
    Python raises in the main one, between the start of a child and the hand-over of its work, which the
    child then looks for in vain.
    """
    handler = signal.getsignal(signal.SIGINT)
    heard: list[tuple[int, object]] = []
    defer = callable(handler) and threading.current_thread() is threading.main_thread()
    if defer:
        signal.signal(signal.SIGINT, lambda number, where: heard.append((number, where)))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if defer:
            signal.signal(signal.SIGINT, handler)
        if heard and callable(handler):
            handler(*heard[0])  # type: ignore[arg-type]
