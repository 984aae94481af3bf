"""What a run of `swardmap synth` makes, and the folder that it is made in."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swardmap.config.loader import to_dict
from swardmap.errors import ConfigError, shortened
from swardmap.io.sources.eden_layout import LIGHTS
from swardmap.runs.plan_folder import open_plan_folder
from swardmap.synth.config import SynthConfig, digest

MAX_SCENES = 10_000
"""EDEN numbers scenes with four digits; the gardens of two seeds are never the same."""


@dataclass(frozen=True, slots=True)
class SynthPlan:
    """What is made.

    Attributes:
        seed: of everything.
        scenes: gardens.
        frames: of each sequence.
        illuminations: lights that each garden is filmed in.
        config: all settings.
    """

    seed: int = 0
    scenes: int = 20
    frames: int = 100
    illuminations: tuple[str, ...] = LIGHTS
    config: SynthConfig = field(default_factory=SynthConfig)

    def __post_init__(self) -> None:
        unknown = set(self.illuminations) - set(LIGHTS)
        if unknown or not self.illuminations or len(set(self.illuminations)) != len(self.illuminations):
            raise ConfigError(
                f"illumination: expected some of {', '.join(LIGHTS)}, each once, "
                f"got {', '.join(self.illuminations) or 'none'}"
            )
        if not (self.seed >= 0 and 1 <= self.scenes <= MAX_SCENES and self.frames >= 1):
            raise ConfigError(
                f"expected a seed of 0 or more, 1 to {MAX_SCENES} scenes and at least one frame, "
                f"got {self.seed}, {self.scenes} and {self.frames}"
            )

    @property
    def sequences(self) -> list[tuple[int, str]]:
        """Scene and light of each, scene by scene."""
        return [(scene, light) for scene in range(self.scenes) for light in self.illuminations]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and strings; of what changes the frames that are there already."""
        return {"seed": self.seed, "frames": self.frames, "config": to_dict(self.config)}


def garden_seed(seed: int, scene: int) -> int:
    """Seed of a scene's garden: gardens of different seeds have none in common."""
    return seed * MAX_SCENES + scene


def prepare_folder(plan: SynthPlan, out: Path, overwrite: bool) -> None:
    """Make the folder ready, or refuse one that holds something else.

    Raises:
        OutputError: if it is in use, or was made with other settings.
    """
    plain = plan.to_dict()

    def difference(before: Mapping[str, Any]) -> str:
        return _difference(before, plain)

    open_plan_folder(
        out, "gardens", lambda: {**plain, "digest": digest(plain)}, difference, overwrite, inner=("eden",)
    )


def _difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """The settings that differ, each with both values; an older folder has later ones at their default."""
    old, new = _flat({"config": to_dict(SynthConfig())}) | _flat(before), _flat(now)
    names = [name for name in sorted(old.keys() | new.keys()) if old.get(name) != new.get(name)]
    told = [
        f"{name}: {shortened(old.get(name))} there, {shortened(new.get(name))} now"
        for name in names
        if name != "digest"
    ]
    return "; ".join(told[:3]) + (f"; and {len(told) - 3} more" if len(told) > 3 else "")


def _flat(tree: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        flat |= _flat(value, f"{path}{key}.") if isinstance(value, dict) else {f"{path}{key}": value}
    return flat
