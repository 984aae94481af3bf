"""Point Cloud Data (PCL's PCD v0.7) to structured arrays, and XYZL clouds back."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.bags.lzf import lzf_decompress
from swardmap.io.number_tables import as_kind, format_table, parse_table

COMMENT = "# swardmap "
"""Starts the comment in which swardmap keeps what the format has no place for."""

KINDS: Mapping[tuple[str, int], str] = {
    **{("F", n): f"<f{n}" for n in (4, 8)},
    **{("U", n): f"<u{n}" for n in (1, 2, 4, 8)},
    **{("I", n): f"<i{n}" for n in (1, 2, 4, 8)},
}
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("label", "<u4")])
MAX_HEADER_BYTES = 65_536
MAX_POINT_BYTES = 65_536


@dataclass(frozen=True, slots=True)
class PcdHeader:
    """The header, checked: what a point holds, how many there are, how and where they are stored."""

    point: np.dtype[np.void]
    count: int
    encoding: str
    start: int
    comment: str


def encode_pcd(points: NDArray[np.void], comment: str, ascii_text: bool = False) -> bytes:
    """XYZL points as PCD v0.7, as PCL writes PointXYZL packed.

    Args:
        points: (N,) of dtype POINT.
        comment: one line of text for `COMMENT`.
        ascii_text: write numbers as text, with digits enough to read the same floats.
    """
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\n"
        f"{COMMENT}{comment}\n"
        "VERSION 0.7\nFIELDS x y z label\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\n"
        f"DATA {'ascii' if ascii_text else 'binary'}\n"
    )
    if not ascii_text:
        return header.encode("ascii") + points.tobytes()
    return header.encode("ascii") + format_table(points)


def decode_pcd(content: bytes, name: str) -> tuple[NDArray[np.void], str]:
    """Decode a PCD file: ascii, binary or binary_compressed, any fields in any order.

    Args:
        content: bytes of the file.
        name: of the file, for messages.

    Returns:
        (N,) structured array with the fields of the file, points without a reading included, and
        swardmap's comment, "" if there is none. Padding (fields named `_`) is left out.

    Raises:
        InputError: if it is damaged; nothing is allocated before the sizes are found to fit the file.
    """
    header = parse_header(content, name)
    body = memoryview(content)[header.start :]
    if header.encoding == "ascii":
        points = _decode_text(bytes(body), header, name)
    elif header.encoding == "binary":
        needed = header.count * header.point.itemsize
        if len(body) < needed:
            raise InputError(f"{name}: truncated: expected {needed} bytes of points, got {len(body)}")
        points = np.frombuffer(body, header.point, header.count)
    else:
        points = _decode_compressed(body, header, name)
    kept = [field for field in header.point.names or () if not field.startswith("_")]
    return points[kept], header.comment


def parse_header(content: bytes, name: str) -> PcdHeader:
    """Read and check the header of a PCD file."""
    entries, comment, start = _header_lines(content, name)
    fields = entries.get("FIELDS", entries.get("COLUMNS", []))
    kinds = entries.get("TYPE", [])
    sizes = _numbers(entries.get("SIZE", []), "SIZE", name)
    counts = _numbers(entries.get("COUNT", ["1"] * len(fields)), "COUNT", name)
    if not fields or not len(fields) == len(kinds) == len(sizes) == len(counts):
        raise InputError(f"{name}: expected FIELDS, SIZE, TYPE and COUNT of one length, at least one field")
    width, height = (_numbers(entries.get(key, ["1"]), key, name)[0] for key in ("WIDTH", "HEIGHT"))
    count = _numbers(entries.get("POINTS", [str(width * height)]), "POINTS", name)[0]
    if "WIDTH" in entries and count != width * height:
        raise InputError(f"{name}: {width} x {height} points are announced, but also {count}")
    point = _point_dtype(fields, kinds, sizes, counts, name)
    encoding = " ".join(entries["DATA"]).lower()
    if encoding not in ("ascii", "binary", "binary_compressed"):
        raise InputError(f"{name}: expected DATA ascii, binary or binary_compressed, got '{encoding}'")
    return PcdHeader(point, count, encoding, start, comment)


def _header_lines(content: bytes, name: str) -> tuple[dict[str, list[str]], str, int]:
    entries: dict[str, list[str]] = {}
    comment, at = "", 0
    while "DATA" not in entries:
        end = content.find(b"\n", at, MAX_HEADER_BYTES)
        if end < 0:
            raise InputError(f"{name}: not a PCD file: no DATA line in its header")
        line = content[at:end].decode("utf-8", "replace").strip()
        at = end + 1
        if line.startswith(COMMENT):
            comment = line.removeprefix(COMMENT)
        elif line and not line.startswith("#"):
            key, *values = line.split()
            entries[key.upper()] = values
    return entries, comment, at


def _numbers(words: list[str], key: str, name: str) -> list[int]:
    if not words or not all(word.isascii() and word.isdigit() and len(word) < 16 for word in words):
        raise InputError(f"{name}: expected {key} to hold whole numbers from 0, got '{' '.join(words)}'")
    return [int(word) for word in words]


def _point_dtype(
    fields: list[str], kinds: list[str], sizes: list[int], counts: list[int], name: str
) -> np.dtype[np.void]:
    if sum(s * c for s, c in zip(sizes, counts, strict=True)) > MAX_POINT_BYTES:
        raise InputError(f"{name}: a point of more than {MAX_POINT_BYTES} bytes")
    members: list[Any] = []
    for index, (field, kind, size, count) in enumerate(zip(fields, kinds, sizes, counts, strict=True)):
        code = KINDS.get((kind.upper(), size))
        if field == "_":  # padding: any size, named apart
            members.append((f"_{index}", "V1", (size * count,)))
        elif code is None or not 0 < count <= MAX_POINT_BYTES:
            raise InputError(
                f"{name}: field '{field}': no such number: TYPE {kind} SIZE {size} COUNT {count}"
            )
        elif field.startswith("_") or field in fields[:index]:
            members.append((f"_{index}_{field}", code, (count,)))
        else:
            members.append((field, code) if count == 1 else (field, code, (count,)))
    return np.dtype(members)


def _decode_text(body: bytes, header: PcdHeader, name: str) -> NDArray[np.void]:
    fields = header.point.names or ()
    widths = [int(np.prod(header.point[field].shape, dtype=int)) for field in fields]
    columns = sum(widths)
    if len(body) + 1 < header.count * columns * 2:  # a digit and a space each
        raise InputError(f"{name}: truncated: {header.count} points are not all there")
    points = np.zeros(header.count, header.point)
    table = parse_table(body, header.count, columns, name)
    at = 0
    for field, width in zip(fields, widths, strict=True):
        if not field.startswith("_"):
            values = table[:, at : at + width].reshape(points[field].shape)
            points[field] = as_kind(values, points[field].dtype, f"{name}: field '{field}'")
        at += width
    return points


def _decode_compressed(body: memoryview, header: PcdHeader, name: str) -> NDArray[np.void]:
    if len(body) < 8:
        raise InputError(f"{name}: truncated: the sizes of the compressed data are missing")
    packed_size, size = struct.unpack("<II", body[:8])
    if size != header.count * header.point.itemsize:
        raise InputError(f"{name}: the points take {header.count * header.point.itemsize} bytes, not {size}")
    if len(body) < 8 + packed_size:
        raise InputError(f"{name}: truncated: expected {packed_size} compressed bytes, got {len(body) - 8}")
    try:
        raw = lzf_decompress(bytes(body[8 : 8 + packed_size]), size)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    points = np.zeros(header.count, header.point)
    at = 0
    for field in header.point.names or ():  # stored field by field
        values = np.frombuffer(raw, points[field].dtype, points[field].size, at)
        points[field] = values.reshape(points[field].shape)
        at += points[field].nbytes
    return points
