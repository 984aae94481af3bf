"""A page for a map: one HTML file that works from a disk, offline, on a phone and in print."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from swardmap.grid import OccupancyGrid
from swardmap.labels import MapClass
from swardmap.mapping.costmap import Costmap
from swardmap.viz.map_album import Album, AlbumFrame
from swardmap.viz.map_layers import bounded_layers
from swardmap.viz.maps import bounds_of
from swardmap.viz.templates import render

Summary = Mapping[str, Any]
MOST_BYTES = 20_000_000
"""Of a page: at most 6 MB of layers, 12 MB of frames, and what is left is small."""

MOST_FRAME_BYTES = 12_000_000
"""Where frames would take more, every second one is left out until they do not."""


def map_page(
    grid: OccupancyGrid | None,
    costmap: Costmap | None,
    album: Album,
    summary: Summary,
    settings: str,
    command: str | None = None,
) -> str:
    """The whole page.

    Args:
        grid: the accumulated map; None where no frame had a pose.
        costmap: its costs, or None.
        album: frames and way of the run.
        summary: what summary.json holds.
        settings: all of them, as YAML.
        command: that made the map; None where it was made from Python.
    """
    frames = album.frames
    while sum(map(_size, frames)) > MOST_FRAME_BYTES and frames[1:]:
        frames = frames[::2]
    return render(
        "map.html",
        title=title(summary),
        subtitle=subtitle(summary, grid),
        map=None if grid is None else map_view(grid, costmap, album),
        frames=[asdict(f) for f in frames],
        frames_total=summary["frames"],
        cards=cards(summary, grid),
        left_out=left_out(summary),
        pixels=pixel_rows(summary),
        timings=timing_rows(summary),
        settings=settings,
        command=command or "made from Python",
        versions=summary.get("versions", {}),
    )


def title(summary: Summary) -> str:
    """What was mapped."""
    name = str(summary.get("source", {}).get("name", "")) or "this drive"
    return f"Map of {name}"


def subtitle(summary: Summary, grid: OccupancyGrid | None) -> str:
    """How much, with what."""
    parts = [f"{_count(summary['frames'])} frames"]
    if summary.get("segmenter"):
        parts.append(f"segmenter {summary['segmenter']}")
    if grid is not None:
        parts.append(f"cells of {grid.spec.resolution_m:g} m, frame '{grid.spec.frame_id}'")
    if summary.get("interrupted"):
        parts.append("interrupted: the rest of the recording is not in it")
    return ", ".join(parts)


def map_view(grid: OccupancyGrid, costmap: Costmap | None, album: Album) -> dict[str, Any]:
    """What the page draws. SVG's y points down: it is the map's with its sign changed."""
    x_min, _, y_min, _ = grid.spec.extent_m
    layers, step = bounded_layers(grid, costmap)
    edge = grid.spec.resolution_m * step
    low_x, high_x, low_y, high_y = bounds_of(grid, *album.way_m)
    rows, columns = (-(-n // step) for n in grid.spec.shape)
    return {
        "layers": layers,
        # whole blocks: those at the far rims may reach beyond the last cell
        "image": {"x": x_min, "y": -(y_min + rows * edge), "width": columns * edge, "height": rows * edge},
        "view": {"x": low_x, "y": -high_y, "width": high_x - low_x, "height": high_y - low_y},
        "way": " ".join(f"{x:.2f},{-y:.2f}" for x, y in album.way_m),
        "ties": "",
        "things": [],
        "joined": step,
        "resolution_m": grid.spec.resolution_m,
    }


def cards(summary: Summary, grid: OccupancyGrid | None) -> list[tuple[str, str, str]]:
    """Figure, what it is, and more about it."""
    if grid is None:
        return [(str(_count(summary["frames"])), "frames mapped each on its own", "no poses: see maps/")]
    cell_m2 = grid.spec.resolution_m**2
    counts = {c: grid.count(c) for c in MapClass}
    seen = sum(n for c, n in counts.items() if c is not MapClass.UNKNOWN)
    return [
        (f"{seen * cell_m2:.1f} m²", "seen", f"{seen:,} cells"),
        (f"{counts[MapClass.GRASS] * cell_m2:.1f} m²", "grass", f"{counts[MapClass.GRASS]:,} cells"),
        (f"{counts[MapClass.OBSTACLE] * cell_m2:.2f} m²", "obstacle", f"{counts[MapClass.OBSTACLE]:,} cells"),
        (f"{counts[MapClass.PERSON] * cell_m2:.2f} m²", "person", f"{counts[MapClass.PERSON]:,} cells"),
    ]


def left_out(summary: Summary) -> list[tuple[str, int]]:
    """Reason and number of the frames that are not in the map."""
    found = {str(k): int(n) for k, n in (summary.get("skipped") or {}).items() if n}
    without = summary.get("frames_without_pose", 0)
    if without:
        found["no pose: mapped on its own, not in this map"] = int(without)
    return sorted(found.items(), key=lambda item: -item[1])


def pixel_rows(summary: Summary) -> list[tuple[str, int, float]]:
    """What became of the pixels: name, count, share of all."""
    pixels = {k.replace("_", " "): int(n) for k, n in (summary.get("pixels") or {}).items()}
    total = pixels.pop("pixels", 0)
    return [(name, n, n / total) for name, n in pixels.items()] if total else []


def timing_rows(summary: Summary) -> list[tuple[str, str, str, str]]:
    """Milliseconds of each stage: median, mean, 99th percentile."""
    timings: Mapping[str, Mapping[str, float]] = summary.get("timings_ms") or {}
    return [(stage, *(f"{t[key]:.1f}" for key in ("p50", "mean", "p99"))) for stage, t in timings.items()]  # type: ignore[misc]


def _size(frame: AlbumFrame) -> int:
    return len(frame.photo) + len(frame.mask) + len(frame.depth) + len(frame.map)


def _count(frames: Any) -> int:
    """Frames of a run, or of each camera of a node."""
    return sum(frames.values()) if isinstance(frames, Mapping) else int(frames)
