"""The worst frames as pictures: photo, mask, reference map, predicted map with its misses tied (Fig. 5)."""

import base64
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.eval.dataset import read_frames
from swardmap.eval.frame import Plan, compare_again, segmenter_of
from swardmap.eval.maps import MapComparison, tied_cells
from swardmap.labels import MapClass
from swardmap.types import Frame, Segmentation

MAP_COLORS = np.array([(213, 217, 214), (104, 180, 84), (66, 103, 178), (240, 180, 40)], np.uint8)
"""Unknown, grass, obstacle, person."""

PHOTO_WIDTH = 480


def frame_figure(plan: Plan, index: int, command: str) -> str:
    """One frame of the gallery as HTML; empty if it cannot be read any more."""
    numbered = next(read_frames(plan.dataset, index, index + 1))
    frame = numbered.frame
    if frame is None:
        return ""
    segmentation, found = compare_again(plan, frame, numbered.clean, segmenter_of(plan, frame.label_set))
    window = _known_window(found)
    pictures = [
        ("photo", _image(_photo(frame), f"photo of frame {frame.name}", ".jpg")),
        ("mask", _image(_masked(frame, segmentation), f"predicted mask of frame {frame.name}", ".jpg")),
        ("reference map", _map(found.reference.classes, window, [], "reference map")),
        (
            "predicted map",
            _map(found.predicted.classes, window, _ties(found), "predicted map, misses in red"),
        ),
    ]
    cells = "".join(f"<div>{picture}<small>{name}</small></div>" for name, picture in pictures)
    return (
        f'<figure class="frame"><div class="four">{cells}</div>'
        f"<figcaption>{_caption(index, frame, found)}<br><code>{escape(command)}</code></figcaption></figure>"
    )


def _caption(index: int, frame: Frame, found: MapComparison) -> str:
    tally, summary = found.tally, found.tally.distances().summary()
    tags = ", ".join(f"{k} {v}" for k, v in sorted(frame.tags.items()))
    called = tally.matrix.obstacle_called_free
    parts = [f"{called.count} of {called.of} obstacle cells called free"]
    if summary.mean_m is not None and summary.max_m is not None:
        parts.append(f"d_min-obst mean {summary.mean_m:.2f} m, largest {summary.max_m:.2f} m")
    if tally.frames_without_hit:
        parts.append("no obstacle cell was found at all: no d_min-obst")
    if tally.missed_called_free:
        parts.append(f"{tally.missed_called_free} whole obstacles called free")
    name = escape(frame.name or str(index))
    return f"<b>Frame {name}</b>{' (' + escape(tags) + ')' if tags else ''}: {escape('; '.join(parts))}."


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
    classes: NDArray[np.uint8],
    window: tuple[slice, slice],
    ties: list[tuple[NDArray[np.int64], NDArray[np.int64] | None]],
    name: str,
) -> str:
    """A map with y up, one unit a cell, misses as red squares and ties as lines."""
    rows, columns = window
    picture = MAP_COLORS[classes[window]][::-1]
    height, width = picture.shape[:2]

    def place(cell: NDArray[np.int64]) -> tuple[float, float]:
        return float(cell[0] - columns.start) + 0.5, float(rows.stop - cell[1]) - 0.5

    marks = []
    for missed, hit in ties:
        x, y = place(missed)
        marks.append(f'<rect x="{x - 0.5}" y="{y - 0.5}" width="1" height="1" fill="#d6333a"/>')
        if hit is not None:
            u, v = place(hit)
            marks.append(f'<line x1="{x}" y1="{y}" x2="{u}" y2="{v}" stroke="#d6333a" stroke-width=".35"/>')
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{escape(name)}">'
        f'<image width="{width}" height="{height}" href="{_data_url(picture, ".png")}"/>'
        f"{''.join(marks)}</svg>"
    )


def _image(picture: NDArray[np.uint8], alt: str, kind: str) -> str:
    height, width = picture.shape[:2]
    return f'<img src="{_data_url(picture, kind)}" width="{width}" height="{height}" alt="{escape(alt)}">'


def _data_url(picture: NDArray[np.uint8], kind: str) -> str:
    import cv2

    options: list[Any] = [cv2.IMWRITE_JPEG_QUALITY, 82] if kind == ".jpg" else []
    _, encoded = cv2.imencode(kind, np.ascontiguousarray(picture[..., ::-1]), options)
    mime = "image/jpeg" if kind == ".jpg" else "image/png"
    return f"data:{mime};base64,{base64.b64encode(encoded.tobytes()).decode()}"
