"""EDEN, the synthetic gardens of the paper (Sec. 4.1.1), left camera; also written in this layout.

    ROOT/RGB/SCENE/LIGHT/FRAME_L.png                  8-bit colour
    ROOT/Depth/SCENE/LIGHT/FRAME_L.mat                `Depth`, H x W x k, metres in channel 0
    ROOT/Segmentation/SCENE/LIGHT/FRAME_L_Sem.png     8-bit ids
    ROOT/cam_matrix/SCENE/LIGHT/FRAME.mat             `K_L` 3 x 3; `RT_L` 3 x 4, world to camera
    ROOT/label_table.yaml                             ours, optional: what the ids mean

SCENE has four digits, LIGHT is clear, cloudy, overcast, sunset or twilight. See docs/eden.md.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.config import SourceConfig
from swardmap.errors import InputError, InvalidValueError, OutputError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.clouds.mat_files import read_mat, write_mat
from swardmap.io.files import read_bytes, write_bytes, write_text
from swardmap.io.images import encode_png, read_color, read_mask
from swardmap.io.sources.eden_labels import LabelTable, label_table_yaml, read_label_table
from swardmap.io.sources.eden_layout import (
    CAMERA,
    DEPTH,
    LABEL_TABLE,
    LIGHTS,
    MODALITIES,
    RGB,
    SCENE,
    SEGMENTATION,
    EdenEntry,
    locate,
    scenes,
    stems_of,
)
from swardmap.io.sources.source import Source, Tally
from swardmap.labels import LabelSet
from swardmap.types import Frame

PERIOD_NS = 100_000_000
"""Time between frames; EDEN has no stamps."""

NO_COLOR, NO_DEPTH, NO_CAMERA = "no colour image", "no depth file", "no camera matrix"
NO_LABELS = "no segmentation; frame used without labels"
NO_POSE = "no RT_L in the camera matrix; frame used without a pose"
CAMERA_OF_TABLE = "no camera matrix; frame used with the camera of the label table"


@dataclass(frozen=True, slots=True)
class Eden:
    """EDEN's root: what its ids mean, and whether its poses are used."""

    root: Path
    table: LabelTable
    poses: bool
    has_labels: bool

    def frames(self, entries: list[EdenEntry], tally: Tally) -> Iterator[Frame]:
        """The frames listed; what is left out or done without is counted, so are pixels that mean nothing."""
        for entry in entries:
            missing = self._missing(entry)
            if missing:
                tally.skip(missing, f"frame {entry.name}: {missing}")
                continue
            try:
                yield self._read(entry, tally)
            except InvalidValueError as error:
                raise InputError(f"{self.root}, frame {entry.name}: {error}") from error

    def _missing(self, entry: EdenEntry) -> str | None:
        needed = {RGB: NO_COLOR, DEPTH: NO_DEPTH}
        if self.table.camera is None:
            needed[CAMERA] = NO_CAMERA
        reasons = (reason for part, reason in needed.items() if not entry.file(self.root, part).is_file())
        return next(reasons, None)

    def _read(self, entry: EdenEntry, tally: Tally) -> Frame:
        rgb = read_color(entry.file(self.root, RGB))
        intrinsics, T_map_camera = self._camera(entry, rgb.shape[1], rgb.shape[0], tally)
        labels = self._labels(entry, tally)
        return Frame(
            stamp_ns=entry.stamp_ns,
            intrinsics=intrinsics,
            rgb=rgb,
            depth=_read_depth(entry.file(self.root, DEPTH)),
            T_map_camera=T_map_camera,
            labels=labels,
            label_set=None if labels is None else self.table.label_set,
            name=entry.name,
            tags={"scene": entry.scene, "illumination": entry.light},
        )

    def _camera(
        self, entry: EdenEntry, width: int, height: int, tally: Tally
    ) -> tuple[Intrinsics, Pose | None]:
        file = entry.file(self.root, CAMERA)
        if not file.is_file() and self.table.camera is not None:
            tally.skip(CAMERA_OF_TABLE)
            return self.table.camera, None
        arrays = read_mat(file, ("K_L", "RT_L"))
        if "K_L" not in arrays or arrays["K_L"].shape != (3, 3):
            raise InputError(f"{file}: expected a 3 x 3 matrix K_L, got {_shape(arrays.get('K_L'))}")
        try:
            intrinsics = Intrinsics.from_matrix(arrays["K_L"], width, height).centered()
            if self.poses and "RT_L" in arrays:
                return intrinsics, _pose(arrays["RT_L"], file)
        except InvalidValueError as error:
            raise InputError(f"{file}: {error}") from error
        if self.poses:
            tally.skip(NO_POSE)
        return intrinsics, None

    def _labels(self, entry: EdenEntry, tally: Tally) -> NDArray[np.uint8] | None:
        if not self.has_labels:
            return None
        file = entry.file(self.root, SEGMENTATION)
        if not file.is_file():
            tally.skip(NO_LABELS)
            return None
        labels = read_mask(file)
        counts = np.bincount(labels.ravel(), minlength=256)
        counts[[c.id for c in self.table.label_set.classes]] = 0
        for undeclared in np.nonzero(counts)[0]:
            tally.skip(
                f"pixels of id {undeclared}, not in the label table: void", count=int(counts[undeclared])
            )
        return labels


def recognises(path: Path) -> bool:
    """Whether `path` is EDEN's root, or a modality, scene or light in it."""
    return locate(path) is not None


