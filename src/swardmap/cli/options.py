"""Options that several verbs share."""

import json
import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swardmap.config import Config, load_config

if TYPE_CHECKING:
    from swardmap.io.annotations.masks import Masks

ConfigFile = Annotated[
    Path | None, typer.Option("--config", "-c", help="YAML file with any part of the settings.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="One setting, such as grid.resolution_m=0.1. Repeatable."
    ),
]
Classes = Annotated[
    list[str] | None,
    typer.Option(
        "--class",
        metavar="THEIRS=OURS",
        help="What a class of the source is: other, grass, person or void; * = all the rest. Repeatable.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, for programs.")]
Kind = Annotated[str | None, typer.Option("--format", help="Kind of recording, if it is not recognised.")]
SegmenterName = Annotated[
    str | None, typer.Option("--segmenter", help="auto, large, small, colour, truth, or an .onnx file.")
]
Provider = Annotated[
    str | None,
    typer.Option(
        "--provider", help="What runs the network: cpu, openvino, cuda, or a provider of ONNX Runtime."
    ),
]
PROVIDERS = {
    "cpu": "CPUExecutionProvider", "openvino": "OpenVINOExecutionProvider", "cuda": "CUDAExecutionProvider",
}  # fmt: skip
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace OUT if swardmap made it.")]
OverwriteFile = Annotated[bool, typer.Option("--overwrite", help="Replace the file if it exists.")]

Rgb = Annotated[
    str | None, typer.Option("--rgb", help="Images by pattern: of the colour images, such as 'rgb/*.jpg'.")
]
Depth = Annotated[
    str | None, typer.Option("--depth", help="Images by pattern: of the depth images, such as 'depth/*.png'.")
]
Poses = Annotated[
    str | None, typer.Option("--poses", help="Images by pattern: file of poses (docs/recordings.md).")
]


def image_flags(rgb: str | None, depth: str | None, poses: str | None) -> dict[str, str | None]:
    """Settings of a source of images by pattern; none where no flag was given."""
    if rgb is None and depth is None and poses is None:
        return {}
    if rgb is None or depth is None:
        raise typer.BadParameter("--rgb and --depth go together: patterns of the two kinds of images")
    return {
        "source.format": "images", "source.color_files": rgb, "source.depth_files": depth,
        "source.poses_file": poses,
    }  # fmt: skip


def with_flags(set_: list[str] | None, flags: Mapping[str, Any]) -> list[str]:
    """What --set says, then the named options that were given: the most explicit are the last word."""
    return [*(set_ or []), *(f"{k}={json.dumps(value)}" for k, value in flags.items() if value is not None)]


def settings(file: Path | None, overrides: list[str]) -> Config:
    """The configuration of a command: defaults < file < environment < --set."""
    return load_config(file, os.environ, overrides)


def provider_name(word: str | None) -> str | None:
    """ONNX Runtime's name of a provider; its own names are taken as they are.

    >>> provider_name("openvino"), provider_name("DmlExecutionProvider")
    ('OpenVINOExecutionProvider', 'DmlExecutionProvider')
    """
    return None if word is None else PROVIDERS.get(word.lower(), word)


def meanings(words: Iterable[str]) -> dict[str, str]:
    """`--class lawn=grass` as theirs -> ours."""
    found = {}
    for word in words:
        theirs, sign, ours = word.rpartition("=")
        if not sign or not theirs or not ours:
            raise typer.BadParameter(f"--class: expected THEIRS=OURS, such as lawn=grass, got '{word}'")
        found[theirs] = ours
    return found


def tell_guesses(masks: "Masks") -> None:
    """Say once what classes were taken for, and what else was taken for something."""
    if masks.guessed:
        told = ", ".join(f"{theirs} = {ours}" for theirs, ours in masks.guessed.items())
        print(f"classes taken for: {told} (--class says otherwise)", file=sys.stderr)
    for note in masks.notes:
        print(f"note: {note}", file=sys.stderr)
