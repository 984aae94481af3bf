"""The map of log-odds as a NumPy archive, every tile with its evidence: it goes on where it ended."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config, EvidenceConfig
from swardmap.grid import GridSpec
from swardmap.io.maps.npz_files import read_archive, write_archive
from swardmap.io.maps.saved_evidence import (
    adapted,
    check_cells,
    difference,
    settings_of_evidence,
    without_doubt,
)
from swardmap.labels import MapClass
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.mapping.sensor_model import Cells
from swardmap.mapping.tiles import TILE, TileKey

VERSION = 1
DTYPES = {"keys": np.int64, "evidence": np.int16, "person": np.int16, "classes": np.uint8}


def write_living(living: LogOddsMap, path: str | Path, config: Config | None = None) -> None:
    """Write all tiles as .npz: keys (N, 2), evidence, person and classes (N, 128, 128), and where they lie.

    Args:
        living: the map.
        path: the archive.
        config: that it was made under. Without it, whoever goes on from the map keeps its hazards alone.

    Raises:
        OutputError: if it cannot be written; an earlier file stays as it was.
    """
    tiles, corner = living.tiles, living.corner_cell
    shape = len(tiles), TILE, TILE
    blocks = {
        name: np.array([getattr(tile, name) for tile in tiles.values()], DTYPES[name]).reshape(shape)
        for name in ("evidence", "person", "classes")
    }
    blocks["classes"] = without_doubt(Cells(**blocks))
    told = {} if config is None else {"settings": np.array(json.dumps(settings_of_evidence(config)))}
    arrays: dict[str, Any] = {
        "living_map": np.int64(VERSION),
        "resolution_m": np.float64(corner.resolution_m),
        "corner_m": np.array(corner.origin_m, np.float64),
        "frame_id": np.array(corner.frame_id),
        "stamp_ns": np.int64(living.stamp_ns),
        "keys": np.array(list(tiles), np.int64).reshape(-1, 2),
        **told,
        **blocks,
    }
    write_archive(path, arrays)


def read_living_map(
    path: str | Path, config: Config, tell: Callable[[str], None] | None = None
) -> LogOddsMap:
    """A living map as `write_living` wrote it, in the frame it was of, to be gone on from.

    Under other settings than those of the run that goes on, its evidence is worth no more than that run's
    own (see `saved_evidence`).

    Args:
        path: the archive.
        config: of the run that goes on; its cells must be those of the file.
        tell: called with one line if the map was made under other settings.

    Raises:
        InputError: if the file is something else, damaged, on another lattice, or calls a cell free for
            which it holds no evidence.
    """

    def restored(arrays: dict[str, NDArray[Any]]) -> LogOddsMap:
        frame_id = str(arrays["frame_id"])
        living = LogOddsMap(config.grid, config.evidence, config.cloud.min_height_m, frame_id)
        tiles, told = _tiles_of(arrays, living.corner_cell, config)
        living.restore(tiles, int(arrays["stamp_ns"]))
        if told and tell is not None:
            tell(f"{path}: {told}")
        return living

    return read_archive(path, "a living map", restored)


def _tiles_of(
    arrays: dict[str, NDArray[Any]], corner: GridSpec, config: Config
) -> tuple[dict[TileKey, Cells], str]:
    """Tiles that a run may go on from, and what it is to be told of them."""
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
    before = Cells(arrays["evidence"], arrays["person"], arrays["classes"])
    settings = str(arrays["settings"]) if "settings" in arrays else None
    found = difference(settings, config)
    check_cells(before, None if settings is None else EvidenceConfig(**json.loads(settings)["evidence"]))
    cells = adapted(before, found, config.evidence)
    tiles = {
        (int(tx), int(ty)): Cells(cells.evidence[i].copy(), cells.person[i].copy(), cells.classes[i].copy())
        for i, (tx, ty) in enumerate(keys)
    }
    if len(tiles) != len(keys):
        raise ValueError("a tile is there twice")
    forgotten = int(((before.classes == MapClass.GRASS) & (cells.classes == MapClass.UNKNOWN)).sum())
    told = f"made under other settings ({found}); {forgotten} free cells are unknown until seen again"
    return tiles, told if str(found) else ""
