"""What a run of `swardmap map` counts, and what it says at its end to a person and in summary.json."""

from array import array
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from swardmap.config import Config, config_to_dict
from swardmap.grid import OccupancyGrid
from swardmap.io import FrameSource
from swardmap.kernels.compiled import machine_code_count
from swardmap.labels import MapClass
from swardmap.monitor.diagnostics import MAPPED, Fault
from swardmap.perception.observation import PixelCounts
from swardmap.pipeline import StepResult
from swardmap.runs.frame_check import FrameCheck, doubt_warnings
from swardmap.runs.versions import versions

LOST_PIXELS = (
    ("no_reading", "without a reading"),
    ("out_of_range", "out of range (cloud.max_range_m)"),
    ("inconsistent", "removed by the filter (cloud.consistent_neighbours)"),
    ("void", "where the mask says nothing"),
    ("out_of_height", "out of height (cloud.max_height_m)"),
    ("outside_grid", "beside the grid"),
)
LIMITS = (
    ("out_of_height", "cloud.max_height_m"),
    ("out_of_range", "cloud.max_range_m"),
    ("inconsistent", "cloud.consistent_neighbours"),
)
"""Limits that should not take most of the readings, and their settings."""
MOST = 0.5
"""Share of readings from which on a loss is a warning."""
BODY_FRAMES = ("base", "body", "camera_link", "chassis", "robot")


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


def warnings_of(summary: Mapping[str, Any]) -> list[str]:
    """One line for each thing that makes a map poor without being an error."""
    found = pixel_warnings(summary["pixels"])
    found += _thinned(summary["config"])
    found += flat_warnings(summary["config"])
    refused = summary["watchdog"]["refused"]
    if refused > MOST * (refused + summary["frames"]):
        found.append(
            f"{refused} frames were refused as the node would ({_refused(summary['watchdog'])}): check the "
            "recording; a simulator without noise needs --set watchdog.frozen_s=null"
        )
    strange = summary["watchdog"]["faults"].get(Fault.UNFAMILIAR, 0)
    if strange > MOST * summary["frames"]:
        found.append(
            f"{strange} of {summary['frames']} frames are unfamiliar to the network and cleared nothing: "
            "look at the lens and the light; another kind of lawn it can be taught (docs/models.md)"
        )
    found += doubt_warnings(summary["watchdog"])
    without = summary["ground"]["frames_without"]
    if without > MOST * summary["frames"]:
        found.append(
            f"{without} of {summary['frames']} frames show no ground and cleared nothing: check the pose "
            "of the camera, or point it lower"
        )
    grid = summary["map"]
    posed = summary["frames"] > summary["frames_without_pose"]
    if posed and (grid is None or grid["cells"]["grass"] == 0):
        found.append("no lawn was seen: check the segmenter, and the pose of the camera over the ground")
    frame = _camera_frame(summary["source"])
    meant = (
        summary["config"]["source"]["camera_axes"] != "auto"
    )  # who says which axes it has was asked before
    if not meant and any(word in frame.lower() for word in BODY_FRAMES) and "optical" not in frame.lower():
        found.append(
            f"the images are of frame '{frame}', which looks like a body frame: z of a camera looks forward; "
            "name the optical frame with source.camera_frame"
        )
    if "flipped" in summary["watchdog"]["faults"]:
        found.append("images fit the ground only upside down: turn the camera, or correct its pose")
    return found


def flat_warnings(config: Mapping[str, Any]) -> list[str]:
    """That nothing but the network tells lawn from what stands on it.

    Args:
        config: all settings, as plain data.
    """
    if config["geometry"]["enabled"]:
        return []
    high_m = config["cloud"]["max_height_m"]
    text = (
        "geometry.enabled is false: what the network calls grass is free however high it stands, "
        f"up to {high_m:g} m (cloud.max_height_m)"
    )
    return [text]


def _thinned(config: Mapping[str, Any]) -> list[str]:
    """That a voxel grid leaves too few points in a cell to clear it."""
    cloud, grid = config["cloud"], config["grid"]
    voxel_m, edge_m, needed = cloud["voxel_m"], grid["resolution_m"], grid["min_grass_points"]
    cells = 9 if grid["clear_together"] else 1
    if not voxel_m or cells * (edge_m / voxel_m) ** 2 >= needed:
        return []
    left, enough_m = max(1, round((edge_m / voxel_m) ** 2)), edge_m * (cells / needed) ** 0.5
    text = (
        f"cloud.voxel_m of {voxel_m:g} m leaves about {left} of the points of a cell, and {needed} of lawn "
        f"are needed to clear it: make it {enough_m:.2g} m or less, or lower grid.min_grass_points"
    )
    return [text]


def pixel_warnings(pixels: Mapping[str, int]) -> list[str]:
    """One line for each limit that most of the readings lie beyond.

    Args:
        pixels: what became of them, by the names of `PixelCounts`; empty = none.
    """
    found: list[str] = []
    readings = pixels.get("pixels", 0) - pixels.get("no_reading", 0)
    for name, setting in LIMITS:
        if readings and pixels[name] > MOST * readings:
            found.append(
                f"{100 * pixels[name] / readings:.0f} % of the readings are {name.replace('_', ' ')}: check "
                f"{setting}, the depth unit, and the pose of the camera"
            )
    return found


