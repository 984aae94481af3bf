"""Arrays in MATLAB's version 5 files.

Read here and not by SciPy, whose reader crashes the process on some damaged files (found by flipping
bytes). Layout: "MAT-File Format", The MathWorks, chapter 1.
"""

import math
import zlib
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.door import reading, through_door
from swardmap.io.files import read_bytes, write_bytes

MAX_BYTES = 512 * 2**20
HEADER_BYTES, TEXT_BYTES = 128, 116
ORDERS = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}
"""Version 5 in both byte orders."""
HDF5_VERSION, HDF5_START = b"\x00\x02IM", b"\x89HDF"
TEXT = b"MATLAB 5.0 MAT-file, written by swardmap"

MATRIX, COMPRESSED = 14, 15
STORED_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
CLASS_TYPES = {
    6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"
}  # fmt: skip
COMPLEX = 0x0800


@through_door("a .mat file")
def read_mat(file: Path, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Read named arrays of real numbers.

    Args:
        file: a version 5 .mat file.
        names: of the arrays wanted; those that the file lacks are left out.

    Returns:
        Arrays by name, of the type and shape of their MATLAB class.

    Raises:
        InputError: if it is truncated, of another version, or holds something else under a name.
    """
    content = read_bytes(file, MAX_BYTES)
    version = content[HEADER_BYTES - 4 : HEADER_BYTES]
    if version == HDF5_VERSION or HDF5_START in (content[:4], content[512:516]):
        raise InputError(
            f"{file}: expected a MATLAB file of version 5, got HDF5 (version 7.3); save it again with '-v7'"
        )
    if version not in ORDERS:
        raise InputError(
            f"{file}: expected a MATLAB file of version 5, got {len(content)} bytes of something else"
        )
    arrays: dict[str, NDArray[Any]] = {}
    order = ORDERS[version]
    with reading(file, "a MATLAB file that is whole"):
        for kind, data in _elements(memoryview(content)[HEADER_BYTES:], order):
            for inner_kind, inner in _unpacked(kind, data, order):
                name, array = _matrix(inner, order, names) if inner_kind == MATRIX else ("", None)
                if array is not None:
                    arrays[name] = array
    return arrays


def write_mat(file: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays, compressed; equal arrays give equal bytes.

    Raises:
        OutputError: if it cannot be written.
    """
    from scipy.io import savemat

    buffer = BytesIO()
    savemat(buffer, dict(arrays), do_compression=True)
    content = buffer.getvalue()
    write_bytes(file, TEXT.ljust(TEXT_BYTES) + content[TEXT_BYTES:], durable=False)  # without the date


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and content of one data element after the other."""
    at = 0
    while at < len(data):
        if len(data) - at < 8:
            raise ValueError(f"truncated: {len(data) - at} bytes where a tag of 8 begins")
        kind, size = (int(v) for v in np.frombuffer(data[at : at + 8], order + "u4"))
        start = at + 8
        if kind >> 16:  # small element: the size is in the tag, the data in its second half
            kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
            end = at + 8
            if size > 4:
                raise ValueError(f"expected at most 4 bytes in a small element, got {size}")
        else:
            end = start + (size if kind == COMPRESSED else (size + 7) // 8 * 8)
        if start + size > len(data):
            raise ValueError(f"truncated: expected {size} bytes, got {len(data) - start}")
        yield kind, data[start : start + size]
        at = end


def _unpacked(kind: int, data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    if kind != COMPRESSED:
        yield kind, data
        return
    inflate = zlib.decompressobj()
    content = inflate.decompress(data, MAX_BYTES)
    if not inflate.eof:
        raise ValueError(f"truncated, or larger than {MAX_BYTES} bytes")
    yield from _elements(memoryview(content), order)


def _matrix(data: memoryview, order: str, names: tuple[str, ...]) -> tuple[str, NDArray[Any] | None]:
    """Name and array of a matrix element; None if it is not one of `names`."""
    parts = _elements(data, order)
    head = [_numbers(*part, order) for _, part in zip(range(3), parts, strict=False)]
    if len(head) < 3 or head[0].size < 1:
        raise ValueError("expected flags, sizes and a name in a matrix")
    flags, shape, name = int(head[0][0]), [int(n) for n in head[1]], head[2].tobytes().decode("latin-1")
    if name not in names:
        return name, None
    stored = CLASS_TYPES.get(flags & 0xFF)
    if stored is None or flags & COMPLEX:
        raise ValueError(f"expected an array of real numbers in {name}")
    values = _numbers(*next(parts, (2, memoryview(b""))), order)
    if len(shape) < 2 or min(shape) < 0 or math.prod(shape) != values.size:
        raise ValueError(f"{name}: expected {shape} numbers, got {values.size}")
    if values.size * np.dtype(stored).itemsize > MAX_BYTES:  # bytes may stand for numbers of eight
        raise ValueError(f"{name}: {values.size} numbers take more than {MAX_BYTES} bytes")
    with np.errstate(invalid="ignore", over="ignore"):
        return name, values.astype(stored).reshape(shape, order="F")


def _numbers(kind: int, data: memoryview, order: str) -> NDArray[Any]:
    if kind not in STORED_TYPES:
        raise ValueError(f"expected numbers, got a data element of type {kind}")
    return np.frombuffer(data, order + STORED_TYPES[kind])
