"""The YAML file of a map: read and checked, written with all digits, and its rule for grey levels."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.grid import GridSpec
from swardmap.io.door import parse_yaml, through_door
from swardmap.io.files import read_bytes

Mode = Literal["trinary", "scale", "raw"]

FREE_THRESH, OCCUPIED_THRESH = 0.196, 0.65
MAX_YAML_BYTES = 1_000_000
NO_YAW_RAD = 1e-6
"""A map of 10,000 cells turned by less is off by a hundredth of a cell."""


@dataclass(frozen=True, slots=True)
class MapDescription:
    """The YAML file of a map, checked.

    Attributes:
        image: file with the pixels; may be absolute.
        mode, negate, free_thresh, occupied_thresh: how a grey level is read.
        resolution_m: edge of a cell.
        origin: x and y in metres and yaw in radians of the outer corner of the lower left cell.
        extra: what only swardmap writes: frame_id, stamp_ns, person, costs.
    """

    image: Path
    mode: Mode
    negate: bool
    free_thresh: float
    occupied_thresh: float
    resolution_m: float
    origin: tuple[float, float, float]
    extra: Mapping[str, Any]


@through_door("the YAML of a map")
def read_description(path: str | Path) -> MapDescription:
    """Read and check the YAML file of a map."""
    tree = parse_yaml(read_bytes(path, MAX_YAML_BYTES), path)
    if not isinstance(tree, dict):
        raise InputError(
            f"{path}: expected the keys of a map (image, resolution, origin, ...), got other text"
        )
    image = tree.get("image")
    if not isinstance(image, str) or not image or "\0" in image:
        raise InputError(f"{path}: expected 'image' to name a file, got {image!r}")
    mode: Any = tree.get("mode", "trinary")
    mode = mode.lower() if isinstance(mode, str) else mode  # as map_server does
    if mode not in ("trinary", "scale", "raw"):
        raise InputError(f"{path}: expected 'mode' trinary, scale or raw, got {mode!r}")
    origin = tree.get("origin")
    if not isinstance(origin, list) or len(origin) != 3:
        raise InputError(f"{path}: expected 'origin' to be [x, y, yaw], got {origin!r}")
    x, y, yaw = (_number({"origin": v}, "origin", path) for v in origin)
    free, occupied = _number(tree, "free_thresh", path), _number(tree, "occupied_thresh", path)
    if free >= occupied:  # map_server goes on, and reads what lies between as free
        raise InputError(f"{path}: expected free_thresh below occupied_thresh, got {free} and {occupied}")
    extra = tree.get("swardmap")
    return MapDescription(
        image=Path(path).parent / Path(image).expanduser(),
        mode=mode,
        negate=_number(tree, "negate", path) != 0,
        free_thresh=free,
        occupied_thresh=occupied,
        resolution_m=_number(tree, "resolution", path),
        origin=(x, y, _yaw(yaw)),
        extra=extra if isinstance(extra, dict) else {},
    )


def nav_value_of_grey(
    mode: Mode,
    negate: bool = False,
    free_thresh: float = FREE_THRESH,
    occupied_thresh: float = OCCUPIED_THRESH,
) -> NDArray[np.int8]:
    """map_server's rule as a table (256,) int8: grey level -> -1 unknown, 0 free .. 100 occupied.

    In float32 as there (nav2_map_server/src/map_io.cpp), so that borders fall on the same side.

    >>> nav_value_of_grey("trinary")[[0, 128, 205, 254]].tolist()
    [100, -1, -1, 0]
    """
    grey = np.arange(256)
    if mode == "raw":
        return np.where(grey <= 100, grey, -1).astype(np.int8)
    occupancy = grey.astype(np.float32) / np.float32(255)
    if not negate:
        occupancy = np.float32(1) - occupancy
    free, occupied = np.float32(free_thresh), np.float32(occupied_thresh)
    values = np.full(256, -1.0, np.float32)
    if mode == "scale":
        values = (occupancy - free) / np.float32(occupied_thresh - free_thresh) * np.float32(100)
        values = np.floor(values + np.float32(0.5))
    values[occupancy >= occupied] = 100
    values[occupancy <= free] = 0
    return values.astype(np.int8)


def description_text(image: str, mode: Mode, spec: GridSpec, stamp_ns: int, extra: Mapping[str, Any]) -> str:
    """The YAML file as text: what map_server needs, and `extra` where it does not look."""
    import yaml

    x, y = spec.origin_m
    more = {"frame_id": spec.frame_id, "stamp_ns": int(stamp_ns), **extra}
    return (
        f"{yaml.safe_dump({'image': image}, allow_unicode=True, width=1_000_000)}"
        f"mode: {mode}\n"
        f"resolution: {float(spec.resolution_m)!r}\n"
        f"origin: [{x!r}, {y!r}, 0.0]\n"
        "negate: 0\n"
        f"occupied_thresh: {OCCUPIED_THRESH}\n"
        f"free_thresh: {FREE_THRESH}\n"
        f"swardmap: {yaml.safe_dump(more, default_flow_style=True, width=1_000_000)}"
    )


def _yaw(yaw_rad: float) -> float:
    """Radians in -pi..pi; 0 where it is what is left of a computation."""
    wrapped = math.remainder(yaw_rad, 2 * math.pi)
    return 0.0 if abs(wrapped) < NO_YAW_RAD else wrapped


def _number(tree: Mapping[str, Any], key: str, path: str | Path) -> float:
    value = tree.get(key)
    try:
        number = float(value) if isinstance(value, (int, float, str)) else math.nan
    except (ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{path}: expected '{key}' to be a finite number, got {value!r}")
    return number
