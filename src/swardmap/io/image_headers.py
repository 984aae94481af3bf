"""What image files say of themselves, read before any decoder gets them.

OpenCV hands out the upper part of a truncated PNG or JPEG without a word, takes gigabytes for one damaged
length byte, and decodes whatever it knows. So only formats whose size can be looked up here are decoded, and
PNG, where every chunk has a checksum, is walked to its end.
"""

import struct
import zlib
from collections.abc import Callable, Iterator

from swardmap.errors import InputError

MAX_PIXELS = 100_000_000
MAX_DECODED_BYTES = 512 * 2**20
PNG_START = b"\x89PNG\r\n\x1a\n"
JPEG_START, JPEG_END = b"\xff\xd8\xff", b"\xff\xd9"
JPEG_FRAMES = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})
TIFF_EXTENTS = (273, 279, 324, 325)
"""Tags of where strips and tiles begin and how long they are."""
CHANNELS_OF_PNG = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}

Size = tuple[int, int, int]
"""Width, height, bytes a pixel when decoded."""


def check_image(content: bytes, name: str, max_pixels: int = MAX_PIXELS) -> None:
    """Refuse what is no whole image of a known format and a sane size.

    Args:
        content: of the file or message.
        name: for messages.
        max_pixels: largest number of pixels.

    Raises:
        InputError: saying what is wrong.
    """
    size_of = _reader(content)
    if size_of is None:
        raise InputError(
            f"{name}: expected a PNG, JPEG, TIFF, BMP, WebP or PNM image, got something else "
            f"({len(content)} bytes)"
        )
    try:
        width, height, pixel_bytes = size_of(content, name)
    except (struct.error, IndexError, ValueError) as error:
        raise InputError(f"{name}: the image is truncated or damaged ({len(content)} bytes)") from error
    if not (0 < width * height <= max_pixels and width > 0):
        raise InputError(f"{name}: expected an image of at most {max_pixels} pixels, got {width} x {height}")
    if width * height * pixel_bytes > MAX_DECODED_BYTES:
        raise InputError(
            f"{name}: expected an image of at most {MAX_DECODED_BYTES} bytes, got {width} x {height} pixels "
            f"of {pixel_bytes} bytes"
        )


def _reader(content: bytes) -> Callable[[bytes, str], Size] | None:
    starts: tuple[tuple[bytes, Callable[[bytes, str], Size]], ...] = (
        (PNG_START, _png),
        (JPEG_START, _jpeg),
        (b"BM", _bmp),
        (b"II*\0", _tiff),
        (b"MM\0*", _tiff),
        *((b"P%d" % n, _pnm) for n in range(1, 7)),
    )
    if content[:4] == b"RIFF" and content[8:12] == b"WEBP":
        return _webp
    return next((reader for start, reader in starts if content.startswith(start)), None)


def _png(content: bytes, name: str) -> Size:
    """Walk the chunks to IEND, checksum by checksum."""
    at, kind, size = 8, b"", (0, 0, 0)
    while kind != b"IEND":
        if len(content) < at + 12:
            raise InputError(
                f"{name}: the image is truncated ({len(content)} bytes and no end); copy it again"
            )
        length, kind = struct.unpack(">I4s", content[at : at + 8])
        end = at + 8 + length
        if len(content) < end + 4:
            raise InputError(
                f"{name}: the image is truncated or damaged: a chunk of {length} bytes is not there"
            )
        if zlib.crc32(memoryview(content)[at + 4 : end]) != int.from_bytes(content[end : end + 4]):
            raise InputError(f"{name}: the image is damaged: the checksum of a chunk is wrong; copy it again")
        if kind == b"IHDR" and size != (0, 0, 0):
            raise InputError(f"{name}: the image is damaged: it has two headers")
        if kind == b"IHDR":
            width, height, bits, colour = struct.unpack(">IIBB", content[at + 8 : at + 18])
            size = width, height, CHANNELS_OF_PNG.get(colour, 4) * (2 if bits == 16 else 1)
        at = end + 4
    return size


def _jpeg(content: bytes, name: str) -> Size:
    """Follow the segments to the pixels, behind which the end must come; cameras may pad it."""
    at, size = 2, (0, 0, 0)
    while True:
        while content[at] == 0xFF and content[at + 1] == 0xFF:
            at += 1
        if content[at] != 0xFF:
            raise ValueError("no segment")
        marker = content[at + 1]
        if marker in JPEG_FRAMES:
            if size != (0, 0, 0):
                raise ValueError("two headers")
            _, bits, height, width, channels = struct.unpack(">HBHHB", content[at + 2 : at + 10])
            size = width, height, (1 if channels == 1 else 3) * (2 if bits > 8 else 1)
        if marker == 0xDA:
            break
        alone = marker == 0x01 or 0xD0 <= marker <= 0xD8
        at += 2 if alone else 2 + max(2, int.from_bytes(content[at + 2 : at + 4]))
    if content.find(JPEG_END, at) < 0:  # among pixels a byte of 0xFF is followed by 0
        raise InputError(f"{name}: the image is truncated ({len(content)} bytes and no end); copy it again")
    return size


