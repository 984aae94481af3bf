"""Frames as ScanNet's exporter writes them (SensReader/python), and data sets in that layout.

    SCENE/color/0.jpg                     8-bit colour, often larger than the depth image
    SCENE/depth/0.png                     16-bit, millimetres
    SCENE/pose/0.txt                      4x4, camera to world, z up; infinite where tracking was lost
    SCENE/intrinsic/intrinsic_depth.txt   4x4 or 3x3; and intrinsic_color.txt
    SCENE/intrinsic/extrinsic_depth.txt   optional; both must be the identity

Depth stays as it came from the sensor: the colour is taken at the depth image's rays. Frames count as 1/30 s
apart.
"""

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.io.files import read_bytes
from swardmap.io.images import read_color, read_depth
from swardmap.io.number_tables import parse_table
from swardmap.io.sources.listed import Focal, Listed, Pair, listed_source
from swardmap.io.sources.source import Source

PERIOD_NS = 33_333_333
DEPTH_UNIT_M = 0.001
COLOR_SUFFIXES = (".jpg", ".png", ".jpeg")


def recognises(path: Path) -> bool:
    """Whether `path` has the folders of such a scene."""
    return all((path / part).is_dir() for part in ("color", "depth", "pose", "intrinsic"))


def open_source(path: Path, config: SourceConfig) -> Source:
    """Open one scene.

    Raises:
        InputError: if a part is missing or does not hold together, or colour and depth camera lie apart.
    """
    if not recognises(path):
        raise InputError(f"{path}: expected folders color, depth, pose and intrinsic")
    for name in ("extrinsic_color.txt", "extrinsic_depth.txt"):
        file = path / "intrinsic" / name
        if file.is_file() and not np.allclose(_matrix(file), np.eye(4), atol=1e-6):
            raise InputError(
                f"{file}: expected the identity, as in ScanNet: a colour camera that lies apart from the "
                "depth camera cannot be read from this layout; record aligned depth"
            )
    depth, color = (_focal(path / "intrinsic" / f"intrinsic_{kind}.txt") for kind in ("depth", "color"))
    numbers = {
        int(p.stem) for part in ("color", "depth") for p in (path / part).iterdir() if p.stem.isdigit()
    }
    frames = [_listed(path, number) for number in sorted(numbers)]
    focal = config.intrinsics or depth
    return listed_source(path, frames, focal, DEPTH_UNIT_M, config, partial(_read, color=color, depth=focal))


def _listed(path: Path, number: int) -> Listed:
    files = ((path / "color" / f"{number}{suffix}") for suffix in COLOR_SUFFIXES)
    color = next((file for file in files if file.is_file()), None)
    depth, pose_file = path / "depth" / f"{number}.png", path / "pose" / f"{number}.txt"
    pose, fault = None, "no pose"
    if pose_file.is_file():
        matrix = _matrix(pose_file)
        fault = "" if np.isfinite(matrix).all() else "tracking lost"
        pose = None if fault else _pose(matrix, pose_file)
    name, stamp_ns = f"{number:06d}", number * PERIOD_NS
    return Listed(name, stamp_ns, color, depth if depth.is_file() else None, pose, fault)


def _pose(matrix: NDArray[np.float64], file: Path) -> Pose:
    try:
        return Pose("map", "camera", matrix)
    except ValueError as error:
        raise InputError(f"{file}: {error}") from error


def _read(color_file: Path, depth_file: Path, color: Focal, depth: Focal) -> Pair:
    """Depth, and the colour along the ray of each of its pixels."""
    import cv2

    rgb, depth_image = read_color(color_file), read_depth(depth_file)
    height, width = depth_image.shape
    if rgb.shape[:2] == (height, width) and color == depth:
        return rgb, depth_image
    u = (np.arange(width, dtype=np.float32) - depth[2]) / depth[0] * color[0] + color[2]
    v = (np.arange(height, dtype=np.float32) - depth[3]) / depth[1] * color[1] + color[3]
    grid_u, grid_v = np.meshgrid(u.astype(np.float32), v.astype(np.float32))
    sampled = cv2.remap(rgb, grid_u, grid_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return np.ascontiguousarray(sampled), depth_image


def _focal(file: Path) -> Focal:
    K = _matrix(file)
    expected = np.array([[K[0, 0], 0, K[0, 2]], [0, K[1, 1], K[1, 2]], [0, 0, 1]])
    if not np.array_equal(K[:3, :3], expected):
        raise InputError(f"{file}: expected rows fx 0 cx, 0 fy cy, 0 0 1; got {K[:3, :3].tolist()}")
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])


def _matrix(file: Path) -> NDArray[np.float64]:
    content = read_bytes(file, 2**16)
    size = {9: 3, 16: 4}.get(len(content.split()))
    if size is None:
        raise InputError(f"{file}: expected a 3x3 or 4x4 matrix, got {len(content.split())} words")
    return parse_table(content, size, size, str(file))