def open_source(path: Path, config: SourceConfig) -> Source:
    """Open EDEN, or one scene or one light of it; lists folders and opens no image.

    Poses are used only with `level` off: EDEN does not say which way is up in its world frame.

    Raises:
        InputError: if a part is missing or does not hold together.
    """
    located = locate(path)
    if located is None:
        raise InputError(
            f"{path}: expected EDEN's folders {RGB}/ and {DEPTH}/ with a scene of four digits and a light "
            f"({', '.join(LIGHTS)}) in them, or one of those; see docs/eden.md"
        )
    root, scene, light = located
    table = _label_table(root, config)
    sequences = [
        (s, li)
        for s in ([scene] if scene else scenes(root))
        for li in ([light] if light else LIGHTS)
        if any((root / part / s / li).is_dir() for part in (RGB, DEPTH))
    ]
    for s, li in sequences:
        if table.camera is None and not (root / CAMERA / s / li).is_dir():
            raise InputError(
                f"{root / CAMERA / s / li}: the camera matrices are missing. Unpack them there, or declare "
                "'camera: {width: 640, height: 480, fx: 640, fy: 640, cx: 320, cy: 240}' (public loaders of "
                "EDEN assume these) in a YAML file and name it with --set source.label_table=FILE"
            )
    stems = [(s, li, stem) for s, li in sequences for stem in stems_of(root, s, li)]
    if not stems:
        raise InputError(f"{path}: no frame found, neither {RGB}/.../*_L.png nor {DEPTH}/.../*_L.mat")
    entries = [EdenEntry(*parts, i * PERIOD_NS) for i, parts in enumerate(stems)]
    name = "-".join(filter(None, (root.name, scene, light)))
    chosen = entries[config.start : config.stop : config.every]
    eden = Eden(root, table, poses=not config.level, has_labels=(root / SEGMENTATION).is_dir())
    return Source(
        name, len(chosen), table.label_set if eden.has_labels else None, partial(eden.frames, chosen)
    )


def write_eden(
    frames: Iterable[Frame], path: str | Path, *, scene: str = "0000", illumination: str = "clear"
) -> int:
    """Write frames as one sequence in EDEN's layout; more calls add more sequences.

    Frames are numbered; stamps and names are not kept. Depth is written in metres as float32, labels
    with their own ids, and what these mean into `label_table.yaml`.

    Args:
        frames: of any sizes; with labels, all of the same label set.
        path: the root.
        scene: four digits.
        illumination: one of EDEN's five lights.

    Returns:
        Number of frames written.

    Raises:
        OutputError: if the sequence exists or cannot be written.
        InvalidValueError: for another scene or light, or label sets that differ.
    """
    root = Path(path)
    if not SCENE.fullmatch(scene) or illumination not in LIGHTS:
        raise InvalidValueError(
            f"expected a scene of four digits and a light of {', '.join(LIGHTS)}, "
            f"got '{scene}' and '{illumination}'"
        )
    for modality in MODALITIES:
        if (root / modality / scene / illumination).exists():
            raise OutputError(f"{root / modality / scene / illumination} exists: choose another folder")
    count = 0
    for count, frame in enumerate(frames, 1):
        if frame.labels is not None and frame.label_set is not None:
            _declare(root / LABEL_TABLE, frame.label_set)
        _write_frame(frame, root, EdenEntry(scene, illumination, f"{count:05d}", 0))
    if count == 0:
        raise InvalidValueError(f"no frame to write into {path}")
    return count


def _write_frame(frame: Frame, root: Path, entry: EdenEntry) -> None:
    depth = frame.depth if frame.depth.dtype == np.float32 else frame.depth_m
    arrays = {"K_L": frame.intrinsics.matrix}
    if frame.T_map_camera is not None:
        arrays["RT_L"] = frame.T_map_camera.inverse().matrix[:3]
    write_bytes(entry.file(root, RGB), encode_png(frame.rgb), durable=False)
    write_mat(entry.file(root, DEPTH), {"Depth": depth[..., None]})
    write_mat(entry.file(root, CAMERA), arrays)
    if frame.labels is not None:
        write_bytes(entry.file(root, SEGMENTATION), encode_png(frame.labels), durable=False)


def _declare(file: Path, label_set: LabelSet) -> None:
    if not file.exists():
        write_text(file, label_table_yaml(label_set))
    elif read_bytes(file).decode("utf-8", "replace") != label_table_yaml(label_set):
        raise InvalidValueError(f"{file} declares other classes than these frames: {label_set.names}")


def _label_table(root: Path, config: SourceConfig) -> LabelTable:
    if config.label_table is not None:
        return read_label_table(Path(config.label_table))
    return read_label_table(root / LABEL_TABLE) if (root / LABEL_TABLE).is_file() else LabelTable()


def _read_depth(file: Path) -> NDArray[np.float32]:
    depth = read_mat(file, ("Depth",)).get("Depth")
    if depth is None or depth.ndim not in (2, 3) or 0 in depth.shape:
        raise InputError(f"{file}: expected an array Depth, H x W x k in metres, got {_shape(depth)}")
    channel = depth if depth.ndim == 2 else depth[..., 0]
    with np.errstate(over="ignore"):  # too large for float32: infinity, no reading
        return np.ascontiguousarray(channel, np.float32)


def _pose(RT: NDArray[np.float64], file: Path) -> Pose:
    """T_map_camera of a world-to-camera matrix."""
    if RT.shape != (3, 4):
        raise InputError(f"{file}: expected a 3 x 4 matrix RT_L, got {_shape(RT)}")
    return Pose("camera", "map", np.vstack((RT, [0.0, 0.0, 0.0, 1.0]))).inverse()


def _shape(array: NDArray[np.generic] | None) -> str:
    return "nothing of that name" if array is None else f"shape {array.shape}"
