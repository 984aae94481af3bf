"""Folders of results: whole or as they were, marked with what they are, never written into by another verb.

A new folder is made under a hidden name beside its place and takes the name at the end; one that is there
already exchanges its name with it in one step (`exchange`). Where a system cannot, the old one is renamed
aside first, and the next run that is killed between the two renames leaves puts it back.
"""

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from swardmap.errors import OutputError, one_line, shortened
from swardmap.io.exchange import exchange
from swardmap.io.files import output_error, write_text
from swardmap.io.staging import name_beside, staged_folder, sweep, sweep_inside

MARKER = ".swardmap"
"""File that says of a folder: swardmap made it, and may replace it; and what kind of folder it is."""
UNFINISHED = "state: unfinished"
KIND = re.compile(r"^kind: (.+)$", re.MULTILINE)
SIGNS = {
    "results.json": "evaluation", "parts": "evaluation", "eden": "gardens", "summary.json": "map",
    "camera.yaml": "recording", "classes.yaml": "masks",
}  # fmt: skip
"""What tells the kind of a folder that was made before markers said it."""


def marker_text(kind: str) -> str:
    """What the marker of a folder says."""
    return f"Made by swardmap. --overwrite may replace this folder.\nkind: {kind}\n"


def kind_of(folder: Path) -> str | None:
    """What kind of folder this is: map, maps, evaluation, gardens, recording, masks; None = not ours.

    Raises:
        OSError: if it cannot be read.
    """
    marker = folder / MARKER
    if not marker.is_file():
        return None
    found = KIND.search(marker.read_bytes()[:1000].decode("utf-8", "replace"))
    if found is not None:
        return found[1]
    return next((kind for name, kind in SIGNS.items() if (folder / name).exists()), "unknown")


def is_unfinished(folder: Path) -> bool:
    """Whether a run was killed while it exchanged the content of a folder that cannot be renamed."""
    marker = folder / MARKER
    return marker.is_file() and UNFINISHED in marker.read_bytes()[:1000].decode("utf-8", "replace")


@contextmanager
def new_output_folder(path: str | Path, overwrite: bool = False, kind: str = "map") -> Iterator[Path]:
    """A folder that appears under its name, complete, when the block ends without an error.

    Write into the folder that is yielded, not into `path`. After an error it is removed and `path` is
    what it was. A run that shall keep what it finished on Ctrl-C catches KeyboardInterrupt inside the block.

    Args:
        path: where the folder shall be; it may exist if it is empty.
        overwrite: replace a folder that swardmap made, of the same kind; nothing else.
        kind: of the folder.

    Raises:
        OutputError: if `path` is in use, is not one of ours, or cannot be written.
    """
    target = resolved(path)
    clear_leftovers(target)
    replaces = refuse_occupied(target, overwrite, kind)
    with ExitStack() as stack:
        with _one_error(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            staging = stack.enter_context(staged_folder(target, within=_must_stay(target)))
            write_text(staging / MARKER, marker_text(kind))
        yield staging
        with _one_error(target):
            _publish(staging, target, replaces)


def resolved(path: str | Path) -> Path:
    """The place that a path means, through all links.

    Raises:
        OutputError: for a loop of links.
    """
    try:
        return Path(path).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # RuntimeError: Python 3.11 and 3.12 of a loop
        raise OutputError(f"cannot write {shortened(path)}: {one_line(error)}") from error


def clear_leftovers(target: Path) -> None:
    """Remove what dead runs left of a folder, and put back what one had renamed aside."""
    with suppress(OSError):
        aside = sorted(target.parent.glob(f".{_escaped(target.name)}.*.old"))
        if aside and not target.exists():
            aside.pop().rename(target)
        for old in aside:
            shutil.rmtree(old, ignore_errors=True)
    sweep(target)
    sweep_inside(target)


def refuse_occupied(target: Path, overwrite: bool, kind: str) -> bool:
    """Hold that a folder is free for a kind of result; returns whether something of ours is there to replace.

    Raises:
        OutputError: if it is in use and may not be replaced.
    """
    try:
        if not target.exists():
            return False
        if not target.is_dir():
            raise OutputError(f"expected a folder to write into, but {target} is a file")
        if not any(target.iterdir()):
            return False
        if is_unfinished(target):
            return True
        found = kind_of(target)
    except OSError as error:
        raise output_error(target, error) from error
    if found not in (None, "unknown", kind):
        raise OutputError(
            f"{target} holds {_with_article(found)}, not {_with_article(kind)}: choose another folder"
        )
    if found is None:
        raise OutputError(
            f"{target} is not empty and was not made by swardmap (it has no {MARKER} file), so --overwrite "
            "does not touch it: choose another folder, or empty it yourself"
        )
    if not overwrite:
        raise OutputError(f"{target} exists and is not empty: choose another folder, or pass --overwrite")
    return True


@contextmanager
def _one_error(target: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise output_error(target, error) from error


def _with_article(kind: str) -> str:
    names = {"evaluation": "an evaluation", "map": "a map", "recording": "a recording"}
    return names.get(kind or "", f"{kind}")


def _escaped(name: str) -> str:
    return "".join(f"[{c}]" if c in "*?[" else c for c in name)


def _must_stay(target: Path) -> bool:
    """Whether a folder cannot be renamed, so that its content must be exchanged: a mounted volume."""
    return target.is_dir() and (target.is_mount() or not os.access(target.parent, os.W_OK))


def _publish(staging: Path, target: Path, replaces: bool) -> None:
    if staging.parent == target:
        _exchange_content(staging, target)
    elif replaces and target.exists():
        if not exchange(staging, target):
            _replace(staging, target)
    else:  # fails if another run has filled the folder meanwhile; an empty one may be there
        staging.rename(target)


def _replace(staging: Path, target: Path) -> None:
    """Where names cannot be exchanged: the old folder goes aside, to be put back after a kill in between."""
    old = target.with_name(f"{name_beside(target).name.removesuffix('.part')}.old")
    target.rename(old)
    try:
        staging.rename(target)
    except OSError:
        old.rename(target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _exchange_content(staging: Path, target: Path) -> None:
    """Replace what a mounted folder holds; until that is whole, its marker says that it is not."""
    with staged_folder(target, within=True) as old:
        entries = [entry for entry in target.iterdir() if entry not in (staging, old, target / MARKER)]
        kind = KIND.search((staging / MARKER).read_text(encoding="utf-8"))
        write_text(target / MARKER, f"{marker_text(kind[1] if kind else 'map')}{UNFINISHED}\n")
        for entry in entries:
            entry.rename(old / entry.name)
        for entry in sorted(staging.iterdir(), key=lambda entry: entry.name == MARKER):
            entry.replace(target / entry.name)
