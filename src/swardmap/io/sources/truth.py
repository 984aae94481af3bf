"""What a recording may know beyond its labels: which thing each pixel is, and where the ground truly lies.

    RECORDING/instances/NAME.png   16-bit: id of the thing that each pixel shows, 0 = lawn, sky, unknown
    RECORDING/instances.json       {"12": {"kind": "shrub", "height_m": 0.43}, "60004": {"kind": "mulch", ...
    RECORDING/ground.npz           origin_m (2,), texel_m, height_m (ny, nx) float32, in the map's frame

All are optional. They lie beside the frames and not in them: an evaluation reads them, a robot has none.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.errors import InputError, InvalidValueError
from swardmap.io.door import reading
from swardmap.io.files import read_bytes, table_text, write_text
from swardmap.io.images import decode
from swardmap.io.maps.npz_files import read_archive, write_archive

IMAGES, TABLE, GROUND = "instances", "instances.json", "ground.npz"
FIRST_AREA = 60_000
"""Ids from here on are areas of the ground, such as mulch or water; below it they are things."""


@dataclass(frozen=True, slots=True)
class KnownThing:
    """What an id stands for.

    Attributes:
        kind: shrub, person, test body, mulch, water, ...
        height_m: how far it rises above the ground beneath it; 0 for areas of the ground.
    """

    kind: str
    height_m: float

    def __post_init__(self) -> None:
        if not self.kind or not np.isfinite(self.height_m):
            raise InvalidValueError(f"thing: expected a kind and a finite height, got {self}")


@dataclass(frozen=True, slots=True, eq=False)
class GroundRaster:
    """Heights of the ground at texel centres; linear between them, beyond the raster the nearest edge counts.

    Attributes:
        origin_m: outer corner of texel (0, 0) in the map's frame.
        texel_m: edge of a texel.
        height_m: (ny, nx) float32.
    """

    origin_m: tuple[float, float]
    texel_m: float
    height_m: NDArray[np.float32]

    def __post_init__(self) -> None:
        if not (self.texel_m > 0 and self.height_m.ndim == 2 and np.isfinite(self.height_m).all()):
            raise InvalidValueError(
                f"ground: expected a positive texel and finite heights of shape (ny, nx), "
                f"got {self.texel_m} m and {self.height_m.shape}"
            )

    def at(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Height of the ground at points of any shape, in metres."""
        ny, nx = self.height_m.shape
        i, a = _between(np.asarray(x, np.float64), self.origin_m[0], self.texel_m, nx)
        j, b = _between(np.asarray(y, np.float64), self.origin_m[1], self.texel_m, ny)
        heights, corner = self.height_m.ravel(), j * nx + i
        right, up = int(nx > 1), nx * int(ny > 1)
        lower = heights[corner] * (1 - a) + heights[corner + right] * a
        upper = heights[corner + up] * (1 - a) + heights[corner + up + right] * a
        found: NDArray[np.float64] = lower * (1 - b) + upper * b
        return found


def _between(
    at: NDArray[np.float64], origin_m: float, texel_m: float, n: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The texel centre before each place on an axis, and the share of the way to the next one."""
    place = np.clip((at - origin_m) / texel_m - 0.5, 0, n - 1)
    before = np.minimum(place.astype(np.int64), max(n - 2, 0))
    return before, place - before


@dataclass(frozen=True, slots=True, eq=False)
class FrameTruth:
    """What is truly there in a frame.

    Attributes:
        instances: (H, W) uint16 id of what each pixel shows, 0 = nothing known; None if nobody recorded it.
        things: what the ids stand for.
        ground: where the ground lies; None if nobody recorded it.
    """

    instances: NDArray[np.uint16] | None = None
    things: Mapping[int, KnownThing] = field(default_factory=dict)
    ground: GroundRaster | None = None


def read_truth(recording: Path, name: str) -> FrameTruth | None:
    """What a recording knows of a frame; None if it holds nothing of the kind.

    Raises:
        InputError: if a file is damaged.
    """
    image, table, ground = recording / IMAGES / f"{name}.png", recording / TABLE, recording / GROUND
    if not image.is_file() and not ground.is_file():
        return None
    instances = None
    if image.is_file():
        instances = decode(read_bytes(image), str(image))
        if instances.dtype != np.uint16 or instances.ndim != 2:
            raise InputError(
                f"{image}: expected a 16-bit image of ids, got {instances.dtype} {instances.shape}"
            )
    return FrameTruth(
        instances,
        read_things(table) if table.is_file() else {},
        read_ground(ground) if ground.is_file() else None,
    )


def read_things(file: Path) -> dict[int, KnownThing]:
    """The table of ids.

    Raises:
        InputError: if it is something else.
    """
    with reading(file, "ids with kind and height_m"):
        tree = json.loads(read_bytes(file, 10_000_000))
        return {int(key): KnownThing(str(v["kind"]), float(v["height_m"])) for key, v in tree.items()}


def write_things(file: Path, things: Mapping[int, KnownThing]) -> None:
    """The table of ids as JSON."""
    tree: dict[str, Any] = {
        str(key): {"kind": thing.kind, "height_m": round(thing.height_m, 4)}
        for key, thing in sorted(things.items())
    }
    write_text(file, table_text(tree))


def read_ground(file: Path) -> GroundRaster:
    """The raster of the ground.

    Raises:
        InputError: if it is something else.
    """

    def build(arrays: dict[str, NDArray[Any]]) -> GroundRaster:
        x, y = (float(v) for v in arrays["origin_m"])
        return GroundRaster((x, y), float(arrays["texel_m"]), arrays["height_m"].astype(np.float32))

    return read_archive(file, "heights of the ground", build)


def write_ground(file: Path, ground: GroundRaster) -> None:
    """The raster of the ground, compressed."""
    arrays = {"origin_m": np.array(ground.origin_m), "texel_m": np.float64(ground.texel_m)}
    write_archive(file, arrays | {"height_m": ground.height_m.astype(np.float32)})
