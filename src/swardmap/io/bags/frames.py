"""From a pair of messages to a frame: decoded, checked, filtered, rectified, aligned."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig
from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.io.bags.depth_filter import grid_stride, without_flying_pixels
from swardmap.io.bags.encodings import ColorImage
from swardmap.io.bags.plan import BagPlan
from swardmap.io.bags.reader import Bag
from swardmap.io.bags.ros_messages import DepthImage
from swardmap.perception.align import align_depth_to_color
from swardmap.types import Frame

MOST_METRES = 50.0
"""Half of the readings of a depth camera that measures in metres are nearer than this."""


@dataclass(slots=True)
class FrameBuilder:
    """Makes frames of one recording.

    Attributes:
        plan: how.
        cloud: the filter for flying pixels.
        stride: of the grid that depth is, once it is known.
    """

    plan: BagPlan
    cloud: CloudConfig
    stride: int | None = None
    _unit_is_plain: bool = False

    def decode(self, bag: Bag, color: bytes, depth: bytes) -> tuple[ColorImage, DepthImage]:
        """The images as they came; float depth in metres.

        Raises:
            InputError: if one cannot be decoded.
        """
        plan = self.plan
        rgb = plan.color.color(bag.decode(plan.color.name, color))
        image = plan.depth.depth(bag.decode(plan.depth.name, depth))
        if image.dtype == np.float32 and plan.float_unit_m is not None:
            image = image * np.float32(plan.float_unit_m)
        return rgb, image

    def check_unit(self, depth: DepthImage) -> None:
        """Refuse float depth that cannot be in metres.

        Raises:
            InputError: if half of it is farther than any depth camera sees.
        """
        if self._unit_is_plain or depth.dtype != np.float32 or self.plan.float_unit_m is not None:
            return
        readings = depth[np.isfinite(depth) & (depth > 0)]
        if readings.size < depth.size // 100:
            return
        median = float(np.median(readings))
        if median > MOST_METRES:
            raise InputError(
                f"{self.plan.depth.name}: expected 32FC1 depth in metres (REP-118), but half of it is beyond "
                f"{median:.0f}: is it in millimetres? Then --set source.depth_unit_m=0.001 (1 = metres)"
            )
        self._unit_is_plain = True

    def build(
        self,
        stamp_ns: int,
        rgb: ColorImage,
        depth: DepthImage,
        labels: NDArray[np.uint8] | None,
        T_map_camera: Pose | None,
        name: str,
    ) -> Frame:
        """The frame.

        Raises:
            InputError: if an image has not the size in its CameraInfo.
        """
        plan = self.plan
        camera, unit_m = plan.color_camera.intrinsics, plan.depth_unit_m
        if self.stride is None:
            self.stride = grid_stride(depth)
        apart = plan.T_color_depth is not None
        filtered = (apart or (self.stride or 1) > 1) and self.cloud.consistent_neighbours > 0
        if filtered:
            depth = without_flying_pixels(depth, unit_m, self.cloud, self.stride or 1)
        rgb, depth = plan.color_camera.rectify_color(rgb), plan.depth_camera.rectify_depth(depth)
        if plan.T_color_depth is not None:
            depth = align_depth_to_color(
                depth, unit_m, plan.depth_camera.intrinsics, camera, plan.T_color_depth
            )
        label_set = None if labels is None or plan.labels is None else plan.labels.label_set
        return Frame(
            stamp_ns,
            camera,
            rgb,
            depth,
            unit_m,
            T_map_camera,
            labels,
            label_set,
            name,
            depth_filtered=filtered,
        )

    def facts(self) -> dict[str, object]:
        """How depth came into the pixels of the colour image."""
        aligned = "as recorded" if self.plan.T_color_depth is None else "rendered into the colour image"
        stride = self.stride or 1
        return {
            "color_topic": self.plan.color.name,
            "depth_topic": self.plan.depth.name,
            "depth_alignment": aligned,
            **({"depth_grid_px": stride} if stride > 1 else {}),
        }
