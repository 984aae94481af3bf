"""Depth of one camera to depth in the pixels of its colour image, for recordings and the node alike."""

from dataclasses import dataclass

import numpy as np

from swardmap.config import CloudConfig
from swardmap.errors import InputError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.bags.depth_filter import grid_stride, without_flying_pixels
from swardmap.io.bags.ros_camera import Calibration
from swardmap.io.bags.ros_messages import DepthImage
from swardmap.perception.align import align_depth_to_color

MOST_METRES = 50.0
"""Half of the readings of a depth camera that measures in metres are nearer than this."""


@dataclass(slots=True)
class DepthView:
    """What depth of one topic needs before it is used.

    Attributes:
        topic: its name, for messages.
        cloud: the filter for flying pixels.
        unit_m: metres per unit of 16-bit depth.
        float_unit_m: metres per unit of float depth; None = metres, unless they cannot be.
        stride: of the grid that depth is, once it is known.
    """

    topic: str
    cloud: CloudConfig
    unit_m: float
    float_unit_m: float | None
    stride: int | None = None
    _unit_is_plain: bool = False

    def in_metres(self, depth: DepthImage) -> DepthImage:
        """Float depth in metres; 16-bit depth as it is.

        Raises:
            InputError: if nobody set the unit, and half of it is farther than any depth camera sees.
        """
        if depth.dtype != np.float32:
            return depth
        if self.float_unit_m is not None:
            return depth * np.float32(self.float_unit_m)
        self._check_unit(depth)
        return depth

    def in_color_view(
        self,
        depth: DepthImage,
        camera: Calibration,
        color: Intrinsics,
        T_color_depth: Pose | None,
    ) -> tuple[DepthImage, bool]:
        """Depth as it came to depth in the pixels of the colour image, and whether it was filtered.

        It is filtered before it is rendered into another image, where flying pixels agree with their own
        copies, and where it is a grid of lone pixels, none of which has a neighbour.

        Args:
            depth: of `in_metres`.
            camera: that took it.
            color: the colour camera, rectified.
            T_color_depth: where depth is seen from; None = in the pixels of the colour image already.
        """
        if self.stride is None:
            self.stride = grid_stride(depth)
        stride, cloud = self.stride or 1, self.cloud  # another thread may set it
        filtered = (T_color_depth is not None or stride > 1) and cloud.consistent_neighbours > 0
        if filtered:
            depth = without_flying_pixels(depth, self.unit_m, cloud, stride)
        depth = camera.rectify_depth(depth)
        if T_color_depth is not None:
            depth = align_depth_to_color(depth, self.unit_m, camera.intrinsics, color, T_color_depth)
        return depth, filtered

    def _check_unit(self, depth: DepthImage) -> None:
        if self._unit_is_plain:
            return
        readings = depth[np.isfinite(depth) & (depth > 0)]
        if readings.size < depth.size // 100:
            return
        median = float(np.median(readings))
        if median > MOST_METRES:
            raise InputError(
                f"{self.topic}: expected 32FC1 depth in metres (REP-118), but half of it is beyond "
                f"{median:.0f}: is it in millimetres? Then --set source.depth_unit_m=0.001 (1 = metres)"
            )
        self._unit_is_plain = True
