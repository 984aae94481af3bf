"""From a pair of messages to a frame: decoded, checked, filtered, rectified, aligned."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig
from swardmap.geometry import Pose
from swardmap.io.bags.depth_view import DepthView
from swardmap.io.bags.encodings import ColorImage
from swardmap.io.bags.plan import BagPlan
from swardmap.io.bags.reader import Bag
from swardmap.io.bags.ros_messages import DepthImage
from swardmap.types import Frame


@dataclass(slots=True)
class FrameBuilder:
    """Makes frames of one recording.

    Attributes:
        plan: how.
        view: of the depth topic.
    """

    plan: BagPlan
    view: DepthView

    @classmethod
    def of(cls, plan: BagPlan, cloud: CloudConfig) -> "FrameBuilder":
        """The builder for a plan, with the filter for flying pixels."""
        return cls(plan, DepthView(plan.depth.name, cloud, plan.depth_unit_m, plan.float_unit_m))

    def decode(self, bag: Bag, color: bytes, depth: bytes) -> tuple[ColorImage, DepthImage]:
        """The images as they came.

        Raises:
            InputError: if one cannot be decoded.
        """
        plan = self.plan
        rgb = plan.color.color(bag.decode(plan.color.name, color))
        return rgb, plan.depth.depth(bag.decode(plan.depth.name, depth))

    def build(
        self,
        stamp_ns: int,
        rgb: ColorImage,
        depth: DepthImage,
        labels: NDArray[np.uint8] | None,
        T_map_camera: Pose | None,
        name: str,
    ) -> Frame:
        """The frame; depth is that of `DepthView.in_metres`.

        Raises:
            InputError: if an image has not the size in its CameraInfo.
        """
        plan = self.plan
        camera = plan.color_camera.intrinsics
        rgb = plan.color_camera.rectify_color(rgb)
        depth, filtered = self.view.in_color_view(depth, plan.depth_camera, camera, plan.T_color_depth)
        label_set = None if labels is None or plan.labels is None else plan.labels.label_set
        return Frame(
            stamp_ns,
            camera,
            rgb,
            depth,
            plan.depth_unit_m,
            T_map_camera,
            labels,
            label_set,
            name,
            depth_filtered=filtered,
        )

    def facts(self) -> dict[str, object]:
        """How depth came into the pixels of the colour image."""
        aligned = "as recorded" if self.plan.T_color_depth is None else "rendered into the colour image"
        stride = self.view.stride or 1
        return {
            "color_topic": self.plan.color.name,
            "depth_topic": self.plan.depth.name,
            "depth_alignment": aligned,
            **({"depth_grid_px": stride} if stride > 1 else {}),
        }
