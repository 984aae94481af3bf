"""The worst frames as pictures: photo, mask, reference map, predicted map with its misses tied (Fig. 5)."""

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.eval.dataset import read_frames
from swardmap.eval.frame import Plan, compare_again, segmenter_of
from swardmap.eval.maps import MapComparison, tied_cells
from swardmap.grid import OccupancyGrid
from swardmap.labels import MapClass
from swardmap.types import Frame, Segmentation

MAP_COLORS = np.array([(213, 217, 214), (104, 180, 84), (66, 103, 178), (240, 180, 40)], np.uint8)
"""Unknown, grass, obstacle, person."""

PHOTO_WIDTH = 480


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture inside the page.

    Attributes:
        url: with the data in it.
        width, height: in pixels, of maps in cells.
        alt: what it shows.
        ties: of a map: missed cells with the found cell nearest to them.
        metre: of a map: cells a metre.
    """

    url: str
    width: int
    height: int
    alt: str
    ties: tuple["Tie", ...] = ()
    metre: float = 0.0


@dataclass(frozen=True, slots=True)
class Tie:
    """Centre of a missed cell in the picture, and that of the found cell nearest to it, if there is one."""

    x: float
    y: float
    hit: tuple[float, float] | None


def frame_pictures(plan: Plan, index: int) -> dict[str, Any] | None:
    """One frame of the gallery for its template; None if it cannot be read any more."""
    numbered = next(read_frames(plan.dataset, index, index + 1))
    frame = numbered.frame
    if frame is None:
        return None
    segmenter = segmenter_of(plan, frame.label_set)
    segmentation, found = compare_again(plan, frame, numbered.clean, segmenter, numbered.truth)
    window = _known_window(found)
    return {
        "name": frame.name or str(index),
        "tags": ", ".join(f"{k} {v}" for k, v in sorted(frame.tags.items())),
        "facts": "; ".join(_facts(found)),
        "photo": _image(_photo(frame), f"photo of frame {frame.name}", ".jpg"),
        "mask": _image(_masked(frame, segmentation), f"predicted mask of frame {frame.name}", ".jpg"),
        "reference": _map(found.reference, window, [], "reference map"),
        "predicted": _map(found.predicted, window, _ties(found), "predicted map, misses in red"),
    }


def _facts(found: MapComparison) -> list[str]:
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


def _photo(frame: Frame) -> NDArray[np.uint8]:
    import cv2

    height = round(frame.rgb.shape[0] * PHOTO_WIDTH / frame.rgb.shape[1])
    small: NDArray[np.uint8] = cv2.resize(frame.rgb, (PHOTO_WIDTH, height), interpolation=cv2.INTER_AREA)
    return small


def _masked(frame: Frame, segmentation: Segmentation) -> NDArray[np.uint8]:
    photo = _photo(frame)
    labels = segmentation.resized_to(*photo.shape[:2])
    colors = labels.label_set.color_table[labels.labels]
    return ((photo.astype(np.uint16) * 2 + colors.astype(np.uint16) * 3) // 5).astype(np.uint8)


def _known_window(found: MapComparison) -> tuple[slice, slice]:
    """Rows and columns that either map knows something of, with a little room."""
    known = (found.reference.classes != MapClass.UNKNOWN) | (found.predicted.classes != MapClass.UNKNOWN)
    spans = []
    for axis, size in ((1, known.shape[0]), (0, known.shape[1])):
        places = np.flatnonzero(known.any(axis=axis))
        low, high = (0, size) if len(places) == 0 else (int(places[0]), int(places[-1]) + 1)
        spans.append(slice(max(0, low - 2), min(size, high + 2)))
    return spans[0], spans[1]


def _ties(found: MapComparison) -> list[tuple[NDArray[np.int64], NDArray[np.int64] | None]]:
    """Missed cells with the found cell nearest to them, the farthest first; None where nothing was found."""
    ties = [(tie[0], tie[1]) for tie in tied_cells(found)]
    return [*ties] if found.misses.hits else [(cell, None) for cell in found.misses.cells[:400]]


def _map(
    grid: OccupancyGrid,
    window: tuple[slice, slice],
    ties: list[tuple[NDArray[np.int64], NDArray[np.int64] | None]],
    name: str,
) -> Picture:
    """A map with y up, one unit a cell."""
    rows, columns = window
    picture = MAP_COLORS[grid.classes[window]][::-1]
    height, width = picture.shape[:2]

    def place(cell: NDArray[np.int64]) -> tuple[float, float]:
        return float(cell[0] - columns.start) + 0.5, float(rows.stop - cell[1]) - 0.5

    tied = tuple(Tie(*place(missed), None if hit is None else place(hit)) for missed, hit in ties)
    return Picture(_data_url(picture, ".png"), width, height, name, tied, 1 / grid.spec.resolution_m)


def _image(picture: NDArray[np.uint8], alt: str, kind: str) -> Picture:
    height, width = picture.shape[:2]
    return Picture(_data_url(picture, kind), width, height, alt)


def _data_url(picture: NDArray[np.uint8], kind: str) -> str:
    import cv2

    options: list[Any] = [cv2.IMWRITE_JPEG_QUALITY, 82] if kind == ".jpg" else []
    _, encoded = cv2.imencode(kind, np.ascontiguousarray(picture[..., ::-1]), options)
    mime = "image/jpeg" if kind == ".jpg" else "image/png"
    return f"data:{mime};base64,{base64.b64encode(encoded.tobytes()).decode()}"
