"""From files, environment and command line to a settings dataclass, and back to plain data and YAML."""

import dataclasses
import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from swardmap.config.bounded_yaml import MAX_YAML_BYTES, parse_yaml
from swardmap.config.settings import build, merge, merge_overrides, merge_text, yaml_lines
from swardmap.errors import ConfigError, SwardmapError

ENVIRONMENT_PREFIX = "SWARDMAP_"

Settings = TypeVar("Settings")


def load(
    cls: type[Settings],
    file: Path | None = None,
    environment: Mapping[str, str] | None = None,
    overrides: Iterable[str] = (),
    present: Callable[[Mapping[str, Any]], Mapping[str, Any]] = dict,
    earlier: tuple[str, ...] = (),
) -> Settings:
    """Build a settings dataclass: defaults < file < environment < overrides.

    Args:
        cls: the dataclass at the top of the tree.
        file: YAML with any part of the tree.
        environment: such as os.environ; `SWARDMAP_SECTION__KEY` and the keys of the top level count.
        overrides: `section.key=value`, values in YAML.
        present: gives keys and values of earlier versions the names they have now.
        earlier: keys of the top level that only earlier versions had.

    Raises:
        ConfigError: for an unknown key, a wrong type, or a value out of range.
    """
    tree: dict[str, Any] = {}
    if file is not None:
        merge(tree, read_yaml(file), str(file))
    known = {*earlier, *(f.name for f in fields(cls))}  # type: ignore[arg-type]
    by_environment = dict(_settings_of(known, environment or {}))
    for name, keys in by_environment.items():
        merge_text(tree, keys, (environment or {})[name], f"environment variable {name}")
    merge_overrides(tree, overrides)
    try:
        return from_dict(cls, present(tree))
    except ConfigError as error:
        if not by_environment:
            raise
        raise ConfigError(f"{error} (set in the environment: {', '.join(by_environment)})") from error


def from_dict(cls: type[Settings], tree: Mapping[str, Any]) -> Settings:
    """Build a settings dataclass from a nested dict with any part of its tree.

    Raises:
        ConfigError: for an unknown key (with the nearest known one), a wrong type, a value out of range.
    """
    built = build(cls, tree)
    assert isinstance(built, cls)  # noqa: S101 - narrows the type; build returns its first argument's
    return built


def to_dict(settings: Any) -> dict[str, Any]:
    """A settings dataclass as plain dicts, lists, strings and numbers, as `from_dict` takes it."""
    plain: dict[str, Any] = dataclasses.asdict(settings, dict_factory=_plain_dict)
    return plain


def to_yaml(settings: Any, comments: bool = True) -> str:
    """A settings dataclass as YAML, each setting with what it is for and what it may be."""
    lines: list[str] = []
    for f in fields(settings):
        value = getattr(settings, f.name)
        if not dataclasses.is_dataclass(value):
            lines += yaml_lines(f, value, "", comments)
            continue
        about = (type(value).__doc__ or "").strip()
        lines += ["", f"# {about}"] if comments else []
        lines.append(f"{f.name}:")
        for inner in fields(value):
            lines += yaml_lines(inner, getattr(value, inner.name), "  ", comments)
    return "\n".join(lines).strip() + "\n"


def read_yaml(file: Path) -> Any:
    """What a YAML file with settings holds; an empty one holds none.

    Raises:
        ConfigError: if it cannot be read.
    """
    from swardmap.errors import one_line

    try:
        if file.exists() and not file.is_file():
            raise ConfigError(f"cannot read the configuration {file}: it is no regular file")
        if file.stat().st_size > MAX_YAML_BYTES:
            raise ConfigError(
                f"{file}: expected YAML of at most {MAX_YAML_BYTES} bytes, got {file.stat().st_size}"
            )
        content = file.read_bytes()
    except SwardmapError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        reason = getattr(error, "strerror", None) or one_line(error)
        raise ConfigError(f"cannot read the configuration {file}: {reason}") from error
    return parse_yaml(content, f"cannot read the configuration {file}") or {}


def _settings_of(known: set[str], environment: Mapping[str, str]) -> Iterable[tuple[str, list[str]]]:
    """Variables that are settings, and the keys each of them sets.

    A name without `__` that is none of the top level's is not ours (SWARDMAP_DATA), unless it is nearly one.
    """
    for name in environment:
        if not name.startswith(ENVIRONMENT_PREFIX):
            continue
        keys = name.removeprefix(ENVIRONMENT_PREFIX).lower().split("__")
        near = difflib.get_close_matches(keys[0], known, n=1, cutoff=0.7)
        if keys[0] not in known and (near or len(keys) > 1):
            hint = f"did you mean {ENVIRONMENT_PREFIX}{near[0].upper()}?" if near else "see `swardmap config`"
            raise ConfigError(
                f"environment variable {name}: expected SWARDMAP_SECTION__KEY of a known setting; {hint}"
            )
        if keys[0] in known:
            yield name, keys


def _plain_dict(items: list[tuple[str, Any]]) -> dict[str, Any]:
    return {key: list(value) if isinstance(value, tuple) else value for key, value in items}
