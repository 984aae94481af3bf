"""The checksums of an MCAP file that its reader leaves unread.

rosbags compares those of chunks. That of the summary, which leads to the chunks, is compared here; and that
of the data where messages lie outside of chunks. Both are optional in the format, 0 = none.
"""

import struct
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

from swardmap.errors import InputError

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER = struct.Struct("<BQQQI8s")
_DATA_END = struct.Struct("<BQI")
_RECORD = struct.Struct("<BQ")
_MESSAGE, _CHUNK, _DATA_END_CODE = 0x05, 0x06, 0x0F
_PIECE_BYTES = 2**20


def check_mcap(path: Path) -> None:
    """Compare the checksums of a file that has some; what is no MCAP file is left to the reader.

    Raises:
        InputError: if one differs.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        if size < _FOOTER.size + len(_MAGIC):
            return
        file.seek(size - _FOOTER.size)
        _, _, summary_start, _, summary_crc, magic = _FOOTER.unpack(file.read(_FOOTER.size))
        if magic != _MAGIC:
            return
        begin, end = summary_start or size - _FOOTER.size, size - len(_MAGIC) - 4
        if summary_crc and (begin > end or _checksum(file, begin, end) != summary_crc):
            raise _damaged(path, "summary")
        data_end = begin - _DATA_END.size
        if data_end < len(_MAGIC) or _has_chunks(file):
            return
        file.seek(data_end)
        code, _, data_crc = _DATA_END.unpack(file.read(_DATA_END.size))
        if code == _DATA_END_CODE and data_crc and _checksum(file, 0, data_end) != data_crc:
            raise _damaged(path, "data")


def _damaged(path: Path, part: str) -> InputError:
    return InputError(
        f"{path}: the checksum of its {part} differs: the file is damaged. Copy it again; `mcap recover` "
        "saves what is whole."
    )


def _checksum(file: BinaryIO, begin: int, end: int) -> int:
    file.seek(begin)
    left, crc = end - begin, 0
    while left > 0 and (piece := file.read(min(left, _PIECE_BYTES))):
        crc, left = crc32(piece, crc), left - len(piece)
    return crc


def _has_chunks(file: BinaryIO) -> bool:
    """Whether the first messages lie in a chunk, which has a checksum of its own."""
    file.seek(len(_MAGIC))
    while len(head := file.read(_RECORD.size)) == _RECORD.size:
        code, length = _RECORD.unpack(head)
        if code in (_MESSAGE, _CHUNK, _DATA_END_CODE):
            return bool(code == _CHUNK)
        file.seek(length, 1)
    return False
