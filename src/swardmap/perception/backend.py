"""What a backend does for a frame: two passes over the pixels, and between and after them two over the cells.

Both are equal to the last digit (tests/perception/test_passes.py).
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config, GeometryConfig
from swardmap.geometry import Pose
from swardmap.grid import GridSpec
from swardmap.perception.geometric_obstacles import GeometricMarks
from swardmap.perception.ground_surface import Ground, Sums
from swardmap.perception.passes import Counted, Placed
from swardmap.types import Frame, Segmentation


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """What the cells of a frame are.

    Attributes:
        classes: (height, width) uint8 MapClass, of all the evidence that is switched on.
        points: (height, width, 4) uint32 points by MapClass, as a map takes them in.
        semantic: (height, width) uint8 MapClass from the network's classes alone.
        geometry: what depth marks; None = switched off.
    """

    classes: NDArray[np.uint8]
    points: NDArray[np.uint32]
    semantic: NDArray[np.uint8]
    geometry: GeometricMarks | None


class Backend(Protocol):
    """Plain NumPy or compiled."""

    def place(self, frame: Frame, T_grid_camera: Pose, spec: GridSpec, config: Config) -> Placed:
        """Cell of every pixel, and heights of every cell (Eq. 1, Eq. 2)."""

    def fit_ground(self, sums: Sums, spec: GridSpec, config: GeometryConfig) -> Ground | None:
        """The ground under the cells that were seen."""

    def count(
        self,
        frame: Frame,
        segmentation: Segmentation,
        placed: Placed,
        T_grid_camera: Pose,
        ground: Ground | None,
        spec: GridSpec,
        config: Config,
    ) -> Counted:
        """What the pixels say of each cell, at their heights above the ground."""

    def judge(self, counted: Counted, ground: Ground | None, config: Config) -> Judged:
        """What may be cleared, what stands above the ground, and what each cell is by both."""
