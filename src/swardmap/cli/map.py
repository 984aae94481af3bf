"""`swardmap map`: a recording or a live camera to an obstacle map."""

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

import typer

from swardmap.cli.live import Duration, Frames, tell_how_it_ended, until_stopped
from swardmap.cli.options import (
    ConfigFile,
    Depth,
    Json,
    Kind,
    Overwrite,
    Poses,
    Provider,
    Rgb,
    SegmenterName,
    Settings,
    image_flags,
    provider_name,
    settings,
    with_flags,
)
from swardmap.cli.progress import Progress
from swardmap.config import Config, config_to_dict
from swardmap.errors import InputError

EXAMPLES = """\b
Examples:
  swardmap map recording/ -o out/
  swardmap map drive.mcap -o out/ --segmenter lawn.onnx --resolution 0.1
  swardmap map drive.bag -o out/ --set source.depth_topic=/depth/image_raw
  swardmap map data/ -o out/ --rgb 'rgb/*.jpg' --depth 'depth/*.png' --set source.intrinsics=[615,615,320,240]
  swardmap map monday.mcap tuesday.mcap friday.mcap -o maps/ --workers 2
  swardmap map friday.mcap -o out2/ --resume-map out/living.npz
  swardmap map drive.mcap -o out/ --set area.file=lawn.kml --set area.datum_lat=52.4 --set area.datum_lon=16.9
"""


def map_command(
    sources: Annotated[
        list[Path],
        typer.Argument(
            help="A folder, a ROS bag, an MCAP file, or the camera realsense:; several get a map each.",
            metavar="SOURCE...",
            readable=False,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.", readable=False)],
    kind: Kind = None,
    rgb: Rgb = None,
    depth: Depth = None,
    poses: Poses = None,
    segmenter: SegmenterName = None,
    provider: Provider = None,
    resolution: Annotated[float | None, typer.Option(help="Edge of a map cell in metres.")] = None,
    margin: Annotated[
        float | None, typer.Option(help="Margin in metres that obstacles are grown by.")
    ] = None,
    pictures: Annotated[
        int | None, typer.Option(help="A picture of every n-th frame; 0 = none. Without it: about 50.")
    ] = None,
    clouds: Annotated[str | None, typer.Option(help="Cloud of each frame: none, pcd, ply.")] = None,
    resume_map: Annotated[
        Path | None,
        typer.Option(help="living.npz of an earlier run to go on from; makes grid.mode log_odds."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes for several recordings; none = one a core.", min=1)
    ] = None,
    ray: Annotated[
        str | None, typer.Option(help="Address of a Ray cluster for several recordings, or local.")
    ] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Stop at a frame that the node's watchdog would name.")
    ] = False,
    frames: Frames = None,
    duration: Duration = None,
    config: ConfigFile = None,
    set_: Settings = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Turn a recording into an obstacle map that Nav2 reads: map, costmap, clouds, pictures, summary."""
    flags = {
        "source.format": kind, **image_flags(rgb, depth, poses),
        "segmenter.name": segmenter, "segmenter.provider": provider_name(provider),
        "grid.resolution_m": resolution,
        "costmap.margin_m": margin, "output.pictures": pictures, "output.clouds": clouds,
        **({} if resume_map is None else {"grid.mode": "log_odds", "grid.resume": str(resume_map)}),
    }  # fmt: skip
    chosen = settings(config, with_flags(set_, flags))
    resumed = [] if resume_map is None else _mode_notes(settings(config, set_ or []), chosen)

    if len(sources) > 1:
        if frames or duration or resume_map:
            raise typer.BadParameter("--frames, --duration and --resume-map are for one recording")
        _map_many(sources, out, chosen, workers, ray, overwrite, strict, as_json)
        return
    (source,) = sources
    from swardmap.io import is_live, open_source
    from swardmap.io.files import refuse_to_replace
    from swardmap.io.maps.margin_file import margin_notes
    from swardmap.io.sources.limited import LimitedSource
    from swardmap.runs.recording import map_recording
    from swardmap.runs.versions import segmenter_title

    live = is_live(source)
    if not live:
        refuse_to_replace(source, out)
    given = LimitedSource(open_source(source, chosen), frames, duration)
    notes = [] if config is None else margin_notes(config, config_to_dict(chosen), segmenter_title(chosen))
    notes += resumed
    with ExitStack() as stack:
        if live:  # a recording that is stopped is an interrupted run; a camera has no other end
            stack.enter_context(until_stopped(given))
        bar = stack.enter_context(Progress("mapping", "mapped", given.frame_count, as_json))
        run = map_recording(
            given, out, chosen, overwrite=overwrite, on_step=bar.step, strict=strict, notes=notes,
            ahead=not live,
        )  # fmt: skip
    print(json.dumps(run.summary, indent=2) if as_json else report(run.summary, out))
    tell_how_it_ended(given, live, run.totals.frames, out)


def _mode_notes(asked: Config, chosen: Config) -> list[str]:
    """What --resume-map changed of the settings."""
    before, now = asked.grid.mode, chosen.grid.mode
    return [] if before == now else [f"--resume-map goes on as grid.mode {now}; the settings say {before}"]


def _map_many(
    sources: list[Path],
    out: Path,
    config: Config,
    workers: int | None,
    ray: str | None,
    overwrite: bool,
    strict: bool,
    as_json: bool,
) -> None:
    """A map each; says at the end which could not be made.

    Raises:
        InputError: if one could not be mapped; the others are there.
    """
    from swardmap.runs.many import map_recordings

    with Progress("mapping", "mapped", quiet=as_json, things="recordings") as bar:
        found = map_recordings(
            sources,
            out,
            config,
            workers=workers,
            ray_address=ray,
            overwrite=overwrite,
            strict=strict,
            on_done=bar.show,
        )
    made: dict[str, Any] = found["recordings"]
    failed = [name for name, facts in made.items() if "error" in facts]
    if as_json:
        print(json.dumps(found, indent=2))
    else:
        for name, facts in made.items():
            print(f"{name}: {facts['error'] if name in failed else _cells_text(facts)}")
        print(f"{len(made) - len(failed)} of {len(made)} recordings mapped, a folder each in {out}")
        print(f"all of them on one page: {out / 'report.html'}")
    if failed:
        raise InputError(
            f"{len(failed)} of {len(made)} recordings could not be mapped: {', '.join(failed[:5])}; "
            f"the others are in {out}"
        )


def _cells_text(facts: dict[str, Any]) -> str:
    cells = facts["cells"]
    if cells is None:
        return f"{facts['frames']} frames, no poses: a map each"
    counts = ", ".join(f"{cells[name]} {name}" for name in ("grass", "obstacle", "person"))
    return f"{facts['frames']} frames, {counts}"


def report(summary: dict[str, Any], out: Path) -> str:
    """What a person wants to know after a run, in a few lines."""
    from swardmap.runs.told import report_lines

    return "\n".join([*report_lines(summary), f"results in {out}"])
