"""A whole recording, from source to files: what `swardmap map` does, as one call.

from swardmap import map_recording
run = map_recording("my_recording", out="my_map")
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.config import Config
from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.grid import OccupancyGrid
from swardmap.io import FrameSource, open_source
from swardmap.mapping.costmap import Costmap
from swardmap.mapping.work_area import WorkArea, work_area_in
from swardmap.pipeline import ObstacleMapper, StepResult, configured_mount
from swardmap.runs.ahead import may_run_at_once, network_plan
from swardmap.runs.frame_check import FrameCheck
from swardmap.runs.map_steps import map_steps
from swardmap.runs.summary import RunTotals, summarise
from swardmap.runs.warnings import warnings_of
from swardmap.segmenter import Segmenter

OnStep = Callable[[StepResult], None]


@dataclass(frozen=True, slots=True, eq=False)
class MapRun:
    """What mapping a recording gave.

    Attributes:
        grid: the accumulated map; None if no frame had a pose.
        costmap: its costmap.
        totals: sums over the frames.
        summary: what summary.json holds.
    """

    grid: OccupancyGrid | None
    costmap: Costmap | None
    totals: RunTotals
    summary: dict[str, Any]


def map_recording(
    recording: str | Path | FrameSource,
    out: str | Path | None = None,
    config: Config | None = None,
    segmenter: Segmenter | None = None,
    overwrite: bool = False,
    on_step: OnStep | None = None,
    strict: bool = False,
    notes: Sequence[str] = (),
    ahead: bool = True,
) -> MapRun:
    """Map a recording, and write the results if `out` is given.

    Args:
        recording: a folder or file, or an open source.
        out: folder for the results; it appears complete at the end, or not at all. On Ctrl-C it holds
            what was finished, and KeyboardInterrupt is raised again.
        config: all settings.
        segmenter: in place of the configured one.
        overwrite: replace `out` if swardmap made it.
        on_step: called after each frame, for progress or display.
        strict: stop at the first frame that the node's watchdog would refuse, in place of leaving it out, or
            that is unfamiliar.
        notes: what the caller knows of the settings; stands among the notes of the summary.
        ahead: read and segment frames while earlier ones are mapped, in threads (see `runs.ahead`); the map
            is the same. False for a live camera, whose frames are not there yet.

    Raises:
        InputError: if the recording cannot be read, or holds no frame that can be mapped.
        OutputError: if the results cannot be written.
    """
    config = config or Config()
    if out is None:
        return _mapped(recording, config, segmenter, None, on_step, strict, notes, ahead)
    from swardmap.io.files import refuse_to_replace
    from swardmap.io.folders import new_output_folder

    if isinstance(recording, (str, Path)):
        refuse_to_replace(recording, out)
    interrupted = False
    with new_output_folder(out, overwrite) as folder:
        try:
            run = _mapped(recording, config, segmenter, folder, on_step, strict, notes, ahead)
        except _InterruptedError as stop:
            run, interrupted = stop.run, True
    if interrupted:
        raise KeyboardInterrupt(f"{out} holds the {run.totals.frames} frames that were finished")
    return run


def build_mapper(
    segmenter: Segmenter, config: Config, tell: Callable[[str], None] | None = None
) -> ObstacleMapper:
    """A mapper with all that the configuration names: mount, work area, and the map it goes on from.

    Args:
        segmenter: tells grass from obstacles.
        config: all settings.
        tell: called with one line for what a person should know of them.

    Raises:
        InputError: if one of their files cannot be read.
        MissingExtraError: for a work area without pyproj.
    """
    from swardmap.io.maps.costmap_layers import zone_layers
    from swardmap.io.maps.log_odds_files import read_living_map

    saved = None if config.grid.resume is None else read_living_map(config.grid.resume, config, tell)
    return ObstacleMapper(segmenter, config, configured_mount(config.mount), zone_layers(config), saved)


def _segmenter_for(
    given: Segmenter | None, config: Config, source: FrameSource, ahead: bool
) -> tuple[Segmenter, int | None]:
    """The segmenter of a recording, and how many frames it takes at once; None = nothing runs ahead."""
    from swardmap.models import build_segmenter

    workers, threads = network_plan(config.segmenter)
    if given is None:
        one = replace(config.segmenter, threads=threads) if ahead else config.segmenter
        given = build_segmenter(one, source.label_set)
    if not ahead:
        return given, None
    return given, workers if may_run_at_once(given) else 0


class _InterruptedError(Exception):
    """Ctrl-C after at least one frame; carries what was finished."""

    def __init__(self, run: MapRun) -> None:
        super().__init__("interrupted")
        self.run = run


def _mapped(
    recording: str | Path | FrameSource,
    config: Config,
    segmenter: Segmenter | None,
    folder: Path | None,
    on_step: OnStep | None,
    strict: bool,
    said: Sequence[str],
    ahead: bool,
) -> MapRun:
    source = recording
    if isinstance(source, (str, Path)):
        source = open_source(source, config)
    segmenter, workers = _segmenter_for(segmenter, config, source, ahead)
    writer = None
    if folder is not None:
        from swardmap.runs.files import RunWriter

        writer = RunWriter(folder, config, source.frame_count)
    notes = list(said)
    mapper = build_mapper(segmenter, config, notes.append)
    mount = {"source": "poses of the recording" if mapper.T_base_camera is None else "configured"}
    totals, check = RunTotals(), FrameCheck(config.watchdog, strict)

    def add(step: StepResult) -> None:
        totals.add(step)
        if writer is not None:
            writer.add(step, mapper)
        if on_step is not None:
            on_step(step)

    interrupted = not _ended(map_steps(source, mapper, mount, check, workers), add, totals)
    if totals.frames == 0:
        faults = ", ".join(f"{n} x {fault}" for fault, n in check.faults.items())
        raise InputError(f"{source.name}: no frame can be mapped, all are faulty ({faults})")
    grid, costmap = mapper.map, mapper.costmap()
    summary = summarise(source, segmenter.name, config, totals, check, grid, notes)
    summary |= {"interrupted": interrupted, "warnings": warnings_of(summary)}
    T_base_camera = mapper.T_base_camera
    area = work_area_in(mapper.layers)
    summary["work_area"] = None if area is None else _area_facts(area, grid)
    summary["mount"] = mount | ({} if T_base_camera is None else _mount_facts(T_base_camera))
    if writer is not None:
        writer.finish(grid, costmap, summary, mapper.log_odds)
    run = MapRun(grid, costmap, totals, summary)
    if interrupted:
        raise _InterruptedError(run)
    return run


def _ended(steps: Iterator[StepResult], add: OnStep, totals: RunTotals) -> bool:
    """Take every step; whether they came to their end, or Ctrl-C to some."""
    try:
        for step in steps:
            add(step)
    except KeyboardInterrupt:
        if totals.frames == 0:
            raise
        return False
    return True


def _area_facts(area: WorkArea, grid: OccupancyGrid | None) -> dict[str, Any]:
    kept_out = None if grid is None else int(area.keep_out(grid.spec).sum())
    return {
        "polygons": [{"role": str(p.role), "name": p.name} for p in area.polygons],
        "left_out": area.ignored,
        "boundary_m2": round(area.area_m2, 2),
        "kept_out_cells": kept_out,
    }


def _mount_facts(T_base_camera: Pose) -> dict[str, float]:
    forward = T_base_camera.matrix[:3, 2]
    return {
        "height_m": round(float(T_base_camera.position_m[2]), 4),
        "pitch_deg": round(float(np.rad2deg(np.arcsin(np.clip(-forward[2], -1, 1)))), 3),
    }
