"""A whole recording, from source to files: what `swardmap map` does, as one call.

from swardmap import map_recording
run = map_recording("my_recording", out="my_map")
"""

from array import array
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.config import Config, config_to_dict
from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.grid import OccupancyGrid
from swardmap.io import FrameSource, open_source
from swardmap.kernels.compiled import machine_code_count
from swardmap.labels import MapClass
from swardmap.mapping.costmap import Costmap
from swardmap.mapping.work_area import WorkArea
from swardmap.perception.observation import PixelCounts
from swardmap.pipeline import ObstacleMapper, StepResult, configured_mount
from swardmap.runs.versions import versions
from swardmap.segmenter import Segmenter
from swardmap.types import Frame

OnStep = Callable[[StepResult], None]


@dataclass(slots=True)
class RunTotals:
    """Sums over the frames of a run, small enough to keep for hours of driving.

    Attributes:
        frames: that were mapped.
        pixels: what became of theirs.
        timings_ms: of each stage and frame, but for those that waited for a kernel's machine code.
        compiling_ms: of those that did: what a machine does once, and no measure of its speed.
        without_pose: frames that were mapped each on its own.
        evidence: cells by what marked them.
    """

    frames: int = 0
    pixels: PixelCounts | None = None
    timings_ms: dict[str, "array[float]"] = field(default_factory=dict)
    compiling_ms: dict[str, "array[float]"] = field(default_factory=dict)
    machine_code: int = field(default_factory=machine_code_count)
    without_pose: int = 0
    evidence: dict[str, int] = field(default_factory=dict)

    def add(self, step: StepResult) -> None:
        """Count one frame."""
        self.frames += 1
        self.pixels = step.counts if self.pixels is None else self.pixels + step.counts
        self.without_pose += step.frame.T_map_camera is None
        for name, cells in evidence_cells(step).items():
            self.evidence[name] = self.evidence.get(name, 0) + cells
        before, self.machine_code = self.machine_code, machine_code_count()
        timings_ms = self.timings_ms if self.machine_code == before else self.compiling_ms
        for stage, milliseconds in step.timings_ms.items():
            timings_ms.setdefault(stage, array("f")).append(milliseconds)

    def timing_summary(self) -> dict[str, dict[str, float]]:
        """Mean, median and 99th percentile of each stage, ms; compiling counts where all frames did."""
        return {
            stage: {
                "mean": round(float(np.mean(values)), 3),
                "p50": round(float(np.percentile(values, 50)), 3),
                "p99": round(float(np.percentile(values, 99)), 3),
            }
            for stage, values in (self.timings_ms or self.compiling_ms).items()
        }


