"""What files look like from outside: tells whether data has changed since, without reading it."""

import os
from collections.abc import Collection, Iterator
from hashlib import sha256
from pathlib import Path

from swardmap.errors import InputError
from swardmap.io.folders import kind_of

RESULTS = ("map", "maps", "evaluation")
"""Folders that swardmap makes of data: one that lies in a recording is no part of it."""

GONE = -1


def marks_of(location: str | Path, without: Collection[Path] = ()) -> str:
    """Number and bytes of the files of a place, and a digest of their names, sizes and times of change.

    Hidden files count, folders of results do not. It takes a look at each file and reads none: a second for
    100,000 of them.

    Args:
        location: a file or folder.
        without: absolute paths that are no part of it.

    Raises:
        InputError: if a folder cannot be listed.
    """
    top = Path(location)
    try:
        found = (
            [_mark(top, "")] if not top.is_dir() else sorted(_marks(top.absolute(), "", frozenset(), without))
        )
    except OSError as error:
        raise InputError(f"cannot read {location}: {error.strerror or error}") from error
    total = sum(size for _, size, _ in found if size != GONE)
    return f"{len(found)} files, {total} bytes, {sha256(repr(found).encode()).hexdigest()[:16]}"


def _marks(
    folder: Path, inside: str, above: frozenset[tuple[int, int]], without: Collection[Path]
) -> Iterator[tuple[str, int, int]]:
    """(name, bytes, ns of the last change) of each file below a folder."""
    stat = folder.stat()
    here = above | {(stat.st_dev, stat.st_ino)}
    with os.scandir(folder) as entries:
        for entry in entries:
            name, path = inside + entry.name, Path(entry.path)
            if path in without:
                continue
            if not entry.is_dir():
                yield _mark(path, name)
                continue
            to = entry.stat()
            if (to.st_dev, to.st_ino) not in here and kind_of(path) not in RESULTS:  # no link leads round
                yield from _marks(path, f"{name}/", here, without)


def _mark(path: Path, name: str) -> tuple[str, int, int]:
    try:
        stat = path.stat()
    except OSError:  # a link that leads nowhere is data that is not there
        return name, GONE, 0
    return name, stat.st_size, stat.st_mtime_ns
