"""The frames of an evaluation, numbered, so that any part of them can be read by any process.

Every index has exactly one outcome: a frame, or the reason why there is none.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swardmap.config import Config, SourceConfig
from swardmap.errors import InputError, SwardmapError
from swardmap.io import FrameSource, TruthSource, is_named, open_source
from swardmap.io.marks import marks_of
from swardmap.io.sources.truth import FrameTruth
from swardmap.types import Frame

if TYPE_CHECKING:
    from swardmap.io.annotations.masks import Masks


@dataclass(frozen=True, slots=True)
class DatasetSpec:
    """Which frames to evaluate; plain data, so that it can travel to other machines.

    Attributes:
        location: a recording, or `analytic:scenes=4,frames=25,noise=1,seed=0,width=640`.
        source: how to read it.
        clean: a second recording of the same frames with clean depth; None if there is none.
        masks: masks of an annotation tool, by frame name, for recordings without labels.
        classes: what its classes mean, THEIRS=OURS each; plain words are taken for what they mean.
    """

    location: str
    source: SourceConfig = field(default_factory=SourceConfig)
    clean: str | None = None
    masks: str | None = None
    classes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "classes", tuple(self.classes))

    def to_dict(self) -> dict[str, Any]:
        """Plain strings and numbers."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False)
class Numbered:
    """One index of a dataset: the frame, or why there is none.

    Attributes:
        index: 0-based, in the order of the dataset.
        frame: with true labels; None if it cannot be used.
        clean: the same frame with clean depth, if the dataset has it.
        unfiltered: where depth was filtered before it was aligned, the same frame without that; None else.
        truth: which thing each pixel is and where the ground lies, as far as the dataset knows.
        error: why there is no frame; empty otherwise.
    """

    index: int
    frame: Frame | None
    clean: Frame | None = None
    truth: FrameTruth | None = None
    error: str = ""
    unfiltered: Frame | None = None

    @property
    def best(self) -> Frame | None:
        """What references are made of, if not of the frame: clean depth, or all that the sensor read."""
        return self.unfiltered if self.clean is None else self.clean

    @property
    def filtered(self) -> Frame | None:
        """The frame itself where `best` is the same without the filter of the source; None else."""
        return None if self.unfiltered is None or self.clean is not None else self.frame


def open_dataset(spec: DatasetSpec, config: Config | None = None) -> FrameSource:
    """Open the recording itself, to ask for its name, its classes and its first frame.

    Args:
        spec: the recording, and which of its frames.
        config: of the robot: recordings whose depth is filtered before it is aligned obey `cloud`.
    """
    return open_source(spec.location, replace(config or Config(), source=spec.source))


def data_marks(spec: DatasetSpec) -> tuple[tuple[str, str], ...]:
    """What the files of a dataset look like, by role: another look is other data, under the same name.

    Frames that are made by a name have no files.

    Raises:
        InputError: if a folder cannot be read.
    """
    places = {"recording": spec.location, "clean depth": spec.clean, "masks": spec.masks}
    return tuple(
        (role, marks_of(place)) for role, place in places.items() if place is not None and not is_named(place)
    )


def count_frames(spec: DatasetSpec) -> int:
    """Number of indices of a dataset; reads it through where the source cannot tell."""
    source = open_dataset(spec)
    count = source.frame_count
    if count is None:
        count = sum(1 for _ in source)
    return count


def read_frames(spec: DatasetSpec, start: int, stop: int, config: Config | None = None) -> Iterator[Numbered]:
    """The frames start..stop-1 of a dataset, each index once.

    A frame that cannot be read, or that the source leaves out, comes as its reason. Sources whose length is
    not known (ROS bags) are read from the beginning.

    Args:
        spec: the dataset.
        start: first index.
        stop: one behind the last.
        config: of the robot, as `open_dataset` takes it.
    """
    config = config or Config()
    source = open_dataset(spec, config)
    if source.frame_count is None:
        yield from _streamed(spec, start, stop, config)
        return
    part = _part(spec, start, stop)
    frames = _listed(part, config)
    beside = _beside(part, frames, config)
    others = None if beside is None else _listed(*beside)
    if len(frames) == stop - start and (others is None or len(others) == stop - start):
        for i, frame in enumerate(frames):
            yield _with_truth(spec, source, start + i, frame, others[i] if others else None)
        return
    for index in range(start, stop):  # one of them is bad: find out which
        yield _single(spec, source, index, config)


def _beside(spec: DatasetSpec, frames: Sequence[Frame], config: Config) -> tuple[DatasetSpec, Config] | None:
    """Where the depth of references is read: the clean recording, or the same one unfiltered; None = neither.

    A filter takes wires and twigs away, which are there all the same.
    """
    unfiltered = replace(config, cloud=replace(config.cloud, consistent_neighbours=0))
    if spec.clean is not None:
        return _clean_spec(spec), unfiltered
    return (spec, unfiltered) if any(frame.depth_filtered for frame in frames) else None


