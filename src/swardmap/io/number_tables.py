"""Tables of numbers in text files, read strictly."""

import io
import re
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.door import reading

MICROSOFT_NAN = re.compile(rb"[-+]?\d\.#(?:INF|IND|QNAN|SNAN)\d*")


def format_table(points: NDArray[np.void]) -> bytes:
    """The fields of a structured array (N,) as lines of text; nine digits give the same float32 again."""
    buffer = io.BytesIO()
    formats = ["%.9g" if points[name].dtype.kind == "f" else "%d" for name in points.dtype.names or ()]
    table = np.stack([points[name].astype(np.float64) for name in points.dtype.names or ()], axis=1)
    np.savetxt(buffer, table, fmt=formats)
    return buffer.getvalue()


def parse_table(body: bytes, rows: int, columns: int, name: str, skip: int = 0) -> NDArray[np.float64]:
    """The first `rows` lines of text after `skip` as numbers separated by white space.

    Args:
        body: ASCII text.
        rows: lines the table must have.
        columns: numbers each line must have.
        name: of the file, for messages.
        skip: lines to leave out first.

    Returns:
        (rows, columns) float64; the words nan and inf are read as such, Windows' 1.#QNAN and 1.#INF as NaN.

    Raises:
        InputError: if it is not such a table.
    """
    if rows == 0:
        return np.empty((0, columns))
    with reading(name, f"rows of {columns} numbers"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about no data: said better below
        text = io.StringIO(MICROSOFT_NAN.sub(b"nan", body).decode("ascii"))
        table = np.loadtxt(text, np.float64, comments=None, ndmin=2, skiprows=skip, max_rows=rows)
    if table.shape != (rows, columns):
        raise InputError(f"{name}: expected {rows} rows of {columns} numbers, got {table.shape}")
    return table


def as_kind(values: NDArray[np.float64], kind: np.dtype[Any], what: str) -> NDArray[Any]:
    """Numbers as the type a file announces, refused where they do not fit.

    Raises:
        InputError: if a whole number was announced and is none, or is out of range.
    """
    if kind.kind == "f":
        with np.errstate(over="ignore"):  # 1e300 becomes infinite, and is no reading
            return values.astype(kind)
    limits = np.iinfo(kind)
    if not ((values == np.rint(values)) & (values >= limits.min) & (values <= limits.max)).all():
        raise InputError(f"{what}: expected whole numbers {limits.min}..{limits.max}")
    return values.astype(kind)
