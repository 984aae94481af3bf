"""What verbs do with a source that may have no end: limits, and Ctrl-C as the ordinary way to stop."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from swardmap.errors import InputError
from swardmap.io.sources.limited import LimitedSource

Frames = Annotated[int | None, typer.Option("--frames", min=1, help="Stop after so many frames.")]
Duration = Annotated[
    float | None, typer.Option("--duration", min=0.001, help="Stop after so many seconds, by the stamps.")
]


@contextmanager
def until_stopped(source: LimitedSource) -> Iterator[None]:
    """Ctrl-C and SIGTERM end the source after the frame in progress; a second one interrupts at once."""

    def ask(*_: object) -> None:
        if source.stopped:
            raise KeyboardInterrupt
        source.stop()

    if threading.current_thread() is not threading.main_thread():  # where signals cannot be caught
        yield
        return
    numbers = [n for n in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(n) is not signal.SIG_IGN]
    before = {number: signal.signal(number, ask) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def tell_how_it_ended(source: LimitedSource, live: bool, frames: int, out: Path | str) -> None:
    """Say with the exit code if a run is not what was asked for, though its result is whole.

    Args:
        source: that was run.
        live: whether it has no end, so that stopping it is no interruption.
        frames: finished.
        out: where they are.

    Raises:
        InputError: if a camera was lost.
        Abort: if a recording was stopped before its end.
    """
    if source.lost:
        raise InputError(f"{source.lost} {out} holds the {frames} frames that came.")
    if source.stopped and not live:
        raise typer.Abort(f"{out} holds the {frames} frames that were finished")
