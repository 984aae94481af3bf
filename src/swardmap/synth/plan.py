"""What a run of `swardmap synth` makes, and the folder that it is made in."""

import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swardmap.config.loader import to_dict
from swardmap.errors import ConfigError, InputError, OutputError
from swardmap.io.files import MARKER, write_text
from swardmap.io.sources.eden_layout import LIGHTS
from swardmap.synth.config import SynthConfig, digest

MAX_SCENES = 10_000
"""EDEN numbers scenes with four digits; the gardens of two seeds are never the same."""
PLAN_FILE = "plan.json"


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


def read_plan(out: Path) -> dict[str, Any] | None:
    """What a folder says it holds; None if there is no plan in it.

    Raises:
        InputError: if the plan is damaged.
    """
    file = out / PLAN_FILE
    if not file.is_file():
        return None
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        if not isinstance(found["config"], dict):
            raise ValueError("no configuration in it")
        return dict(found)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"cannot read {file}: {error}; pass --overwrite to begin anew") from error


def prepare_folder(plan: SynthPlan, out: Path, overwrite: bool) -> None:
    """Make the folder ready, or refuse one that holds something else."""
    try:
        occupied = out.exists() and (not out.is_dir() or any(out.iterdir()))
        ours = (out / MARKER).is_file()
        if occupied and not ours:
            raise OutputError(f"{out} exists and was not made by `swardmap synth`: choose another folder")
        if occupied and overwrite:
            for name in ("folder", "eden"):
                shutil.rmtree(out / name, ignore_errors=True)
            (out / PLAN_FILE).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write {out}: {error.strerror or error}") from error
    before = read_plan(out)
    if before is not None and (different := _difference(before, plan.to_dict())):
        raise OutputError(
            f"{out} was made with other settings ({different}): choose another folder, give the same "
            "settings, or pass --overwrite"
        )
    write_text(out / MARKER, "Made by swardmap. --overwrite may replace this folder.\n")
    plain = plan.to_dict()
    write_text(out / PLAN_FILE, json.dumps({**plain, "digest": digest(plain)}, indent=2) + "\n")


def _difference(before: dict[str, Any], now: dict[str, Any]) -> str:
    """The settings that differ, each with both values."""
    old, new = _flat(before), _flat(now)
    names = [name for name in sorted(old.keys() | new.keys()) if old.get(name) != new.get(name)]
    told = [f"{name}: {old.get(name)} there, {new.get(name)} now" for name in names if name != "digest"]
    return "; ".join(told[:3]) + (f"; and {len(told) - 3} more" if len(told) > 3 else "")


def _flat(tree: dict[str, Any], path: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        flat |= _flat(value, f"{path}{key}.") if isinstance(value, dict) else {f"{path}{key}": value}
    return flat
