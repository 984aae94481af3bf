"""Settings as frozen dataclasses that check themselves: what each is for, what it may be, no key unknown."""

import dataclasses
import difflib
import functools
import math
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field, fields
from typing import Any

from swardmap.config.bounded_yaml import parse_yaml
from swardmap.errors import ConfigError, one_line, shortened


def setting(
    default: Any,
    about: str,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] | None = None,
) -> Any:
    """Declare one setting: default, what it is for, and what it may be."""
    limits = {"about": about, "minimum": minimum, "maximum": maximum, "choices": choices}
    return field(default=default, metadata=limits)


_hints: Callable[[Any], Mapping[str, Any]] = functools.cache(typing.get_type_hints)
"""Types of the settings of a class: looked up once, not with every configuration that is built."""


class Checked:
    """Checks every field of a settings dataclass against its declared limits."""

    def __post_init__(self) -> None:
        hints = _hints(type(self))
        for f in fields(self):  # type: ignore[arg-type]
            name = f"{type(self).__name__}.{f.name}"
            value = _converted(getattr(self, f.name), hints[f.name], name)
            _check_limits(value, f.metadata, name)
            object.__setattr__(self, f.name, value)


def build(cls: Any, tree: Any, path: str = "") -> Any:
    """Build a settings dataclass from a nested dict with any part of its tree.

    Args:
        cls: the dataclass; fields may be such dataclasses themselves.
        tree: key -> value or section.
        path: of the section, for messages; ends in a dot.

    Raises:
        ConfigError: for an unknown key (with the nearest known one), a wrong type, a value out of range.
    """
    if not isinstance(tree, Mapping):
        raise ConfigError(f"section '{path}': expected keys and values, got {shortened(tree)}")
    known = {f.name for f in fields(cls)}
    hints = _hints(cls)
    for key in tree:
        if key not in known:
            near = difflib.get_close_matches(str(key), known, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else f"; known: {', '.join(sorted(known))}"
            raise ConfigError(f"unknown setting '{path}{one_line(key, 80)}'{hint}")
    values = {}
    for key, value in tree.items():
        section = dataclasses.is_dataclass(hints[key])
        values[key] = build(hints[key], value, f"{path}{key}.") if section else value
    return cls(**values)


def merge(tree: dict[str, Any], news: Any, where: str) -> None:
    """Put the keys of one nested dict into another, section by section.

    Args:
        tree: changed in place.
        news: what is to be set.
        where: it comes from, for messages.

    Raises:
        ConfigError: if `news` is no dict.
    """
    if not isinstance(news, dict):
        raise ConfigError(f"{where}: expected sections with keys, got {type(news).__name__}")
    for key, value in news.items():
        if isinstance(value, dict) and isinstance(tree.get(key), dict):
            merge(tree[key], value, where)
        else:
            tree[key] = value


def merge_text(tree: dict[str, Any], keys: Sequence[str], text: str, where: str) -> None:
    """Put one setting, its value in YAML, into a nested dict.

    Raises:
        ConfigError: for a value that is no YAML.
    """
    value = parse_yaml(text, where)
    for key in reversed(keys):
        value = {key: value}
    merge(tree, value, where)


def merge_overrides(tree: dict[str, Any], overrides: Iterable[str]) -> None:
    """Put settings of a command line, `section.key=value` with values in YAML, into a nested dict.

    Raises:
        ConfigError: for what is no such text.
    """
    for override in overrides:
        key, sign, text = override.partition("=")
        if not sign or not key.strip():
            raise ConfigError(f"expected section.key=value, got {shortened(override)}")
        merge_text(tree, key.strip().split("."), text, shortened(override))


def yaml_lines(f: "dataclasses.Field[Any]", value: Any, indent: str = "", comments: bool = True) -> list[str]:
    """One setting as YAML, with what it is for and what it may be."""
    import yaml

    plain = list(value) if isinstance(value, tuple) else value
    text = yaml.safe_dump(plain, default_flow_style=True, width=1000).strip().removesuffix("...").strip()
    line = f"{indent}{f.name}: {text}"
    if not comments:
        return [line]
    choices = f.metadata.get("choices")
    about = f.metadata["about"] + (f" ({', '.join(choices)})" if choices else "")
    return [f"{line:<44}# {about}"]


def _converted(value: Any, hint: Any, name: str) -> Any:
    """`value` as the declared type; whole numbers pass as floats and lists as tuples, nothing else."""
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        if value is None:
            return None
        hint = next(a for a in typing.get_args(hint) if a is not types.NoneType)
    if typing.get_origin(hint) is tuple:
        parts = typing.get_args(hint)
        if not isinstance(value, (list, tuple)) or len(value) != len(parts):
            raise ConfigError(f"{name}: expected a list of {len(parts)} numbers, got {shortened(value)}")
        return tuple(_converted(v, part, name) for v, part in zip(value, parts, strict=True))
    if hint is float and not isinstance(value, bool) and isinstance(value, (int, float, str)):
        try:
            number = float(value)  # YAML 1.1 reads 1e-3 as a string
        except (ValueError, OverflowError):  # a whole number of 400 digits
            number = math.nan
        if math.isfinite(number):
            return number
    elif isinstance(value, hint) and not (hint is int and isinstance(value, bool)):
        return value
    raise ConfigError(f"{name}: expected {hint.__name__}, got {shortened(value)}")


def _check_limits(value: Any, limits: Mapping[str, Any], name: str) -> None:
    if value is None or not limits:
        return
    choices, low, high = limits["choices"], limits["minimum"], limits["maximum"]
    if choices is not None and value not in choices:
        raise ConfigError(f"{name}: expected one of {', '.join(choices)}, got {shortened(value)}")
    if low is not None and value < low:
        raise ConfigError(f"{name}: expected at least {low:g}, got {value:g}")
    if high is not None and value > high:
        raise ConfigError(f"{name}: expected at most {high:g}, got {value:g}")
