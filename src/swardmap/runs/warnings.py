"""What makes the map of a run poor without being an error: a line each, offline and in the node."""

from collections.abc import Mapping
from typing import Any

from swardmap.monitor.diagnostics import MAPPED, Fault
from swardmap.runs.frame_check import doubt_warnings

LIMITS = (
    ("out_of_height", "cloud.max_height_m"),
    ("out_of_range", "cloud.max_range_m"),
    ("inconsistent", "cloud.consistent_neighbours"),
)
"""Limits that should not take most of the readings, and their settings."""
MOST = 0.5
"""Share of readings from which on a loss is a warning."""
BODY_FRAMES = ("base", "body", "camera_link", "chassis", "robot")


def warnings_of(summary: Mapping[str, Any]) -> list[str]:
    """One line for each thing that makes a map poor without being an error."""
    found = pixel_warnings(summary["pixels"])
    found += _thinned(summary["config"])
    found += flat_warnings(summary["config"])
    refused = summary["watchdog"]["refused"]
    if refused > MOST * (refused + summary["frames"]):
        found.append(
            f"{refused} frames were refused as the node would ({refused_by_fault(summary['watchdog'])}): "
            "check the recording; a simulator without noise needs --set watchdog.frozen_s=null"
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


def refused_by_fault(watchdog: Mapping[str, Any]) -> str:
    """How many frames were not mapped, by fault."""
    return ", ".join(f"{n} x {fault}" for fault, n in watchdog["faults"].items() if fault not in MAPPED)
