"""The door that bytes from outside come through: whatever is wrong with them is one InputError with a name.

Parsers raise what they like; nobody can list it. So a reader does its work inside `with reading(file)`, which
lets errors of ours pass and turns every other exception into one line. JSON is read against the shape that is
expected, NumPy arrays never take more memory than their bytes, members of archives never unpack to more than
is allowed.
"""

import io
import json
import types
import typing
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError, SwardmapError, one_line, shortened
from swardmap.io.files import read_bytes
from swardmap.io.unpacking import MAX_UNPACKED_BYTES, unzip_member
from swardmap.types import Frame

Given = ParamSpec("Given")
Found = TypeVar("Found")

MAX_JSON_BYTES = 2**28
MAX_HEADER_BYTES = 10_000
LAST_LETTER = 0x10FFFF


@contextmanager
def reading(
    name: str | Path, what: str = "a readable file", kind: type[SwardmapError] = InputError, more: str = ""
) -> Iterator[None]:
    """Turn whatever is raised inside into one error of ours that names the file.

    Args:
        name: of the file or message.
        what: it was expected to be.
        kind: of error.
        more: what to do about it, at the end of the message.

    Raises:
        InputError: as it is, or of any other exception; in its place any other `kind`.
    """
    more = f"; {more}" if more else ""
    try:
        yield
    except kind:
        raise
    except SwardmapError as error:
        raise kind(f"{name}: {one_line(error)}{more}") from error
    except OSError as error:
        raise kind(f"cannot read {name}: {error.strerror or one_line(error)}{more}") from error
    except RecursionError as error:
        raise kind(f"{name}: expected {what}, got one nested too deeply{more}") from error
    except MemoryError as error:
        raise kind(f"{name}: expected {what}, got one that needs more memory than there is{more}") from error
    except KeyError as error:
        missing = shortened(error.args[0] if error.args else error)
        raise kind(f"{name}: expected {what} with {missing}, which is missing{more}") from error
    except Exception as error:
        raise kind(f"{name}: expected {what}, got: {one_line(error, 150)}{more}") from error


def through_door(what: str) -> Callable[[Callable[Given, Found]], Callable[Given, Found]]:
    """For a reader whose first argument is a path: any exception that is none of ours becomes an InputError.

    Args:
        what: it reads, for the message.
    """

    def decorate(reader: Callable[Given, Found]) -> Callable[Given, Found]:
        @wraps(reader)
        def through(*args: Given.args, **kwargs: Given.kwargs) -> Found:
            try:
                return reader(*args, **kwargs)
            except SwardmapError:
                raise
            except Exception:
                with reading(one_line(args[0] if args else next(iter(kwargs.values()))), what):
                    raise
                raise  # for the type checker: `reading` never lets an exception be

        return through

    return decorate


def frames_of(source: Iterable[Frame], name: str) -> Iterator[Frame]:
    """The frames of a source; whatever its reader raises becomes an InputError.

    Args:
        source: of frames.
        name: of the source, for the message.
    """
    with reading(name, "a recording"):
        frames = iter(source)
    while True:
        try:
            frame = next(frames, None)
        except SwardmapError:
            raise
        except Exception:
            with reading(name, "a recording"):
                raise
            raise  # as above
        if frame is None:
            return
        yield frame


def parse_yaml(content: bytes | str, name: str | Path) -> Any:
    """One YAML document, bounded in size, depth and aliases (see `config.bounded_yaml`).

    Raises:
        InputError: if it is none.
    """
    from swardmap.config.bounded_yaml import parse_yaml as parse

    try:
        return parse(content, str(name))
    except SwardmapError as error:
        raise InputError(str(error)) from error


def read_yaml(path: str | Path) -> Any:
    """One YAML document of a file.

    Raises:
        InputError: if it cannot be read.
    """
    from swardmap.config.bounded_yaml import MAX_YAML_BYTES

    return parse_yaml(read_bytes(path, MAX_YAML_BYTES), path)


def read_json(path: str | Path, shape: Any = Any, limit: int = MAX_JSON_BYTES) -> Any:
    """JSON of a file. See `parse_json`."""
    return parse_json(read_bytes(path, limit), path, shape)


def parse_json(content: bytes | str, name: str | Path, shape: Any = Any) -> Any:
    """JSON whose values are of the types that are expected.

    Args:
        content: UTF-8, with or without a byte order mark.
        name: of the file, for messages.
        shape: a type (`int`, `str | None`, `Any`), a list of one shape (`[int]`), or a dict of keys and
            their shapes; keys that end in `?` may be missing, others may be there. A float may be
            a whole number, and neither is ever infinite or NaN.

    Raises:
        InputError: if it is no JSON, or of another shape.
    """
    with reading(name, "JSON"):
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
        tree = json.loads(text, parse_constant=_no_number)
        _check_shape(tree, shape, str(name), "")
    return tree


