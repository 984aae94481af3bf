"""Options that several verbs share."""

import os
from pathlib import Path
from typing import Annotated

import typer

from swardmap.config import Config, load_config

ConfigFile = Annotated[
    Path | None, typer.Option("--config", "-c", help="YAML file with any part of the settings.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="One setting, such as grid.resolution_m=0.1. Repeatable."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, for programs.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace OUT if swardmap made it.")]


def settings(file: Path | None, overrides: list[str]) -> Config:
    """The configuration of a command: defaults < file < environment < --set."""
    return load_config(file, os.environ, overrides)
