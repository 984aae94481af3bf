"""Segmenters: what tells grass from obstacles in a colour image (Sec. 3.3).

To add one: one file with `open_segmenter`, one entry in SEGMENTERS.
"""

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from swardmap.config import SegmenterConfig
from swardmap.errors import ConfigError
from swardmap.labels import LabelSet
from swardmap.segmenter import Segmenter

BUNDLED_FOLDER = Path(__file__).parent.parent / "data" / "models"
BUNDLED_FILES: Mapping[str, str] = {"auto": "lawn.onnx", "large": "lawn.onnx", "small": "lawn-small.onnx"}
"""Networks in the package by the name of the segmenter; `small` is the same one with a smaller input.

`auto` is the larger one, but on a robot whose cameras ask more of its cores (`swardmap.ros.network_choice`).
"""


class SegmenterModule(Protocol):
    """What a module named in SEGMENTERS offers."""

    @staticmethod
    def open_segmenter(config: SegmenterConfig, source_label_set: LabelSet | None) -> Segmenter:
        """Make it ready to run, or raise a SwardmapError that says what is missing."""


SEGMENTERS: Mapping[str, str] = {
    "colour": "swardmap.models.colour",
    "truth": "swardmap.models.oracle",
    "onnx": "swardmap.models.onnx",
}
"""Kinds of segmenter and the module of each."""


def bundled_network(name: str = "auto") -> Path | None:
    """The network that comes with the package, by a name of `BUNDLED_FILES`; None in a package without it."""
    path = BUNDLED_FOLDER / BUNDLED_FILES[name]
    return path if path.is_file() else None


def network_file(name: str) -> Path | None:
    """The file of the network that a segmenter's name means; None where it means no network."""
    if name in BUNDLED_FILES:
        return bundled_network(name)
    return Path(name) if Path(name).suffix.lower() == ".onnx" else None


def build_segmenter(
    config: SegmenterConfig | None = None, source_label_set: LabelSet | None = None
) -> Segmenter:
    """Make the segmenter that the configuration names.

    Args:
        config: `config.name` is `auto` (the bundled network, or colour where there is none), `large` (the
            same, or nothing), `small` (that network with a smaller input), `colour`, `truth`, or the path of
            an .onnx file.
        source_label_set: classes of the recording's true labels, if it has any; `truth` needs it.

    Raises:
        ConfigError: for a name that is none of these.
        ModelError: for a network file that is not what it should be.
    """
    config = config or SegmenterConfig()
    kind = _kind_of(config.name)
    module: SegmenterModule = importlib.import_module(SEGMENTERS[kind])  # type: ignore[assignment]
    return module.open_segmenter(config, source_label_set)


def _kind_of(name: str) -> str:
    if name == "auto":
        return "onnx" if bundled_network() else "colour"
    if name in BUNDLED_FILES or Path(name).suffix.lower() == ".onnx":
        return "onnx"
    if name in SEGMENTERS and name != "onnx":
        return name
    raise ConfigError(
        f"segmenter: expected auto, large, small, colour, truth or the path of an .onnx file, got '{name}'"
    )
