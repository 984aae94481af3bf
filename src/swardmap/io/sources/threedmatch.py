"""RGB-D sequences in the layout of 3DMatch and 7-Scenes.

    SEQUENCE/camera-intrinsics.txt        3x3 camera matrix; may lie one folder higher (seq-01/ sub-folders);
                                          7-Scenes has none: its authors state 585, 585, 320, 240
    SEQUENCE/frame-000000.color.png       8-bit colour, .png or .jpg
    SEQUENCE/frame-000000.depth.png       16-bit, millimetres; 0 and 65535 = no reading
    SEQUENCE/frame-000000.pose.txt        4x4, camera to world; NaN or infinite where tracking was lost

The data has no times: a frame gets its number times 1/30 s. Nor has its world a direction that is up: it
is wherever the reconstruction began. Cameras are held upright, though, so the mean of the poses' -y axes is
roughly up, and with `level` the map is turned once so that the floor seen from there is z = 0.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.config import SourceConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Float64Array, Intrinsics, Pose, deproject
from swardmap.io.files import read_bytes
from swardmap.io.images import read_color, read_depth
from swardmap.io.number_tables import parse_table
from swardmap.io.sources.source import Source, Tally
from swardmap.perception.ground_plane import fit_ground_plane, level_pose
from swardmap.types import Frame, depth_in_metres

INTRINSICS_FILE = "camera-intrinsics.txt"
FRAME_FILE = re.compile(r"(frame-(\d{1,9}))\.(?:color\.(?:png|jpg)|depth\.png|pose\.txt)")
SEVEN_SCENES = (585.0, 585.0, 320.0, 240.0)
"""The camera its authors state for 7-Scenes; its colour and depth are not aligned to the last pixels."""
SEVEN_SCENES_LISTS = ("TrainSplit.txt", "TestSplit.txt")
PERIOD_NS = 33_333_333
NO_READING = 65535
MILLIMETRE_M = 0.001
LEVEL_FRAMES, LEVEL_STRIDE = 8, 4
"""The floor is looked for in so many frames, spread over the sequence, and every n-th row and column."""
MIN_AGREEMENT = 0.5
"""Length of the mean of the cameras' up vectors; below it they were not all held upright."""


@dataclass(frozen=True, slots=True)
class SequenceEntry:
    """One frame by name: its number, and its pose if its tracking was not lost."""

    name: str
    number: int
    T_world_camera: Pose | None
    fault: str = ""


@dataclass(frozen=True, slots=True)
class Sequence:
    """One sequence: its folder, its camera, and its frames."""

    path: Path
    entries: tuple[SequenceEntry, ...]
    camera: Intrinsics
    depth_unit_m: float

    def frames(self, T_map_world: Pose, tally: Tally) -> Iterator[Frame]:
        """The frames in a map that lies so in the world of the recording; what misses a part is counted."""
        for entry in self.entries:
            if entry.T_world_camera is None:
                tally.skip(entry.fault, f"{entry.name}: {entry.fault}")
            else:
                yield self._read(entry, T_map_world @ entry.T_world_camera)

    def T_map_world(self) -> Pose:
        """Where the floor seen from cameras that were held upright is z = 0.

        Raises:
            InputError: if they were not, or no floor is seen.
        """
        usable = [(e.name, e.T_world_camera) for e in self.entries if e.T_world_camera is not None]
        up = np.mean([-pose.matrix[:3, 1] for _, pose in usable], axis=0)
        if np.linalg.norm(up) < MIN_AGREEMENT:
            raise InputError(
                f"{self.path}: cannot tell what is up, the camera was not held upright; "
                "set source.level=false to take the world as it is"
            )
        spread = np.unique(np.linspace(0, len(usable) - 1, LEVEL_FRAMES).round().astype(int))
        points = [self._world_points(*usable[i]) for i in spread]
        views = [np.tile(usable[i][1].position_m, (len(p), 1)) for i, p in zip(spread, points, strict=True)]
        try:
            plane = fit_ground_plane(np.concatenate(points), up, np.concatenate(views))
        except InputError as error:
            raise InputError(
                f"{self.path}: {error}; set source.level=false to take the world as it is"
            ) from error
        return level_pose(plane, parent="map", child="world")

    def _read(self, entry: SequenceEntry, T_map_camera: Pose) -> Frame:
        color = _color_file(self.path, entry.name)
        try:
            return Frame(
                stamp_ns=entry.number * PERIOD_NS,
                intrinsics=self.camera,
                rgb=read_color(color),
                depth=_read_depth(self.path, entry.name),
                depth_unit_m=self.depth_unit_m,
                T_map_camera=T_map_camera,
                name=entry.name,
            )
        except InvalidValueError as error:
            raise InputError(f"{self.path}: {error}") from error

    def _world_points(self, name: str, T_world_camera: Pose) -> Float64Array:
        """(N, 3) some points of a frame in the world."""
        depth = _read_depth(self.path, name)
        try:
            xyz = deproject(depth_in_metres(depth, self.depth_unit_m), self.camera)
        except InvalidValueError as error:
            raise InputError(f"{self.path}: frame {name}: {error}") from error
        some = xyz[::LEVEL_STRIDE, ::LEVEL_STRIDE].reshape(-1, 3)
        return T_world_camera.apply(some[np.isfinite(some[:, 2])])


def recognises(path: Path) -> bool:
    """Whether `path` is such a sequence, or holds seq-... folders with some."""
    return any(_frame_names(folder) for folder in _candidates(path))


