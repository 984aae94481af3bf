"""What the two passes over the pixels give, whichever backend makes them: plain NumPy or compiled.

First every pixel gets its cell and every cell its heights (`place`); from these the ground follows. Then
every pixel is counted in its cell by class, by doubt, and by its height above that ground (`count`). Depth
is filtered once. Both backends are equal to the last digit (tests/perception/test_passes.py).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.geometry import Pose
from swardmap.kernels.constants import UNSURE, VOID
from swardmap.labels import LabelSet
from swardmap.perception.cloud import limits_in_view
from swardmap.perception.ground_surface import Ground, Sums
from swardmap.types import Segmentation


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Where the pixels of a frame fall.

    Attributes:
        cells: (H, W) int32 flat index of each pixel's cell, or why it has none; DROPPED - i for a reading
            that the filter removes and that would fall into cell i.
        sums: (cells, 3) int64 sum of heights in 0.1 mm, points, and lowest height of each cell.
        no_reading: pixels that are 0, NaN or infinite.
        not_in_range: pixels nearer or farther than the limits, those without a reading among them.
        not_consistent: pixels removed by the 3x3 consistency filter.
        outside: pixels that fall beside the grid.
    """

    cells: NDArray[np.int32]
    sums: Sums
    no_reading: int
    not_in_range: int
    not_consistent: int
    outside: int


@dataclass(frozen=True, slots=True, eq=False)
class Counted:
    """What the pixels of a frame say of each cell.

    Attributes:
        points: (height, width, 4) uint32 points by MapClass; at UNKNOWN grass that is not sure.
        seen: (height, width) uint32 points of any class.
        doubt: (height, width) uint32 sum of their P(obstacle or person) in 255ths.
        above: (height, width) uint32 points above the ground, of any class or none.
        below: (height, width) uint32 points below it.
        raised: (height, width) uint32 points that are a little above it, and doubted.
        dropped: (height, width) uint32 readings above it that the 3x3 filter removed.
        height_row: (4,) float32 of the function of that name.
        void: pixels of which the mask says nothing.
        out_of_height: pixels below or above the limits.
        merged: points joined in a voxel or removed as outliers.
    """

    points: NDArray[np.uint32]
    seen: NDArray[np.uint32]
    doubt: NDArray[np.uint32]
    above: NDArray[np.uint32]
    below: NDArray[np.uint32]
    raised: NDArray[np.uint32]
    dropped: NDArray[np.uint32]
    height_row: NDArray[np.float32]
    void: int
    out_of_height: int
    merged: int = 0


def code_table(label_set: LabelSet) -> NDArray[np.uint8]:
    """(256,) uint8 what each id of a mask counts as."""
    table = label_set.map_class_table
    return np.where(table == 0, np.uint8(VOID), table)


def mask_codes(segmentation: Segmentation, config: Config) -> NDArray[np.uint8]:
    """(h, w) uint8 what each pixel of the mask counts as."""
    codes = code_table(segmentation.label_set)[segmentation.labels]
    unsure = segmentation.unsure(config.segmenter.min_confidence, config.watchdog.unfamiliar)
    if unsure is not None:
        codes[unsure] = UNSURE
    return codes


def height_row(T_grid_camera: Pose, ground: Ground | None) -> NDArray[np.float32]:
    """(4,) float32 a, b, c, d: height a x + b y + c z + d of a point of the camera above the ground's plane.

    Where no ground is known it is the height in the map, which says nothing about the lawn.
    """
    if ground is None:
        level: NDArray[np.float32] = T_grid_camera.matrix[2].astype(np.float32)
        return level
    a, b, c = ground.plane
    R, t = T_grid_camera.matrix[:3, :3], T_grid_camera.position_m
    normal = np.array([-a, -b, 1.0])  # height above the plane = normal . p - c
    row: NDArray[np.float32] = np.array([*(normal @ R), normal @ t - c]).astype(np.float32)
    return row


def count_limits(config: Config, ground: Ground | None) -> NDArray[np.float32]:
    """(7,) float32 lowest and highest point, rise, doubted rise, hole, noise at 1 m times sigmas, doubt."""
    cloud, geometry = limits_in_view(config.cloud, ground is not None), config.geometry
    return np.array(
        [cloud.min_height_m, cloud.max_height_m, geometry.min_height_m, geometry.doubt_height_m,
         geometry.hole_depth_m, geometry.noise_sigmas * geometry.noise_m_at_1m, 255 * geometry.doubt_above],
        np.float32,
    )  # fmt: skip


def depth_limits(config: Config) -> NDArray[np.float32]:
    """(4,) float32 nearest and farthest depth, relative and absolute tolerance of the filter."""
    cloud = config.cloud
    return np.array(
        [cloud.min_range_m, cloud.max_range_m, cloud.consistency_relative, cloud.consistency_m], np.float32
    )
