"""`swardmap view`: a recording or a live camera in the Rerun viewer."""

import json
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import typer

from swardmap.cli.live import Duration, Frames, tell_how_it_ended, until_stopped
from swardmap.cli.options import (
    ConfigFile,
    Json,
    Kind,
    OverwriteFile,
    SegmenterName,
    Settings,
    settings,
    with_flags,
)
from swardmap.cli.progress import Progress
from swardmap.pipeline import StepResult

EXAMPLES = """\b
Examples:
  swardmap view recording/
  swardmap view realsense: --set grid.mode=log_odds
  swardmap view drive.mcap --save drive.rrd --jpeg 85
  swardmap view drive.mcap --connect rerun+http://192.168.0.7:9876/proxy
"""


def view_command(
    source: Annotated[
        Path,
        typer.Argument(help="realsense:, realsense:SERIAL, or a recording of any kind.", readable=False),
    ],
    save: Annotated[
        Path | None, typer.Option(help="Write an .rrd file instead of showing it.", readable=False)
    ] = None,
    connect: Annotated[
        str | None, typer.Option(metavar="URL", help="Send to a viewer that runs, in place of a new one.")
    ] = None,
    segmenter: SegmenterName = None,
    jpeg: Annotated[
        int | None, typer.Option(min=1, max=100, help="Quality of photos as JPEG; without it they are raw.")
    ] = None,
    frames: Frames = None,
    duration: Duration = None,
    kind: Kind = None,
    config: ConfigFile = None,
    set_: Settings = None,
    overwrite: OverwriteFile = False,
    as_json: Json = False,
) -> None:
    """Map a recording or a live camera and watch it: photo, mask, depth, cloud, map, margin, timings."""
    if save is not None and connect is not None:
        raise typer.BadParameter("expected --save or --connect, got both")
    flags = {"source.format": kind, "segmenter.name": segmenter}
    chosen = settings(config, with_flags(set_, flags))

    from swardmap.io import is_live, open_source
    from swardmap.io.sources.limited import LimitedSource
    from swardmap.models import build_segmenter
    from swardmap.runs.map_steps import map_steps
    from swardmap.runs.recording import build_mapper
    from swardmap.runs.summary import RunTotals
    from swardmap.viz.rerun_sink import load_rerun, rerun_sink
    from swardmap.viz.rerun_stream import RerunStream, layout

    load_rerun()  # that it is missing is said before any work
    live, totals = is_live(source), RunTotals()
    given = LimitedSource(open_source(source, chosen), frames, duration)
    mapper = build_mapper(build_segmenter(chosen.segmenter, given.label_set), chosen)
    with (
        rerun_sink(save, connect, overwrite, layout()) as sink,
        until_stopped(given),
        Progress("viewing", "sent", given.frame_count, as_json) as bar,
    ):
        stream = RerunStream(sink, chosen, jpeg, live)
        for step, read_ms in _timed(map_steps(given, mapper)):
            stream.add(step, mapper, read_ms)
            totals.add(step)
            bar.step()
        stream.finish(mapper)
    where = save or connect or "the viewer"
    _report(totals, given, where, as_json)
    tell_how_it_ended(given, live, totals.frames, where)


def _timed(steps: Iterator[StepResult]) -> Iterator[tuple[StepResult, float]]:
    """Each step, and how long it took to read its frame: the rest of the time."""
    while True:
        started = perf_counter()
        step = next(steps, None)
        if step is None:
            return
        all_ms = 1e3 * (perf_counter() - started)
        yield step, max(0.0, all_ms - sum(step.timings_ms.values()))


def _report(totals: Any, given: Any, where: Path | str, as_json: bool) -> None:
    left_out, timings_ms = dict(given.skipped), totals.timing_summary()
    if as_json:
        facts = {
            "to": str(where),
            "frames": totals.frames,
            "skipped": left_out,
            "stopped": given.stopped,
            "timings_ms": timings_ms,
        }
        print(json.dumps(facts, indent=2))
        return
    print(f"{totals.frames} frames in {where}")
    if left_out:
        print("left out: " + ", ".join(f"{n} x {reason}" for reason, n in left_out.items()))
    print(
        "median milliseconds a frame: "
        + ", ".join(f"{stage} {t['p50']:.1f}" for stage, t in timings_ms.items())
    )
