"""`swardmap record`: what a camera or any other source gives, to an MCAP file."""

import json
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer

from swardmap.cli.live import Duration, Frames, tell_how_it_ended, until_stopped
from swardmap.cli.options import ConfigFile, Json, Kind, OverwriteFile, Settings, settings, with_flags
from swardmap.cli.progress import Progress
from swardmap.errors import InputError

QUEUE = 15
"""Pairs that wait while one is written: as many as the SDK keeps buffers for (frames_queue_size, 16)."""

EXAMPLES = """\b
Examples:
  swardmap record realsense: -o drive.mcap --duration 60
  swardmap record realsense:012345678901 -o drive.mcap --images jpeg
  swardmap record recording/ -o recording.mcap
"""


def record_command(
    source: Annotated[
        Path,
        typer.Argument(help="realsense:, realsense:SERIAL, or a recording of any kind.", readable=False),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write; ends in .mcap.", readable=False)],
    frames: Frames = None,
    duration: Duration = None,
    images: Annotated[str, typer.Option(help="Colour: raw or png, both without loss, or jpeg.")] = "raw",
    depth: Annotated[str, typer.Option(help="Depth: raw or png, both without loss.")] = "raw",
    kind: Kind = None,
    config: ConfigFile = None,
    set_: Settings = None,
    overwrite: OverwriteFile = False,
    as_json: Json = False,
) -> None:
    """Record a live camera, or any other source, to an MCAP file for swardmap, Foxglove and `ros2 bag`.

    The file appears when it is whole. Ctrl-C ends it with the frames that came.
    """
    chosen = settings(config, with_flags(set_, {"source.format": kind}))

    from swardmap.io import is_live, open_source
    from swardmap.io.bags.mcap_writer import record
    from swardmap.io.bags.record_messages import RecordOptions
    from swardmap.io.sources.limited import LimitedSource
    from swardmap.pipeline import configured_mount

    options = RecordOptions(images, depth, configured_mount(chosen.mount))
    camera = replace(chosen.camera, queue=max(chosen.camera.queue, QUEUE))  # a hiccup shall cost no image
    given = LimitedSource(open_source(source, replace(chosen, camera=camera)), frames, duration)
    started = perf_counter()
    try:
        with (
            until_stopped(given),
            Progress("recording", "recorded", given.frame_count, as_json) as bar,
        ):
            count = record(given, out, options, overwrite, bar.step)
    except InputError as error:
        if given.stopped and not given.given:
            raise typer.Abort("before the first frame came; nothing was written") from error
        raise
    size, left_out = out.stat().st_size, dict(given.skipped)
    if as_json:
        facts = {
            "file": str(out),
            "frames": count,
            "bytes": size,
            "seconds": round(perf_counter() - started, 3),
            "skipped": left_out,
            "stopped": given.stopped,
        }
        print(json.dumps(facts, indent=2))
    else:
        print(f"{count} frames in {out}, {size / 1e6:.1f} MB")
        if left_out:
            print("left out: " + ", ".join(f"{n} x {reason}" for reason, n in left_out.items()))
    tell_how_it_ended(given, is_live(source), count, out)
