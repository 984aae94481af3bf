"""HTML from the templates in data/report; everything that is told is escaped there."""

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

from swardmap.eval.metrics import UNDEFINED
from swardmap.viz import templates


def render(template: str, **context: Any) -> str:
    """A page from one of the templates.

    Args:
        template: file in data/report.
        context: its names; only what is `markupsafe.Markup` is taken as HTML.
    """
    filters: dict[str, Callable[..., str]] = {
        "pct": pct, "metres": metres, "points": points, "sentence": sentence,
    }  # fmt: skip
    return templates.render(template, filters, **context)


def told_command(command: str) -> str:
    """A command as it may be told to others: files by their names, without the folders of this machine.

    >>> told_command("swardmap evaluate /home/me/lawn -o /tmp/out --set area.file=/home/me/area.yaml")
    'swardmap evaluate lawn -o out --set area.file=area.yaml'
    """
    try:
        words = shlex.split(command)
    except ValueError:  # an unpaired quote
        return command
    return shlex.join(_without_folders(word) for word in words) if any("/" in w for w in words) else command


def _without_folders(word: str) -> str:
    key, equals, value = word.rpartition("=")
    return f"{key}{equals}{Path(value).name or value}" if value.startswith(("/", "~")) else word


def sentence(text: str) -> str:
    """Text with a capital and a full stop."""
    return text[:1].upper() + text[1:] + "."


def percent(value: float | None) -> str:
    """A share as the paper prints it."""
    return UNDEFINED if value is None else f"{100 * value:.2f}"


def pct(share: float | None) -> str:
    """A share in percent, or a dash."""
    return UNDEFINED if share is None else f"{percent(share)} %"


def points(share: float | None) -> str:
    """A difference of shares in percentage points, or a dash."""
    return UNDEFINED if share is None else f"{100 * share:+.2f}"


def metres(value: float | None) -> str:
    """Metres with millimetres, or a dash."""
    return UNDEFINED if value is None else f"{value:.3f} m"
