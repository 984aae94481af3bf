"""The truth of a frame: every pixel by its true label and its height above the true ground (Sec. 4.3).

The ground is the one that the data set recorded; elsewhere it is fitted to the pixels that are truly
lawn. So the truth depends on nothing that is to be judged. Where nobody knows the ground no limit of height
leaves anything out, as in maps: z of a map tells nothing of it. What limits do leave out is counted.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig, Config
from swardmap.errors import InvalidValueError
from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.sources.truth import FrameTruth, GroundRaster
from swardmap.labels import LabelSet, MapClass
from swardmap.types import Frame, Segmentation

RECORDED, FITTED, UNKNOWN = "recorded", "fitted", "unknown"
GROUNDS = {RECORDED: "recorded", FITTED: "fitted to true lawn", UNKNOWN: "known to nobody"}
"""Where the true ground of a frame is from, and how a page says it."""
TEXEL_M = 0.25
"""Of a ground that is fitted."""
FEWEST_LAWN_PIXELS = 50
"""Of true lawn that a ground is fitted to."""
LOWEST_SHARE = 0.01
"""So many pixels lie below what counts as the lowest where no ground is known: noise."""


@dataclass(frozen=True, slots=True, eq=False)
class TruePixels:
    """The pixels of a frame that have a reading within the range.

    Attributes:
        shape: (H, W) of the image.
        index: (N,) int64 flat place in the image.
        xyz_m: (N, 3) float32 in the frame of the camera.
        T_map_camera: pose that they are placed by.
        height_m: (N,) float64 above the true ground; above the lowest of the pixels where nobody knows it.
        judged: (N,) bool, within the height limits; all where nobody knows the ground.
        ground: where the ground is from: `recorded`, `fitted`, or `unknown`.
        out_of_range: (M,) int64 flat places of pixels with a reading nearer or farther than the range.
    """

    shape: tuple[int, int]
    index: NDArray[np.int64]
    xyz_m: NDArray[np.float32]
    T_map_camera: Pose
    height_m: NDArray[np.float64]
    judged: NDArray[np.bool_]
    ground: str
    out_of_range: NDArray[np.int64]

    def cells(self, spec: GridSpec) -> NDArray[np.int64]:
        """(N,) flat cell of each pixel, within the height limits or not; -1 beside the grid.

        In float32 and in the order of the pipeline, so that both put a pixel into the same cell.
        """
        from swardmap.kernels import truth as kernel

        renamed = Pose(self.T_map_camera.parent, "camera", self.T_map_camera.matrix)
        T_grid_camera = (spec.T_grid_map @ renamed).matrix[:3].astype(np.float32)
        cells = np.empty(len(self.index), np.int64)
        kernel.cells_of(
            self.xyz_m, T_grid_camera, np.float32(1 / spec.resolution_m), spec.width, spec.height, cells
        )
        return cells

    def classes(self, labels: NDArray[np.uint8], label_set: LabelSet) -> NDArray[np.uint8]:
        """(N,) MapClass of each pixel by a mask of the image's size; void is unknown."""
        from swardmap.kernels import truth as kernel

        classes = np.empty(len(self.index), np.uint8)
        kernel.take(labels.ravel(), self.index, label_set.map_class_table, classes)
        return classes

    def away_m(self, chosen: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n,) horizontal distance from the camera of some of the N pixels."""
        moved = _in_map(self.xyz_m[chosen], self.T_map_camera)
        x, y, _ = self.T_map_camera.position_m
        away_m: NDArray[np.float64] = np.hypot(moved[:, 0] - x, moved[:, 1] - y)
        return away_m


def true_pixels(
    frame: Frame,
    T_map_camera: Pose,
    config: Config,
    truth: FrameTruth | None = None,
) -> TruePixels:
    """Places and heights of the pixels of a frame.

    Args:
        frame: with the best depth there is; its true labels say where lawn is.
        T_map_camera: true pose.
        config: limits of range and height.
        truth: with the recorded ground, if there is one.
    """
    from swardmap.kernels import truth as kernel

    depth_m, cloud = frame.depth_m, config.cloud
    limits = np.float32(cloud.min_range_m), np.float32(cloud.max_range_m)
    within, beyond = kernel.readings(depth_m, *limits)
    index, left_out = np.empty(within, np.int64), np.empty(beyond, np.int64)
    xyz_m = np.empty((within, 3), np.float32)
    kernel.points(depth_m, *limits, *frame.intrinsics.ray_tables(), index, xyz_m, left_out)
    ground, source = _ground(frame, xyz_m, T_map_camera, index, truth)
    if ground is None:
        z_m = _in_map(xyz_m, T_map_camera)[:, 2]
        height_m = z_m - (np.quantile(z_m, LOWEST_SHARE) if within else 0.0)
    else:
        height_m, origin_m = np.empty(within), np.array(ground.origin_m, np.float64)
        turn, position_m = _turn_and_position(T_map_camera)
        kernel.heights_above(xyz_m, turn, position_m, ground.height_m, origin_m, ground.texel_m, height_m)
    return TruePixels(
        shape=(depth_m.shape[0], depth_m.shape[1]),
        index=index,
        xyz_m=xyz_m,
        T_map_camera=T_map_camera,
        height_m=height_m,
        judged=within_limits(height_m, cloud, ground is not None),
        ground=source,
        out_of_range=left_out,
    )


def within_limits(height_m: NDArray[np.float64], cloud: CloudConfig, grounded: bool) -> NDArray[np.bool_]:
    """(N,) whether heights lie within the limits; where no ground is known they limit nothing."""
    if not grounded:
        return np.ones(len(height_m), np.bool_)
    inside: NDArray[np.bool_] = (height_m >= cloud.min_height_m) & (height_m <= cloud.max_height_m)
    return inside


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
    from swardmap.kernels import truth as kernel

    mask = segmentation.resized_to(*pixels.shape)
    cells = pixels.cells(spec) if cells is None else cells
    classes = np.zeros(spec.width * spec.height, np.uint8)
    table = mask.label_set.map_class_table
    kernel.highest_class(mask.labels.ravel(), pixels.index, table, pixels.judged, cells, classes)
    return OccupancyGrid(spec, classes.reshape(spec.shape), stamp_ns)


def _in_map(xyz_m: NDArray[np.float32], T_map_camera: Pose) -> NDArray[np.float64]:
    """(N, 3) float64 places in the map: turned in float32 about the camera, then moved."""
    from swardmap.kernels import truth as kernel

    moved = np.empty(xyz_m.shape, np.float64)
    kernel.turn_and_move(xyz_m, *_turn_and_position(T_map_camera), moved)
    return moved


def _turn_and_position(T_map_camera: Pose) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    return T_map_camera.matrix[:3, :3].astype(np.float32), T_map_camera.position_m.copy()


def fitted_ground(xyz: NDArray[np.float64]) -> GroundRaster | None:
    """The ground through points that are lawn: a plane, and what the points differ from it, texel by texel.

    Texels without a point take what the nearest with one has; None if there are too few points.

    Args:
        xyz: (N, 3) of true lawn in the map's frame.

    Raises:
        InvalidValueError: for points that are not finite.
    """
    if len(xyz) < FEWEST_LAWN_PIXELS:
        return None
    from scipy.ndimage import distance_transform_edt

    from swardmap.kernels import truth as kernel

    middle, least, most = np.empty((3, 3))
    kernel.column_sums(xyz, middle, least, most)
    middle /= len(xyz)
    if not np.isfinite(middle).all():
        raise InvalidValueError("ground: expected finite points of lawn, got NaN or infinity; remove them")
    design = np.ones((len(xyz), 3))
    np.subtract(xyz[:, :2], middle[:2], out=design[:, :2])
    plane, *_ = np.linalg.lstsq(design, xyz[:, 2], rcond=None)
    low = np.floor(least[:2] / TEXEL_M).astype(np.int64) - 8
    high = np.floor(most[:2] / TEXEL_M).astype(np.int64) + 9
    nx, ny = (high - low).tolist()
    n, total = np.empty(nx * ny, np.int64), np.empty(nx * ny)
    kernel.texel_sums(xyz, xyz[:, 2] - design @ plane, low, TEXEL_M, nx, n, total)
    rest = (total / np.maximum(n, 1)).reshape(ny, nx)
    nearest = distance_transform_edt((n < 3).reshape(ny, nx), return_distances=False, return_indices=True)
    x = (low[0] + np.arange(nx) + 0.5) * TEXEL_M - middle[0]
    y = (low[1] + np.arange(ny) + 0.5) * TEXEL_M - middle[1]
    height = plane[0] * x + plane[1] * y[:, None] + plane[2] + rest[tuple(nearest)]
    return GroundRaster(
        (float(low[0]) * TEXEL_M, float(low[1]) * TEXEL_M), TEXEL_M, height.astype(np.float32)
    )


def _ground(
    frame: Frame,
    xyz_m: NDArray[np.float32],
    T_map_camera: Pose,
    index: NDArray[np.int64],
    truth: FrameTruth | None,
) -> tuple[GroundRaster | None, str]:
    if truth is not None and truth.ground is not None:
        return truth.ground, RECORDED
    if frame.labels is None or frame.label_set is None:
        return None, UNKNOWN
    from swardmap.kernels import truth as kernel

    labels, table = frame.labels.ravel(), frame.label_set.map_class_table
    classes = np.empty(len(index), np.uint8)
    kernel.take(labels, index, table, classes)
    lawn = np.empty((int(np.count_nonzero(classes == MapClass.GRASS)), 3), np.float32)
    kernel.choose(xyz_m, classes, np.uint8(MapClass.GRASS), lawn)
    fitted = fitted_ground(_in_map(lawn, T_map_camera))
    return fitted, UNKNOWN if fitted is None else FITTED
