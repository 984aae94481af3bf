"""Damage to bytes, drawn by chance: what disks, networks, other programs and attackers do."""

import random
import re
import struct
from itertools import islice

WORDS = (
    b"Infinity", b"NaN", b"-1", b"0", b"1e999", b"9" * 400, b"4294967295", b"\xff\xff\xff\xff", b"\x00" * 8,
    b"null", b"[]", b"{}", b"[" * 200, b"&a [*a]", b"!!bool x", b"!!timestamp x", b"../../../etc/passwd",
    b"/dev/zero", b"\xef\xbb\xbf", b"\xfe\xff", b"\n", b"\r\n", b"'", b'"', b"<!ENTITY a 'a'>", b"\xc2\xb2",
    b"True", b"1.5", b"PK\x03\x04", b"IEND",
)  # fmt: skip
"""What parsers trip over."""


def mutated(content: bytes, dice: random.Random, others: list[bytes]) -> bytes:
    """The content with one to eight faults in it.

    Args:
        content: of a good file.
        dice: decides.
        others: good contents to take pieces of.
    """
    data = bytearray(content)
    for _ in range(dice.choice((1, 1, 1, 2, 3, 8))):
        _damage(data, dice, others)
    return bytes(data[: 4 * len(content) + 10_000])


def _damage(data: bytearray, dice: random.Random, others: list[bytes]) -> None:
    at = dice.randrange(len(data) + 1)
    end = min(len(data), at + dice.choice((1, 2, 4, 8, 16, 64, 512)))
    kind = dice.randrange(10)
    if kind == 0 and data:
        data[at % len(data)] ^= 1 << dice.randrange(8)
    elif kind == 1 and data:
        data[at % len(data)] = dice.randrange(256)
    elif kind == 2:
        del data[at:end]
    elif kind == 3:
        data[at:at] = data[at:end] * dice.choice((1, 2, 30))
    elif kind == 4:
        del data[at:]
    elif kind == 5:
        data[at : at + dice.choice((0, 1, 4))] = dice.choice(WORDS)
    elif kind == 6:
        form = dice.choice(("<I", ">I", "<H", ">H", "<q", "<d"))
        number = dice.choice((0, 1, 255, 65535, 2**31 - 1, 2**16, 10**9))
        value = struct.pack(form, number % 65536 if form[1] == "H" else number)
        data[at : at + len(value)] = value
    elif kind == 7 and others:
        other = dice.choice(others)
        start = dice.randrange(len(other) + 1)
        data[at:end] = other[start : start + end - at]
    elif kind == 8:
        _number(data, dice)
    else:
        data[at:end] = bytes(end - at)


def _number(data: bytearray, dice: random.Random) -> None:
    """Another number in place of one that is written in digits."""
    numbers = [found.span() for found in islice(re.finditer(rb"[0-9]+", data), 2000)]
    if not numbers:
        return
    start, end = dice.choice(numbers)
    data[start:end] = dice.choice(
        (b"0", b"-1", b"1e308", b"nan", b"999999999999", b"7", b"9" * 5000, b"0.0", b"")
    )
