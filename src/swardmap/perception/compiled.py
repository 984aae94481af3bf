"""The passes over the pixels, compiled: the default at run time (twin: `plain`)."""

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.errors import ConfigError
from swardmap.geometry import Pose
from swardmap.grid import GridSpec
from swardmap.perception.ground_surface import Ground
from swardmap.perception.passes import (
    Counted,
    Placed,
    count_limits,
    depth_limits,
    height_row,
    mask_codes,
)
from swardmap.types import Frame, Segmentation, nearest_indices


def place(frame: Frame, T_grid_camera: Pose, spec: GridSpec, config: Config) -> Placed:
    """Cell of every pixel that passes range and consistency, and heights of every cell.

    Raises:
        ConfigError: if the configuration asks for a voxel grid or outlier removal.
    """
    from swardmap.kernels import passes as kernel

    if config.cloud.voxel_m > 0 or config.cloud.outliers != "none":
        raise ConfigError(
            "cloud: a voxel grid or outlier removal was asked for, which the compiled backend leaves out; "
            "set backend to 'plain', or rely on the consistency filter"
        )
    cells = np.empty(frame.depth.shape, np.int32)
    sums = np.empty((spec.width * spec.height, 3), np.int64)
    ray_x, ray_y = frame.intrinsics.ray_tables()
    readings = kernel.place(
        frame.depth, np.float32(frame.depth_unit_m), ray_x, ray_y,
        T_grid_camera.matrix[:3].astype(np.float32), depth_limits(config), config.cloud.consistent_neighbours,
        spec.width, spec.height, np.float32(1.0 / spec.resolution_m), cells, sums,
    )  # fmt: skip
    return Placed(cells, sums, frame.depth.size - int(readings))


def count(
    frame: Frame,
    segmentation: Segmentation,
    placed: Placed,
    T_grid_camera: Pose,
    ground: Ground | None,
    spec: GridSpec,
    config: Config,
) -> Counted:
    """What the pixels say of each cell, at their heights above the ground."""
    from swardmap.kernels import passes as kernel

    n = spec.width * spec.height
    ray_x, ray_y = frame.intrinsics.ray_tables()
    level = np.zeros(n, np.float32)  # where no ground is known: heights in the map, and no marks
    tallies = np.empty(4 * n, np.uint64)
    rises = np.empty((n, 3), np.uint32)
    reasons = np.empty(2, np.int64)
    rows, columns = (nearest_indices(a, b) for a, b in zip(frame.depth.shape, segmentation.labels.shape,
                                                           strict=True))  # fmt: skip
    kernel.count(
        frame.depth, np.float32(frame.depth_unit_m), ray_x, ray_y, placed.cells,
        mask_codes(segmentation, config.segmenter.min_confidence), segmentation.hazard_255, rows, columns,
        height_row(T_grid_camera, ground), count_limits(config), ground is not None,
        level if ground is None else ground.offset_m, level if ground is None else ground.floor_m,
        tallies, rises, reasons,
    )  # fmt: skip
    points = np.empty((*spec.shape, 4), np.uint32)
    seen, doubt = np.empty(spec.shape, np.uint32), np.empty(spec.shape, np.uint32)
    kernel.unpack(tallies, points.reshape(-1), seen.reshape(-1), doubt.reshape(-1))
    above, below, raised = (rises[:, i].reshape(spec.shape) for i in range(3))
    return Counted(points, seen, doubt, above, below, raised, *(int(r) for r in reasons))


def classify(
    points: NDArray[np.uint32],
    clear: NDArray[np.bool_],
    min_points: int,
    min_grass_points: int,
) -> NDArray[np.uint8]:
    """Class of each cell (twin: `grid.classify_cells`)."""
    from swardmap.kernels import passes as kernel

    classes = np.empty(points.shape[:2], np.uint8)
    kernel.classify(
        np.ascontiguousarray(points).reshape(-1), clear.reshape(-1),
        np.uint32(min_points), np.uint32(min_grass_points), classes.reshape(-1),
    )  # fmt: skip
    return classes
