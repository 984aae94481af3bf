"""What a run of `swardmap map` counts, and what summary.json holds of it."""

from array import array
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from swardmap.config import Config, config_to_dict
from swardmap.grid import OccupancyGrid
from swardmap.io import FrameSource
from swardmap.kernels.compiled import machine_code_count
from swardmap.labels import MapClass
from swardmap.perception.observation import PixelCounts
from swardmap.pipeline import StepResult
from swardmap.runs.frame_check import FrameCheck
from swardmap.runs.versions import versions


@dataclass(slots=True)
class RunTotals:
    """Sums over the frames of a run, small enough to keep for hours of driving.

    Attributes:
        frames: that were mapped.
        pixels: what became of theirs.
        timings_ms: of each stage and frame, but for those that waited for a kernel's machine code.
        compiling_ms: of those that did: what a machine does once, and no measure of its speed.
        without_pose: frames that were mapped each on its own.
        without_ground: frames of which no ground is known; nothing was cleared by them.
        ground_carried: frames that show no ground and were judged by that of an earlier one.
        evidence: cells by what marked them.
    """

    frames: int = 0
    pixels: PixelCounts | None = None
    timings_ms: dict[str, "array[float]"] = field(default_factory=dict)
    compiling_ms: dict[str, "array[float]"] = field(default_factory=dict)
    machine_code: int = field(default_factory=machine_code_count)
    without_pose: int = 0
    without_ground: int = 0
    ground_carried: int = 0
    evidence: dict[str, int] = field(default_factory=dict)

    def add(self, step: StepResult) -> None:
        """Count one frame."""
        self.frames += 1
        self.pixels = step.counts if self.pixels is None else self.pixels + step.counts
        self.without_pose += step.frame.T_map_camera is None
        ground = step.observation.ground
        self.without_ground += ground is None
        self.ground_carried += ground is not None and ground.carried
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


def summarise(
    source: FrameSource,
    segmenter_name: str,
    config: Config,
    totals: RunTotals,
    check: FrameCheck,
    grid: OccupancyGrid | None,
    notes: list[str],
) -> dict[str, Any]:
    """What summary.json holds of the frames, the map and the settings."""
    facts = dict(getattr(source, "facts", {}))
    return {
        "source": {"name": source.name, "frame_count": source.frame_count, **facts},
        "frames": totals.frames,
        "frames_without_pose": totals.without_pose,
        "skipped": dict(source.skipped),
        "watchdog": {
            "refused": check.refused,
            "faults": check.faults,
            "first": check.first,
            "doubts": check.doubts,
        },
        "segmenter": segmenter_name,
        "pixels": asdict(totals.pixels) if totals.pixels else {},
        "evidence_cells": totals.evidence or None,
        "map": None if grid is None else map_facts(grid),
        "margin_m": config.costmap.obstacle_margin_m,
        "margin_measured": config.costmap.margin_m is not None,
        "ground": {"frames_carried_over": totals.ground_carried, "frames_without": totals.without_ground},
        "notes": [*notes, *getattr(source, "notes", [])],
        "timings_ms": totals.timing_summary(),
        "versions": versions(),
        "config": config_to_dict(config),
    }


def map_facts(grid: OccupancyGrid) -> dict[str, Any]:
    """Where a map lies, and how many cells of each class it has."""
    area_m2 = grid.spec.resolution_m**2
    return {
        "frame": grid.spec.frame_id,
        "resolution_m": grid.spec.resolution_m,
        "size_cells": [grid.spec.width, grid.spec.height],
        "origin_m": list(grid.spec.origin_m),
        "cells": {c.name.lower(): grid.count(c) for c in MapClass},
        "seen_m2": round(area_m2 * int(np.count_nonzero(grid.classes)), 3),
    }
