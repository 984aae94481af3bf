"""The margin as a file: a piece of configuration that `map` and the robot take as it is, and says why.

swardmap map recording/ -o out/ --config margin.yaml
"""

from dataclasses import dataclass
from pathlib import Path

from swardmap.errors import InputError, InvalidValueError
from swardmap.io.door import parse_yaml, through_door

LARGEST_M = 10.0
"""A margin beyond this is a mistake in a unit."""


@dataclass(frozen=True, slots=True)
class Margin:
    """What obstacles are grown by.

    Attributes:
        margin_m: around every obstacle cell.
        person_margin_m: around cells mapped as persons; never smaller. None = margin_m.
    """

    margin_m: float
    person_margin_m: float | None = None

    def __post_init__(self) -> None:
        person = self.margin_m if self.person_margin_m is None else self.person_margin_m
        if not 0 <= self.margin_m <= person <= LARGEST_M:
            raise InvalidValueError(
                f"margin: expected 0 <= margin_m <= person_margin_m <= {LARGEST_M:g}, "
                f"got {self.margin_m} and {self.person_margin_m}"
            )


def margin_text(margin: Margin, statement: str) -> str:
    """The file: configuration, with the statement as a comment above it."""
    comment = "\n".join(f"# {line}".rstrip() for line in statement.splitlines())
    person = "null" if margin.person_margin_m is None else repr(float(margin.person_margin_m))
    return f"{comment}\n\ncostmap:\n  margin_m: {float(margin.margin_m)!r}\n  person_margin_m: {person}\n"


@through_door("a margin")
def read_margin(path: str | Path) -> Margin:
    """Read a margin file.

    Raises:
        InputError: if it is no such file, or holds anything but the two margins.
    """
    import yaml

    from swardmap.io.files import read_bytes

    try:
        tree = parse_yaml(read_bytes(path, limit=1_000_000), path)
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{path}: expected a margin file, got something else ({error})") from error
    section = tree.get("costmap") if isinstance(tree, dict) else None
    if not isinstance(section, dict) or set(tree) != {"costmap"}:
        raise InputError(f"{path}: expected the section 'costmap' with margin_m, and nothing else")
    known = {"margin_m", "person_margin_m"}
    values = {key: section.get(key) for key in known}
    numbers = all(
        isinstance(v, (int, float)) and not isinstance(v, bool) for v in values.values() if v is not None
    )
    if set(section) - known or values["margin_m"] is None or not numbers:
        raise InputError(f"{path}: expected numbers margin_m and person_margin_m, got {section}")
    try:
        return Margin(section["margin_m"], section.get("person_margin_m"))
    except InvalidValueError as error:
        raise InputError(f"{path}: {error}") from error
