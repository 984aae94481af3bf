"""The truth of a frame: every pixel by its true label and its height above the true ground (Sec. 4.3).

The ground is the one that the data set recorded; elsewhere it is fitted to the pixels that are truly
lawn. So the truth depends on nothing that is to be judged. What limits of range and height leave out of
it is counted.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.geometry import Pose, deproject, transform_points
from swardmap.grid import GridSpec, OccupancyGrid, classify_cells
from swardmap.io.sources.truth import FrameTruth, GroundRaster
from swardmap.labels import LabelSet, MapClass
from swardmap.types import Frame, Segmentation

TEXEL_M = 0.25
"""Of a ground that is fitted."""
FEWEST_LAWN_PIXELS = 50
"""Of true lawn that a ground is fitted to."""


@dataclass(frozen=True, slots=True, eq=False)
class TruePixels:
    """The pixels of a frame that have a reading within the range.

    Attributes:
        shape: (H, W) of the image.
        index: (N,) int64 flat place in the image.
        xyz_m: (N, 3) float32 in the frame of the camera.
        T_map_camera: pose that they are placed by.
        height_m: (N,) float64 above the true ground; above the map's z = 0 where no ground is known.
        away_m: (N,) float64 horizontal distance from the camera.
        judged: (N,) bool, within the height limits.
        ground: where the ground is from: `recorded`, `fitted`, or `map` (nobody knows it).
        out_of_range: (M,) int64 flat places of pixels with a reading nearer or farther than the range.
    """

    shape: tuple[int, int]
    index: NDArray[np.int64]
    xyz_m: NDArray[np.float32]
    T_map_camera: Pose
    height_m: NDArray[np.float64]
    away_m: NDArray[np.float64]
    judged: NDArray[np.bool_]
    ground: str
    out_of_range: NDArray[np.int64]

    def cells(self, spec: GridSpec) -> NDArray[np.int64]:
        """(N,) flat cell of each pixel, within the height limits or not; -1 beside the grid.

        In float32 and in the order of the pipeline, so that both put a pixel into the same cell.
        """
        renamed = Pose(self.T_map_camera.parent, "camera", self.T_map_camera.matrix)
        moved = transform_points(self.xyz_m, spec.T_grid_map @ renamed)
        x, y = (moved[:, axis] * np.float32(1 / spec.resolution_m) for axis in (0, 1))
        inside = (x >= 0) & (y >= 0) & (x < np.float32(spec.width)) & (y < np.float32(spec.height))
        flat: NDArray[np.int64] = y.astype(np.int64) * spec.width + x.astype(np.int64)
        flat[~inside] = -1
        return flat

    def classes(self, labels: NDArray[np.uint8], label_set: LabelSet) -> NDArray[np.uint8]:
        """(N,) MapClass of each pixel by a mask of the image's size; void is unknown."""
        return label_set.map_class_table[labels.ravel()[self.index]]


def true_pixels(
    frame: Frame,
    T_map_camera: Pose,
    config: Config,
    truth: FrameTruth | None = None,
    T_placed: Pose | None = None,
) -> TruePixels:
    """Places and heights of the pixels of a frame.

    Args:
        frame: with the best depth there is; its true labels say where lawn is.
        T_map_camera: true pose: heights are by it.
        config: limits of range and height.
        truth: with the recorded ground, if there is one.
        T_placed: pose that pixels are placed by; None = the true one.
    """
    depth_m = frame.depth_m
    with np.errstate(invalid="ignore"):
        in_range = (depth_m >= config.cloud.min_range_m) & (depth_m <= config.cloud.max_range_m)
        left_out = (depth_m > 0) & ~in_range
    index = np.flatnonzero(in_range)
    points = deproject(depth_m, frame.intrinsics).reshape(-1, 3)[index]
    x, y, z = _turned(points, T_map_camera)
    ground, source = _ground(frame, (x, y, z), index, truth)
    height_m = z - (0.0 if ground is None else ground.at(x, y))
    if T_placed is not None and T_placed is not T_map_camera:
        x, y, _ = _turned(points, T_placed)
    camera = (T_placed or T_map_camera).position_m
    low, high = config.cloud.min_height_m, config.cloud.max_height_m
    return TruePixels(
        shape=(depth_m.shape[0], depth_m.shape[1]),
        index=index,
        xyz_m=points,
        T_map_camera=T_placed or T_map_camera,
        height_m=height_m,
        away_m=np.hypot(x - camera[0], y - camera[1]),
        judged=(height_m >= low) & (height_m <= high),
        ground=source,
        out_of_range=np.flatnonzero(left_out),
    )


