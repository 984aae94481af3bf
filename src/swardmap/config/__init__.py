"""All settings: one tree of frozen dataclasses, checked when built, none of them needed to start.

Order of precedence: defaults < file < environment (`SWARDMAP_GRID__RESOLUTION_M=0.1`) < command line
(`--set grid.resolution_m=0.1`). Unknown keys are refused. `swardmap config` prints the tree.

Every setting of the package is in this room and nowhere else; `Config` is the door.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swardmap.config.inputs import CameraConfig, MountConfig, SegmenterConfig, SourceConfig
from swardmap.config.loader import from_dict, load, to_dict, to_yaml
from swardmap.config.mapping import CloudConfig, EvidenceConfig, GeometryConfig, GridConfig
from swardmap.config.outputs import AreaConfig, CostmapConfig, OutputConfig, WatchdogConfig
from swardmap.config.settings import Checked, setting

__all__ = [
    "AreaConfig",
    "CameraConfig",
    "CloudConfig",
    "Config",
    "CostmapConfig",
    "EvidenceConfig",
    "GeometryConfig",
    "GridConfig",
    "MountConfig",
    "OutputConfig",
    "SegmenterConfig",
    "SourceConfig",
    "WatchdogConfig",
    "config_from_dict",
    "config_to_dict",
    "config_to_yaml",
    "load_config",
]


@dataclass(frozen=True)
class Config(Checked):
    """The whole tree."""

    source: SourceConfig = field(default_factory=SourceConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    segmenter: SegmenterConfig = field(default_factory=SegmenterConfig)
    mount: MountConfig = field(default_factory=MountConfig)
    cloud: CloudConfig = field(default_factory=CloudConfig)
    grid: GridConfig = field(default_factory=GridConfig)
    geometry: GeometryConfig = field(default_factory=GeometryConfig)
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    costmap: CostmapConfig = field(default_factory=CostmapConfig)
    area: AreaConfig = field(default_factory=AreaConfig)
    watchdog: WatchdogConfig = field(default_factory=WatchdogConfig)
    output: OutputConfig = field(default_factory=OutputConfig)
    backend: str = setting(
        "compiled",
        "passes over the pixels: compiled, or plain NumPy; cell for cell the same",
        choices=("compiled", "plain"),
    )


def load_config(
    file: Path | None = None,
    environment: Mapping[str, str] | None = None,
    overrides: Iterable[str] = (),
) -> Config:
    """Build the configuration: defaults < file < environment < overrides.

    Args:
        file: YAML with any part of the tree.
        environment: such as os.environ; names `SWARDMAP_SECTION__KEY`.
        overrides: `section.key=value`, values in YAML.

    Raises:
        ConfigError: for an unknown key, a wrong type, or a value out of range.
    """
    return load(Config, file, environment, overrides, _with_present_names, ("road",))


RENAMED_VALUES: Mapping[tuple[str, str], Mapping[str, str]] = {
    ("", "backend"): {"fused": "compiled", "staged": "plain"},
    ("grid", "mode"): {"paper": "last_seen", "evidence": "log_odds"},
}
"""What values were called in earlier versions, by section and key; files and command lines keep working."""


def _with_present_names(tree: Mapping[str, Any]) -> dict[str, Any]:
    """A tree in which keys and values of earlier versions have the names they have now (docs/moved.md)."""
    present = dict(tree)
    if "road" in present:
        present.setdefault("backend", present.pop("road"))
    for (section, key), names in RENAMED_VALUES.items():
        part = present.get(section) if section else present
        if isinstance(part, Mapping) and isinstance(part.get(key), str) and part[key] in names:
            changed = {**part, key: names[part[key]]}
            present = {**present, section: changed} if section else changed
    return present


def config_from_dict(tree: Mapping[str, Any]) -> Config:
    """Build the configuration from a nested dict with any part of the tree.

    Raises:
        ConfigError: for an unknown key (with the nearest known one), a wrong type, a value out of range.
    """
    return from_dict(Config, _with_present_names(tree))


def config_to_dict(config: Config) -> dict[str, Any]:
    """The tree as plain dicts, lists, strings and numbers, as `config_from_dict` takes it."""
    return to_dict(config)


def config_to_yaml(config: Config, comments: bool = True) -> str:
    """The tree as YAML, each setting with what it is for and what it may be."""
    return to_yaml(config, comments)
