"""RELLIS-3D, an off-road data set: images, and lidar scans whose points carry a class; for reference maps.

    SEQUENCE/pylon_camera_node/frame000104-1581624663_149.jpg       1920x1200, distorted; number and time
    SEQUENCE/os1_cloud_node_kitti_bin/000104.bin                    x y z intensity of the scan of that number
    SEQUENCE/os1_cloud_node_semantickitti_label_id/000104.label     class of each point
    SEQUENCE/poses.txt                                              3x4, scan to world; a line a scan
    SEQUENCE/camera_info.txt, transforms.yaml                       or one folder higher

https://github.com/unmannedlab/RELLIS-3D. Depth is what the lidar saw from the camera, the nearest point of a
pixel, and the labels are those of the points; all other pixels have no reading. Images are undistorted, and
reduced to a quarter, at which most neighbours of a ring touch.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import SourceConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Float64Array, Intrinsics, Pose
from swardmap.io.clouds.cloud_files import read_points
from swardmap.io.door import parse_yaml, reading
from swardmap.io.files import read_bytes
from swardmap.io.images import read_color
from swardmap.io.number_tables import parse_table
from swardmap.io.sources.source import Source, Tally
from swardmap.io.sources.trajectory import read_trajectory
from swardmap.labels import GRASS_OBSTACLE_PERSON, VOID_ID
from swardmap.types import Frame

IMAGES, SCANS = "pylon_camera_node", "os1_cloud_node_kitti_bin"
NAME = re.compile(r"frame(\d{1,9})-(\d{9,10})_(\d{1,3})\.(?:jpg|png)")
SCALE = 4
DISTORTION = np.array([-0.134313, -0.025905, 0.002181, 0.00084, 0.0])
"""plumb_bob, as the authors' utils/lidar2img.ipynb has it."""
CALIBRATION = "os1_cloud_node-pylon_camera_node"
VOID, SKY, GRASS, PERSON = 0, 7, 3, 17
NS_PER_S, NS_PER_MS = 1_000_000_000, 1_000_000


@dataclass(frozen=True, slots=True)
class RellisSequence:
    """One sequence: its folder, its camera in full size, where the camera sits, and where the lidar was."""

    path: Path
    K: Float64Array
    T_lidar_camera: Pose
    poses: tuple[Pose, ...]

    def frames(self, images: list[Path], tally: Tally) -> Iterator[Frame]:
        """The frames of these images; one without scan, labels or pose is counted."""
        for image in images:
            number, stamp_ns = _number_and_stamp(image)
            scan = self.path / SCANS / f"{number:06d}.bin"
            if not scan.is_file() or number >= len(self.poses):
                reason = "no pose" if scan.is_file() else "no scan"
                tally.skip(reason, f"{image.name}: {reason}")
                continue
            points = read_points(scan, 4)
            if points.ids is None:
                tally.skip("scan without labels", f"{scan}: no .label of its name in a folder beside")
                continue
            yield self._frame(image, stamp_ns, points.xyz, points.ids, self.poses[number])

    def _frame(
        self, image: Path, stamp_ns: int, xyz: NDArray[np.float32], ids: NDArray[np.int64], T_map_lidar: Pose
    ) -> Frame:
        rgb = undistorted(read_color(image), self.K)
        height, width = rgb.shape[0] // SCALE, rgb.shape[1] // SCALE
        camera = scaled_camera(self.K, width, height)
        depth, labels = rendered(self.T_lidar_camera.inverse().apply(xyz.astype(np.float64)), ids, camera)
        try:
            return Frame(
                stamp_ns, camera, _reduced(rgb), depth, 1.0, T_map_lidar @ self.T_lidar_camera,
                labels=labels, label_set=GRASS_OBSTACLE_PERSON, name=image.stem,
            )  # fmt: skip
        except InvalidValueError as error:
            raise InputError(f"{image}: {error}") from error


def recognises(path: Path) -> bool:
    """Whether `path` has the folders of images and scans."""
    return (path / IMAGES).is_dir() and (path / SCANS).is_dir()