def dense_map(
    pixels: TruePixels,
    segmentation: Segmentation,
    spec: GridSpec,
    cells: NDArray[np.int64] | None = None,
    stamp_ns: int = 0,
) -> OccupancyGrid:
    """The map of all judged pixels by their labels, nothing filtered: the reference, if the labels are true.

    Args:
        pixels: of the frame.
        segmentation: its mask, true or not, of any size.
        spec: the grid.
        cells: `pixels.cells(spec)`, if it is there already.
        stamp_ns: time of the frame.
    """
    mask = segmentation.resized_to(*pixels.shape)
    classes = pixels.classes(mask.labels, mask.label_set)
    cells = pixels.cells(spec) if cells is None else cells
    used = pixels.judged & (cells >= 0) & (classes != MapClass.UNKNOWN)
    n = spec.width * spec.height
    counts = np.bincount(4 * cells[used] + classes[used], minlength=4 * n).reshape(*spec.shape, 4)
    return OccupancyGrid(spec, classify_cells(counts.astype(np.uint32), 1), stamp_ns)


def _turned(points: NDArray[np.float32], T_map_camera: Pose) -> tuple[NDArray[np.float64], ...]:
    """x, y and z in the map, each (N,) float64: turned in float32 about the camera, then moved."""
    turn = np.eye(4)
    turn[:3, :3] = T_map_camera.matrix[:3, :3]
    turned = transform_points(points, Pose(T_map_camera.parent, T_map_camera.child, turn))
    return tuple(turned[:, i].astype(np.float64) + T_map_camera.position_m[i] for i in range(3))


def fitted_ground(xyz: NDArray[np.float64]) -> GroundRaster | None:
    """The ground through points that are lawn: a plane, and what the points differ from it, texel by texel.

    Texels without a point take what the nearest with one has; None if there are too few points.

    Args:
        xyz: (N, 3) of true lawn in the map's frame.
    """
    if len(xyz) < FEWEST_LAWN_PIXELS:
        return None
    from scipy.ndimage import distance_transform_edt

    middle = xyz.mean(axis=0)
    design = np.column_stack((xyz[:, :2] - middle[:2], np.ones(len(xyz))))
    plane, *_ = np.linalg.lstsq(design, xyz[:, 2], rcond=None)
    low = np.floor(xyz[:, :2].min(axis=0) / TEXEL_M).astype(np.int64) - 8
    high = np.floor(xyz[:, :2].max(axis=0) / TEXEL_M).astype(np.int64) + 9
    nx, ny = (high - low).tolist()
    at = np.floor(xyz[:, :2] / TEXEL_M).astype(np.int64) - low
    flat = at[:, 1] * nx + at[:, 0]
    n = np.bincount(flat, minlength=nx * ny)
    total = np.bincount(flat, xyz[:, 2] - design @ plane, minlength=nx * ny)
    rest = (total / np.maximum(n, 1)).reshape(ny, nx)
    nearest = distance_transform_edt((n < 3).reshape(ny, nx), return_distances=False, return_indices=True)
    x = (low[0] + np.arange(nx) + 0.5) * TEXEL_M - middle[0]
    y = (low[1] + np.arange(ny) + 0.5) * TEXEL_M - middle[1]
    height = plane[0] * x + plane[1] * y[:, None] + plane[2] + rest[tuple(nearest)]
    return GroundRaster(
        (float(low[0]) * TEXEL_M, float(low[1]) * TEXEL_M), TEXEL_M, height.astype(np.float32)
    )


def _ground(
    frame: Frame, xyz: tuple[NDArray[np.float64], ...], index: NDArray[np.int64], truth: FrameTruth | None
) -> tuple[GroundRaster | None, str]:
    if truth is not None and truth.ground is not None:
        return truth.ground, "recorded"
    if frame.labels is None or frame.label_set is None:
        return None, "map"
    lawn = frame.label_set.map_class_table[frame.labels.ravel()[index]] == MapClass.GRASS
    fitted = fitted_ground(np.column_stack([values[lawn] for values in xyz]))
    return fitted, "map" if fitted is None else "fitted"
