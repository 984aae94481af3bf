"""Ctrl-C while a process is started: it waits, whichever thread it reaches."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import pytest

from swardmap.runs.interrupts import interrupts_wait


def interrupt_by_another_thread() -> None:
    """The signal as a thread gets that does not block it; Python tells the main one."""
    thread = threading.Thread(target=lambda: signal.pthread_kill(threading.get_ident(), signal.SIGINT))
    before = signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # which the thread inherits
    try:
        thread.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    thread.join()
    time.sleep(0.01)


def is_heard_afterwards(interrupt: Callable[[], None]) -> bool:
    """Whether Ctrl-C interrupts nothing meanwhile, and raises in the end."""
    reached = False
    try:
        with interrupts_wait():
            interrupt()
            reached = True
    except KeyboardInterrupt:
        return reached
    return False


def test_an_interrupt_that_another_thread_hears_waits() -> None:
    assert is_heard_afterwards(interrupt_by_another_thread)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, set())


def test_an_interrupt_of_the_main_thread_waits() -> None:
    assert is_heard_afterwards(lambda: signal.raise_signal(signal.SIGINT))


def test_without_one_nothing_is_raised_and_errors_go_through() -> None:
    with interrupts_wait():
        pass
    with pytest.raises(ValueError, match="mine"), interrupts_wait():
        raise ValueError("mine")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_what_is_started_meanwhile_does_not_die_of_it() -> None:
    with interrupts_wait():
        child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    child.send_signal(signal.SIGINT)
    child.communicate(b"\n", timeout=60)
    assert child.returncode == 0


def test_in_another_thread_only_the_signal_is_blocked() -> None:
    blocked: list[bool] = []

    def look() -> None:
        with interrupts_wait():
            blocked.append(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, set()))
        blocked.append(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, set()))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert blocked == [True, False]