def _bmp(content: bytes, name: str) -> Size:
    (size,) = struct.unpack("<I", content[2:6])
    (head,) = struct.unpack("<I", content[14:18])
    width, height = struct.unpack("<HH" if head == 12 else "<ii", content[18 : 22 if head == 12 else 26])
    if len(content) < size:
        raise InputError(f"{name}: truncated BMP: expected {size} bytes, got {len(content)}")
    return width, abs(height), 4


def _tiff(content: bytes, name: str) -> Size:
    """The first directory alone, in one strip or many; what is not there counts as its default."""
    order = "<" if content[:2] == b"II" else ">"
    if not _tiff_is_whole(content, order):
        raise InputError(f"{name}: the image is truncated ({len(content)} bytes and no end); copy it again")
    (at,) = struct.unpack(f"{order}I", content[4:8])
    entries = list(_tiff_tags(content, at, order))
    tags = dict(entries)
    if len(tags) < len(entries):
        raise InputError(f"{name}: the image is damaged: it says something twice")
    width, height, bits, channels = (
        tags.get(tag, default) for tag, default in ((256, 0), (257, 0), (258, 8), (277, 1))
    )
    return width, height, max(1, channels) * max(1, (max(bits, 8) + 7) // 8)


def _tiff_is_whole(content: bytes, order: str) -> bool:
    """Whether all strips or tiles of the first image lie inside: OpenCV reads what is missing as zeros."""
    sizes = {1: "B", 3: "H", 4: "I"}
    try:
        (at,) = struct.unpack_from(order + "I", content, 4)
        (count,) = struct.unpack_from(order + "H", content, at)
        struct.unpack_from(order + "I", content, at + 2 + 12 * count)  # where the next image would be
        tags: dict[int, tuple[int, ...]] = {}
        for entry in range(at + 2, at + 2 + 12 * count, 12):
            tag, kind, n = struct.unpack_from(order + "HHI", content, entry)
            if tag in TIFF_EXTENTS and kind in sizes and n <= len(content):
                layout = f"{order}{n}{sizes[kind]}"
                fits = struct.calcsize(layout) <= 4
                place = entry + 8 if fits else struct.unpack_from(order + "I", content, entry + 8)[0]
                tags[tag] = struct.unpack_from(layout, content, place)
    except struct.error:
        return False
    starts = tags.get(273, tags.get(324, ()))
    lengths = tags.get(279, tags.get(325, ()))
    return all(start + length <= len(content) for start, length in zip(starts, lengths, strict=False))


def _tiff_tags(content: bytes, at: int, order: str) -> Iterator[tuple[int, int]]:
    (count,) = struct.unpack(f"{order}H", content[at : at + 2])
    for k in range(count):
        entry = content[at + 2 + 12 * k : at + 14 + 12 * k]
        tag, kind, number = struct.unpack(f"{order}HHI", entry[:8])
        if kind == 3 and number > 2:  # shorts that lie elsewhere: bits of each channel
            (where,) = struct.unpack(f"{order}I", entry[8:12])
            yield tag, struct.unpack(f"{order}H", content[where : where + 2])[0]
        elif kind in (3, 4):
            yield (
                tag,
                struct.unpack(f"{order}{'H' if kind == 3 else 'I'}", entry[8 : 10 if kind == 3 else 12])[0],
            )


def _webp(content: bytes, name: str) -> Size:
    (size,) = struct.unpack("<I", content[4:8])
    if len(content) < size + 8:
        raise InputError(f"{name}: the image is truncated: expected {size + 8} bytes, got {len(content)}")
    kind, data = content[12:16], content[20:30]
    if kind == b"VP8X":
        return int.from_bytes(data[4:7], "little") + 1, int.from_bytes(data[7:10], "little") + 1, 4
    if kind == b"VP8L":
        bits = int.from_bytes(data[1:5], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1, 4
    width, height = struct.unpack("<HH", data[6:10])
    return width & 0x3FFF, height & 0x3FFF, 3


def _pnm(content: bytes, _: str) -> Size:
    words: list[int] = []
    for line in content[2:1000].splitlines():  # a comment ends where OpenCV says: at either end of a line
        for word in line.split(b"#")[0].split():
            if len(word) > 9 or not word.isdigit():
                raise ValueError("no number")
            words.append(int(word))
            if len(words) == 2:
                return words[0], words[1], 6
    raise ValueError("no size")
