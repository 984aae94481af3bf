"""`swardmap demo`: the main job on a scene that the package makes itself."""

import json
from pathlib import Path
from typing import Annotated

import typer

from swardmap.cli.map import report
from swardmap.cli.options import ConfigFile, Json, Overwrite, Progress, Settings, settings


def demo(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.")] = Path("demo"),
    frames: Annotated[int, typer.Option(min=1, max=500, help="Frames to drive.")] = 24,
    seed: Annotated[int, typer.Option(help="Of the garden.")] = 0,
    config: ConfigFile = None,
    set_: Settings = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Drive a mower through a small garden with exact truth and map it: no network, no weights, no data.

    Example: swardmap demo -o demo/
    """
    chosen = settings(config, ["segmenter.name=colour", *(set_ or [])])

    from swardmap.recording import map_recording
    from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
    from swardmap.synth.analytic_noise import StereoNoise

    lane = tuple(lane_poses(frames, step_m=0.2))
    source = AnalyticSource(garden_scene(seed), lane, noise=StereoNoise(), seed=seed)
    with Progress(frames, quiet=as_json) as on_step:
        run = map_recording(source, out, chosen, overwrite=overwrite, on_step=on_step)
    print(json.dumps(run.summary, indent=2) if as_json else report(run.summary, out))
