"""Our own folder layout: what one writes by hand in a minute, and what `swardmap record` writes.

    RECORDING/camera.yaml         width, height, fx, fy, cx, cy, depth_unit_m; optional classes, tags
    RECORDING/rgb/NAME.png        8-bit colour, .png or .jpg
    RECORDING/depth/NAME.png      16-bit depth, or .tif or .npy of uint16 or float32
    RECORDING/poses.txt           optional: NAME stamp_ns tx ty tz qx qy qz qw, the pose T_map_camera
    RECORDING/labels/NAME.png     optional: 8-bit true class ids
    RECORDING/exact/              optional: the same recording with exact depth, for evaluations
    RECORDING/instances/, ...     optional: which thing each pixel is, and the true ground (see `truth`)

Frames are taken in the order of poses.txt, or of their names if there is none. See docs/recordings.md.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.config import SourceConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.door import parse_yaml, reading
from swardmap.io.files import inside, read_bytes, write_bytes, write_text
from swardmap.io.folders import new_output_folder
from swardmap.io.images import DEPTH_SUFFIXES, encode_png, read_color, read_depth, read_mask
from swardmap.io.sources.source import Source, Tally
from swardmap.io.sources.truth import read_truth
from swardmap.io.text_lines import numbered_lines
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelClass, LabelSet
from swardmap.types import Frame

CAMERA_FILE, POSES_FILE = "camera.yaml", "poses.txt"
COLOR_SUFFIXES = (".png", ".jpg", ".jpeg")
PERIOD_NS = 100_000_000
"""Time between frames of a recording without stamps."""


@dataclass(frozen=True, slots=True)
class FolderEntry:
    """One frame by name: its stamp, and its pose if the recording has one for it."""

    name: str
    stamp_ns: int
    T_map_camera: Pose | None


@dataclass(frozen=True, slots=True)
class FolderCamera:
    """What camera.yaml holds."""

    intrinsics: Intrinsics
    depth_unit_m: float
    label_set: LabelSet
    tags: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder in our layout."""

    path: Path
    camera: FolderCamera
    has_labels: bool

    def frames(self, entries: list[FolderEntry], tally: Tally) -> Iterator[Frame]:
        """The frames listed; one whose files are missing is counted."""
        for entry in entries:
            color = _file_of(self.path / "rgb", entry.name, COLOR_SUFFIXES)
            depth = _file_of(self.path / "depth", entry.name, DEPTH_SUFFIXES)
            if color is None or depth is None:
                part = "colour" if color is None else "depth"
                tally.skip(f"no {part} image", f"frame {entry.name} has no {part} image")
                continue
            yield self._read(entry, color, depth)

    def clean_frame(self, entry: FolderEntry) -> Frame | None:
        """A frame with the exact depth of the folder `exact`; None if there is none."""
        exact = self.path / "exact"
        color = _file_of(self.path / "rgb", entry.name, COLOR_SUFFIXES)
        depth = _file_of(exact / "depth", entry.name, DEPTH_SUFFIXES)
        if color is None or depth is None:
            return None
        unit = _read_camera(exact / CAMERA_FILE, None).depth_unit_m
        return replace(self._read(entry, color, depth), depth_unit_m=unit)

    def _read(self, entry: FolderEntry, color: Path, depth: Path) -> Frame:
        camera = self.camera
        labels = _file_of(self.path / "labels", entry.name, (".png",)) if self.has_labels else None
        try:
            return Frame(
                stamp_ns=entry.stamp_ns,
                intrinsics=camera.intrinsics,
                rgb=read_color(color),
                depth=read_depth(depth),
                depth_unit_m=camera.depth_unit_m,
                T_map_camera=entry.T_map_camera,
                labels=None if labels is None else read_mask(labels),
                label_set=None if labels is None else camera.label_set,
                name=entry.name,
                tags=camera.tags,
            )
        except InvalidValueError as error:
            raise InputError(f"{self.path}: {error}") from error


def recognises(path: Path) -> bool:
    """Whether `path` is a folder with a camera.yaml."""
    return (path / CAMERA_FILE).is_file()


