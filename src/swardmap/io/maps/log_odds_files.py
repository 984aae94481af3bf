"""The map of log-odds as a NumPy archive, every tile with its evidence: it goes on where it ended."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.grid import GridSpec
from swardmap.io.maps.npz_files import read_archive, write_archive
from swardmap.labels import MapClass
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.mapping.sensor_model import Cells
from swardmap.mapping.tiles import TILE, TileKey

VERSION = 1
DTYPES = {"keys": np.int64, "evidence": np.int16, "person": np.int16, "classes": np.uint8}


def write_living(living: LogOddsMap, path: str | Path) -> None:
    """Write all tiles as .npz: keys (N, 2), evidence, person and classes (N, 128, 128), and where they lie.

    Raises:
        OutputError: if it cannot be written; an earlier file stays as it was.
    """
    tiles, corner = living.tiles, living.corner_cell
    shape = len(tiles), TILE, TILE
    blocks = {
        name: np.array([getattr(tile, name) for tile in tiles.values()], DTYPES[name]).reshape(shape)
        for name in ("evidence", "person", "classes")
    }
    arrays: dict[str, Any] = {
        "living_map": np.int64(VERSION),
        "resolution_m": np.float64(corner.resolution_m),
        "corner_m": np.array(corner.origin_m, np.float64),
        "frame_id": np.array(corner.frame_id),
        "stamp_ns": np.int64(living.stamp_ns),
        "keys": np.array(list(tiles), np.int64).reshape(-1, 2),
        **blocks,
    }
    write_archive(path, arrays)


def read_living(path: str | Path, into: LogOddsMap) -> None:
    """Fill an empty or used living map with what `write_living` wrote; it must be on the same lattice.

    Args:
        path: the archive.
        into: map whose tiles are replaced; it stays as it was if anything is wrong.

    Raises:
        InputError: if the file is something else, damaged, on another lattice, or calls a cell free for
            which it holds no evidence.
    """

    def restore(arrays: dict[str, NDArray[Any]]) -> None:
        into.restore(_tiles_of(arrays, into.corner_cell), int(arrays["stamp_ns"]))

    read_archive(path, "a living map", restore)


def read_living_map(path: str | Path, config: Config) -> LogOddsMap:
    """A living map as `write_living` wrote it, in the frame it was of, to be gone on from.

    Args:
        path: the archive.
        config: of the run that goes on; its cells must be those of the file.

    Raises:
        InputError: see `read_living`.
    """

    def restored(arrays: dict[str, NDArray[Any]]) -> LogOddsMap:
        frame_id = str(arrays["frame_id"])
        living = LogOddsMap(config.grid, config.evidence, config.cloud.min_height_m, frame_id)
        living.restore(_tiles_of(arrays, living.corner_cell), int(arrays["stamp_ns"]))
        return living

    return read_archive(path, "a living map", restored)


def _tiles_of(arrays: dict[str, NDArray[Any]], corner: GridSpec) -> dict[TileKey, Cells]:
    if int(arrays["living_map"]) != VERSION:
        raise ValueError(f"expected version {VERSION}, got {arrays['living_map']}")
    x, y = (float(v) for v in arrays["corner_m"])
    saved = GridSpec(float(arrays["resolution_m"]), 1, 1, (x, y), str(arrays["frame_id"]))
    if saved != corner:
        raise ValueError(
            f"its cells are {saved.resolution_m:g} m in '{saved.frame_id}' from {saved.origin_m}, "
            f"those of this map {corner.resolution_m:g} m in '{corner.frame_id}' from {corner.origin_m}"
        )
    keys = arrays["keys"]
    for name, dtype in DTYPES.items():
        shape = (len(keys), 2) if name == "keys" else (len(keys), TILE, TILE)
        if arrays[name].shape != shape or arrays[name].dtype != dtype:
            raise ValueError(f"{name}: expected {np.dtype(dtype)} of {shape}, got {arrays[name].dtype} of "
                             f"{arrays[name].shape}")  # fmt: skip
    evidence, person, classes = arrays["evidence"], arrays["person"], arrays["classes"]
    if classes.size and classes.max() > max(MapClass):
        raise ValueError(f"expected classes 0..{int(max(MapClass))}, got {classes.max()}")
    if person.size and person.min() < 0:
        raise ValueError("expected evidence of persons of 0 or more")
    if ((classes == MapClass.GRASS) & (evidence > 0)).any():
        raise ValueError("a cell is called grass against its evidence")
    tiles = {
        (int(tx), int(ty)): Cells(evidence[i].copy(), person[i].copy(), classes[i].copy())
        for i, (tx, ty) in enumerate(keys)
    }
    if len(tiles) != len(keys):
        raise ValueError("a tile is there twice")
    return tiles
