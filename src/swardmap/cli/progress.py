"""How far a verb is: a bar on a terminal, plain lines when not."""

import sys
import time
from contextlib import ExitStack
from typing import Any

import typer

from swardmap.cli.compiling import told_when_compiling

LINE_EVERY_S = 5.0
"""Between plain lines; the last one, when all is done, comes always."""


class Progress:
    """A progress bar with the time left; `with Progress(...) as bar`, then `bar.show` or `bar.step`.

    Args:
        doing, did: what happens to the things.
        total: number of things, or None if it cannot be known; `show` tells it too.
        quiet: show nothing, for --json.
        things: what is counted.
    """

    def __init__(
        self, doing: str, did: str, total: int | None = None, quiet: bool = False, things: str = "frames"
    ) -> None:
        self._doing, self._did, self._things, self._quiet = doing, did, things, quiet
        self._done, self._total, self._printed_s = 0, total, 0.0
        self._start: tuple[float, int] | None = None
        self._bar: Any = None
        self._told = ExitStack()

    def __enter__(self) -> "Progress":
        if self._doing == "mapping" and not self._quiet:
            self._told.enter_context(told_when_compiling())
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        self._told.close()
        if self._bar is not None:
            self._bar.stop()
        if isinstance(error, KeyboardInterrupt):
            raise typer.Abort(*error.args) from error  # typer would drop what it says

    def step(self, _: object = None) -> None:
        """One more thing is done."""
        self.show(self._done + 1, self._total)

    def show(self, done: int, total: int | None) -> None:
        """So many things are done, of so many."""
        self._done, self._total = done, total
        now = time.monotonic()
        if self._start is None:
            self._start, self._printed_s = (now, done), now
        if self._quiet:
            return
        if sys.stderr is not None and sys.stderr.isatty():
            self._show_bar()
        elif done == total or now - self._printed_s >= LINE_EVERY_S:
            of = "?" if total is None else total
            print(f"{self._did} {done} of {of} {self._things}{self._left(now)}", file=sys.stderr, flush=True)
            self._printed_s = now

    def _show_bar(self) -> None:
        if self._bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            columns = (
                TextColumn(self._doing), BarColumn(), MofNCompleteColumn(),
                TimeRemainingColumn(elapsed_when_finished=True),
            )  # fmt: skip
            self._bar = Bar(*columns, console=Console(stderr=True), speed_estimate_period=120)
            self._bar.start()
            self._task = self._bar.add_task(self._things, total=self._total, completed=self._done)
        self._bar.update(self._task, completed=self._done, total=self._total)

    def _left(self, now: float) -> str:
        """The time left, once the pace is known."""
        if self._start is None or self._total is None or self._done in (self._start[1], self._total):
            return ""
        since, first = self._start
        minutes = (now - since) / (self._done - first) * (self._total - self._done) / 60
        return f", about {minutes:.0f} min left" if minutes >= 1 else ", less than a minute left"
