"""Writing so that nobody ever sees half a file: a temporary file beside the target, then a rename."""

import os
import shutil
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from swardmap.errors import InputError, OutputError

LFS_POINTER = b"version https://git-lfs.github.com/spec/"
MARKER = ".swardmap"
"""File that says of a folder: swardmap made it, and may replace it."""


@contextmanager
def atomic_write(path: str | Path, durable: bool = True) -> Iterator[BinaryIO]:
    """Open a file that appears under its name only when the block ends without an error.

    Args:
        path: where the file shall be; missing parent folders are made.
        durable: wait until it is on the disk, so that it outlives a power cut. Without it a crash of
            the program leaves no half-written file either, and thousands of small files are faster.

    Yields:
        A binary file open for writing.

    Raises:
        OutputError: if it cannot be written (permission, full disk, ...); an earlier file stays as it was.
    """
    path = Path(path)
    temporary = _beside(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("xb") as file:
            yield file
            file.flush()
            if durable:
                os.fsync(file.fileno())
        temporary.replace(path)
        if durable:
            _sync_folder(path.parent)
    except OSError as error:
        raise _output_error(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_bytes(path: str | Path, content: bytes, durable: bool = True) -> None:
    """Write one file atomically. See `atomic_write`."""
    with atomic_write(path, durable) as file:
        file.write(content)


def write_text(path: str | Path, text: str, durable: bool = True) -> None:
    """Write one UTF-8 text file atomically. See `atomic_write`."""
    write_bytes(path, text.encode("utf-8"), durable)


def write_together(contents: Mapping[Path, bytes]) -> None:
    """Write files that mean something only together, such as a map's image and its YAML.

    All are on the disk before the first gets its name. The last one names the others: it is taken
    away first and comes back last, so that an old description never stands beside a new image.

    Args:
        contents: file -> bytes; the last one is the file that names the others.

    Raises:
        OutputError: if one cannot be written; then earlier files stay as they were.
    """
    *_, head = contents
    staged = {path: _beside(path) for path in contents}
    path = head
    try:
        for path, temporary in staged.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.is_dir():
                raise IsADirectoryError(None, "there is a folder of that name")
            with temporary.open("xb") as file:
                file.write(contents[path])
                file.flush()
                os.fsync(file.fileno())
        path = head
        head.unlink(missing_ok=True)
        for path, temporary in staged.items():
            temporary.replace(path)
        _sync_folder(head.parent)
    except OSError as error:
        raise _output_error(path, error) from error
    finally:
        for temporary in staged.values():
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


@contextmanager
def new_output_folder(path: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """A folder that appears under its name, complete, when the block ends without an error.

    Write into the folder that is yielded, not into `path`. After an error it is removed and `path` is
    what it was. A run that shall keep what it finished on Ctrl-C catches KeyboardInterrupt inside the block.

    Args:
        path: where the folder shall be; it may exist if it is empty.
        overwrite: replace a folder that swardmap made (it holds the file `.swardmap`); nothing else.

    Raises:
        OutputError: if `path` is in use, is not one of ours, or cannot be written.
    """
    target = Path(path).resolve()
    _refuse_occupied(target, overwrite)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        staging = _beside(target, within=_must_stay(target))
        staging.mkdir()
    except OSError as error:
        raise _output_error(target, error) from error
    try:
        write_text(staging / MARKER, "Made by swardmap. --overwrite may replace this folder.\n")
        yield staging
        try:
            _publish(staging, target, overwrite)
        except OSError as error:
            raise _output_error(target, error) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def refuse_to_replace(source: str | Path, out: str | Path) -> None:
    """Hold that writing results to `out` cannot delete the recording they are made of.

    Raises:
        OutputError: if `out` is `source`, or a folder around it that is in use.
    """
    target = Path(out).resolve()
    if target in (Path(source).resolve(), *Path(source).resolve().parents) and target.is_dir():
        raise OutputError(
            f"{target} holds the recording itself ({source}): choose another folder for the results"
        )


def inside(folder: Path, name: str) -> Path:
    """`folder / name`, for a name that comes from a file.

    Raises:
        InputError: if the name is absolute or leads out of the folder.
    """
    parts = Path(name.replace("\\", "/")).parts
    if not parts or "\0" in name or ".." in parts or Path(*parts).is_absolute() or ":" in parts[0]:
        raise InputError(f"expected a name of a file inside {folder}, got '{name}'")
    return folder.joinpath(*parts)


def read_bytes(path: str | Path, limit: int | None = None) -> bytes:
    """Content of a file.

    Raises:
        InputError: if it cannot be read, or is larger than `limit` bytes.
    """
    try:
        size = Path(path).stat().st_size
        if limit is not None and size > limit:
            raise InputError(f"{path}: expected at most {limit} bytes, got {size}")
        content = Path(path).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot read {path}: {reason}") from error
    if content.startswith(LFS_POINTER):
        raise InputError(f"{path}: only a pointer of Git LFS is there, not the file: run 'git lfs pull'")
    return content


def _beside(path: Path, within: bool = False) -> Path:
    """A name that nobody else uses, on the same file system."""
    folder = path if within else path.parent
    return folder / f".{path.name}.{uuid.uuid4().hex[:12]}.part"


def _must_stay(target: Path) -> bool:
    """Whether a folder cannot be renamed, so that its content must be exchanged: a mounted volume."""
    return target.is_dir() and (target.is_mount() or not os.access(target.parent, os.W_OK))


def _refuse_occupied(target: Path, overwrite: bool) -> None:
    try:
        if not target.exists():
            return
        if not target.is_dir():
            raise OutputError(f"expected a folder to write into, but {target} is a file")
        names = [entry.name for entry in target.iterdir()]
    except OSError as error:
        raise _output_error(target, error) from error
    if not names:
        return
    if not overwrite:
        raise OutputError(f"{target} exists and is not empty: choose another folder, or pass --overwrite")
    if MARKER not in names:
        raise OutputError(
            f"{target} was not made by swardmap (it has no {MARKER} file), so --overwrite does not touch it: "
            "choose another folder, or empty it yourself"
        )


def _publish(staging: Path, target: Path, overwrite: bool) -> None:
    if staging.parent == target:
        _exchange_content(staging, target)
    elif overwrite and target.exists():
        old = _beside(target)
        target.rename(old)
        try:
            staging.rename(target)
        except OSError:
            old.rename(target)
            raise
        shutil.rmtree(old, ignore_errors=True)
    else:
        staging.rename(
            target
        )  # fails if another run has filled the folder meanwhile; an empty one may be there


def _exchange_content(staging: Path, target: Path) -> None:
    """Replace what a mounted folder holds: old entries go aside, new ones come in, the old are deleted."""
    old = _beside(target, within=True)
    entries = [entry for entry in target.iterdir() if entry != staging]
    old.mkdir()
    for entry in entries:
        entry.rename(old / entry.name)
    for entry in list(staging.iterdir()):
        entry.rename(target / entry.name)
    shutil.rmtree(old, ignore_errors=True)


def _sync_folder(folder: Path) -> None:
    """Make a rename outlive a power cut, where the file system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _output_error(path: Path, error: OSError) -> OutputError:
    return OutputError(f"cannot write {path}: {error.strerror or error}")
