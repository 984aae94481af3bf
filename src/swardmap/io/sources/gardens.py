"""All sequences that `swardmap synth` made, as one data set: frames as a robot gets them, with true labels.

    OUT/plan.json                     what was made
    OUT/folder/SCENE/LIGHT/           one sequence, in our folder layout; whole if complete.json is there

Frames are named as EDEN's are (SCENE-LIGHT-FRAME), so that `--clean OUT/eden` finds the exact depth of each.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.io.door import read_json
from swardmap.io.sources import folder
from swardmap.io.sources.eden_layout import LIGHTS, SCENE
from swardmap.io.sources.source import Source, Tally
from swardmap.io.sources.truth import FrameTruth
from swardmap.labels import GRASS_OBSTACLE_PERSON
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


@dataclass(frozen=True, slots=True)
class Gardens:
    """All whole sequences, and how many are not."""

    sequences: tuple[Sequence, ...]
    broken: int
    config: SourceConfig

    @property
    def indices(self) -> range:
        """Which of all frames are to be read."""
        config = self.config
        return range(sum(s.frames for s in self.sequences))[config.start : config.stop : config.every]

    def count_broken(self, tally: Tally) -> Tally:
        """Count the sequences that are left out."""
        if self.broken:
            tally.skip(NOT_WHOLE, count=self.broken)
        return tally

    def frames(self, tally: Tally) -> Iterator[Frame]:
        """The frames chosen, scene by scene, light by light."""
        self.count_broken(tally)
        first = 0
        for sequence in self.sequences:
            wanted = [i - first for i in self.indices if first <= i < first + sequence.frames]
            first += sequence.frames
            if wanted:
                yield from self._frames(sequence, wanted, tally)

    def clean_frame(self, position: int) -> Frame | None:
        """The frame at a position with exact depth; None if the gardens were made without a sensor."""
        sequence, source = self._at(position)
        frame = source.clean_frame(0)
        return None if frame is None else _named(frame, sequence)

    def truth(self, position: int) -> FrameTruth | None:
        """What is truly there in the frame at a position."""
        _, source = self._at(position)
        return source.truth(0)

    def _at(self, position: int) -> tuple[Sequence, Source]:
        """The sequence of a frame, and the frame alone as a source."""
        index = self.indices[position]
        for sequence in self.sequences:
            if index < sequence.frames:
                part = replace(self.config, start=index, stop=index + 1, every=1)
                return sequence, folder.open_source(sequence.path, part)
            index -= sequence.frames
        raise InputError(f"gardens: no frame {position}")

    def _frames(self, sequence: Sequence, wanted: list[int], tally: Tally) -> Iterator[Frame]:
        part = replace(self.config, start=wanted[0], stop=wanted[-1] + 1)
        source = folder.open_source(sequence.path, part)
        for frame in source:
            yield _named(frame, sequence)
        for reason, count in source.skipped.items():
            tally.skip(reason, source.tally.first.get(reason, ""), count)


def _named(frame: Frame, sequence: Sequence) -> Frame:
    """The frame as one of all sequences: its name, and a time of its own."""
    stamp_ns = frame.stamp_ns + sequence.number * APART_NS
    return replace(frame, name=f"{sequence.name}-{frame.name}", stamp_ns=stamp_ns)


def recognises(path: Path) -> bool:
    """Whether `path` is what `swardmap synth` makes."""
    return (path / PLAN_FILE).is_file() and (path / SEQUENCES).is_dir()


def open_source(path: Path, config: SourceConfig) -> Source:
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
    gardens = Gardens(tuple(whole), counts.count(0), config)
    tally = gardens.count_broken(Tally())
    return Source(
        path.resolve().name, len(gardens.indices), GRASS_OBSTACLE_PERSON, gardens.frames, tally,
        gardens.clean_frame, gardens.truth,
    )  # fmt: skip


MAX_FRAMES = 100_000
"""Of a sequence: EDEN numbers them with five digits."""


def _frames_of(sequence: Path) -> int:
    """How many frames a sequence holds; 0 = it is not whole."""
    try:
        frames: int = read_json(sequence / COMPLETE_FILE, {"frames": int}, 10_000)["frames"]
        return max(0, min(frames, MAX_FRAMES))
    except InputError:
        return 0
