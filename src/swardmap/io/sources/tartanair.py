"""Trajectories of TartanAir (simulated, outdoors too), version 1 and 2.

    P001/image_left/000000_left.png              or image_lcam_front/000000_lcam_front.png
    P001/depth_left/000000_left_depth.npy        or depth_lcam_front/000000_lcam_front_depth.png (RGBA)
    P001/pose_left.txt                           or pose_lcam_front.txt: tx ty tz qx qy qz qw a frame

https://github.com/castacks/tartanair_tools (data_type.md). World and camera are north-east-down: x forward, y
right, z down. Here the map is x forward, y left, z up. There are no times: frames count as 1/10 s apart.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.io.files import read_bytes
from swardmap.io.images import DepthImage, decode, read_color, read_depth
from swardmap.io.sources.listed import Focal, Listed, Pair, listed_source
from swardmap.io.sources.source import Source
from swardmap.io.sources.trajectory import read_trajectory

VERSIONS: dict[str, Focal] = {
    "left": (320.0, 320.0, 320.0, 240.0),
    "lcam_front": (320.0, 320.0, 320.0, 320.0),
}
"""Camera by name, and its fx, fy, cx, cy: 640x480 and 640x640 pixels."""
PERIOD_NS = 100_000_000
T_MAP_NED = np.diag([1.0, -1.0, -1.0, 1.0])
T_NED_OPTICAL = np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def recognises(path: Path) -> bool:
    """Whether `path` is such a trajectory."""
    return _camera(path) is not None


def open_source(path: Path, config: SourceConfig) -> Source:
    """Open one trajectory.

    Raises:
        InputError: if a part is missing, or there is not one pose a frame.
    """
    camera = _camera(path)
    if camera is None:
        raise InputError(f"{path}: expected image_left, depth_left and pose_left.txt, or those of lcam_front")
    images = sorted((path / f"image_{camera}").glob(f"*_{camera}.png"))
    poses = read_trajectory(path / f"pose_{camera}.txt", "ned").poses
    if len(poses) != len(images):
        raise InputError(f"{path}: expected one pose for each of the {len(images)} images, got {len(poses)}")
    frames = [
        Listed(
            file.stem.partition("_")[0], i * PERIOD_NS, file, _depth_file(path, camera, file), _placed(pose)
        )
        for i, (file, pose) in enumerate(zip(images, poses, strict=True))
    ]
    return listed_source(path, frames, config.intrinsics or VERSIONS[camera], 1.0, config, _read)


def _camera(path: Path) -> str | None:
    for name in VERSIONS:
        folders = (path / f"image_{name}", path / f"depth_{name}")
        if all(folder.is_dir() for folder in folders) and (path / f"pose_{name}.txt").is_file():
            return name
    return None


def _depth_file(path: Path, camera: str, image: Path) -> Path | None:
    stem = path / f"depth_{camera}" / f"{image.stem}_depth"
    return next((file for s in (".npy", ".png") if (file := stem.with_suffix(s)).is_file()), None)


def _placed(T_ned_camera: Pose) -> Pose:
    """T_map_camera of the optical frame."""
    return Pose("map", "camera", T_MAP_NED @ T_ned_camera.matrix @ T_NED_OPTICAL)


def _read(color: Path, depth: Path) -> Pair:
    return read_color(color), read_depth(depth) if depth.suffix == ".npy" else _packed_depth(depth)


def _packed_depth(file: Path) -> DepthImage:
    """Depth whose float32 lie in the four bytes of each pixel."""
    image: NDArray[Any] = decode(read_bytes(file), str(file))
    if image.ndim != 3 or image.shape[2] != 4 or image.dtype != np.uint8:
        raise InputError(
            f"{file}: expected floats in four channels of 8 bits, got {image.dtype} {image.shape}"
        )
    packed: DepthImage = np.ascontiguousarray(image).view("<f4")[..., 0].astype(np.float32)
    return packed
