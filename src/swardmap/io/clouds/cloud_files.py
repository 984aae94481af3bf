"""Labelled clouds as files: PCD (XYZL), PLY, and SemanticKITTI's .bin + .label.

Files written here carry, in a comment, the frame, the stamp and the classes, so that they read back with
nothing lost and without a word about classes. For files of others the caller says what the ids mean.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError, OutputError
from swardmap.io.clouds import pcd, ply
from swardmap.io.clouds.bin_files import KITTI_POINT, find_labels, points_of_bin
from swardmap.io.door import parse_json, reading, through_door
from swardmap.io.files import read_bytes, write_bytes, write_together
from swardmap.labels import LabelClass, LabelSet, Role
from swardmap.types import LabeledCloud

LABEL_FIELDS = ("label", "labels", "class", "semantic", "classification", "scalar_label", "scalar_class")
"""Names under which programs store a label, in lower case."""

MAX_COORDINATE_M = 100_000.0
"""Beyond it float32 no longer resolves a centimetre."""


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """What a cloud file holds, before its ids mean anything.

    Attributes:
        xyz: (N, 3) float32, points without a reading (NaN, infinite) included.
        ids: (N,) int64 labels as in the file, or None if it has none.
        name: of the file, for messages.
        own: what swardmap wrote in its comment: frame_id, stamp_ns, classes.
    """

    xyz: NDArray[np.float32]
    ids: NDArray[np.int64] | None
    name: str
    own: Mapping[str, Any]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(N,) bool: points with a reading."""
        return np.asarray(np.isfinite(self.xyz).all(axis=1))


def write_cloud(cloud: LabeledCloud, path: str | Path, ascii_text: bool = False) -> None:
    """Write a cloud in the format of the suffix: .pcd, .ply, or .bin (and .label beside it).

    Args:
        cloud: the points.
        path: the file; .bin and .label keep neither frame nor classes.
        ascii_text: numbers as text, for PCD and PLY.

    Raises:
        OutputError: for another suffix, or if it cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".pcd":
        write_pcd(cloud, path, ascii_text)
    elif suffix == ".ply":
        write_ply(cloud, path, ascii_text)
    elif suffix == ".bin" and not ascii_text:
        points = _filled(cloud, KITTI_POINT).tobytes()
        labels = cloud.labels.astype("<u4").tobytes()
        write_together({path.with_suffix(".label"): labels, path: points})
    else:
        raise OutputError(f"{path}: expected a name ending in .pcd, .ply or .bin (.bin has no text form)")


def write_pcd(cloud: LabeledCloud, path: str | Path, ascii_text: bool = False) -> None:
    """Write a cloud as PCD v0.7: PCL's PointXYZL, packed."""
    write_bytes(path, pcd.encode_pcd(_filled(cloud, pcd.POINT), _own_comment(cloud), ascii_text))


def write_ply(cloud: LabeledCloud, path: str | Path, ascii_text: bool = False) -> None:
    """Write a cloud as PLY: x y z, the class colour, and the label."""
    write_bytes(path, ply.encode_ply(_filled(cloud, ply.POINT), _own_comment(cloud), ascii_text))


@through_door("a labelled cloud")
def read_cloud(
    path: str | Path,
    label_set: LabelSet | None = None,
    names: Mapping[int, str] | None = None,
    frame_id: str | None = None,
    unlabeled: str | None = None,
) -> LabeledCloud:
    """Read a labelled cloud (.pcd, .ply, or .bin with its .label); points without a reading are left out.

    Args:
        path: the file.
        label_set: classes to express the labels in; None = those written in the file.
        names: id in the file -> name in `label_set`; None = by the file's own classes, or the same ids.
        frame_id: frame of the points; None = the one written in the file, else "map".
        unlabeled: class of every point of a file without labels.

    Raises:
        InputError: if it cannot be read, has no labels, or has ids that mean nothing.
    """
    points = read_points(path)
    return label_points(points, label_set, names, frame_id, unlabeled)


@through_door("a cloud")
def read_points(path: str | Path, point_floats: int | None = None) -> Points:
    """Read a cloud file as it is, every point kept.

    Args:
        path: the file.
        point_floats: of a `.bin`: numbers a point, 4 (SemanticKITTI) or 5 (nuScenes); None = by its content.

    Raises:
        InputError: if it cannot be read.
    """
    path = Path(path)
    content = read_bytes(path)
    suffix = path.suffix.lower()
    if suffix == ".bin":
        return read_bin(content, path, point_floats)
    if suffix not in (".pcd", ".ply"):
        raise InputError(f"{path}: expected a name ending in .pcd, .ply or .bin")
    decode = pcd.decode_pcd if suffix == ".pcd" else ply.decode_ply
    array, comment = decode(content, str(path))
    fields = {name.lower(): name for name in array.dtype.names or ()}
    missing = [axis for axis in "xyz" if axis not in fields or array[fields[axis]].ndim != 1]
    if missing:
        raise InputError(f"{path}: expected fields x, y and z, got: {', '.join(fields) or 'none'}")
    xyz = np.stack([_as_float32(array[fields[axis]], path) for axis in "xyz"], axis=1)
    label = next((fields[name] for name in LABEL_FIELDS if name in fields), None)
    ids = None if label is None else _as_ids(array[label], path)
    return Points(xyz, ids, str(path), _parse_own(comment))


