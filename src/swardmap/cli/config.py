"""`swardmap config`: the settings, with what each is for."""

import json
from typing import Annotated

import typer

from swardmap.cli.options import ConfigFile, Json, Settings, settings
from swardmap.config import config_to_dict, config_to_yaml


def config(
    config: ConfigFile = None,
    set_: Settings = None,
    as_json: Json = False,
    comments: Annotated[bool, typer.Option(help="Say what each setting is for.")] = True,
) -> None:
    """Print all settings with comments, as they are after file, environment and --set.

    Example: swardmap config > mower.yaml
    """
    chosen = settings(config, set_ or [])
    print(
        json.dumps(config_to_dict(chosen), indent=2) if as_json else config_to_yaml(chosen, comments), end=""
    )
