"""Lines of text files that may be long: poses, lists of images. One at a time, and never too many."""

import io
from collections.abc import Iterator
from pathlib import Path

from swardmap.errors import InputError
from swardmap.io.files import read_bytes

MAX_BYTES = 500_000_000
MAX_LINES = 1_000_000
"""More than a day of frames, ten a second."""


def numbered_lines(
    file: Path, commas: bool = False, most: int = MAX_LINES
) -> Iterator[tuple[int, list[str]]]:
    """Number and words of each line that says something; `#` begins a comment.

    Args:
        file: of text in UTF-8; what is none is replaced.
        commas: whether they part words too.
        most: lines that are taken.

    Raises:
        InputError: if it cannot be read, or has more lines than a recording can have frames.
    """
    content = read_bytes(file, MAX_BYTES)
    count = max(content.count(b"\n"), content.count(b"\r"))
    if count > most:
        raise InputError(
            f"{file}: expected at most {most} lines, got {count}: part the recording, or leave out lines"
        )
    text = io.TextIOWrapper(io.BytesIO(content), encoding="utf-8", errors="replace")
    for number, line in enumerate(text, 1):
        said = line.split("#", 1)[0]
        words = (said.replace(",", " ") if commas else said).split()
        if words:
            yield number, words
