"""Bare floats in a `.bin`: four a point (SemanticKITTI, RELLIS-3D) or five (nuScenes), and their labels."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError

KITTI_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
FLOATS = (4, 5)
MAX_REACH_M = 1_000.0
MAX_INTENSITY, MAX_RING = 65_535, 1_023


def points_of_bin(
    content: bytes, name: str, point_floats: int | None = None, count: int | None = None
) -> NDArray[np.float32]:
    """(N, 3) float32 points; the file does not say how many numbers a point has, so its content must.

    Args:
        content: of the file.
        name: of the file, for messages.
        point_floats: numbers a point, where the caller knows.
        count: of its labels, which settles it too.

    Raises:
        InputError: if the bytes are not whole points, or may be read in two ways.
    """
    if point_floats is not None and point_floats not in FLOATS:
        raise InputError(f"{name}: expected 4 or 5 numbers a point, got {point_floats}")
    whole = [n for n in FLOATS if len(content) % (4 * n) == 0 and point_floats in (None, n)]
    if not whole:
        wanted = "4 or 5" if point_floats is None else str(point_floats)
        raise InputError(f"{name}: truncated: {len(content)} bytes are not whole points of {wanted} floats")
    readings = [n for n in whole if len(content) // (4 * n) == count] or whole
    if len(readings) > 1:
        readings = [n for n in readings if _plausible(_table(content, n))]
    if len(readings) != 1 and content and point_floats is None:
        raise InputError(
            f"{name}: cannot tell whether its points have {' or '.join(map(str, whole))} numbers: "
            "say --point-floats 4 (x y z intensity) or 5 (and a ring)"
        )
    chosen = point_floats or (readings[0] if readings else FLOATS[0])
    return np.ascontiguousarray(_table(content, chosen)[:, :3])


def find_labels(path: Path) -> Path | None:
    """The labels of a `.bin`: beside it, in ../labels, or in the one folder of labels beside its own.

    Raises:
        InputError: if several folders have them.
    """
    name = f"{path.stem}.label"
    near = (path.with_suffix(".label"), path.parent.parent / "labels" / name)
    found = next((file for file in near if file.is_file()), None)
    if found is not None:
        return found
    try:
        beside = path.resolve().parent.parent.glob(f"*/{_literal(name)}")
        others = sorted(f for f in beside if f.is_file() and "label" in f.parent.name.lower())
    except OSError:
        return None
    if len(others) > 1:
        raise InputError(
            f"{path}: labels of that name lie in {', '.join(str(f.parent.name) for f in others[:6])}: "
            f"copy the right one beside it as {path.with_suffix('.label').name}"
        )
    return others[0] if others else None


def _literal(name: str) -> str:
    return "".join(f"[{c}]" if c in "*?[" else c for c in name)


def _table(content: bytes, floats: int) -> NDArray[np.float32]:
    return np.frombuffer(content, "<f4").reshape(-1, floats)


def _plausible(table: NDArray[np.float32]) -> bool:
    """Whether numbers can be a lidar's: points near, an intensity that is not negative, a whole ring."""
    with np.errstate(invalid="ignore"):
        xyz, intensity, rings = table[:, :3], table[:, 3], table[:, 4:]
        near = bool((~np.isfinite(xyz) | (np.abs(xyz) < MAX_REACH_M)).all())
        lit = bool(((intensity >= 0) & (intensity <= MAX_INTENSITY) | np.isnan(intensity)).all())
        ringed = bool(((rings == np.rint(rings)) & (rings >= 0) & (rings <= MAX_RING)).all())
    return near and lit and ringed
