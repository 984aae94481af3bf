"""ORFD, an off-road data set: colour images and dense depth from a lidar, no poses.

    SEQUENCE/image_data/1623721491895.png     or images/: 8-bit colour; the name is a time in milliseconds
    SEQUENCE/dense_depth/1623721491895.png    or depth/: 16-bit, 0 = no reading
    SEQUENCE/calib/1623721491895.txt          a line "cam_K:" with the nine numbers of the camera matrix

The unit of the depth is stated nowhere. 1/256 m, as in KITTI, puts the camera 2 m above the road, which
fits the vehicle; `depth_unit_m` overrides it. Free space (gt_image/) is not read: it is not grass.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from swardmap.config import SourceConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Intrinsics
from swardmap.io.files import read_bytes
from swardmap.io.images import read_color, read_depth
from swardmap.io.number_tables import parse_table
from swardmap.io.sources.source import Source, Tally
from swardmap.types import Frame

COLOR_FOLDERS, DEPTH_FOLDERS, CALIBRATION_FOLDER = ("image_data", "images"), ("dense_depth", "depth"), "calib"
STAMP_MS = re.compile(r"\d{1,15}")
NS_PER_MS = 1_000_000
DEPTH_UNIT_M = 1 / 256


@dataclass(frozen=True, slots=True)
class Sequence:
    """One sequence: its folders, and the unit of its depth."""

    path: Path
    color: Path
    depth: Path
    depth_unit_m: float

    def frames(self, names: list[str], tally: Tally) -> Iterator[Frame]:
        """The frames of these names; one that misses a part is counted."""
        for name in names:
            parts = {
                "no colour image": self.color / f"{name}.png",
                "no depth image": self.depth / f"{name}.png",
                "no calibration": self.path / CALIBRATION_FOLDER / f"{name}.txt",
            }
            missing = [reason for reason, file in parts.items() if not file.is_file()]
            if missing:
                tally.skip(missing[0], f"{parts[missing[0]]} is missing")
            else:
                yield self._read(name, *parts.values())

    def _read(self, name: str, color: Path, depth: Path, calibration: Path) -> Frame:
        rgb = read_color(color)
        height, width = rgb.shape[:2]
        camera = parse_calibration(read_bytes(calibration, 2**16), str(calibration), width, height)
        try:
            return Frame(
                stamp_ns=int(name) * NS_PER_MS,
                intrinsics=camera,
                rgb=rgb,
                depth=read_depth(depth),
                depth_unit_m=self.depth_unit_m,
                name=name,
            )
        except InvalidValueError as error:
            raise InputError(f"{self.path}: {error}") from error


def recognises(path: Path) -> bool:
    """Whether `path` has the folders of a sequence."""
    return (
        (path / CALIBRATION_FOLDER).is_dir()
        and _one_of(path, COLOR_FOLDERS) is not None
        and _one_of(path, DEPTH_FOLDERS) is not None
    )


def open_source(path: Path, config: SourceConfig) -> Source:
    """Open one sequence.

    Raises:
        InputError: if a folder is missing, or holds no image named by a time.
    """
    color, depth = _one_of(path, COLOR_FOLDERS), _one_of(path, DEPTH_FOLDERS)
    if color is None or depth is None or not (path / CALIBRATION_FOLDER).is_dir():
        raise InputError(
            f"{path}: expected folders {' or '.join(COLOR_FOLDERS)}, {' or '.join(DEPTH_FOLDERS)}, "
            f"and {CALIBRATION_FOLDER}"
        )
    try:
        files = [file for folder in (color, depth) for file in folder.iterdir()]
    except OSError as error:
        raise InputError(f"cannot list {path}: {error.strerror}") from error
    names = {file.stem for file in files if file.suffix == ".png"}
    stamped = sorted((name for name in names if STAMP_MS.fullmatch(name)), key=lambda name: (int(name), name))
    if not stamped:
        raise InputError(
            f"{path}: expected images named by their time, such as 1623721491895.png; found none"
        )
    chosen = stamped[config.start : config.stop : config.every]
    sequence = Sequence(path, color, depth, config.depth_unit_m or DEPTH_UNIT_M)
    return Source(path.resolve().name, len(chosen), None, partial(sequence.frames, chosen))


def parse_calibration(content: bytes, name: str, width: int, height: int) -> Intrinsics:
    """Intrinsics from the line `cam_K:` of a calibration file, for an image of a size.

    Raises:
        InputError: if there is no such line, or no camera in it that fits the image.
    """
    lines = [line for line in content.splitlines() if line.startswith(b"cam_K:")]
    if len(lines) != 1:
        raise InputError(f"{name}: expected one line 'cam_K:' with nine numbers, got {len(lines)}")
    K = parse_table(lines[0].removeprefix(b"cam_K:"), 1, 9, f"{name}, cam_K").reshape(3, 3)
    if not np.array_equal(K, [[K[0, 0], 0, K[0, 2]], [0, K[1, 1], K[1, 2]], [0, 0, 1]], equal_nan=True):
        raise InputError(f"{name}: expected cam_K: fx 0 cx 0 fy cy 0 0 1, got {K.ravel().tolist()}")
    try:
        return Intrinsics.from_matrix(K, width, height).centered()
    except InvalidValueError as error:
        raise InputError(f"{name}: {error}") from error


def _one_of(path: Path, names: tuple[str, ...]) -> Path | None:
    return next((path / name for name in names if (path / name).is_dir()), None)
