"""The margin as a file: a piece of configuration that `map` and the robot take as it is, and says why.

swardmap map recording/ -o out/ --config margin.yaml

What the margin was measured with stands in a comment, `# measured_with: {JSON}`: the file stays a piece of
configuration.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swardmap.errors import InputError, InvalidValueError
from swardmap.io.door import parse_yaml, reading, through_door

LARGEST_M = 10.0
"""A margin beyond this is a mistake in a unit."""


SECTIONS = ("cloud", "geometry", "grid", "segmenter")
"""Of the settings that a margin depends on ..."""
OF_ANOTHER_RUN = frozenset(
    ("grid.resolution_m", "grid.mode", "grid.origin_m", "grid.size_m", "grid.resume",
     "grid.obstacle_clear_frames", "grid.person_clear_frames",
     "segmenter.name", "segmenter.threads", "segmenter.provider")
)  # fmt: skip
"""... and those in them that say where and how fast a map is made, or stand in a field of their own."""
MARK = "# measured_with: "


@dataclass(frozen=True, slots=True)
class MeasuredWith:
    """What a margin was measured with.

    Attributes:
        resolution_m: of the maps.
        segmenter: its name, with the head of the network's digest.
        settings: of SECTIONS, such as `grid.min_points`, that the maps were made with.
    """

    resolution_m: float
    segmenter: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    def differences(self, other: "MeasuredWith") -> list[str]:
        """What differs where the margin is to be used, each with both values; empty if nothing does."""
        pairs = [
            ("resolution", f"{self.resolution_m:g} m", f"{other.resolution_m:g} m"),
            ("segmenter", self.segmenter, other.segmenter),
        ]
        shared = sorted(self.settings.keys() & other.settings.keys())
        pairs += [(key, str(self.settings[key]), str(other.settings[key])) for key in shared]
        return [f"{key}: {own} there, {theirs} here" for key, own, theirs in pairs if own != theirs]


def measured_with(tree: Mapping[str, Any], segmenter: str) -> MeasuredWith:
    """What a margin is measured or used with.

    Args:
        tree: all settings, from `config_to_dict`.
        segmenter: its name, with the head of the network's digest.
    """
    flat = {f"{section}.{key}": value for section in SECTIONS for key, value in tree[section].items()}
    settings = {key: value for key, value in flat.items() if key not in OF_ANOTHER_RUN}
    return MeasuredWith(float(tree["grid"]["resolution_m"]), segmenter, settings)


@dataclass(frozen=True, slots=True)
class Margin:
    """What obstacles are grown by.

    Attributes:
        margin_m: around every obstacle cell.
        person_margin_m: around cells mapped as persons; never smaller. None = margin_m.
        measured: what it was measured with; None if nobody wrote it down.
    """

    margin_m: float
    person_margin_m: float | None = None
    measured: MeasuredWith | None = None

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
    if margin.measured is not None:
        known = {
            "resolution_m": margin.measured.resolution_m,
            "segmenter": margin.measured.segmenter,
            "settings": dict(margin.measured.settings),
        }
        comment += f"\n{MARK}{json.dumps(known, sort_keys=True)}"
    person = "null" if margin.person_margin_m is None else repr(float(margin.person_margin_m))
    return f"{comment}\n\ncostmap:\n  margin_m: {float(margin.margin_m)!r}\n  person_margin_m: {person}\n"


def margin_notes(path: str | Path, tree: Mapping[str, Any], segmenter: str) -> list[str]:
    """What a margin was measured with that is otherwise where it is used; empty if nothing is.

    Args:
        path: a margin file, or any settings file that its text was pasted into.
        tree: all settings in use, from `config_to_dict`.
        segmenter: its name, with the head of the network's digest.

    Raises:
        InputError: if the file cannot be read, or what it says of its margin is damaged.
    """
    from swardmap.io.files import read_bytes

    text = read_bytes(path, limit=1_000_000).decode("utf-8", errors="replace")
    measured = _measured(text, path)
    if measured is None:
        return []
    apart = measured.differences(measured_with(tree, segmenter))
    return [f"the margin of {Path(path).name} was measured otherwise: {one}" for one in apart]


@through_door("a margin")
def read_margin(path: str | Path) -> Margin:
    """Read a margin file.

    Raises:
        InputError: if it is no such file, or holds more than the margins and what they were measured with.
    """
    from swardmap.io.files import read_bytes

    with reading(path, "a margin file"):
        text = read_bytes(path, limit=1_000_000).decode("utf-8")
        tree = parse_yaml(text, path)
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
        return Margin(section["margin_m"], section.get("person_margin_m"), _measured(text, path))
    except InvalidValueError as error:
        raise InputError(f"{path}: {error}") from error


def _measured(text: str, path: str | Path) -> MeasuredWith | None:
    """What the comment says; None in files without it."""
    line = next((line for line in text.splitlines() if line.startswith(MARK)), None)
    if line is None:
        return None
    what = f"'{MARK}' with resolution_m, segmenter and settings"
    with reading(path, what, more="write the file anew"):
        known = json.loads(line.removeprefix(MARK))
        return MeasuredWith(float(known["resolution_m"]), str(known["segmenter"]), dict(known["settings"]))
