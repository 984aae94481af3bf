"""Polygon files (PLY): the vertices as structured arrays, and labelled points with colours back."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError, shortened
from swardmap.io.number_tables import as_kind, format_table, parse_table

COMMENT = "comment swardmap "

KINDS: Mapping[str, str] = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
ENCODINGS: Mapping[str, str] = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
POINT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("red", "u1"),
        ("green", "u1"),
        ("blue", "u1"),
        ("label", "u1"),
    ]
)
MAX_HEADER_BYTES = 65_536


@dataclass
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)
    has_lists: bool = False


def encode_ply(points: NDArray[np.void], comment: str, ascii_text: bool = False) -> bytes:
    """Labelled points with colours as PLY.

    Args:
        points: (N,) of dtype POINT.
        comment: one line of text for `COMMENT`.
        ascii_text: write numbers as text, with digits enough to read the same floats.
    """
    properties = "".join(
        f"property {'float' if name in 'xyz' else 'uchar'} {name}\n" for name in POINT.names or ()
    )
    encoding = "ascii" if ascii_text else "binary_little_endian"
    header = (
        f"ply\nformat {encoding} 1.0\n{COMMENT}{comment}\n"
        f"element vertex {len(points)}\n{properties}end_header\n"
    )
    if not ascii_text:
        return header.encode("ascii") + points.tobytes()
    return header.encode("ascii") + format_table(points)


def decode_ply(content: bytes, name: str) -> tuple[NDArray[np.void], str]:
    """Decode the vertices of a PLY file: ascii, or binary of either byte order.

    Args:
        content: bytes of the file.
        name: of the file, for messages.

    Returns:
        (N,) structured array with the properties of the vertices, and swardmap's comment, or "".

    Raises:
        InputError: if it is damaged, or its vertices hold lists.
    """
    encoding, elements, comment, at = _parse_header(content, name)
    skipped_rows = 0
    for element in elements:
        point = _dtype(element, ENCODINGS[encoding], name)
        if element.name == "vertex":
            break
        skipped_rows += element.count
        at += 0 if encoding == "ascii" else element.count * point.itemsize
    else:
        raise InputError(f"{name}: expected an element 'vertex', got {[e.name for e in elements]}")
    needed = element.count * (2 * len(element.properties) if encoding == "ascii" else point.itemsize)
    if len(content) + 1 - at < needed or (encoding != "ascii" and len(content) - at < needed):
        raise InputError(f"{name}: truncated: {element.count} vertices are not all there")
    if encoding != "ascii":
        return np.frombuffer(content, point, element.count, at), comment
    return _decode_text(content[at:], point, element.count, skipped_rows, name), comment


def _parse_header(content: bytes, name: str) -> tuple[str, list[_Element], str, int]:
    encoding, comment, at = "", "", 0
    elements: list[_Element] = []
    while True:
        end = content.find(b"\n", at, MAX_HEADER_BYTES)
        if end < 0 or (at == 0 and content[:end].strip() != b"ply"):
            raise InputError(f"{name}: not a PLY file: no 'ply' at its start, or no 'end_header'")
        line = content[at:end].decode("utf-8", "replace").strip()
        at = end + 1
        words = line.split()
        if line.startswith(COMMENT):
            comment = line.removeprefix(COMMENT)
        elif words[:1] == ["format"] and len(words) == 3:
            encoding = words[1]
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isdigit() and len(words[2]) < 16:
            elements.append(_Element(words[1], int(words[2])))
        elif words[:1] == ["property"] and elements and len(words) in (3, 5):
            elements[-1].has_lists |= words[1] == "list"
            elements[-1].properties.append((words[-1], words[1]))
        elif words == ["end_header"]:
            break
        elif words and words[0] not in ("ply", "comment", "obj_info"):
            raise InputError(f"{name}: damaged PLY header: {shortened(line)}")
    if encoding not in ENCODINGS:
        raise InputError(f"{name}: expected format {', '.join(ENCODINGS)}, got '{encoding}'")
    return encoding, elements, comment, at


def _dtype(element: _Element, order: str, name: str) -> np.dtype[np.void]:
    names = [p for p, _ in element.properties]
    if element.has_lists:
        raise InputError(
            f"{name}: element '{element.name}' holds lists: expected plain numbers up to the vertices"
        )
    if not names or len(set(names)) < len(names) or not all(k in KINDS for _, k in element.properties):
        raise InputError(f"{name}: element '{element.name}': a property is missing, named twice or no number")
    return np.dtype([(p, order + KINDS[k]) for p, k in element.properties])


def _decode_text(
    body: bytes, point: np.dtype[np.void], count: int, skipped: int, name: str
) -> NDArray[np.void]:
    points = np.zeros(count, point)
    columns = point.names or ()
    table = parse_table(body, count, len(columns), name, skipped)
    for index, column in enumerate(columns):
        points[column] = as_kind(table[:, index], point[column], f"{name}: property '{column}'")
    return points
