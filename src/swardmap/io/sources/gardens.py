"""All sequences that `swardmap synth` made, as one data set: frames as a robot gets them, with true labels.

    OUT/plan.json                     what was made
    OUT/folder/SCENE/LIGHT/           one sequence, in our folder layout; whole if complete.json is there

Frames are named as EDEN's are (SCENE-LIGHT-FRAME), so that `--clean OUT/eden` finds the exact depth of each.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.io.sources import folder
from swardmap.io.sources.eden_layout import LIGHTS, SCENE
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelSet
from swardmap.types import Frame

PLAN_FILE, SEQUENCES, COMPLETE_FILE = "plan.json", "folder", "complete.json"
NOT_WHOLE = "sequence that is not whole (give the same `swardmap synth` again)"
APART_NS = 86_400 * 10**9
"""Between the beginnings of two sequences: longer than any of them."""


@dataclass(frozen=True, slots=True)
class Sequence:
    """One drive in one light: its place among all sequences, and how many frames it has."""

    path: Path
    number: int
    frames: int

    @property
    def name(self) -> str:
        """As EDEN has it."""
        return f"{self.path.parent.name}-{self.path.name}"


class GardensSource:
    """Frames of all whole sequences, scene by scene, light by light; opened by `open_source`."""

    def __init__(self, path: Path, sequences: list[Sequence], broken: int, config: SourceConfig) -> None:
        self._path, self._sequences, self._broken, self._config = path, sequences, broken, config
        total = sum(sequence.frames for sequence in sequences)
        self._indices = range(total)[config.start : config.stop : config.every]
        self._skipped: dict[str, int] = {}

    @property
    def name(self) -> str:
        """Of the folder."""
        return self._path.resolve().name

    @property
    def frame_count(self) -> int:
        """Of all whole sequences."""
        return len(self._indices)

    @property
    def label_set(self) -> LabelSet:
        """Other, grass, person."""
        return GRASS_OBSTACLE_PERSON

    @property
    def skipped(self) -> Mapping[str, int]:
        """Sequences left out, and what is left out of those that are read."""
        return {**({NOT_WHOLE: self._broken} if self._broken else {}), **self._skipped}

    def __iter__(self) -> Iterator[Frame]:
        """Read frame by frame."""
        self._skipped = {}
        first = 0
        for sequence in self._sequences:
            wanted = [i - first for i in self._indices if first <= i < first + sequence.frames]
            first += sequence.frames
            if wanted:
                yield from self._frames(sequence, wanted)

    def _frames(self, sequence: Sequence, wanted: list[int]) -> Iterator[Frame]:
        part = replace(self._config, start=wanted[0], stop=wanted[-1] + 1)
        source = folder.open_source(sequence.path, part)
        for frame in source:
            stamp_ns = frame.stamp_ns + sequence.number * APART_NS
            yield replace(frame, name=f"{sequence.name}-{frame.name}", stamp_ns=stamp_ns)
        for reason, count in source.skipped.items():
            self._skipped[reason] = self._skipped.get(reason, 0) + count


def recognises(path: Path) -> bool:
    """Whether `path` is what `swardmap synth` makes."""
    return (path / PLAN_FILE).is_file() and (path / SEQUENCES).is_dir()


def open_source(path: Path, config: SourceConfig) -> GardensSource:
    """Open all whole sequences.

    Raises:
        InputError: if there is none.
    """
    here = path / SEQUENCES
    if not here.is_dir():
        raise InputError(f"{path}: expected a folder {SEQUENCES}/, as `swardmap synth` writes it")
    scenes = sorted(p for p in here.iterdir() if SCENE.fullmatch(p.name) and p.is_dir())
    found = [p / light for p in scenes for light in LIGHTS if (p / light).is_dir()]
    counts = [_frames_of(p) for p in found]
    whole = [Sequence(p, k, n) for k, (p, n) in enumerate(zip(found, counts, strict=True)) if n]
    if not whole:
        raise InputError(f"{path}: expected at least one sequence with {COMPLETE_FILE}, found none")
    return GardensSource(path, whole, counts.count(0), config)


def _frames_of(sequence: Path) -> int:
    """How many frames a sequence holds; 0 = it is not whole."""
    try:
        return max(0, int(json.loads((sequence / COMPLETE_FILE).read_text(encoding="utf-8"))["frames"]))
    except (OSError, ValueError, KeyError, TypeError):
        return 0