def open_source(path: Path, config: SourceConfig) -> Source:
    """Open one sequence; a folder that holds a single seq-... folder stands for it.

    Raises:
        InputError: if a part is missing or does not hold together, or no floor is seen to level the map by.
    """
    folder = _sequence_folder(path)
    K, of_camera = _camera_matrix(folder, config)
    chosen = _frame_names(folder)[config.start : config.stop : config.every]
    entries = [_read_entry(folder, name, number) for name, number in chosen]
    first = next((entry for entry in entries if entry.T_world_camera is not None), None)
    if first is None:
        faults = ", ".join(f"{n} x {fault}" for fault, n in Counter(e.fault for e in entries).items())
        raise InputError(
            f"{folder}: none of the {len(entries)} frames chosen can be used ({faults or 'none'})"
        )
    height, width = _read_depth(folder, first.name).shape
    camera = _camera(K, width, height, of_camera)
    sequence = Sequence(folder, tuple(entries), camera, config.depth_unit_m or MILLIMETRE_M)
    T_map_world = sequence.T_map_world() if config.level else Pose.identity("map", "world")
    return Source(folder.resolve().name, len(entries), None, partial(sequence.frames, T_map_world))


def parse_pose(content: bytes, name: str) -> Pose | None:
    """T_world_camera of a pose file, or None if its tracking was lost (NaN or infinite numbers).

    Args:
        content: of the file, four rows of four numbers.
        name: of the file, for messages.

    Raises:
        InputError: if it is no 4x4 matrix, or no rotation and translation.
    """
    matrix = _matrix(content, 4, name)
    if not np.isfinite(matrix).all():
        return None
    try:
        return Pose("world", "camera", matrix)
    except InvalidValueError as error:
        raise InputError(f"{name}: {error}") from error


def _read_entry(folder: Path, name: str, number: int) -> SequenceEntry:
    for what, file in (
        ("no colour image", _color_file(folder, name)),
        ("no depth image", folder / f"{name}.depth.png"),
        ("no pose", folder / f"{name}.pose.txt"),
    ):
        if not file.is_file():
            return SequenceEntry(name, number, None, what)
    pose = parse_pose(read_bytes(file, 2**16), str(file))
    return SequenceEntry(name, number, pose, "" if pose else "tracking lost")


def _read_depth(folder: Path, name: str) -> NDArray[np.uint16]:
    """Depth in units, 0 = no reading."""
    file = folder / f"{name}.depth.png"
    depth = read_depth(file)
    if depth.dtype != np.uint16:
        raise InputError(f"{file}: expected a 16-bit depth image, got {depth.dtype}")
    return np.where(depth == NO_READING, 0, depth).astype(np.uint16)


def _camera_matrix(folder: Path, config: SourceConfig) -> tuple[Float64Array, Path]:
    """The camera matrix, and the file or folder that it is of: configured, in a file, or that of 7-Scenes."""
    file = _intrinsics_file(folder)
    if config.intrinsics is None and file is not None:
        return _read_intrinsics(file), file
    lists = folder.resolve().parent
    focal = SEVEN_SCENES if any((lists / name).is_file() for name in SEVEN_SCENES_LISTS) else None
    focal = config.intrinsics or focal
    if focal is None:
        raise InputError(
            f"{folder}: expected {INTRINSICS_FILE} there or one folder higher: write it, or set "
            "source.intrinsics=[fx,fy,cx,cy] (7-Scenes: [585,585,320,240])"
        )
    fx, fy, cx, cy = focal
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], np.float64), folder


def _read_intrinsics(file: Path) -> Float64Array:
    K = _matrix(read_bytes(file, 2**16), 3, str(file))
    expected = np.array([[K[0, 0], 0, K[0, 2]], [0, K[1, 1], K[1, 2]], [0, 0, 1]])
    if not np.array_equal(K, expected):
        raise InputError(f"{file}: expected rows fx 0 cx, 0 fy cy, 0 0 1; got {K.tolist()}")
    return K


def _matrix(content: bytes, size: int, name: str) -> Float64Array:
    if (count := len(content.split())) != size * size:
        raise InputError(f"{name}: expected {size} rows of {size} numbers, got {count} words")
    return parse_table(content, size, size, name)


def _camera(K: Float64Array, width: int, height: int, file: Path) -> Intrinsics:
    try:
        return Intrinsics.from_matrix(K, width, height).centered()
    except InvalidValueError as error:
        raise InputError(f"{file}: {error}") from error


def _color_file(folder: Path, name: str) -> Path:
    jpeg = folder / f"{name}.color.jpg"
    return jpeg if jpeg.is_file() else folder / f"{name}.color.png"


def _frame_names(folder: Path) -> list[tuple[str, int]]:
    """Names and numbers of the frames of which any file is there, in order of number."""
    try:
        found = [FRAME_FILE.fullmatch(file.name) for file in folder.iterdir()]
    except OSError as error:
        raise InputError(f"cannot list {folder}: {error.strerror}") from error
    return sorted({(m[1], int(m[2])) for m in found if m}, key=lambda frame: frame[1])


def _candidates(path: Path) -> list[Path]:
    if not path.is_dir():
        return []
    return [path, *sorted(f for f in path.glob("seq-*") if f.is_dir())]


def _sequence_folder(path: Path) -> Path:
    with_frames = [folder for folder in _candidates(path) if _frame_names(folder)]
    if not with_frames:
        raise InputError(f"{path}: expected files such as frame-000000.depth.png, found none")
    if with_frames[0] != path and len(with_frames) > 1:
        names = ", ".join(folder.name for folder in with_frames)
        raise InputError(f"{path} holds several sequences, each with its own world; name one of {names}")
    return with_frames[0]


def _intrinsics_file(folder: Path) -> Path | None:
    for file in (folder / INTRINSICS_FILE, folder.resolve().parent / INTRINSICS_FILE):
        if file.is_file():
            return file
    return None