def _camera_frame(source: Mapping[str, Any]) -> str:
    """The frame that the images are taken to be of, where the source says how it found their poses."""
    poses = source.get("poses")
    return str(poses.get("frames", "")).split(" <- ")[-1] if isinstance(poses, dict) else ""


def report_lines(summary: Mapping[str, Any]) -> list[str]:
    """What a person wants to know after a run, line by line."""
    lines = [f"{summary['frames']} frames mapped with '{summary['segmenter']}'"]
    lines += _watched(summary["watchdog"])
    lines += seen_lines(summary)
    grid, ground = summary["map"], summary["ground"]
    if ground["frames_without"] or ground["frames_carried_over"]:
        lines.append(
            f"no ground of their own: {ground['frames_carried_over']} frames judged by an earlier one's, "
            f"{ground['frames_without']} by none, which cleared nothing"
        )
    if grid is None:
        alone = summary["frames"] == summary["frames_without_pose"]
        lines.append(
            "no poses: each frame has a map of its own in maps/" if alone else "nothing was seen: no map"
        )
    else:
        cells: dict[str, int] = grid["cells"]
        width, height = grid["size_cells"]
        lines.append(
            f"map {width} x {height} cells of {grid['resolution_m']:g} m: {cells['grass']} grass, "
            f"{cells['obstacle']} obstacle, {cells['person']} person, {cells['unknown']} unknown"
        )
    margin = summary["margin_m"]
    given = "" if summary["margin_measured"] else ", the default: none was measured (swardmap evaluate)"
    lines.append(f"margin in use: {margin:g} m{given}")
    stages = ", ".join(f"{stage} {t['p50']:.1f}" for stage, t in summary["timings_ms"].items())
    lines.append(f"median milliseconds a frame: {stages}")
    lines += [f"note: {note}" for note in summary["notes"]]
    lines += [f"warning: {warning}" for warning in summary["warnings"]]
    return lines


def seen_lines(summary: Mapping[str, Any]) -> list[str]:
    """What came in: what was left out, poses, pairing, and where the pixels went if they are lost.

    Args:
        summary: `skipped`, `source` and `pixels` of a run, offline or in the node.
    """
    source = summary["source"]
    firsts = {reason: of["first"] for reason, of in source.get("left_out", {}).items() if "first" in of}
    return [
        *left_out_lines(summary["skipped"], firsts),
        *pose_lines(source.get("poses")),
        *pairing_lines(source.get("pairing")),
        *pixel_lines(summary["pixels"]),
    ]


def left_out_lines(skipped: Mapping[str, int], firsts: Mapping[str, str]) -> list[str]:
    """What did not reach the map, by reason, and the first of each reason in full where it is known."""
    counts = {reason: n for reason, n in skipped.items() if n}
    if not counts:
        return []
    told = [f"  {reason}, the first: {firsts[reason]}" for reason in counts if reason in firsts]
    return ["left out: " + ", ".join(f"{n} x {reason}" for reason, n in counts.items()), *told]


def pose_lines(poses: Any) -> list[str]:
    """How the poses were found: frames, topics and the largest gap; nothing if the source does not say."""
    if not isinstance(poses, dict):
        return []
    found = f"poses: {poses.get('from', 'of the recording')} {poses.get('frames', '')}".rstrip()
    if poses.get("topics"):
        found += f", of {', '.join(poses['topics'])}"
    if gaps := poses.get("largest_gap_ms"):
        edge = max(gaps, key=gaps.__getitem__)
        found += f", gaps of {gaps[edge]:g} ms at most ({edge}; {poses['tolerance_ms']:g} allowed)"
    return [found]


def pairing_lines(pairing: Any) -> list[str]:
    """How far the images of a pair are apart in time; nothing if there are none."""
    if not isinstance(pairing, dict) or not pairing.get("pairs"):
        return []
    apart = f"{pairing['median_ms']:g} ms apart (median), {pairing['worst_ms']:g} at most"
    return [f"colour and depth are {apart}"]


def _watched(watchdog: Mapping[str, Any]) -> list[str]:
    """What the watchdog left out and doubted: how often, and the first of each kind."""
    lines = []
    if watchdog["refused"]:
        first = _firsts({k: v for k, v in watchdog["first"].items() if k not in MAPPED})
        lines.append(f"not mapped, as the node would not: {_refused(watchdog)} (first: {first})")
    strange = watchdog["faults"].get(Fault.UNFAMILIAR, 0)
    if strange:
        lines.append(
            f"unfamiliar to the network: {strange} frames cleared nothing "
            f"(first: {watchdog['first'][Fault.UNFAMILIAR]})"
        )
    return lines


def _firsts(first: Mapping[str, str]) -> str:
    return ", ".join(dict.fromkeys(first.values()))


def _refused(watchdog: Mapping[str, Any]) -> str:
    """How many frames were not mapped, by fault."""
    return ", ".join(f"{n} x {fault}" for fault, n in watchdog["faults"].items() if fault not in MAPPED)


def pixel_lines(pixels: Mapping[str, int]) -> list[str]:
    """Where the pixels went, if most of them are not in the map."""
    total = pixels.get("pixels", 0)
    if not total or pixels["used"] >= MOST * total:
        return []
    lost = [(pixels[name], text) for name, text in LOST_PIXELS if pixels[name] >= 0.01 * total]
    shares = ", ".join(f"{100 * count / total:.0f} % {text}" for count, text in sorted(lost, reverse=True))
    return [f"{100 * pixels['used'] / total:.0f} % of the pixels are in the map; {shares}"]
