"""Writing so that nobody ever sees half a file: a temporary file beside the target, then a rename."""

import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from swardmap.errors import InputError, OutputError, one_line, shortened
from swardmap.io.staging import lock, name_beside

MAX_BYTES = 2**31
"""Of a file that is read as a whole, where its reader knows no smaller limit."""
LFS_POINTER = b"version https://git-lfs.github.com/spec/"


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
    temporary = name_beside(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("xb") as file:
            lock(file.fileno())
            yield file
            file.flush()
            if durable:
                os.fsync(file.fileno())
            temporary.replace(path)  # while it is ours
        if durable:
            _sync_folder(path.parent)
    except OSError as error:
        raise output_error(path, error) from error
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


def table_text(table: Mapping[str, Any]) -> str:
    """A JSON object with one line a key: compact, and a difference names the key.

    >>> print(table_text({"7": {"kind": "shrub", "height_m": 0.4}, "8": [1, 2]}), end="")
    {
    "7": {"kind": "shrub", "height_m": 0.4},
    "8": [1, 2]
    }
    """
    rows = ",\n".join(f"{json.dumps(key)}: {json.dumps(row)}" for key, row in table.items())
    return f"{{\n{rows}\n}}\n"


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
    staged = {path: name_beside(path) for path in contents}
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
        raise output_error(path, error) from error
    finally:
        for temporary in staged.values():
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


def refuse_to_replace(source: str | Path, out: str | Path) -> None:
    """Hold that writing results to `out` cannot delete the recording they are made of.

    Raises:
        OutputError: if `out` is `source`, or a folder around it that is in use.
    """
    try:
        target, recording = Path(out).resolve(), Path(source).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # RuntimeError: a loop of links
        raise OutputError(f"cannot write {shortened(out)}: {one_line(error)}") from error
    if target in (recording, *recording.parents) and target.is_dir():
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


def read_bytes(path: str | Path, limit: int = MAX_BYTES) -> bytes:
    """Content of a regular file: no device, which may have no end, and no pipe, which may have no beginning.

    Raises:
        InputError: if it cannot be read, or is larger than `limit` bytes.
    """
    try:
        about = Path(path).stat()
        if not stat.S_ISREG(about.st_mode):
            raise InputError(f"cannot read {path}: expected a regular file, got a folder, device or pipe")
        if about.st_size > limit:
            raise InputError(f"{path}: expected at most {limit} bytes, got {about.st_size}")
        with Path(path).open("rb") as file:
            content = file.read(about.st_size + 1)  # what is asked for is allocated, be it there or not
            if len(content) > about.st_size:  # it does not tell its size, or grows
                content += file.read(limit + 1 - len(content))
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        reason = getattr(error, "strerror", None) or one_line(error)
        raise InputError(
            f"cannot read {shortened(path) if chr(0) in str(path) else path}: {reason}"
        ) from error
    if len(content) > limit:  # it grew meanwhile, or does not tell its size
        raise InputError(f"{path}: expected at most {limit} bytes, got more")
    if content.startswith(LFS_POINTER):
        raise InputError(f"{path}: only a pointer of Git LFS is there, not the file: run 'git lfs pull'")
    return content


def _sync_folder(folder: Path) -> None:
    """Make a rename outlive a power cut, where the file system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def output_error(path: Path, error: OSError) -> OutputError:
    """One line of why a file or folder cannot be written."""
    return OutputError(f"cannot write {path}: {error.strerror or error}")
