"""`swardmap ros`: the ROS 2 node."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from swardmap.cli.options import ConfigFile, Settings, settings

EXAMPLES = """\b
Examples:
  swardmap ros --params robot.yaml
  swardmap ros --set source.odometry_topic=/odom -- -r color/image_raw:=/camera/camera/color/image_raw
  swardmap ros --params robot.yaml -- -r __ns:=/front_mower
  swardmap ros --demo
"""


class GardenKind(StrEnum):
    """Kinds of garden of the demo."""

    auto = "auto"
    rendered = "rendered"
    solids = "solids"


def ros_command(
    params: Annotated[
        Path | None,
        typer.Option("--params", help="ROS 2 parameter file (docs/robot.md).", exists=True, dir_okay=False),
    ] = None,
    ros_args: Annotated[
        list[str] | None,
        typer.Argument(help="After --: ROS arguments such as -r from:=to or -p name:=value."),
    ] = None,
    demo: Annotated[
        bool, typer.Option("--demo", help="Without a robot: a mower that drives in a simulated garden.")
    ] = False,
    garden: Annotated[
        GardenKind, typer.Option("--garden", help="Of --demo; auto: rendered where there is what draws it.")
    ] = GardenKind.auto,
    rounds: Annotated[
        int | None, typer.Option("--rounds", min=1, help="Of --demo: end after so many.")
    ] = None,
    pace: Annotated[
        float, typer.Option("--pace", min=0.01, max=100, help="Of --demo: its clock is at most so fast.")
    ] = 1.0,
    config: ConfigFile = None,
    set_: Settings = None,
) -> None:
    """Run the ROS 2 node: cameras and poses to masks, clouds, map, costmap and a stop flag."""
    chosen = settings(config, list(set_ or []))
    arguments = ["--ros-args", *(["--params-file", str(params)] if params else []), *_plain(ros_args or [])]
    if demo:
        from swardmap.cli.ros_demo import run_demo

        run_demo(chosen, arguments, garden.value, rounds, pace)
        return

    from swardmap.ros.parameters import Parameters
    from swardmap.ros.run import run_node

    run_node(Parameters(config=chosen), arguments)


def _plain(ros_args: list[str]) -> list[str]:
    """`--ros-args` may be written or not."""
    return [argument for argument in ros_args if argument != "--ros-args"]