def evidence_cells(step: StepResult) -> dict[str, int]:
    """Cells of one frame by what marked them; empty if geometry is switched off."""
    seen, geometry = step.observation, step.observation.geometry
    if geometry is None:
        return {}
    named, marked = seen.semantic >= MapClass.OBSTACLE, geometry.marks
    return {
        "semantic": int(named.sum()),
        "geometric": int(marked.sum()),
        "holes": int(geometry.holes.sum()),
        "both": int((named & marked).sum()),
        "geometric_over_grass": int((marked & (seen.semantic == MapClass.GRASS)).sum()),
        "fused": int((seen.classes >= MapClass.OBSTACLE).sum()),
    }


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

    Raises:
        InputError: if the recording cannot be read, or holds no frame.
        OutputError: if the results cannot be written.
    """
    config = config or Config()
    if out is None:
        return _mapped(recording, config, segmenter, None, on_step)
    from swardmap.io.files import refuse_to_replace
    from swardmap.io.folders import new_output_folder

    if isinstance(recording, (str, Path)):
        refuse_to_replace(recording, out)
    interrupted = False
    with new_output_folder(out, overwrite) as folder:
        try:
            run = _mapped(recording, config, segmenter, folder, on_step)
        except _InterruptedError as stop:
            run, interrupted = stop.run, True
    if interrupted:
        raise KeyboardInterrupt(f"{out} holds the {run.totals.frames} frames that were finished")
    return run


def build_mapper(segmenter: Segmenter, config: Config) -> ObstacleMapper:
    """A mapper with all that the configuration names: mount, work area, and the map it goes on from.

    Raises:
        InputError: if one of their files cannot be read.
        MissingExtraError: for a work area without pyproj.
    """
    from swardmap.io.maps.area_files import read_area
    from swardmap.io.maps.log_odds_files import read_living_map

    saved = None if config.grid.resume is None else read_living_map(config.grid.resume, config)
    return ObstacleMapper(segmenter, config, configured_mount(config.mount), read_area(config.area), saved)


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
) -> MapRun:
    from swardmap.models import build_segmenter

    source = recording
    if isinstance(source, (str, Path)):
        source = open_source(source, config)
    segmenter = segmenter or build_segmenter(config.segmenter, source.label_set)
    writer = None
    if folder is not None:
        from swardmap.runs.files import RunWriter

        writer = RunWriter(folder, config, source.frame_count)
    mapper = build_mapper(segmenter, config)
    mount = {"source": "poses of the recording" if mapper.T_base_camera is None else "configured"}
    totals, interrupted = RunTotals(), False
    try:
        for step in map_steps(source, mapper, mount):
            totals.add(step)
            if writer is not None:
                writer.add(step, mapper)
            if on_step is not None:
                on_step(step)
    except KeyboardInterrupt:
        interrupted = True
        if totals.frames == 0:
            raise
    grid, costmap = mapper.map, mapper.costmap()
    summary = _summary(source, segmenter, config, totals, grid, interrupted)
    T_base_camera = mapper.T_base_camera
    summary["work_area"] = None if mapper.area is None else _area_facts(mapper.area, grid)
    summary["mount"] = mount | ({} if T_base_camera is None else _mount_facts(T_base_camera))
    if writer is not None:
        writer.finish(grid, costmap, summary, mapper.log_odds)
    run = MapRun(grid, costmap, totals, summary)
    if interrupted:
        raise _InterruptedError(run)
    return run


def map_steps(
    source: FrameSource, mapper: ObstacleMapper, mount: dict[str, str] | None = None
) -> Iterator[StepResult]:
    """Map the frames of a source one by one, as `map_recording` does.

    Args:
        source: open, in order of time.
        mapper: gets the mount measured from the first frame without a pose, where none is configured.
        mount: takes under `source` where the mount came from.

    Raises:
        InputError: if there is no frame, or frames with poses are of more than one scene.
    """
    frames = iter(source)
    first = next(frames, None)
    if first is None:
        raise InputError(f"{source.name} holds no frame that can be mapped{_reasons(source)}")
    mount = {} if mount is None else mount
    return mapper.run(_mounted(_chain(first, frames), mapper, mount))


def _chain(first: Frame, rest: Iterator[Frame]) -> Iterator[Frame]:
    """All frames, as long as they are of one world: poses of two scenes do not go into one map."""
    yield first
    scene = first.tags.get("scene")
    for frame in rest:
        if frame.T_map_camera is not None and frame.tags.get("scene") != scene:
            raise InputError(
                f"frame {frame.name} is of scene '{frame.tags.get('scene')}', the map of scene '{scene}': "
                "each scene has a world of its own; map them one by one"
            )
        yield frame


def _mounted(frames: Iterator[Frame], mapper: ObstacleMapper, mount: dict[str, str]) -> Iterator[Frame]:
    """The frames; at the first without a pose, the ground it sees gives the mount that is not configured."""
    for frame in frames:
        if frame.T_map_camera is None and mapper.T_base_camera is None:
            from swardmap.perception.ground_plane import estimate_mount

            # not by its true labels: an evaluation must not profit from them
            mapper.mounted(estimate_mount(replace(frame, labels=None)))
            mount["source"] = f"measured from the ground in frame {frame.name}, the first without a pose"
        yield frame


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


def _reasons(source: FrameSource) -> str:
    left_out = ", ".join(f"{n} x {reason}" for reason, n in source.skipped.items() if n)
    return f" (left out: {left_out})" if left_out else ""


def _summary(
    source: FrameSource,
    segmenter: Segmenter,
    config: Config,
    totals: RunTotals,
    grid: OccupancyGrid | None,
    interrupted: bool,
) -> dict[str, Any]:
    return {
        "source": {"name": source.name, "frame_count": source.frame_count},
        "frames": totals.frames,
        "frames_without_pose": totals.without_pose,
        "skipped": dict(source.skipped),
        "interrupted": interrupted,
        "segmenter": segmenter.name,
        "pixels": asdict(totals.pixels) if totals.pixels else {},
        "evidence_cells": totals.evidence or None,
        "map": None if grid is None else _map_facts(grid),
        "timings_ms": totals.timing_summary(),
        "versions": versions(),
        "config": config_to_dict(config),
    }


def _map_facts(grid: OccupancyGrid) -> dict[str, Any]:
    area_m2 = grid.spec.resolution_m**2
    return {
        "frame": grid.spec.frame_id,
        "resolution_m": grid.spec.resolution_m,
        "size_cells": [grid.spec.width, grid.spec.height],
        "origin_m": list(grid.spec.origin_m),
        "cells": {c.name.lower(): grid.count(c) for c in MapClass},
        "seen_m2": round(area_m2 * int(np.count_nonzero(grid.classes)), 3),
    }