def open_source(path: Path, config: SourceConfig) -> Source:
    """Open one sequence.

    Raises:
        InputError: if a part is missing or damaged.
    """
    images = sorted(p for p in (path / IMAGES).glob("frame*") if NAME.fullmatch(p.name))
    if not images:
        raise InputError(
            f"{path / IMAGES}: expected images such as frame000104-1581624663_149.jpg, found none"
        )
    fx, fy, cx, cy = parse_table(read_bytes(_file(path, "camera_info.txt"), 2**16), 1, 4, "camera_info.txt")[
        0
    ]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    poses = read_trajectory(_file(path, "poses.txt"))
    if poses.stamps_ns is not None:
        raise InputError(f"{path / 'poses.txt'}: expected the 12 numbers of a 3x4 matrix in each line")
    T_lidar_camera = _mount(_file(path, "transforms.yaml"))
    sequence = RellisSequence(path, K, T_lidar_camera, tuple(_of_lidar(p) for p in poses.poses))
    chosen = images[config.start : config.stop : config.every]
    return Source(path.resolve().name, len(chosen), GRASS_OBSTACLE_PERSON, partial(sequence.frames, chosen))


def rendered(
    xyz_camera: Float64Array, ids: NDArray[np.int64], camera: Intrinsics
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Points in the camera's frame as a depth image and a mask; of several in a pixel the nearest.

    Args:
        xyz_camera: (N, 3) in the optical frame; points without a reading may be NaN.
        ids: (N,) classes in RELLIS-3D's ontology.
        camera: of the images.

    Returns:
        (H, W) float32 metres along the optical axis, 0 = no reading, and (H, W) uint8 classes.
    """
    x, y, z = xyz_camera.T
    with np.errstate(invalid="ignore", divide="ignore"):
        u, v = np.rint(camera.fx * x / z + camera.cx), np.rint(camera.fy * y / z + camera.cy)
        seen = (z > 0) & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    order = np.flatnonzero(seen)[np.argsort(-z[seen], kind="stable")]  # the nearest is written last
    at = v[order].astype(np.int64), u[order].astype(np.int64)
    depth = np.zeros((camera.height, camera.width), np.float32)
    labels = np.full(depth.shape, VOID_ID, np.uint8)
    depth[at], labels[at] = z[order], _CLASS_OF_ID[np.clip(ids[order], 0, 255)]
    return depth, labels


def undistorted(rgb: NDArray[np.uint8], K: Float64Array) -> NDArray[np.uint8]:
    """The image as a camera without distortion has it, with the same matrix."""
    import cv2

    return np.asarray(cv2.undistort(rgb, K, DISTORTION), np.uint8)


def scaled_camera(K: Float64Array, width: int, height: int) -> Intrinsics:
    """The camera of an image whose pixels are SCALE as large; the centre of a pixel is its whole number."""
    shift = (1 / SCALE - 1) / 2
    return Intrinsics(
        width, height, K[0, 0] / SCALE, K[1, 1] / SCALE, K[0, 2] / SCALE + shift, K[1, 2] / SCALE + shift
    )


def _reduced(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    import cv2

    height, width = rgb.shape[0] // SCALE, rgb.shape[1] // SCALE
    whole = np.ascontiguousarray(rgb[: height * SCALE, : width * SCALE])
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def _class_table() -> NDArray[np.uint8]:
    table = np.full(256, GRASS_OBSTACLE_PERSON["other"].id, np.uint8)
    table[GRASS], table[PERSON] = GRASS_OBSTACLE_PERSON["grass"].id, GRASS_OBSTACLE_PERSON["person"].id
    table[[VOID, SKY]] = VOID_ID
    return table


_CLASS_OF_ID = _class_table()


def _number_and_stamp(image: Path) -> tuple[int, int]:
    found = NAME.fullmatch(image.name)
    assert found is not None  # noqa: S101 - only such names were taken
    return int(found[1]), int(found[2]) * NS_PER_S + int(found[3]) * NS_PER_MS


def _of_lidar(pose: Pose) -> Pose:
    return Pose("map", "lidar", pose.matrix)


def _mount(file: Path) -> Pose:
    """T_lidar_camera."""
    with reading(file, f"{CALIBRATION} with q and t"):
        tree: Any = parse_yaml(read_bytes(file, 2**16), file)[CALIBRATION]
        q, t = ([float(tree[part][axis]) for axis in axes] for part, axes in (("q", "xyzw"), ("t", "xyz")))
        return Pose.from_quaternion("lidar", "camera", t, q)


def _file(path: Path, name: str) -> Path:
    for file in (path / name, path.resolve().parent / name):
        if file.is_file():
            return file
    raise InputError(f"{path}: expected {name} there or one folder higher")
