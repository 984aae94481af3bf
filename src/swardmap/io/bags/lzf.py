"""LZF, the compression inside PCD files (DATA binary_compressed)."""

from swardmap.errors import InputError

MAX_EXPANSION = 264 / 3
"""No LZF stream can grow by more: a reference of 3 bytes stands for at most 264."""


def lzf_decompress(packed: bytes, size: int) -> bytes:
    """Decompress an LZF stream.

    A control byte below 32 is followed by that many bytes and one more, as they are. Any other holds a
    length (3 bits, 7 = one more byte) and, with the byte after it, how far back to copy from (13 bits).

    Args:
        packed: the stream.
        size: length of the result, known beforehand.

    Raises:
        InputError: if the stream is damaged or does not give `size` bytes.
    """
    if size > len(packed) * MAX_EXPANSION:
        raise InputError(f"damaged LZF data: {len(packed)} bytes cannot hold {size}")
    out = bytearray()
    at, end = 0, len(packed)
    try:
        while at < end and len(out) <= size:
            control = packed[at]
            at += 1
            if control < 32:
                out += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += packed[at]
                at += 1
            _copy_back(out, ((control & 31) << 8) + packed[at] + 1, length + 2)
            at += 1
    except IndexError:
        at = end + 1
    if at != end or len(out) != size:
        raise InputError(f"damaged LZF data: expected {size} bytes, got {len(out)} or a broken end")
    return bytes(out)


def _copy_back(out: bytearray, distance: int, length: int) -> None:
    start = len(out) - distance
    if start < 0:
        raise IndexError
    piece = out[start : start + length]
    if len(piece) < length:  # the copy overlaps what it writes: the piece repeats
        piece = (piece * (length // len(piece) + 1))[:length]
    out += piece
