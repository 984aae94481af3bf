"""What one frame of a drive shows: cell and height over the local ground of each pixel, flat cells."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.geometry import Pose
from swardmap.grid import GridSpec
from swardmap.labels import MapClass
from swardmap.perception.ground_surface import find_ground
from swardmap.perception.passes import height_row
from swardmap.pipeline import BACKENDS, view_spec
from swardmap.teach.plan import LabelConfig
from swardmap.types import Frame, Segmentation

FEWEST_PIXELS = 3
"""Of a cell that is called flat or raised."""

Bools = NDArray[np.bool_]
Float32 = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Where the pixels of a frame lie.

    Attributes:
        spec: grid around the view, on the lattice of the map.
        cells: (H, W) int32 flat index in it; negative = no reading, or none that counts.
        height_m: (H, W) float32 above the local ground; NaN where `cells` is negative or no ground is seen.
        noise_m: (H, W) float32 by which the height may be off, NaN likewise.
        depth_m: (H, W) float32 along the optical axis, NaN = no reading.
    """

    spec: GridSpec
    cells: NDArray[np.int32]
    height_m: Float32
    noise_m: Float32
    depth_m: Float32

    def flat(self, limits: LabelConfig) -> Bools:
        """(H, W) bool: on the ground, and near."""
        near = self.depth_m <= limits.near_m
        return near & (np.abs(self.height_m) <= np.hypot(np.float32(limits.flat_m), self.noise_m))

    def raised(self, limit_m: float | Float32) -> Bools:
        """(H, W) bool: higher than a limit, noise allowed for."""
        return self.height_m > np.hypot(np.float32(limit_m), self.noise_m)


def heights_of(frame: Frame, T_map_camera: Pose, config: Config) -> Heights | None:
    """Cells and heights of a frame's pixels; None if it shows no ground.

    Args:
        frame: aligned images.
        T_map_camera: its pose.
        config: ranges, filters, ground, resolution.
    """
    passes = BACKENDS[config.backend]
    spec = view_spec(frame.intrinsics, T_map_camera, config.cloud.max_range_m, config.grid.resolution_m)
    matrix = T_map_camera.matrix.copy()
    matrix[:2, 3] -= spec.origin_m
    T_grid_camera = Pose("grid", "camera", matrix)
    placed = passes.place(frame, T_grid_camera, spec, config)
    x, y, z = T_map_camera.position_m.tolist()
    ground = find_ground(placed.sums, spec, config.geometry, (x, y, z), None, passes.fit_ground)
    if ground is None:
        return None
    depth_m = frame.depth_m
    up = height_row(T_grid_camera, ground)
    ray_x, ray_y = frame.intrinsics.ray_tables()
    q = up[0] * ray_x[None, :] + (up[1] * ray_y + up[2])[:, None]
    used = placed.cells >= 0
    offset_m = np.where(used, ground.offset_m[np.where(used, placed.cells, 0)], np.float32(np.nan))
    geometry = config.geometry
    noise = np.float32(geometry.noise_sigmas * geometry.noise_m_at_1m)
    noise_m = np.where(used, np.abs(noise * depth_m * depth_m * q), np.float32(np.nan))
    return Heights(spec, placed.cells, depth_m * q + up[3] - offset_m, noise_m, depth_m)


@dataclass(frozen=True, slots=True, eq=False)
class SeenCells:
    """What one frame says of cells, to be held against what others say.

    Attributes:
        spec: grid around the view.
        flat, raised: (height, width) bool; a cell is one of them, or neither where too little was seen.
        persons: (height, width) bool, cells with something that the network calls a person.
    """

    spec: GridSpec
    flat: Bools
    raised: Bools
    persons: Bools


def seen_of(heights: Heights, segmentation: Segmentation, limits: LabelConfig) -> SeenCells:
    """The flat and the raised cells of a frame within the range that labels are taken from.

    Args:
        heights: of the frame.
        segmentation: of the same frame, at its size.
        limits: what is flat and what is raised.
    """
    near = heights.depth_m <= limits.near_m
    flat = _cells(heights, heights.flat(limits))
    raised = _cells(heights, near & heights.raised(limits.raised_driven_m))
    persons = _cells(heights, near & (segmentation.map_classes == MapClass.PERSON))
    stands = raised >= FEWEST_PIXELS
    return SeenCells(heights.spec, (flat >= FEWEST_PIXELS) & (raised == 0), stands, persons > 0)


def _cells(heights: Heights, chosen: Bools) -> NDArray[np.int64]:
    """(height, width) number of chosen pixels in each cell."""
    cells = heights.cells[chosen & (heights.cells >= 0)]
    shape = heights.spec.shape
    return np.bincount(cells, minlength=shape[0] * shape[1]).reshape(shape)