def open_source(path: Path, config: SourceConfig) -> Source:
    """Open a folder in our layout.

    Raises:
        InputError: if a part is missing or does not hold together.
    """
    camera = _read_camera(path / CAMERA_FILE, config.depth_unit_m)
    for part in ("rgb", "depth"):
        if not (path / part).is_dir():
            raise InputError(
                f"{path}: expected a folder {part}/ beside {CAMERA_FILE}; see docs/recordings.md"
            )
    names = _names(path / "rgb", COLOR_SUFFIXES) | _names(path / "depth", DEPTH_SUFFIXES)
    entries = [FolderEntry(name, i * PERIOD_NS, None) for i, name in enumerate(sorted(names))]
    if (path / POSES_FILE).is_file():
        entries = _read_poses(path / POSES_FILE)
        listed = {entry.name for entry in entries}
        if names - listed:
            raise InputError(
                f"{path / POSES_FILE}: {len(names - listed)} frames have no line, such as "
                f"'{min(names - listed)}'; write 'NAME stamp_ns' alone for a frame without a pose"
            )
    chosen = entries[config.start : config.stop : config.every]
    folder = Folder(path, camera, has_labels=(path / "labels").is_dir())
    label_set = camera.label_set if folder.has_labels else None
    return Source(
        path.resolve().name,
        len(chosen),
        label_set,
        partial(folder.frames, chosen),
        clean_frame=lambda position: folder.clean_frame(chosen[position]),
        truth=lambda position: read_truth(path, chosen[position].name),
    )


def write_folder(frames: Iterable[Frame], path: str | Path, overwrite: bool = False) -> int:
    """Write frames in our layout; `path` appears complete at the end, or not at all.

    Args:
        frames: of one camera: same intrinsics, depth unit and classes.
        path: the new folder.
        overwrite: replace it if swardmap made it.

    Returns:
        Number of frames written.

    Raises:
        OutputError: if it cannot be written.
        InvalidValueError: if frames differ in their camera, or two have the same name.
    """
    with new_output_folder(path, overwrite, "recording") as folder:
        first: Frame | None = None
        lines: dict[str, str] = {}
        for index, frame in enumerate(frames):
            first = first or frame
            name = frame.name or f"{index:06d}"
            _check_same_camera(first, frame)
            if name in lines:
                raise InvalidValueError(f"expected each frame name once, got '{name}' twice")
            lines[name] = _pose_line(name, frame)
            write_bytes(inside(folder / "rgb", f"{name}.png"), encode_png(frame.rgb), durable=False)
            _write_depth(folder / "depth", name, frame)
            if frame.labels is not None:
                write_bytes(folder / "labels" / f"{name}.png", encode_png(frame.labels), durable=False)
        if first is None:
            raise InvalidValueError(f"no frame to write into {path}")
        write_text(folder / CAMERA_FILE, _camera_yaml(first))
        head = "# name stamp_ns tx ty tz qx qy qz qw (T_map_camera; metres; none = no pose)\n"
        write_text(folder / POSES_FILE, head + "".join(lines.values()))
    return len(lines)


def same_camera(one: Frame, two: Frame) -> bool:
    """Whether two frames can stand in one folder: of one lens, size, depth unit and type."""
    return _camera_of(one) == _camera_of(two)


def _camera_of(frame: Frame) -> tuple[Any, ...]:
    return frame.intrinsics, frame.depth_unit_m, frame.depth.dtype


def _check_same_camera(first: Frame, frame: Frame) -> None:
    if not same_camera(first, frame):
        raise InvalidValueError(
            f"frame {frame.name}: expected the camera of the first frame, {_camera_of(first)}, "
            f"got {_camera_of(frame)}"
        )


def _write_depth(folder: Path, name: str, frame: Frame) -> None:
    if frame.depth.dtype == np.uint16:
        write_bytes(folder / f"{name}.png", encode_png(frame.depth), durable=False)
        return
    from io import BytesIO

    buffer = BytesIO()
    np.save(buffer, frame.depth, allow_pickle=False)
    write_bytes(folder / f"{name}.npy", buffer.getvalue(), durable=False)