def _listed(spec: DatasetSpec, config: Config) -> list[Frame]:
    """All frames of a part, or as many as there were before the first bad one."""
    frames = []
    try:
        for frame in open_dataset(spec, config):
            frames.append(frame)  # noqa: PERF402 - those before an error are kept
    except SwardmapError:
        pass
    return frames


def _streamed(spec: DatasetSpec, start: int, stop: int, config: Config) -> Iterator[Numbered]:
    index, source = start, open_dataset(spec, config)
    others: Iterator[Frame] | None = None
    for frame in islice(source, start, stop):
        if index == start and (beside := _beside(spec, [frame], config)) is not None:
            others = islice(open_dataset(*beside), start, stop)
        yield _with_truth(spec, source, index, frame, None if others is None else next(others, None))
        index += 1
    for missing in range(index, stop):
        yield Numbered(missing, None, error="the recording ended before this frame")


def _single(spec: DatasetSpec, source: FrameSource, index: int, config: Config) -> Numbered:
    part = _part(spec, index, index + 1)
    try:
        frame = _only_frame(part, config)
        beside = _beside(part, [frame], config)
        other = None if beside is None else _only_frame(*beside)
    except SwardmapError as error:
        return Numbered(index, None, error=str(error))
    return _with_truth(spec, source, index, frame, other)


def _only_frame(spec: DatasetSpec, config: Config) -> Frame:
    source = open_dataset(spec, config)
    frame = next(iter(source), None)
    if frame is None:
        reasons = ", ".join(reason for reason, n in source.skipped.items() if n)
        raise InputError(f"{spec.location}: left out by the source: {reasons or 'no reason given'}")
    return frame


def _with_truth(
    spec: DatasetSpec, source: FrameSource, index: int, frame: Frame, other: Frame | None
) -> Numbered:
    """Add labels, the depth of references and ids of things that lie beside the recording."""
    try:
        if spec.masks is not None:
            frame = _with_mask(frame, spec.masks, spec.classes)
        if frame.labels is None:
            raise InputError(f"frame {frame.name or index}: expected true labels, got none")
        clean = unfiltered = truth = None
        if other is not None and spec.clean is not None:
            clean = _same_frame(frame, other, spec.clean)
        elif other is not None:
            unfiltered = _same_frame(frame, other, spec.location)
        if isinstance(source, TruthSource):
            truth = source.truth(index)
            if clean is None and (exact := source.clean_frame(index)) is not None:
                clean = replace(frame, depth=exact.depth, depth_unit_m=exact.depth_unit_m)
        return Numbered(index, frame, clean, truth, unfiltered=unfiltered)
    except SwardmapError as error:
        return Numbered(index, None, error=str(error))


def _with_mask(frame: Frame, location: str, classes: tuple[str, ...]) -> Frame:
    masks = true_masks(location, classes)
    name = masks.name_of(frame.name)
    if name is None:
        raise InputError(f"frame {frame.name}: no mask of that name in {location}")
    return replace(frame, labels=masks[name], label_set=masks.label_set)


@lru_cache(maxsize=2)
def true_masks(location: str, classes: tuple[str, ...] = ()) -> "Masks":
    """Masks of an annotation tool; plain words are taken for what they mean, as `Masks.guessed` tells.

    Raises:
        InputError: see `read_masks`.
    """
    from swardmap.io.annotations.annotation_files import read_masks

    said = {theirs: ours for theirs, _, ours in (word.rpartition("=") for word in classes)}
    return read_masks(location, classes=said, guess=True)


def _same_frame(frame: Frame, clean: Frame, where: str) -> Frame:
    """The frame with other depth, if that is of the same frame."""
    if clean.name != frame.name or clean.depth.shape != frame.depth.shape:
        raise InputError(
            f"{where}: expected clean depth of frame '{frame.name}' and of shape {frame.depth.shape}, "
            f"got '{clean.name}' of shape {clean.depth.shape}"
        )
    filtered = clean.depth_filtered
    return replace(frame, depth=clean.depth, depth_unit_m=clean.depth_unit_m, depth_filtered=filtered)


def _clean_spec(spec: DatasetSpec) -> DatasetSpec:
    return replace(spec, location=spec.clean or spec.location, clean=None)


def _part(spec: DatasetSpec, start: int, stop: int) -> DatasetSpec:
    """The same dataset, from one index up to another."""
    config = spec.source
    first = config.start + start * config.every
    last = config.start + (stop - 1) * config.every + 1
    last = last if config.stop is None else min(last, config.stop)
    return replace(spec, source=replace(config, start=first, stop=last))


def dataset_name(location: str) -> str:
    """What a report calls a dataset."""
    return "the built-in gardens" if is_named(location) else Path(location).resolve().name
