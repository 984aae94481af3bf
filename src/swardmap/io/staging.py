"""Names for what is not finished yet, and what dead runs have left under them.

A run holds a lock (flock) on what it has not finished, which ends with its process however that ends. So
the next run that writes to the same place can tell what nobody will finish, and removes it.
"""

import fcntl
import os
import re
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LEFTOVER = re.compile(r"\.(?P<of>.+)\.[0-9a-f]{12}\.part")


def name_beside(path: Path, within: bool = False) -> Path:
    """A name that nobody else uses, on the same file system: hidden, beside `path` or within that folder."""
    folder = path if within else path.parent
    return folder / f".{path.name}.{uuid.uuid4().hex[:12]}.part"


@contextmanager
def staged_folder(target: Path, within: bool = False) -> Iterator[Path]:
    """An empty folder beside `target`, or within it, to be renamed; what is left of it is removed at the end.

    Raises:
        OSError: if it cannot be made.
    """
    folder, descriptor = _locked_folder(target, within)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(descriptor)


def lock(descriptor: int) -> bool:
    """Hold a file or folder as ours until it is closed; False if another process holds it.

    Where a file system knows no locks (some network drives) nothing is ours, and leftovers stay.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def sweep(target: Path) -> None:
    """Remove what dead runs left of `target`, beside it."""
    _sweep(target.parent, target.name)


def sweep_inside(folder: Path) -> None:
    """Remove what dead runs left of any name in a folder."""
    _sweep(folder, None)


def _sweep(folder: Path, of: str | None) -> None:
    with suppress(OSError):
        for entry in list(folder.iterdir()):
            found = LEFTOVER.fullmatch(entry.name)
            if found is not None and of in (None, found["of"]):
                _remove_if_dead(entry)


def _remove_if_dead(path: Path) -> None:
    with suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            if not lock(descriptor):
                return
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
        finally:
            os.close(descriptor)


def _locked_folder(target: Path, within: bool) -> tuple[Path, int]:
    """A new folder that is ours; another name where a sweeping run was there before the lock."""
    for _ in range(8):
        folder = name_beside(target, within)
        folder.mkdir()
        with suppress(FileNotFoundError):
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            lock(descriptor)
            if folder.is_dir():
                return folder, descriptor
            os.close(descriptor)
    raise OSError(None, "its unfinished folder is removed again and again")
