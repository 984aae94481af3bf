"""Frames of a report: photo with both masks, and a map to move and zoom, truth and prediction its layers."""

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.eval.look_again import FrameAgain
from swardmap.eval.maps import MapComparison, tied_cells
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import LabelSet, MapClass
from swardmap.viz.map_layers import Layer, image_url
from swardmap.viz.maps import COLOR_OF_CLASS, MARGIN_COLOR, bounds_of

PHOTO_WIDTH = 480
MOST_BYTES = 8_000_000
"""Of all frames of a report together; those with least at stake are left out."""
MISS_COLOR = (214, 51, 58)
LAYERS = (
    ("truth", "true map", "", False),
    ("predicted", "predicted map", "", True),
    ("margin", "margin in use", "#d6423c", False),
    ("missed", "obstacle cells called free", "#d6333a", True),
    ("ties", "missed cells tied to the nearest found cell", "", True),
    ("things", "things of the list (rings)", "", True),
    ("true-mask", "true mask on the photo", "", False),
    ("predicted-mask", "predicted mask on the photo", "", True),
    ("axes", "axes, metres", "", True),
)
"""What can be switched on every frame: name, title, colour of its key or none, whether it shows at first."""


def frame_views(again: Sequence[tuple[int, FrameAgain]], margin_m: float) -> list[dict[str, Any]]:
    """Frames for the template, as many of the first as MOST_BYTES holds.

    Args:
        again: index and frame, the worst first.
        margin_m: that marks are grown by.
    """
    views: list[dict[str, Any]] = []
    size = 0
    for index, seen in again:
        view = frame_view(index, seen, margin_m)
        size += _size(view)
        if size > MOST_BYTES and views:
            break
        views.append(view)
    return views


def frame_view(index: int, seen: FrameAgain, margin_m: float) -> dict[str, Any]:
    """One frame for its template."""
    frame, found = seen.frame, seen.comparison
    size = (PHOTO_WIDTH, max(1, round(frame.rgb.shape[0] * PHOTO_WIDTH / frame.rgb.shape[1])))
    photo: NDArray[np.uint8] = cv2.resize(frame.rgb, size, interpolation=cv2.INTER_AREA)
    assert frame.labels is not None  # noqa: S101 - an evaluated frame has them
    assert frame.label_set is not None  # noqa: S101
    predicted = seen.segmentation
    return {
        "id": f"frame-{index}",
        "name": seen.name,
        "tags": ", ".join(f"{k} {v}" for k, v in sorted(frame.tags.items())),
        "facts": "; ".join(facts(found)),
        "size": size,
        "photo": image_url(photo, ".jpg", 82),
        "true_mask": _mask(frame.labels, frame.label_set, size),
        "predicted_mask": _mask(predicted.labels, predicted.label_set, size),
        "map": map_of(found, seen, margin_m),
    }


def facts(found: MapComparison) -> list[str]:
    """What went wrong in one map, in words."""
    tally, summary = found.tally, found.tally.distances().summary()
    called = tally.matrix.obstacle_called_free
    parts = [f"{called.count} of {called.of} obstacle cells called free"]
    if summary.mean_m is not None and summary.max_m is not None:
        parts.append(f"d_min-obst mean {summary.mean_m:.2f} m, largest {summary.max_m:.2f} m")
    if tally.frames_without_hit:
        parts.append("no obstacle cell was found at all: no d_min-obst")
    if tally.missed_called_free:
        parts.append(f"{tally.missed_called_free} whole obstacles called free")
    return parts


