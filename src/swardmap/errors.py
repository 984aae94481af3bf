"""The errors swardmap raises on purpose.

    SwardmapError
    ├── InvalidValueError     a value that cannot be right: shape, range, NaN, wrong frame (also a ValueError)
    │   └── FrameMismatchError    two poses or clouds whose frames do not meet
    ├── ConfigError           an unknown key, a wrong type, a contradiction in the configuration
    ├── InputError            a file, bag or camera that cannot be read, or is inconsistent
    ├── ModelError            a network file that is not what it should be
    ├── OutputError           a result that cannot be written
    └── MissingExtraError     an optional package that is not installed (also an ImportError)

Every message says what was expected, what came, and what to do. The command line prints it as one
line and exits with 1; anything else that reaches the command line is a bug and shows its traceback.
"""

import importlib
import re
from types import ModuleType


class SwardmapError(Exception):
    """Base of all errors that swardmap raises on purpose; what it says is one line, whatever came in."""

    def __str__(self) -> str:
        """The message; line breaks and letters that cannot be printed may come from damaged input."""
        text = super().__str__()
        return text if text.isprintable() else one_line(text, max(MAX_MESSAGE, len(text)))


class InvalidValueError(SwardmapError, ValueError):
    """A value that cannot be right, refused before it can make a wrong map."""


class FrameMismatchError(InvalidValueError):
    """Two coordinate frames that do not meet."""


class ConfigError(SwardmapError):
    """A configuration that is misspelt, out of range or contradicts itself."""


class InputError(SwardmapError):
    """An input that cannot be read or does not hold together."""


class ModelError(SwardmapError):
    """A network file that is not what it should be."""


class OutputError(SwardmapError):
    """A result that cannot be written."""


class MissingExtraError(SwardmapError, ImportError):
    """An optional package that is not installed."""


MAX_MESSAGE = 300
"""Letters of a message; what is longer is no line that a person reads."""


def one_line(error: object, limit: int = MAX_MESSAGE) -> str:
    """What an error says, or its kind if it says nothing, in one line of at most `limit` letters."""
    text = " ".join(str(error).split()) or type(error).__name__
    text = "".join(c if c.isprintable() else "?" for c in text)
    if limit >= MAX_MESSAGE:
        text = _shorter_values(text, limit)
    if len(text) <= limit:
        return text
    tail = _remedy(text, limit) if limit >= MAX_MESSAGE else 0
    return f"{text[: limit - tail - 4]} ...{text[len(text) - tail :]}"


LONG_VALUE = re.compile(r"'[^']{51,}'|\"[^\"]{51,}\"|\S{51,}")
"""What a message shows of the outside: quoted, or a path, a URL, a list without blanks."""


def _shorter_values(text: str, limit: int) -> str:
    """The message with long values cut in their middle, the longest first, as far as it takes."""
    while len(text) > limit and (found := max(LONG_VALUE.findall(text), key=len, default="")):
        text = text.replace(found, f"{found[:22]} ... {found[-22:]}", 1)
    return text


def _remedy(text: str, limit: int) -> int:
    """Letters at the end that say what to do: they stay whole, if half of the line is enough for them."""
    ends = [
        len(text) - at - 1 for mark in (";", ". ", ":") if (at := text.rfind(mark, 0, len(text) - 20)) >= 0
    ]
    return next((tail for tail in ends if tail <= limit // 2), 2 * limit // 5)


def shortened(value: object, limit: int = 80) -> str:
    """A value from outside as a message may show it: as Python writes it, cut where it is long.

    >>> shortened("x" * 200, 12)
    "'xxxxxxx ..."
    """
    part = value[:limit] if isinstance(value, (str, bytes)) else value
    try:
        text = repr(part)
    except (ValueError, RecursionError):  # a whole number of 5,000 digits
        text = f"a {type(value).__name__}"
    return one_line(text, limit)


def require(module: str, extra: str, hint: str = "") -> ModuleType:
    """Import an optional module or say how to get it.

    Args:
        module: name to import, such as `pyrealsense2`.
        extra: the extra of swardmap that brings it, such as `realsense`.
        hint: what else is needed, such as an apt package.

    Raises:
        MissingExtraError: with the exact pip command.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        more = f" {hint}" if hint else ""
        raise MissingExtraError(
            f"{module} cannot be imported ({error}). Install it with: pip install 'swardmap[{extra}]'.{more}"
        ) from error