def _no_number(word: str) -> float:
    raise ValueError(f"{word}, which is no number")


def _check_shape(value: Any, shape: Any, name: str, path: str) -> None:
    if isinstance(shape, dict):
        _check_is(value, dict, name, path)
        for key, inner in shape.items():
            plain = key.removesuffix("?")
            below = f"{path}.{plain}".lstrip(".")
            if plain in value:
                _check_shape(value[plain], inner, name, below)
            elif plain == key:
                raise InputError(f"{name}: expected the key '{below}', which is missing")
    elif isinstance(shape, list):
        _check_is(value, list, name, path)
        for index, item in enumerate(value):
            _check_shape(item, shape[0], name, f"{path}[{index}]")
    elif shape is not Any:
        _check_is(value, shape, name, path)


def _check_is(value: Any, kind: Any, name: str, path: str) -> None:
    if not _fits(value, kind):
        where = f"{name}: {path}" if path else name
        known = {dict: "keys with values", list: "a list", str: "text", int: "a whole number"}
        wanted = known.get(kind) or getattr(kind, "__name__", str(kind))
        raise InputError(f"{where}: expected {wanted}, got {shortened(value)}")


def _fits(value: Any, kind: Any) -> bool:
    if typing.get_origin(kind) in (types.UnionType, typing.Union):
        return any(_fits(value, one) for one in typing.get_args(kind))
    if isinstance(value, bool):
        return kind is bool
    if kind is float:
        return isinstance(value, (int, float)) and abs(value) < 1e300
    return isinstance(value, kind)


def parse_npy(content: bytes, name: str | Path) -> NDArray[Any]:
    """A NumPy array as `np.save` wrote it; never one of objects, never larger than its bytes.

    Raises:
        InputError: if it is none.
    """
    with reading(name, "a NumPy array"):
        stream = io.BytesIO(content)
        version = np.lib.format.read_magic(stream)
        if version not in ((1, 0), (2, 0)):
            raise ValueError(f"version {version[0]}.{version[1]}")
        known = np.lib.format
        header = known.read_array_header_1_0 if version == (1, 0) else known.read_array_header_2_0
        shape, fortran, dtype = header(stream, max_header_size=MAX_HEADER_BYTES)
        if dtype.hasobject:
            raise ValueError("an array of Python objects")
        count = 1
        for edge in shape:  # in whole numbers of any size
            count *= int(edge)
        there = len(content) - stream.tell()
        if count < 0 or count * dtype.itemsize > there:
            raise ValueError(f"{there} bytes where {shortened(count)} values of {dtype} are announced")
        flat = np.frombuffer(content, dtype, count, stream.tell())
        if dtype.kind == "U" and flat.view(f"{dtype.str[0]}u4").max(initial=0) > LAST_LETTER:
            raise ValueError("text with letters that are none")  # Python's own strings would break on them
        return flat.reshape(shape[::-1]).T.copy() if fortran else flat.reshape(shape).copy()


def open_archive(
    content: bytes,
    name: str | Path,
    limit: int = MAX_UNPACKED_BYTES,
    what: str = "a zip archive",
    lzma: bool = False,
) -> dict[str, bytes]:
    """Members of a zip archive, stored or deflated, that unpack to no more than `limit` bytes together.

    None unpacks to more than it announces. LZMA needs more memory on the way there than the others: `lzma`
    lets it in where a digest says already that the content is the expected one.

    Raises:
        InputError: if it is none, damaged, or a bomb.
    """
    with reading(name, what), zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = archive.infolist()
        size = sum(member.file_size for member in members)
        if size > limit:
            raise InputError(f"{name}: expected at most {limit} bytes unpacked, got {size}")
        known = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, *([zipfile.ZIP_LZMA] if lzma else []))
        for member in members:
            if member.compress_type not in known or member.flag_bits & 1:
                raise ValueError(f"{shortened(member.filename)} packed in another way or encrypted")
        return {member.filename: unzip_member(archive, member) for member in members}


def parse_npz(
    content: bytes,
    name: str | Path,
    limit: int = MAX_UNPACKED_BYTES,
    what: str = "a zip archive of arrays",
    lzma: bool = False,
) -> dict[str, NDArray[Any]]:
    """Arrays of an .npz by their names. See `open_archive` and `parse_npy`."""
    members = open_archive(content, name, limit, what, lzma)
    return {
        member.removesuffix(".npy"): parse_npy(data, f"{name}: {shortened(member)}")
        for member, data in members.items()
    }
