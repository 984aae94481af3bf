"""One page over many maps: a picture of each, what it holds, and what could not be mapped."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from swardmap.grid import OccupancyGrid
from swardmap.viz.map_layers import image_url
from swardmap.viz.map_page import left_out
from swardmap.viz.maps import SWATCHES, View, bounds_of, draw_classes, draw_scale
from swardmap.viz.templates import render

WIDTH, HEIGHT = 360, 270
MOST_PICTURES = 1000
"""On a page; each takes some kB."""

CLASSES = ("grass", "obstacle", "person")


@dataclass(frozen=True, slots=True)
class MappedRecording:
    """What a page says of one recording.

    Attributes:
        name: of the folder of its map, beside the page.
        summary: what its summary.json holds; empty where it could not be mapped.
        picture: of its map, see `thumbnail`; empty where there is none.
        error: why it could not be mapped.
    """

    name: str
    summary: Mapping[str, Any]
    picture: str = ""
    error: str = ""


def maps_page(recordings: Sequence[MappedRecording], resolution_m: float, settings: str, command: str) -> str:
    """The whole page.

    Args:
        recordings: in the order in which they are told.
        resolution_m: of all maps.
        settings: of all maps, as YAML.
        command: that made them.
    """
    mapped = [r for r in recordings if not r.error]
    drawn = [(r.name, r.picture) for r in mapped if r.picture]
    return render(
        "maps.html",
        title=f"Maps of {len(mapped)} recordings",
        cards=_cards(recordings, mapped, resolution_m**2),
        swatches=[(name, "rgb({}, {}, {})".format(*color)) for name, color in SWATCHES],
        pictures=drawn[:MOST_PICTURES],
        drawn=len(drawn),
        warned=any(r.summary.get("warnings") for r in mapped),
        rows=[_row(r, resolution_m**2) for r in mapped],
        failed=[(r.name, r.error) for r in recordings if r.error],
        settings=settings,
        command=command,
    )


def thumbnail(grid: OccupancyGrid) -> str:
    """A small picture of a map as a data URL: what is known fills it, with a scale."""
    view = View.of(bounds_of(grid), WIDTH, HEIGHT)
    picture = draw_classes(grid, view)
    draw_scale(picture, view)
    return image_url(picture, ".png")


def _cards(
    recordings: Sequence[MappedRecording], mapped: Sequence[MappedRecording], cell_m2: float
) -> list[tuple[str, str, str]]:
    total = {name: sum(_cells(r)[name] for r in mapped) * cell_m2 for name in CLASSES}
    frames = sum(int(r.summary["frames"]) for r in mapped)
    return [
        (f"{len(mapped)} of {len(recordings)}", "recordings mapped", f"{frames:,} frames"),
        *((f"{area_m2:.1f} m²", name, "of all maps") for name, area_m2 in total.items()),
    ]


def _row(recording: MappedRecording, cell_m2: float) -> dict[str, Any]:
    summary, cells = recording.summary, _cells(recording)
    omitted = sum(count for _, count in left_out(summary))
    return {
        "name": recording.name,
        "frames": f"{summary['frames']:,}",
        "left_out": f"{omitted:,}",
        "areas_m2": [f"{cells[name] * cell_m2:.1f}" for name in CLASSES] if summary["map"] else None,
        "warnings": list(summary.get("warnings", [])),
    }


def _cells(recording: MappedRecording) -> Mapping[str, int]:
    found = recording.summary["map"]
    return dict.fromkeys(CLASSES, 0) if found is None else found["cells"]