def label_points(
    points: Points,
    label_set: LabelSet | None = None,
    names: Mapping[int, str] | None = None,
    frame_id: str | None = None,
    unlabeled: str | None = None,
) -> LabeledCloud:
    """Give the ids of a cloud file a meaning. See `read_cloud`."""
    own_set = _own_classes(points)
    target = label_set or own_set
    if target is None:
        raise InputError(f"{points.name}: the file does not say what its ids mean: pass a label set")
    valid = points.valid
    if points.ids is None:
        if unlabeled is None:
            raise InputError(
                f"{points.name}: the cloud has no labels; expected a field 'label', or beside a .bin, or "
                "in a folder beside its own, the .label of its name"
            )
        labels = np.full(int(valid.sum()), target[unlabeled].id, np.uint8)
    else:
        labels = _translated(points.ids[valid], target, own_set, names, points.name)
    stamp_ns, frame = points.own.get("stamp_ns", 0), points.own.get("frame_id", "map")
    if not isinstance(stamp_ns, int) or not isinstance(frame, str):
        raise InputError(f"{points.name}: damaged comment: stamp_ns {stamp_ns!r}, frame_id {frame!r}")
    return LabeledCloud(points.xyz[valid], labels, frame_id or frame, target, stamp_ns)


def _translated(
    ids: NDArray[np.int64],
    target: LabelSet,
    own_set: LabelSet | None,
    names: Mapping[int, str] | None,
    name: str,
) -> NDArray[np.uint8]:
    """Ids of a file as ids of `target`; every id that occurs must mean something."""
    if names is not None:
        table = {i: target[class_name].id for i, class_name in names.items()}
    elif own_set is not None:
        remap = own_set.remap_table(target)
        table = {c.id: int(remap[c.id]) for c in own_set.classes}
    else:
        table = {c.id: c.id for c in target.classes}
    found, positions = np.unique(ids, return_inverse=True)
    strange = [int(i) for i in found if int(i) not in table]
    if strange:
        raise InputError(
            f"{name}: nobody says what the label ids {_shortened(strange)} mean; "
            f"known: {_shortened(sorted(table))}"
        )
    values = np.array([table[int(i)] for i in found], np.uint8)
    return values[positions.reshape(-1)]


def read_bin(content: bytes, path: Path, point_floats: int | None = None) -> Points:
    """Points of a `.bin` and, where there are any, their labels: the class is in the low 16 bits."""
    label_file = find_labels(path)
    packed = None if label_file is None else read_bytes(label_file)
    xyz = points_of_bin(content, str(path), point_floats, None if packed is None else len(packed) // 4)
    if packed is None:
        return Points(xyz, None, str(path), {})
    if len(packed) != 4 * len(xyz):
        raise InputError(f"{label_file}: expected {4 * len(xyz)} bytes for {path}, got {len(packed)}")
    return Points(xyz, (np.frombuffer(packed, "<u4") & 0xFFFF).astype(np.int64), str(path), {})


def _filled(cloud: LabeledCloud, point: np.dtype[np.void]) -> NDArray[np.void]:
    array = np.zeros(len(cloud), point)
    values: dict[str, NDArray[Any]] = {axis: cloud.xyz[:, i] for i, axis in enumerate("xyz")}
    colors = cloud.label_set.color_table[cloud.labels]
    values |= {color: colors[:, i] for i, color in enumerate(("red", "green", "blue"))}
    values["label"] = cloud.labels
    for name in point.names or ():
        if name in values:
            array[name] = values[name]
    return array


def _own_comment(cloud: LabeledCloud) -> str:
    classes = [[c.id, c.name, c.role.value, list(c.color)] for c in cloud.label_set.classes]
    return json.dumps({"frame_id": cloud.frame_id, "stamp_ns": int(cloud.stamp_ns), "classes": classes})


def _parse_own(comment: str) -> Mapping[str, Any]:
    try:
        own: Mapping[str, Any] = parse_json(comment or "{}", "comment", dict)
    except InputError:  # somebody else's
        return {}
    return own


def _own_classes(points: Points) -> LabelSet | None:
    if "classes" not in points.own:
        return None
    with reading(points.name, "a list of classes in its comment"):
        return LabelSet(
            tuple(
                LabelClass(int(i), str(name), Role(role), (int(r), int(g), int(b)))
                for i, name, role, (r, g, b) in points.own["classes"]
            )
        )


def _as_float32(values: NDArray[Any], path: Path) -> NDArray[np.float32]:
    if values.dtype != np.float32:
        largest = np.abs(values[np.isfinite(values)], dtype=np.float64).max(initial=0)
        if largest > MAX_COORDINATE_M:
            raise InputError(
                f"{path}: a coordinate of {largest:.0f} m loses centimetres in float32: "
                "subtract an offset first (UTM coordinates?)"
            )
    with np.errstate(over="ignore"):
        return values.astype(np.float32)


def _as_ids(values: NDArray[Any], path: Path) -> NDArray[np.int64]:
    if values.ndim != 1:
        raise InputError(f"{path}: expected one label for each point, got several")
    if values.dtype.kind == "f":
        whole = np.nan_to_num(np.rint(values), nan=-1, posinf=-1, neginf=-1)
        whole = np.where((values == whole) & (np.abs(whole) < 2**31), whole, -1)
        return whole.astype(np.int64)
    if values.dtype == np.uint64:  # what int64 cannot hold must not come back as another id
        values = np.minimum(values, np.uint64(2**63 - 1))
    return values.astype(np.int64)


def _shortened(ids: list[int]) -> str:
    return ", ".join(map(str, ids[:12])) + (", ..." if len(ids) > 12 else "")
