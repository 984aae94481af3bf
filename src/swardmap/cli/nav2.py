"""`swardmap nav2`: parameter files for Nav2 with the margin and cameras of a robot."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from swardmap.cli.options import ConfigFile, Settings, settings

EXAMPLES = """\b
Examples:
  swardmap nav2 nav2_params
  swardmap nav2 nav2_params --config margin.yaml --rig rig.yaml --set costmap.inscribed_radius_m=0.32
  swardmap nav2 nav2_params --footprint '[[0.5, 0.3], [0.5, -0.3], [-0.3, -0.3], [-0.3, 0.3]]'
"""


def nav2_command(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for the files.")],
    rig: Annotated[
        Path | None, typer.Option("--rig", help="Rig file, for the names of the cameras.", exists=True)
    ] = None,
    namespace: Annotated[str, typer.Option("--namespace", help="Of the node, such as /mower1.")] = "",
    map_frame: Annotated[str, typer.Option("--map-frame", help="Frame of the poses.")] = "map",
    footprint: Annotated[
        str | None,
        typer.Option("--footprint", help="Outline of the robot from its base, [[x, y], ...] in metres."),
    ] = None,
    config: ConfigFile = None,
    set_: Settings = None,
) -> None:
    """Write ready parameter files for the node and for Nav2, with your margin (docs/nav2.md)."""
    chosen = settings(config, list(set_ or []))
    from swardmap.config import config_to_dict
    from swardmap.io.maps.margin_file import margin_notes
    from swardmap.rig.rig import read_rig
    from swardmap.ros.footprint import footprint_from_text
    from swardmap.ros.nav2_files import nav2_files, write_nav2_files
    from swardmap.runs.versions import segmenter_title

    found = None if rig is None else read_rig(rig)
    cameras, base_frame = (("camera",), "base_link") if found is None else (found.names, found.base_frame)
    outline = None if footprint is None else footprint_from_text(footprint)
    files = nav2_files(chosen, cameras, namespace, base_frame, map_frame, outline)
    write_nav2_files(out, files)
    for name in files:
        print(out / name)
    if config is not None:
        for note in margin_notes(config, config_to_dict(chosen), segmenter_title(chosen)):
            print(f"note: {note}", file=sys.stderr)
    if chosen.costmap.margin_m is None:
        margin_m = chosen.costmap.obstacle_margin_m
        print(
            f"note: margin {margin_m:g} m, the default: none was measured (swardmap evaluate)",
            file=sys.stderr,
        )
