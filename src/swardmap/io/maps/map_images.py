"""Grey images of maps: PGM, PNG and BMP to arrays, and PGM back. Row 0 is the top, as in the file."""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.grid import MAX_CELLS

GreyImage = tuple[NDArray[np.uint8], NDArray[np.uint8] | None]
"""Grey levels (H, W), and opacity (H, W) where the file has any."""


def encode_pgm(grey: NDArray[np.uint8]) -> bytes:
    """An (H, W) uint8 array as binary PGM (P5, 255 levels)."""
    height, width = grey.shape
    return b"P5\n%d %d\n255\n" % (width, height) + np.ascontiguousarray(grey).tobytes()


def decode_grey(content: bytes, name: str) -> GreyImage:
    """Decode PGM, PNG or BMP, told apart by content; colours become their luma, 16 bits become 8.

    Args:
        content: bytes of the file.
        name: of the file, for messages.

    Raises:
        InputError: for another format, and for an image that is truncated, damaged or too large.
    """
    if content[:2] in (b"P5", b"P2"):
        return _decode_pgm(content, name), None
    check_image(content, name)
    return _decode_with_opencv(content, name)


def check_image(content: bytes, name: str) -> None:
    """Refuse what is no whole PNG or BMP of a sane size, before OpenCV sees it (see `image_headers`).

    Raises:
        InputError: saying what is wrong.
    """
    if content[:8] == b"\x89PNG\r\n\x1a\n":
        _check_png(content, name)
    elif content[:2] == b"BM" and len(content) >= 26:
        _check_bmp(content, name)
    else:
        raise InputError(f"{name}: expected a PGM, PNG or BMP image, got something else or an empty file")


def _decode_pgm(content: bytes, name: str) -> NDArray[np.uint8]:
    (width, height, levels), start = _pgm_header(content, name)
    _check_size(width, height, name)
    if not 1 <= levels <= 65535:
        raise InputError(f"{name}: expected 1 to 65535 grey levels, got {levels}")
    count = width * height
    if content[:2] == b"P5":
        kind = np.dtype(np.uint8 if levels < 256 else ">u2")
        if len(content) - start < count * kind.itemsize:
            raise InputError(f"{name}: truncated: {width} x {height} pixels are not all there")
        if levels == 255:  # as nearly all are
            return np.frombuffer(content, np.uint8, count, start).reshape(height, width)
        values = np.frombuffer(content, kind, count, start).astype(np.int64)
    else:
        words = content[start:].split(maxsplit=count)[:count]
        if len(words) < count or not all(word.isdigit() and len(word) < 6 for word in words):
            raise InputError(f"{name}: expected {count} whole numbers, got {len(words)} or other text")
        values = np.array(words, np.int64)
    if values.max() > levels:
        raise InputError(f"{name}: a pixel is brighter than the {levels} levels of the header")
    grey: NDArray[np.uint8] = ((values * 255 + levels // 2) // levels).astype(np.uint8)
    return grey.reshape(height, width)


def _pgm_header(content: bytes, name: str) -> tuple[list[int], int]:
    """Width, height and levels, and where the pixels start: after one white space."""
    numbers: list[int] = []
    at = 2
    while len(numbers) < 3:
        while content[at : at + 1].isspace() or content[at : at + 1] == b"#":
            at = content.find(b"\n", at) + 1 or len(content) if content[at : at + 1] == b"#" else at + 1
        end = at
        while content[end : end + 1].isdigit() and end - at < 10:
            end += 1
        if end == at:
            raise InputError(f"{name}: damaged PGM header: expected width, height and grey levels")
        numbers.append(int(content[at:end]))
        at = end
    return numbers, at + 1


def _check_size(width: int, height: int, name: str) -> None:
    if not (width > 0 and height > 0 and width * height <= MAX_CELLS):
        raise InputError(f"{name}: expected 1 to {MAX_CELLS} pixels, got {width} x {height}")


def _check_png(content: bytes, name: str) -> None:
    """Walk the chunks: OpenCV returns a truncated image as if the rest were black, that is, obstacles."""
    at, kind = 8, b""
    while kind != b"IEND":
        if len(content) < at + 12:
            raise InputError(f"{name}: truncated PNG")
        length, kind = struct.unpack(">I4s", content[at : at + 8])
        body_end = at + 8 + length
        if zlib.crc32(content[at + 4 : body_end]) != int.from_bytes(content[body_end : body_end + 4]):
            raise InputError(f"{name}: truncated or damaged PNG")
        if kind == b"IHDR" and length == 13:
            width, height = struct.unpack(">II", content[at + 8 : at + 16])
            _check_size(width, height, name)
        at = body_end + 4


def _check_bmp(content: bytes, name: str) -> None:
    (size,) = struct.unpack("<I", content[2:6])
    width, height = struct.unpack("<ii", content[18:26])
    _check_size(width, abs(height), name)
    if len(content) < size:
        raise InputError(f"{name}: truncated BMP: expected {size} bytes, got {len(content)}")


def _decode_with_opencv(content: bytes, name: str) -> GreyImage:
    import cv2

    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise InputError(f"{name}: cannot be decoded: {error}") from error
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{name}: cannot be decoded: damaged, or not an image of 8 or 16 bits")
    if image.dtype == np.uint16:
        image = ((image.astype(np.uint32) + 128) // 257).astype(np.uint8)
    if image.ndim == 2 or image.shape[2] == 1:
        return image.reshape(image.shape[:2]), None
    opacity = np.ascontiguousarray(image[..., -1]) if image.shape[2] in (2, 4) else None
    if image.shape[2] == 2:
        return np.ascontiguousarray(image[..., 0]), opacity
    return cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY), opacity
