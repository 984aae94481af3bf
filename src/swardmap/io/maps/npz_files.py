"""Maps and costmaps as NumPy archives: one file, nothing lost, no image reader needed."""

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.door import parse_npz, reading
from swardmap.io.files import read_bytes, write_bytes
from swardmap.labels import MapClass
from swardmap.mapping.costmap import Costmap

T = TypeVar("T")

MAX_FILE_BYTES = 2**30


def write_npz(grid: OccupancyGrid | Costmap, path: str | Path) -> None:
    """Write a map (array `classes`) or a costmap (array `costs`) as .npz.

    Beside it: resolution_m, origin_m, frame_id, stamp_ns. Row 0 is the bottom of the map.
    """
    cells = {"classes": grid.classes} if isinstance(grid, OccupancyGrid) else {"costs": grid.costs}
    spec = grid.spec
    arrays: dict[str, Any] = {
        "resolution_m": np.float64(spec.resolution_m),
        "origin_m": np.array(spec.origin_m, np.float64),
        "frame_id": np.array(spec.frame_id),
        "stamp_ns": np.int64(grid.stamp_ns),
        **cells,
    }
    write_archive(path, arrays)


def read_npz(path: str | Path) -> OccupancyGrid | Costmap:
    """Read what `write_npz` wrote.

    Raises:
        InputError: if it is something else or damaged.
    """
    return read_archive(path, "a map or costmap", _grid_of)


def _grid_of(arrays: dict[str, NDArray[Any]]) -> OccupancyGrid | Costmap:
    cells = arrays["classes"] if "classes" in arrays else arrays["costs"]
    if cells.ndim != 2:
        raise ValueError(f"expected cells of shape (height, width), got {cells.shape}")
    x, y = (float(v) for v in arrays["origin_m"])
    spec = GridSpec(
        float(arrays["resolution_m"]), cells.shape[1], cells.shape[0], (x, y), str(arrays["frame_id"])
    )
    stamp_ns = int(arrays["stamp_ns"])
    if "classes" not in arrays:
        return Costmap(spec, cells, stamp_ns)
    if cells.size and cells.max() > max(MapClass):
        raise ValueError(f"expected classes 0..{int(max(MapClass))}, got {cells.max()}")
    return OccupancyGrid(spec, cells, stamp_ns)


def write_archive(path: str | Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays as a compressed .npz, atomically."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_bytes(path, buffer.getvalue())


def read_archive(path: str | Path, what: str, build: Callable[[dict[str, NDArray[Any]]], T]) -> T:
    """Build something from the arrays of an .npz; whatever is wrong with the file is one InputError.

    Args:
        path: the archive; nothing in it is unpickled.
        what: it is expected to hold, for the message.
        build: makes it of the arrays; may raise what it likes.
    """
    expected = f"{what} written by swardmap"
    with reading(path, expected):
        return build(parse_npz(read_bytes(path, MAX_FILE_BYTES), path, what=expected))
