"""The files of a recording: which they are, unpacked where they are packed, and whole.

A ROS 2 bag is a folder with metadata.yaml and .db3 or .mcap files, each perhaps packed (.zstd). Where the
recorder was killed metadata.yaml is missing, and messages may lie in SQLite's log beside the file.
"""

import re
import shutil
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any

from swardmap.errors import InputError
from swardmap.io.bags.mcap_checksums import check_mcap
from swardmap.io.door import read_yaml, reading
from swardmap.io.unpacking import unzstd, zstd

METADATA = "metadata.yaml"
STORAGE = (".db3", ".mcap")
PACKED = ".zstd"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
NEWEST_METADATA = 9
PIECE_BYTES = 2**20
MAX_MESSAGE_BYTES = 2**29
"""Far more than the largest image that is read."""

_SERIES = re.compile(r"(.*)_(\d{1,6})")
"""rosbag2 numbers the files of a recording that it splits: NAME_0.mcap, NAME_1.mcap."""


def is_storage(path: Path) -> bool:
    """Whether a name is that of a storage file, packed or not."""
    return Path(path.name.removesuffix(PACKED)).suffix in STORAGE


def storage_files(path: Path) -> list[Path]:
    """The storage files of a recording, in order of time.

    Args:
        path: one such file, or a folder.

    Raises:
        InputError: if there is none, one that metadata.yaml names is missing, or they are several recordings.
    """
    if not path.is_dir():
        return [path]
    try:
        here = sorted(p for p in path.iterdir() if is_storage(p))
    except OSError as error:
        raise InputError(f"cannot list {path}: {error}") from error
    named = [path / PurePath(name).name for name in _metadata(path).get("relative_file_paths") or []]
    missing = [p.name for p in named if not p.exists()]
    if missing:
        raise InputError(
            f"{path}: files that {METADATA} names are missing: {', '.join(missing)}. Copy them there, or "
            "open one of the others by itself."
        )
    if named or len(here) == 1:
        return named or here
    series = [_SERIES.fullmatch(p.name.removesuffix(PACKED).rpartition(".")[0]) for p in here]
    numbers = sorted(int(m[2]) for m in series if m)
    if not here or numbers != list(range(len(here))) or len({m[1] for m in series if m}) != 1:
        raise InputError(
            f"{path}: expected the folder of a ROS 2 bag, with {METADATA} and its storage files; without "
            f"{METADATA}, files NAME_0.mcap, NAME_1.mcap, ..., or one of them by itself. Found "
            f"{', '.join(p.name for p in here) or 'no .db3 or .mcap file'}."
        )
    numbered = sorted(zip([int(m[2]) for m in series if m], here, strict=True))
    return [p for _, p in numbered]


def message_count(path: Path) -> int | None:
    """How many messages metadata.yaml says there are."""
    count = _metadata(path).get("message_count")
    return count if isinstance(count, int) else None


def check_file(path: Path) -> None:
    """Refuse an SQLite file that was cut off, or has messages in a log beside it; a damaged MCAP file.

    SQLite notices that a file was cut off only when it comes to a page that is not there, and what lies in
    the log is not seen by a reader that leaves the file as it is.

    Raises:
        InputError: if it is one.
    """
    if path.suffix == ".mcap":
        check_mcap(path)
    if path.suffix != ".db3":
        return
    for log in (path.with_name(path.name + "-wal"), path.with_name(path.name + "-journal")):
        if log.is_file() and log.stat().st_size > 0:
            command = f"import sqlite3; sqlite3.connect('{path}').execute('PRAGMA wal_checkpoint(TRUNCATE)')"
            raise InputError(
                f"{path}: the recorder was killed, and messages lie in {log.name} "
                f'({log.stat().st_size} bytes). Bring them into the file first: python3 -c "{command}"'
            )
    with path.open("rb") as file:
        head = file.read(100)
    if len(head) < 100:
        raise InputError(f"{path}: expected an SQLite database, got {len(head)} bytes. Is it whole?")
    (page_bytes,), (pages,) = struct.unpack(">H", head[16:18]), struct.unpack(">I", head[28:32])
    expected = pages * (65536 if page_bytes == 1 else page_bytes)
    number_is_valid = (
        head.startswith(b"SQLite") and head[24:28] == head[92:96]
    )  # the count of changes it was written with
    if number_is_valid and path.stat().st_size < expected:
        raise InputError(
            f"{path}: the recording was cut off: it has {path.stat().st_size} of {expected} bytes. Copy it "
            "again, or recover what is left with `sqlite3 FILE .recover`."
        )


@contextmanager
def unpacked(files: list[Path]) -> Iterator[list[Path]]:
    """The files, those that are packed unpacked into a folder that is gone at the end."""
    if not any(file.suffix == PACKED for file in files):
        yield files
        return
    with TemporaryDirectory(prefix="swardmap-") as folder:
        yield [_unpack(file, Path(folder)) if file.suffix == PACKED else file for file in files]


def unpacked_message(data: bytes) -> bytes:
    """A message as it was sent: `ros2 bag record --compression-mode message` packs each by itself.

    No CDR message begins as a zstd frame does, so that the metadata need not be asked.
    """
    return unzstd(data, MAX_MESSAGE_BYTES) if data[:4] == ZSTD_MAGIC else data


def _unpack(file: Path, folder: Path) -> Path:
    """Unpack a file, which may be as large as a drive is long, but may not fill the disk.

    Raises:
        InputError: if it takes more of the disk than there is to take.
    """
    out, written = folder / file.stem, 0
    room = shutil.disk_usage(folder).free * 9 // 10
    with file.open("rb") as packed, zstd().open(packed, "rb") as plain, out.open("wb") as unpacked_file:
        while piece := plain.read(PIECE_BYTES):
            written += len(piece)
            if written > room:
                raise InputError(
                    f"{file}: unpacks to more than {room} bytes, which is what {folder.parent} has room for. "
                    "Unpack it elsewhere (`zstd -d`), or name a larger folder with TMPDIR=..."
                )
            unpacked_file.write(piece)
    return out


def _metadata(path: Path) -> dict[str, Any]:
    """What metadata.yaml holds; empty without one.

    Raises:
        InputError: if it is none, or of a version that is not known.
    """
    file = path / METADATA
    if not file.is_file():
        return {}
    with reading(f"metadata of a ROS 2 bag, {file}", "a whole file"):
        tree = dict(read_yaml(file)["rosbag2_bagfile_information"])
        version = int(tree["version"])
    if version > NEWEST_METADATA:
        raise InputError(f"{file}: expected version {NEWEST_METADATA} at most, got {version}")
    return tree
