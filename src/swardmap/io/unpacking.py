"""Packed bytes as they were, with a bound on what really comes out.

What a header says of a size is a claim: a member of an archive, a chunk or a message of a recording that
says "1 kB" may hold gigabytes. The calls that unpack all at once (`ZipFile.read`, `zstd.decompress`, ...)
have them in memory before anyone compares. Here the decoder itself stops at the bound.
"""

import bz2
import sys
import zipfile
from collections.abc import Callable
from typing import Any, Protocol

MAX_UNPACKED_BYTES = 2**30
"""Of one chunk or message, or of all members of an archive together."""
PIECE_BYTES = 2**12
"""Of a member: LZMA, whose decoder zipfile does not tell where to stop, makes at most 30 MB of as many."""


class Decoder(Protocol):
    """What the decoders of bz2, lz4.frame and zstd have in common."""

    @property
    def eof(self) -> bool:
        """Whether the end of the stream was reached."""

    @property
    def unused_data(self) -> bytes:
        """What lies behind that end."""

    def decompress(self, data: bytes, max_length: int) -> bytes:
        """At most `max_length` bytes of the stream."""


def unpack(data: bytes, decoder: Callable[[], Decoder], limit: int = MAX_UNPACKED_BYTES) -> bytes:
    """Unpack one stream, or several one behind the other.

    Args:
        data: packed.
        decoder: makes one for a stream.
        limit: bytes that may come out.

    Raises:
        ValueError: if more would come out, or a stream does not end; an error of the decoder's own, if it is
            damaged. The caller reads inside `door.reading`.
    """
    pieces, left = [], limit
    while data:
        stream = decoder()
        pieces.append(stream.decompress(data, left + 1))
        left -= len(pieces[-1])
        if left < 0:
            raise ValueError(f"it unpacks to more than the {limit} bytes that were expected at most")
        if not stream.eof:
            raise ValueError(f"packed data that end early, after {len(data)} bytes")
        data = stream.unused_data
    return pieces[0] if len(pieces) == 1 else b"".join(pieces)


def unzstd(data: bytes, limit: int = MAX_UNPACKED_BYTES) -> bytes:
    """Unpack Zstandard. See `unpack`."""
    return unpack(data, zstd().ZstdDecompressor, limit)


def unlz4(data: bytes, limit: int = MAX_UNPACKED_BYTES) -> bytes:
    """Unpack frames of LZ4. See `unpack`."""
    from lz4.frame import LZ4FrameDecompressor

    return unpack(data, LZ4FrameDecompressor, limit)


def unbz2(data: bytes, limit: int = MAX_UNPACKED_BYTES) -> bytes:
    """Unpack bzip2. See `unpack`."""
    return unpack(data, bz2.BZ2Decompressor, limit)


def unzip_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """A member of a zip archive, no larger than its header says: in pieces, where `read` takes all at once.

    Raises:
        Exception: of any kind, if it is damaged.
    """
    with archive.open(member) as stream:
        return b"".join(iter(lambda: stream.read(PIECE_BYTES), b""))


def zstd() -> Any:
    """The standard library's zstd, or what rosbags takes for it before Python 3.14."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd
