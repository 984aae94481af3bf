"""The few array-carrying types that every stage speaks; frozen, and validated when built."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import FrameMismatchError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose, transform_points
from swardmap.labels import VOID_ID, LabelSet, MapClass

MIN_DEPTH_UNIT_M, MAX_DEPTH_UNIT_M = 1e-6, 1.0
"""Of cameras; what lies beyond is units a metre by mistake, or does not fit into float32."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One aligned RGB-D image pair: pixel (u, v) of the colour image is pixel (u, v) of the depth.

    Attributes:
        stamp_ns: time of the colour image, integer nanoseconds.
        intrinsics: of both images.
        rgb: (H, W, 3) uint8, RGB.
        depth: (H, W) along the optical axis; uint16 in units of `depth_unit_m`, 0 = no reading, or
            float32 in metres, where 0, NaN and infinity mean no reading (REP-118).
        depth_unit_m: metres per unit of a uint16 depth image; 1 for float32.
        T_map_camera: pose of the optical frame when the image was taken, as a Pose, or as a (4, 4) matrix
            that becomes one; None if the source knows none (then each frame is mapped on its own, by the
            configured mount).
        labels: (H, W) uint8 true classes in ids of `label_set`, when the source has them.
        label_set: classes of `labels`.
        name: what a person would call this frame: file stem or index.
        depth_filtered: whether the source took flying pixels out of depth as it came from the sensor, before
            it aligned it: after that they cannot be told any more.
        tags: fields to group by, such as scene, illumination, sequence.
    """

    stamp_ns: int
    intrinsics: Intrinsics
    rgb: NDArray[np.uint8]
    depth: NDArray[np.uint16] | NDArray[np.float32]
    depth_unit_m: float = 0.001
    T_map_camera: Pose | None = None
    labels: NDArray[np.uint8] | None = None
    label_set: LabelSet | None = None
    name: str = ""
    tags: Mapping[str, str] = field(default_factory=dict)
    depth_filtered: bool = False

    def __post_init__(self) -> None:
        size = (self.intrinsics.height, self.intrinsics.width)
        who = f"frame {self.name or self.stamp_ns}"
        _check_array(f"{who}: rgb", self.rgb, (*size, 3), (np.uint8,))
        _check_array(f"{who}: depth", self.depth, size, (np.uint16, np.float32))
        if not MIN_DEPTH_UNIT_M <= self.depth_unit_m <= MAX_DEPTH_UNIT_M:
            raise InvalidValueError(
                f"{who}: expected a positive depth unit in metres (0.001 for millimetres), "
                f"got {self.depth_unit_m}"
            )
        object.__setattr__(self, "T_map_camera", _pose_of(who, self.T_map_camera))
        if self.depth.dtype == np.float32:
            object.__setattr__(self, "depth_unit_m", 1.0)
        if self.labels is not None:
            _check_array(f"{who}: labels", self.labels, size, (np.uint8,))
            if self.label_set is None:
                raise InvalidValueError(f"{who}: labels need a label_set that names their ids")

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """(H, W) float32 metres, NaN = no reading."""
        return depth_in_metres(self.depth, self.depth_unit_m)

    def with_pose(self, T_map_camera: Pose) -> "Frame":
        """The same frame seen from another pose."""
        return replace(self, T_map_camera=T_map_camera)


@dataclass(frozen=True, slots=True, eq=False)
class Segmentation:
    """Classes of an image, at the size the network gives (Sec. 3.3).

    Attributes:
        labels: (h, w) uint8 ids of `label_set`; void (255) where nothing is known.
        label_set: what the ids mean.
        confidence: (h, w) float32 probability of the class given, or None if the segmenter has none.
        hazard: (h, w) uint8 P(obstacle or person) in 255ths, or None: it then follows from the label and its
            confidence (`hazard_255`).
        unfamiliar: how far the image is from those that the segmenter knows, 1 = as far as it may be; None if
            the segmenter cannot tell.
    """

    labels: NDArray[np.uint8]
    label_set: LabelSet
    confidence: NDArray[np.float32] | None = None
    hazard: NDArray[np.uint8] | None = None
    unfamiliar: float | None = None

    def __post_init__(self) -> None:
        shape = self.labels.shape
        if len(shape) != 2 or 0 in shape:
            raise InvalidValueError(f"segmentation: expected labels of shape (h, w), got {shape}")
        _check_array("segmentation: labels", self.labels, shape, (np.uint8,))
        if self.confidence is not None:
            _check_array("segmentation: confidence", self.confidence, shape, (np.float32,))
        if self.hazard is not None:
            _check_array("segmentation: hazard", self.hazard, shape, (np.uint8,))
        if self.unfamiliar is not None and (math.isnan(self.unfamiliar) or self.unfamiliar < 0):
            raise InvalidValueError(
                f"segmentation: expected unfamiliar of 0 or more, or None, got {self.unfamiliar}"
            )

    @property
    def map_classes(self) -> NDArray[np.uint8]:
        """(h, w) uint8 MapClass of each pixel."""
        return self.label_set.map_class_table[self.labels]

    @property
    def hazard_255(self) -> NDArray[np.uint8]:
        """(h, w) uint8 P(obstacle or person) in 255ths, whoever says it.

        Where the segmenter gives none: all of it for what is called obstacle or person; for what is called
        grass all that its confidence leaves over, for that may be anything.
        """
        if self.hazard is not None:
            return self.hazard
        hard = np.where(self.map_classes >= MapClass.OBSTACLE, np.uint8(255), np.uint8(0))
        if self.confidence is None:
            return hard
        left = 1 - np.nan_to_num(self.confidence.astype(np.float64), nan=0.0)
        return np.maximum(hard, np.clip(np.rint(255 * left), 0, 255).astype(np.uint8))

    def is_unfamiliar(self, limit: float | None) -> bool:
        """Whether the image is none that the segmenter knows; never if it cannot tell, or without a limit."""
        return limit is not None and self.unfamiliar is not None and self.unfamiliar > limit

    def unsure(self, threshold: float, limit: float | None = None) -> NDArray[np.bool_] | None:
        """(h, w) bool: grass that is not called so with `threshold`; None = there is none.

        Of an image that is unfamiliar by `limit` all grass is. Doubt never takes away what is called obstacle
        or person.
        """
        if not self.may_be_unsure(threshold, limit):
            return None
        grass = self.map_classes == MapClass.GRASS
        if self.confidence is None or self.is_unfamiliar(limit):
            return np.asarray(grass)
        sure = self.confidence >= np.float32(threshold)  # NaN compares false: not sure
        return np.asarray(grass & ~sure)

    def may_be_unsure(self, threshold: float, limit: float | None = None) -> bool:
        """Whether `unsure` has to look at the pixels; a confidence that is no number is never sure."""
        if self.is_unfamiliar(limit):
            return True
        return self.confidence is not None and (threshold > 0 or bool(np.isnan(self.confidence).any()))

    def confident(self, threshold: float, limit: float | None = None) -> "Segmentation":
        """The same masks with every pixel of grass that is `unsure` set to void: not seen, never free."""
        unsure = self.unsure(threshold, limit)
        if unsure is None:
            return self
        return replace(self, labels=np.where(unsure, np.uint8(VOID_ID), self.labels))

    def resized_to(self, height: int, width: int) -> "Segmentation":
        """Masks at another size: nearest neighbour by floor(i * h / height) (docs/conventions.md)."""
        if self.labels.shape == (height, width):
            return self
        rows = nearest_indices(height, self.labels.shape[0])[:, None]
        columns = nearest_indices(width, self.labels.shape[1])[None, :]
        confidence = None if self.confidence is None else self.confidence[rows, columns]
        hazard = None if self.hazard is None else self.hazard[rows, columns]
        return Segmentation(self.labels[rows, columns], self.label_set, confidence, hazard, self.unfamiliar)


@dataclass(frozen=True, slots=True, eq=False)
class LabeledCloud:
    """Points with a class: the paper's XYZL cloud (Sec. 3.4), as parallel arrays.

    Attributes:
        xyz: (N, 3) float32 metres in `frame_id`, all finite.
        labels: (N,) uint8 ids of `label_set`.
        frame_id: name of the coordinate frame.
        label_set: what the ids mean.
        stamp_ns: time of the measurement.
    """

    xyz: NDArray[np.float32]
    labels: NDArray[np.uint8]
    frame_id: str
    label_set: LabelSet
    stamp_ns: int = 0

    def __post_init__(self) -> None:
        count = len(self.xyz)
        _check_array("cloud: xyz", self.xyz, (count, 3), (np.float32,))
        _check_array("cloud: labels", self.labels, (count,), (np.uint8,))

    def __len__(self) -> int:
        return len(self.xyz)

    def __getitem__(self, index: slice | NDArray[np.bool_] | NDArray[np.integer]) -> "LabeledCloud":
        """Points chosen by one mask or index for every field."""
        return replace(self, xyz=self.xyz[index], labels=self.labels[index])

    def transformed(self, T_parent_cloud: Pose) -> "LabeledCloud":
        """The same points in the pose's parent frame (float32, in the kernel's order of operations).

        Raises:
            FrameMismatchError: if the pose's child is not this cloud's frame.
        """
        if T_parent_cloud.child != self.frame_id:
            raise FrameMismatchError(
                f"cloud is in '{self.frame_id}', the pose takes '{T_parent_cloud.child}' "
                f"to '{T_parent_cloud.parent}'"
            )
        xyz = transform_points(self.xyz, T_parent_cloud)
        return replace(self, xyz=xyz, frame_id=T_parent_cloud.parent)


def depth_in_metres(
    depth: NDArray[np.uint16] | NDArray[np.float32], depth_unit_m: float
) -> NDArray[np.float32]:
    """Depth as float32 metres with NaN for every kind of "no reading" (0, negative, NaN, infinite)."""
    if depth.dtype == np.uint16:
        metres = depth.astype(np.float32) * np.float32(depth_unit_m)
        return np.where(depth > 0, metres, np.float32(np.nan))
    valid = np.isfinite(depth) & (depth > 0)
    return np.where(valid, depth, np.float32(np.nan)).astype(np.float32)


def nearest_indices(size_out: int, size_in: int) -> NDArray[np.intp]:
    """Source index of each output index for nearest resampling: floor(i * size_in / size_out).

    Exact integers: OpenCV's INTER_NEAREST and INTER_NEAREST_EXACT differ from it and each other.

    >>> nearest_indices(5, 2).tolist()
    [0, 0, 0, 1, 1]
    """
    return (np.arange(size_out) * size_in) // size_out


def _pose_of(who: str, given: object) -> Pose | None:
    if given is None or isinstance(given, Pose):
        return given
    try:
        return Pose("map", "camera", np.asarray(given, np.float64))
    except (TypeError, ValueError) as error:
        raise InvalidValueError(
            f"{who}: T_map_camera: expected a Pose, a rigid 4x4 matrix or None, "
            f"got {type(given).__name__} ({error})"
        ) from error


def _check_array(
    what: str, array: object, shape: tuple[int, ...], dtypes: tuple[type[np.generic], ...]
) -> None:
    names = " or ".join(np.dtype(d).name for d in dtypes)
    if not isinstance(array, np.ndarray):
        raise InvalidValueError(f"{what}: expected a {names} array, got {type(array).__name__}")
    if array.shape != shape or array.dtype not in [np.dtype(d) for d in dtypes]:
        raise InvalidValueError(
            f"{what}: expected {names} of shape {shape}, got {array.dtype} of shape {array.shape}"
        )
