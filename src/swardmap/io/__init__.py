"""Frame sources and files. Nothing is imported here that is not needed to tell sources apart.

To add a sensor or a data set: one file with `recognises` and `open_source`, one entry in SOURCES,
and a subclass of the contract test (CONTRIBUTING.md).
"""

import importlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from swardmap.config import Config, SourceConfig
from swardmap.errors import ConfigError, InputError, SwardmapError
from swardmap.io.door import through_door
from swardmap.labels import LabelSet
from swardmap.types import Frame

if TYPE_CHECKING:
    from swardmap.io.sources.truth import FrameTruth


@runtime_checkable
class FrameSource(Protocol):
    """A stream of aligned RGB-D frames. Iterating it again starts from the beginning."""

    @property
    def name(self) -> str:
        """What a person would call the source: a folder, a bag, a camera."""

    @property
    def frame_count(self) -> int | None:
        """Number of frames it will yield, where that can be known."""

    @property
    def label_set(self) -> LabelSet | None:
        """Classes of the true labels, if the source has labels."""

    @property
    def skipped(self) -> Mapping[str, int]:
        """What the last iteration left out so far, counted by reason."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order of time."""


class SourceModule(Protocol):
    """What a module named in SOURCES offers.

    One that says WHOLE_CONFIG = True gets the whole configuration: it filters depth before it aligns it.
    """

    @staticmethod
    def recognises(path: Path) -> bool:
        """Whether `path` looks like this kind of source (cheap: names, not contents)."""

    @staticmethod
    def open_source(path: Path, config: SourceConfig) -> FrameSource:
        """Open it, or raise InputError saying what is missing."""


SOURCES: Mapping[str, str] = {
    "folder": "swardmap.io.sources.folder",
    "gardens": "swardmap.io.sources.gardens",
    "3dmatch": "swardmap.io.sources.threedmatch",
    "orfd": "swardmap.io.sources.orfd",
    "rellis": "swardmap.io.sources.rellis",
    "tum": "swardmap.io.sources.tum",
    "scannet": "swardmap.io.sources.scannet",
    "tartanair": "swardmap.io.sources.tartanair",
    "eden": "swardmap.io.sources.eden",
    "rosbag": "swardmap.io.bags.rosbag",
    "images": "swardmap.io.sources.images",
}
"""Kinds of source and the module that reads each; asked in this order."""


class LiveModule(Protocol):
    """What a module named in LIVE offers."""

    @staticmethod
    def open_live(address: str, config: Config) -> FrameSource:
        """Open the camera at `address` (empty: the only one) by its section, or raise InputError."""


LIVE: Mapping[str, str] = {"realsense": "swardmap.io.sources.realsense_live"}
"""Kinds of live camera, named as `realsense:` or `realsense:ADDRESS`, and the module of each."""


class NamedModule(Protocol):
    """What a module named in NAMED offers."""

    @staticmethod
    def open_named(location: str, config: SourceConfig) -> FrameSource:
        """Open what `location` describes, or raise ConfigError saying what it may hold."""


NAMED: Mapping[str, str] = {"analytic": "swardmap.synth.analytic_source"}
"""Sources that are made and not read, named as `analytic` or `analytic:KEY=VALUE,...`."""


@runtime_checkable
class TruthSource(Protocol):
    """A source that may know more of its frames than a sensor sees; an evaluation asks, a robot does not."""

    def clean_frame(self, position: int) -> Frame | None:
        """The frame at a position of this source, with exact depth; None if there is none."""

    def truth(self, position: int) -> "FrameTruth | None":
        """What is truly there in that frame; None if nobody recorded it."""


def is_named(location: str | Path) -> bool:
    """Whether a location describes frames that are made and names no file."""
    return str(location).partition(":")[0] in NAMED


def is_live(location: str | Path) -> bool:
    """Whether a location names a live camera, whose frames have no end."""
    kind, colon, _ = str(location).partition(":")
    return bool(colon) and kind in LIVE


@through_door("a recording")
def open_source(location: str | Path, config: SourceConfig | Config | None = None) -> FrameSource:
    """Open a recording, whatever kind it is, or a live camera.

    Args:
        location: folder, file, `realsense:`, `realsense:SERIAL`, or `analytic:scenes=4`.
        config: how to read it; `source.format` names the kind where it cannot be recognised. A live camera
            takes how it is to run from its own section of the whole configuration.

    Raises:
        ConfigError: if `source.format` is no kind of source.
        InputError: if it does not exist, is of no known kind, or holds nothing.
        MissingExtraError: if the camera's package is not installed.
    """
    whole = config if isinstance(config, Config) else Config(source=config or SourceConfig())
    kind, _, address = str(location).partition(":")
    if is_live(location):
        live: LiveModule = importlib.import_module(LIVE[kind])  # type: ignore[assignment]
        return live.open_live(address, whole)
    if is_named(location):
        named: NamedModule = importlib.import_module(NAMED[kind])  # type: ignore[assignment]
        return named.open_named(str(location), whole.source)
    return _open_path(Path(location), whole)


def _open_path(path: Path, config: Config) -> FrameSource:
    source = config.source
    if source.format is not None and source.format not in SOURCES:
        raise ConfigError(f"source.format: expected one of {', '.join(SOURCES)}, got '{source.format}'")
    try:
        if not path.exists():
            raise InputError(f"no such recording: {path}")
        if path.is_dir():
            next(path.iterdir(), None)  # what cannot be listed looks empty to those who ask for a name
        kinds = [source.format] if source.format else list(SOURCES)
        for kind in kinds:
            module: SourceModule = importlib.import_module(SOURCES[kind])  # type: ignore[assignment]
            if source.format or module.recognises(path):
                whole = getattr(module, "WHOLE_CONFIG", False)
                return module.open_source(path, config if whole else source)  # type: ignore[arg-type]
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        if isinstance(error, SwardmapError):
            raise
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    raise InputError(
        f"{path} is not a recording that swardmap knows ({', '.join(SOURCES)}). "
        "Name its kind with --format, or see docs/recordings.md for the folder layout."
    )