def _pose_line(name: str, frame: Frame) -> str:
    if len(name.split()) != 1 or name.startswith("#"):
        raise InvalidValueError(f"frame name: expected a word without spaces, got '{name}'")
    if frame.T_map_camera is None:
        return f"{name} {frame.stamp_ns}\n"
    from scipy.spatial.transform import Rotation

    pose = frame.T_map_camera
    quaternion = Rotation.from_matrix(pose.matrix[:3, :3]).as_quat()
    numbers = " ".join(repr(float(v)) for v in (*pose.position_m, *quaternion))
    return f"{name} {frame.stamp_ns} {numbers}\n"


def _camera_yaml(frame: Frame) -> str:
    import yaml

    k = frame.intrinsics
    tree: dict[str, Any] = {name: getattr(k, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    tree["depth_unit_m"] = frame.depth_unit_m
    if frame.label_set is not None:
        tree["classes"] = [
            {"id": c.id, "name": c.name, "role": str(c.role), "color": list(c.color)}
            for c in frame.label_set.classes
        ]
    if frame.tags:
        tree["tags"] = dict(frame.tags)
    return yaml.safe_dump(tree, sort_keys=False, default_flow_style=None)


def _read_camera(file: Path, depth_unit_m: float | None) -> FolderCamera:

    tree = parse_yaml(read_bytes(file, 2**20), file)
    if not isinstance(tree, dict):
        raise InputError(f"{file}: expected keys width, height, fx, fy, cx, cy; got {type(tree).__name__}")
    with reading(file, "a camera"):
        size = [int(tree[key]) for key in ("width", "height")]
        focal = (float(tree[key]) for key in ("fx", "fy", "cx", "cy"))
        intrinsics = Intrinsics(*size, *focal).centered("write those of images of this size")
        unit = float(tree.get("depth_unit_m", 0.001)) if depth_unit_m is None else depth_unit_m
        classes = tuple(
            LabelClass(int(c["id"]), str(c["name"]), c["role"], tuple(int(v) for v in c["color"]))  # type: ignore[arg-type]
            for c in tree.get("classes", ())
        )
        label_set = LabelSet(classes) if classes else GRASS_OBSTACLE_PERSON
        tags = {str(key): str(value) for key, value in dict(tree.get("tags", {})).items()}
    return FolderCamera(intrinsics, unit, label_set, tags)


def _read_poses(file: Path) -> list[FolderEntry]:
    entries: list[FolderEntry] = []
    names = set[str]()
    for number, words in numbered_lines(file):
        with reading(f"{file}, line {number}", "a frame"):
            entry = _entry(words)
        if entry.name in names or (entries and entry.stamp_ns < entries[-1].stamp_ns):
            what = "the same name twice" if entry.name in names else "a clock that goes back"
            raise InputError(f"{file}, line {number}: expected frames in order of time, got {what}")
        entries.append(entry)
        names.add(entry.name)
    return entries


def _entry(words: list[str]) -> FolderEntry:
    if len(words) not in (2, 9):
        raise InvalidValueError(f"expected 'name stamp_ns [tx ty tz qx qy qz qw]', got {len(words)} words")
    name, stamp_ns = words[0], int(words[1])
    inside(Path(), name)
    if len(words) == 2:
        return FolderEntry(name, stamp_ns, None)
    numbers = [float(word) for word in words[2:]]
    return FolderEntry(name, stamp_ns, Pose.from_quaternion("map", "camera", numbers[:3], numbers[3:]))


def _names(folder: Path, suffixes: tuple[str, ...]) -> set[str]:
    try:
        return {file.stem for file in folder.iterdir() if file.suffix.lower() in suffixes}
    except OSError as error:
        raise InputError(f"cannot list {folder}: {error.strerror}") from error


def _file_of(folder: Path, name: str, suffixes: tuple[str, ...]) -> Path | None:
    for suffix in suffixes:
        for file in (folder / (name + suffix), folder / (name + suffix.upper())):
            if file.is_file():
                return file
    return None
