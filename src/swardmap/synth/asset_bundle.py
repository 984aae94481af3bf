"""The bundles that garden assets come in: zip files with an index, bounded and checked.

A bundle is a zip file with an `index.json` and one member for each asset: `models/NAME.npz`,
`textures/NAME.webp`, `arrays/NAME.npz`. The index names each with its kind, size, SHA-256 and source.
Positions are steps of 1/65535 of the box around a model (0.1 mm on a tree of 6 m), so they are off by at
most half a step; normals are octahedral bytes (off by less than 1 degree), texture coordinates are steps of
1/65535 of their range. Positions, texture coordinates and faces are stored as differences from the one
before, which compress better. Nothing is unpickled, and nothing is ever unpacked to the disk.
"""

import hashlib
import json
import re
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.io.door import parse_npz, reading
from swardmap.io.unpacking import unzip_member
from swardmap.synth.model import Float32Array

FORMAT = "swardmap-garden-assets/1"
PARTS = {"models": "npz", "textures": "webp", "arrays": "npz"}
MAX_BUNDLE_BYTES = 64 * 2**20
MAX_INDEX_BYTES = 4 * 2**20
MAX_MEMBER_BYTES = 64 * 2**20
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}")
STEPS = 65535
AGAIN = "install the garden assets again: pip install --force-reinstall ./garden_assets"


@dataclass(frozen=True, slots=True)
class Bundle:
    """One zip file; opened anew for each read, so that forked processes may share it.

    Attributes:
        path: of the file.
        index: its `index.json`.
        digest: SHA-256 of the index, which holds the SHA-256 of every member.
    """

    path: Path
    index: Mapping[str, Any]
    digest: bytes

    def read(self, part: str, name: str) -> bytes:
        """Bytes of an asset, checked against the index.

        Args:
            part: models, textures or arrays.
            name: of the asset.

        Raises:
            Exception: of any kind, if the member is missing, too large, or not what the index says; the
                caller reads inside `door.reading`.
        """
        member = f"{part}/{name}.{PARTS[part]}"
        with zipfile.ZipFile(self.path) as bundle:
            content = _member(bundle, member, MAX_MEMBER_BYTES)
        if hashlib.sha256(content).hexdigest() != self.index[part][name]["sha256"]:
            raise ValueError(f"{member} is not what the index says (SHA-256)")
        return content


def open_bundle(path: Path) -> Bundle:
    """Read the index of a bundle, nothing else.

    Raises:
        InputError: if it is no bundle, or its index is damaged.
    """
    with reading(path, "a bundle of garden assets", more=AGAIN):
        if path.stat().st_size > MAX_BUNDLE_BYTES:
            raise ValueError(f"expected at most {MAX_BUNDLE_BYTES} bytes, got {path.stat().st_size}")
        with zipfile.ZipFile(path) as bundle:
            text = _member(bundle, "index.json", MAX_INDEX_BYTES)
        index = json.loads(text)
        if index["format"] != FORMAT:
            raise ValueError(f"expected format {FORMAT}, got {index['format']!r}")
        for part in PARTS:
            _check_names(index[part])
    return Bundle(path, index, hashlib.sha256(text).digest())


def arrays_of(bundle: Bundle, part: str, name: str) -> dict[str, NDArray[Any]]:
    """Arrays of an asset, which may not unpack to more than the limit; raises as `Bundle.read`."""
    where = f"{bundle.path}: {part}/{name}"
    return parse_npz(bundle.read(part, name), where, MAX_MEMBER_BYTES, lzma=True)


def unquantised(steps: NDArray[np.uint16], low: Iterable[float], high: Iterable[float]) -> Float32Array:
    """Undo `quantised`: n x k differences of steps to n x k values between `low` and `high`."""
    low, high = np.array(tuple(low), np.float64), np.array(tuple(high), np.float64)
    whole = np.cumsum(steps, axis=0, dtype=np.uint16)
    return (low + whole * ((high - low) / STEPS)).astype(np.float32)


def quantised(values: NDArray[Any], low: Iterable[float], high: Iterable[float]) -> NDArray[np.uint16]:
    """Values as steps of 1/65535 of their range, each row as the difference from the one before (mod 2^16).

    Args:
        values: n x k.
        low: k, least value of each column.
        high: k, greatest value of each column.

    Returns:
        n x k.
    """
    low, high = np.array(tuple(low), np.float64), np.array(tuple(high), np.float64)
    step = np.maximum(high - low, 1e-12) / STEPS
    whole = np.rint(np.clip((np.asarray(values, np.float64) - low) / step, 0, STEPS)).astype(np.uint16)
    return np.diff(whole, axis=0, prepend=np.zeros((1, whole.shape[1]), np.uint16))


def packed_normals(normals: NDArray[Any]) -> NDArray[np.int8]:
    """Unit vectors, n x 3, as n x 2 octahedral bytes (Cigolle et al., JCGT 2014); off by < 1 degree."""
    n = np.asarray(normals, np.float64)
    n = n / np.maximum(np.abs(n).sum(axis=1, keepdims=True), 1e-12)
    folded = (1 - np.abs(n[:, 1::-1])) * np.where(n[:, :2] >= 0, 1.0, -1.0)
    packed: NDArray[np.int8] = np.rint(np.where(n[:, 2:] >= 0, n[:, :2], folded) * 127).astype(np.int8)
    return packed


def unpacked_normals(packed: NDArray[np.int8]) -> Float32Array:
    """Undo `packed_normals`."""
    xy = packed.astype(np.float64) / 127
    z = 1 - np.abs(xy).sum(axis=1)
    folded = (1 - np.abs(xy[:, ::-1])) * np.where(xy >= 0, 1.0, -1.0)
    n = np.column_stack((np.where(z[:, None] >= 0, xy, folded), z))
    normals: Float32Array = (n / np.linalg.norm(n, axis=1, keepdims=True)).astype(np.float32)
    return normals


def _member(bundle: zipfile.ZipFile, name: str, limit: int) -> bytes:
    member = bundle.getinfo(name)
    if member.file_size > limit:
        raise ValueError(f"{name}: expected at most {limit} bytes, got {member.file_size}")
    return unzip_member(bundle, member)


def _check_names(entries: Mapping[str, Any]) -> None:
    for name in entries:
        if not NAME.fullmatch(name):
            raise ValueError(f"expected a plain name of an asset, got {name!r}")
