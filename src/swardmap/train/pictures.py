"""What a person looks at while a network trains: the curves, and examples of what it sees."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from swardmap.io.files import write_bytes
from swardmap.train.augment import Image
from swardmap.train.photos import Photo
from swardmap.types import Segmentation

CURVES = {
    "loss": (90, 90, 90),
    "accuracy": (66, 103, 178),
    "grass_iou": (84, 150, 64),
    "person_iou": (230, 160, 30),
    "obstacle_called_grass": (200, 40, 40),
}
WIDTH, HEIGHT, MARGIN = 900, 420, 40


def write_pictures(
    out: Path, history: Sequence[Mapping[str, Any]], examples: Sequence[tuple[Photo, Segmentation]]
) -> None:
    """Write `curve.json`, `curve.png` and `examples.png` into the folder, each whole."""
    write_bytes(out / "curve.json", json.dumps(list(history), indent=1).encode())
    write_bytes(out / "curve.png", _png(draw_curves(history)))
    if examples:
        write_bytes(out / "examples.png", _png(draw_examples(examples)))


def draw_curves(history: Sequence[Mapping[str, Any]]) -> Image:
    """Every figure over the steps, 0 at the bottom and 1 at the top."""
    canvas = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    last = max((h["step"] for h in history), default=1)
    cv2.rectangle(canvas, (MARGIN, MARGIN), (WIDTH - MARGIN, HEIGHT - MARGIN), (200, 200, 200), 1)
    for row, (name, color) in enumerate(CURVES.items()):
        points = [(h["step"], h[name]) for h in history if h.get(name) is not None]
        xy = [
            (
                MARGIN + round((WIDTH - 2 * MARGIN) * step / last),
                HEIGHT - MARGIN - round((HEIGHT - 2 * MARGIN) * min(max(value, 0.0), 1.0)),
            )
            for step, value in points
        ]
        cv2.polylines(canvas, [np.array(xy or [(0, 0)], np.int32)], False, color, 2, cv2.LINE_AA)
        value = f" {points[-1][1]:.3f}" if points else ""
        place = (MARGIN + 165 * row, MARGIN - 14)
        cv2.putText(
            canvas, f"{name[:13]}{value}", place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, color, 1, cv2.LINE_AA
        )
    return canvas


def draw_examples(examples: Sequence[tuple[Photo, Segmentation]], width: int = 240) -> Image:
    """Photo above, mask over the photo below; four in a row."""
    tiles = []
    for photo, mask in examples:
        colors = mask.label_set.color_table[mask.labels]
        over = cv2.addWeighted(photo.image, 0.5, np.ascontiguousarray(colors), 0.5, 0)
        both = np.vstack([photo.image, over])
        tiles.append(cv2.resize(both, (width, 2 * width * 3 // 4), interpolation=cv2.INTER_AREA))
    while len(tiles) % 4:
        tiles.append(np.full_like(tiles[0], 255))
    return np.vstack([np.hstack(tiles[i : i + 4]) for i in range(0, len(tiles), 4)]).astype(np.uint8)


def _png(image: Image) -> bytes:
    _, data = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    return bytes(data.tobytes())
