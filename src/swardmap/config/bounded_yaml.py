"""YAML from outside: limited in size, depth and aliases, no key twice; any fault is one ConfigError."""

from collections.abc import Iterator
from typing import Any

from swardmap.errors import ConfigError, one_line, shortened

MAX_YAML_BYTES = 2**20
MAX_DEPTH = 32
MAX_VALUES = 200_000
"""Of a document with its aliases unfolded."""


def parse_yaml(content: bytes | str, name: str) -> Any:
    """One YAML document as plain dicts, lists, strings, numbers and dates; None if it is empty.

    Args:
        content: of the file.
        name: of the file or setting, for messages.

    Raises:
        ConfigError: if it is no YAML, says a key twice, or nests, unfolds or weighs more than a file of
            settings can.
    """
    import yaml

    if len(content) > MAX_YAML_BYTES:
        raise ConfigError(f"{name}: expected YAML of at most {MAX_YAML_BYTES} bytes, got {len(content)}")
    loader_type = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
        _check_depth(yaml.parse(text, Loader=loader_type), name)
        loader = loader_type(text)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            _check_values(node, name)
            _check_keys(node, name)
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except ConfigError:
        raise
    except Exception as error:
        raise ConfigError(f"{name}: expected YAML, got: {one_line(error)}") from error


def _check_depth(events: Iterator[Any], name: str) -> None:
    depth = 0
    for event in events:
        kind = type(event).__name__
        depth += kind.endswith("StartEvent") - kind.endswith("EndEvent")
        if depth > MAX_DEPTH + 2:  # stream and document count as well
            raise ConfigError(f"{name}: expected YAML of at most {MAX_DEPTH} levels, got more")


def _check_values(root: Any, name: str) -> None:
    """Count every value as often as aliases repeat it, without unfolding any."""
    sizes: dict[int, int] = {}

    def size(node: Any) -> int:
        if id(node) in sizes:
            return sizes[id(node)]
        sizes[id(node)] = MAX_VALUES + 1  # a value that holds itself
        children = node.value if isinstance(node.value, list) else []
        flat = (part for child in children for part in (child if isinstance(child, tuple) else (child,)))
        sizes[id(node)] = 1 + sum(size(child) for child in flat)
        return sizes[id(node)]

    if size(root) > MAX_VALUES:
        raise ConfigError(f"{name}: expected at most {MAX_VALUES} values in YAML, its aliases unfold to more")


def _check_keys(root: Any, name: str) -> None:
    """Of two values of one key the last would win in silence, though a person reads the first."""
    todo, done = [root], set[int]()
    while todo:
        node = todo.pop()
        if id(node) in done or not isinstance(node.value, list):
            continue
        done.add(id(node))
        lines: dict[tuple[str, str], int] = {}
        for child in node.value:
            if isinstance(child, tuple) and isinstance(child[0].value, str):
                key, line = (child[0].tag, child[0].value), child[0].start_mark.line + 1
                if key in lines:
                    raise ConfigError(
                        f"{name}: expected each key once, got {shortened(key[1])} in lines {lines[key]} "
                        f"and {line}; remove one of the two"
                    )
                lines[key] = line
            todo += child if isinstance(child, tuple) else (child,)
