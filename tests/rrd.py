"""What is in an .rrd file, by Rerun's own reader."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("rerun", reason="Rerun's own reader is the judge")

Rows = dict[str, dict[str, dict[int, Any]]]
"""Path -> component -> frame number (-1: for all times) -> value."""


def read(path: Path) -> Rows:
    from rerun.chunk import RrdReader

    found: Rows = defaultdict(lambda: defaultdict(dict))
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        columns = {field.name: batch.column(i) for i, field in enumerate(batch.schema)}
        numbers = columns["frame"].to_pylist() if "frame" in columns else [-1] * chunk.num_rows
        for name, column in columns.items():
            if name.startswith("rerun.controls") or name in ("frame", "stamp", "log_time"):
                continue
            for number, value in zip(numbers, column, strict=True):
                if value.is_valid:
                    found[chunk.entity_path][name][number] = value
        if "stamp" in columns:
            for number, value in zip(numbers, columns["stamp"], strict=True):
                found[chunk.entity_path]["stamp"][number] = value.cast("int64").as_py()
    return {path: dict(components) for path, components in found.items()}


def numbers(value: Any) -> NDArray[Any]:
    """A list of numbers, or of fixed lists of numbers."""
    flat = value.values
    while hasattr(flat, "flatten") and flat.type.num_fields:
        flat = flat.flatten()
    return np.asarray(flat.to_numpy(zero_copy_only=False))


def image(rows: Rows, path: str, kind: str, frame: int) -> NDArray[Any]:
    """Pixels of an Image, SegmentationImage or DepthImage."""
    form = rows[path][f"{kind}:format"][frame].as_py()[0]
    dtype = {None: np.uint8, 6: np.uint8, 8: np.uint16, 33: np.float16, 34: np.float32}
    pixels = numbers(rows[path][f"{kind}:buffer"][frame]).view(dtype[form["channel_datatype"]])
    shape = form["height"], form["width"]
    return pixels.reshape(shape if pixels.size == shape[0] * shape[1] else (*shape, -1))