def map_of(found: MapComparison, seen: FrameAgain, margin_m: float) -> dict[str, Any]:
    """Both maps of a frame for the map box; SVG's y points down: it is the map's with its sign changed."""
    rows, columns = _known_window(found)
    reference, predicted = found.reference.classes[rows, columns], found.predicted.classes[rows, columns]
    spec = _part(found.reference.spec, rows, columns)
    x_min, x_max, y_min, y_max = spec.extent_m
    marks = found.predicted.classes >= MapClass.OBSTACLE
    grown = _grown(marks, margin_m / spec.resolution_m)[rows, columns] & (predicted < MapClass.OBSTACLE)
    missed = (reference >= MapClass.OBSTACLE) & (predicted == MapClass.GRASS)
    pictures = {
        "predicted": _classes(predicted),
        "truth": _classes(reference),
        "margin": _colored(grown, MARGIN_COLOR, 150),
        "missed": _colored(missed, MISS_COLOR, 255),
    }
    shown = {name: first for name, _, _, first in LAYERS}
    window = OccupancyGrid(spec, np.maximum(reference, predicted))
    low_x, high_x, low_y, high_y = bounds_of(window, seen.T_map_camera.position_m[:2])
    return {
        "layers": [
            Layer(name, name, "", image_url(np.flipud(picture), ".png"), shown[name])
            for name, picture in pictures.items()
        ],
        "image": {"x": x_min, "y": -y_max, "width": x_max - x_min, "height": y_max - y_min},
        "view": {"x": low_x, "y": -high_y, "width": high_x - low_x, "height": high_y - low_y},
        "way": "",
        "ties": _ties(found),
        "things": [
            {"xy_m": thing.xy_m, "title": thing.title} for thing in seen.things
            if thing.missed or thing.free_cells
        ],
    }  # fmt: skip


def _known_window(found: MapComparison) -> tuple[slice, slice]:
    """Rows and columns that either map knows something of, with a little room."""
    known = (found.reference.classes != MapClass.UNKNOWN) | (found.predicted.classes != MapClass.UNKNOWN)
    spans = []
    for axis, size in ((1, known.shape[0]), (0, known.shape[1])):
        places = np.flatnonzero(known.any(axis=axis))
        low, high = (0, size) if len(places) == 0 else (int(places[0]), int(places[-1]) + 1)
        spans.append(slice(max(0, low - 2), min(size, high + 2)))
    return spans[0], spans[1]


def _part(spec: GridSpec, rows: slice, columns: slice) -> GridSpec:
    x, y = spec.origin_m
    r = spec.resolution_m
    corner = (x + columns.start * r, y + rows.start * r)
    return GridSpec(r, columns.stop - columns.start, rows.stop - rows.start, corner, spec.frame_id)


def _grown(marks: NDArray[np.bool_], radius_cells: float) -> NDArray[np.bool_]:
    """Cells whose centre is within a distance of a mark's."""
    from swardmap.eval.cost import squared_distance

    near: NDArray[np.bool_] = squared_distance(marks) <= radius_cells**2 + 1e-9
    return near


def _ties(found: MapComparison) -> str:
    """Missed cells with the found cell nearest to them, as one path in metres (Fig. 5)."""
    spec = found.reference.spec
    ends = [(spec.center_of(missed), spec.center_of(hit)) for missed, hit in tied_cells(found)]
    return "".join(f"M{a[0]:.3f} {-a[1]:.3f}L{b[0]:.3f} {-b[1]:.3f}" for a, b in ends)


def _classes(classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """RGBA; unknown is transparent."""
    opacity = np.where(classes == MapClass.UNKNOWN, np.uint8(0), np.uint8(255))
    return np.dstack((COLOR_OF_CLASS[classes], opacity))


def _colored(cells: NDArray[np.bool_], color: tuple[int, int, int], opacity: int) -> NDArray[np.uint8]:
    picture = np.zeros((*cells.shape, 4), np.uint8)
    picture[cells] = (*color, opacity)
    return picture


def _mask(labels: NDArray[np.uint8], label_set: LabelSet, size: tuple[int, int]) -> str:
    """A mask at the size of the photo, transparent where nothing is known."""
    small = cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST)
    opacity = np.where(label_set.map_class_table[small] > 0, np.uint8(255), np.uint8(0))
    return image_url(np.dstack((label_set.color_table[small], opacity)), ".png")


def _size(view: Mapping[str, Any]) -> int:
    pictures = [layer.url for layer in view["map"]["layers"]]
    return sum(
        map(len, [view["photo"], view["true_mask"], view["predicted_mask"], view["map"]["ties"], *pictures])
    )
