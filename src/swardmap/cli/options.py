"""Options that several verbs share."""

import os
import sys
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swardmap.cli.compiling import told_when_compiling
from swardmap.config import Config, load_config

if TYPE_CHECKING:
    from swardmap.io.annotations.masks import Masks

ConfigFile = Annotated[
    Path | None, typer.Option("--config", "-c", help="YAML file with any part of the settings.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="One setting, such as grid.resolution_m=0.1. Repeatable."
    ),
]
Classes = Annotated[
    list[str] | None,
    typer.Option(
        "--class",
        metavar="THEIRS=OURS",
        help="What a class of the source is: other, grass, person or void; * = all the rest. Repeatable.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, for programs.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace OUT if swardmap made it.")]


def settings(file: Path | None, overrides: list[str]) -> Config:
    """The configuration of a command: defaults < file < environment < --set."""
    return load_config(file, os.environ, overrides)


def meanings(words: Iterable[str]) -> dict[str, str]:
    """`--class lawn=grass` as theirs -> ours."""
    found = {}
    for word in words:
        theirs, sign, ours = word.rpartition("=")
        if not sign or not theirs or not ours:
            raise typer.BadParameter(f"--class: expected THEIRS=OURS, such as lawn=grass, got '{word}'")
        found[theirs] = ours
    return found


def tell_guesses(masks: "Masks") -> None:
    """Say once what classes were taken for, and what else was taken for something."""
    if masks.guessed:
        told = ", ".join(f"{theirs} = {ours}" for theirs, ours in masks.guessed.items())
        print(f"classes taken for: {told} (--class says otherwise)", file=sys.stderr)
    for note in masks.notes:
        print(f"note: {note}", file=sys.stderr)


class Progress:
    """A progress bar on a terminal, plain lines when not; used as `with Progress(n) as on_step`.

    Args:
        total: number of frames, or None if it cannot be known.
        quiet: show nothing, for --json.
        doing, did: what happens to frames.
    """

    def __init__(
        self, total: int | None, quiet: bool = False, doing: str = "mapping", did: str = "mapped"
    ) -> None:
        self._total, self._quiet, self._done = total, quiet, 0
        self._doing, self._did = doing, did
        self._bar: Any = None
        self._told = ExitStack()

    def __enter__(self) -> Callable[[object], None]:
        if self._doing == "mapping" and not self._quiet:
            self._told.enter_context(told_when_compiling())
        if not self._quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            columns = (TextColumn(self._doing), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self._bar = Bar(*columns, console=Console(stderr=True))
            self._bar.start()
            self._task = self._bar.add_task("frames", total=self._total)
        return self.step

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        self._told.close()
        if self._bar is not None:
            self._bar.stop()
        if isinstance(error, KeyboardInterrupt):
            raise typer.Abort(*error.args) from error  # typer would drop what it says

    def step(self, _: object) -> None:
        """One frame is done."""
        self._done += 1
        if self._bar is not None:
            self._bar.advance(self._task)
        elif not self._quiet and (self._done % 100 == 0 or self._done == self._total):
            print(f"{self._did} {self._done} of {self._total or '?'} frames", file=sys.stderr)
