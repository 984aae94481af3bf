"""The node's publishers; what nobody listens to is not computed."""

import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.bags.ros_fields import occupancy_grid_fields
from swardmap.labels import LabelSet, MapClass
from swardmap.mapping.costmap import Costmap, occupancy_from_costs
from swardmap.monitor.diagnostics import HealthReport, Severity
from swardmap.perception.cloud import limits_in_view
from swardmap.ros import messages
from swardmap.ros.clouds import (
    cloud_fields,
    frame_points,
    ground_fields,
    height_row,
    marked_by_depth_m,
    obstacle_cells_fields,
    organised_cloud_fields,
)
from swardmap.ros.live_pipeline import Mapped
from swardmap.ros.map_outputs import MapOutputs
from swardmap.ros.messages import ros_message
from swardmap.ros.near_frame import NearFrames, near_frame
from swardmap.ros.topics import Types, latched_qos

LEVELS = {Severity.OK: messages.OK, Severity.WARN: messages.WARN, Severity.STOP: messages.ERROR}


IMAGE, CLOUD = "sensor_msgs/msg/Image", "sensor_msgs/msg/PointCloud2"
GRID, UPDATE = "nav_msgs/msg/OccupancyGrid", "map_msgs/msg/OccupancyGridUpdate"

OF_CAMERA: Mapping[str, str] = {
    "mask": IMAGE, "confidence": IMAGE, "cloud": CLOUD, "obstacles": CLOUD, "ground": CLOUD,
}  # fmt: skip
"""Topics below ~/CAMERA, and their types."""

OF_NODE: Mapping[str, str] = {
    "map": GRID, "map_updates": UPDATE, "costmap": GRID, "costmap_updates": UPDATE, "obstacle_cells": CLOUD,
    "stop": "std_msgs/msg/Bool", "health_json": "std_msgs/msg/String",
    "label_info": "vision_msgs/msg/LabelInfo", "labels_json": "std_msgs/msg/String",
}  # fmt: skip
"""Topics below ~; without map_msgs there are no updates, and labels are told by one of two."""


class GridChannel:
    """A grid on two topics: whole, latched; and what changed since, as map_msgs/OccupancyGridUpdate.

    A grid that grew is sent whole, and each `full_s` seconds, so that who comes late is not left with an old
    one. An update holds all that has changed since the whole one, again and again: Nav2's StaticLayer keeps a
    whole map waiting for its next cycle, and puts it over the updates that came meanwhile
    (nav2_costmap_2d/plugins/static_layer.cpp, incomingMap and updateBounds). Without map_msgs what changed is
    sent as a whole grid.

    Args:
        node: of rclpy.
        topic: of the whole grid; updates go to `topic`_updates, as Nav2 expects.
        update_type: map_msgs.msg.OccupancyGridUpdate, or None.
    """

    def __init__(self, node: Any, topic: str, update_type: Any) -> None:
        from nav_msgs.msg import OccupancyGrid as GridMessage

        self._type, self._update_type = GridMessage, update_type
        self.publishers = [node.create_publisher(GridMessage, topic, latched_qos())]
        if update_type is not None:
            self.publishers.append(node.create_publisher(update_type, f"{topic}_updates", 10))
        self._values: NDArray[np.int8] | None = None
        self._spec: GridSpec | None = None
        self._whole_s = -np.inf
        self._since_whole: messages.Rectangle | None = None

    @property
    def updates_are_heard(self) -> bool:
        """Whether somebody listens to the updates."""
        return any(publisher.get_subscription_count() for publisher in self.publishers[1:])

    def publish(
        self, values: NDArray[np.int8], spec: GridSpec, stamp_ns: int, now_s: float, full_s: float
    ) -> None:
        """Send what changed since the whole grid, or all of it if that is due; nothing if nothing changed."""
        last, self._values = self._values, values
        grown, self._spec = spec != self._spec, spec
        part = None if grown or last is None else messages.changed_rectangle(last, values)
        self._since_whole = messages.joined(self._since_whole, part)
        due = grown or last is None or now_s - self._whole_s >= max(full_s, 0.1)
        if not due and self._since_whole is None:
            return
        if not due and full_s > 0 and self._update_type is not None and self._since_whole is not None:
            update = messages.update_fields(values, self._since_whole, spec, stamp_ns)
            self.publishers[1].publish(ros_message(self._update_type, update))
            return
        self._whole_s, self._since_whole = now_s, None
        fields = occupancy_grid_fields(values, spec, stamp_ns, spec.frame_id)
        self.publishers[0].publish(ros_message(self._type, fields))


class Outputs:
    """All publishers of a configured node.

    Args:
        node: of rclpy.
        types: optional messages that there are.
        cameras: names.
        label_set: of the masks.
        depth: messages of frames that DDS keeps for a listener that is slow.
        of_map: publishers of what is made of the map beside map and costmap.
    """

    def __init__(
        self,
        node: Any,
        types: Types,
        cameras: Iterable[str],
        label_set: LabelSet,
        depth: int,
        of_map: MapOutputs,
    ) -> None:
        from sensor_msgs.msg import Image, PointCloud2
        from std_msgs.msg import Bool, String

        self._node, self._types, self.of_map = node, types, of_map
        self._image, self._cloud, self._bool, self._string = Image, PointCloud2, Bool, String
        classes = {IMAGE: Image, CLOUD: PointCloud2}
        self._of_camera = {
            (camera, kind): node.create_publisher(classes[name], f"~/{camera}/{kind}", depth)
            for camera in cameras
            for kind, name in OF_CAMERA.items()
        }
        self._map = GridChannel(node, "~/map", types["updates"])
        self._costmap = GridChannel(node, "~/costmap", types["updates"])
        self._cells = node.create_publisher(PointCloud2, "~/obstacle_cells", depth)
        self._near_frames = NearFrames(node, types["tf"])
        self._stop = node.create_publisher(Bool, "~/stop", latched_qos())
        self._health = node.create_publisher(String, "~/health_json", 10)
        self._more: list[Any] = []
        self._diagnostics = None
        if types["diagnostics"] is not None:
            self._diagnostics = node.create_publisher(types["diagnostics"], "/diagnostics", 10)
        self._publish_labels(label_set)

    @property
    def listened_to(self) -> list[str]:
        """Outputs of frames that somebody listens to, such as `camera/mask`; the others are not computed.

        Updates of maps too: whoever hears the whole one only, which is latched, has missed some.
        """
        frames = [f"{camera}/{kind}" for camera, kind in self._of_camera if self._heard(camera, kind)]
        grids = {"map_updates": self._map, "costmap_updates": self._costmap}
        return frames + [name for name, channel in grids.items() if channel.updates_are_heard]

    def wait_until_heard(self, seconds: float) -> None:
        """Wait until who listens has flag and maps: a publisher that goes takes its last word along."""
        from rclpy.duration import Duration

        for publisher in (self._stop, *self._map.publishers, *self._costmap.publishers):
            publisher.wait_for_all_acked(Duration(seconds=seconds))

    def destroy(self) -> None:
        """Take all publishers back."""
        self.of_map.destroy()
        self._near_frames.destroy()
        grids = [*self._map.publishers, *self._costmap.publishers]
        rest = [
            self._cells,
            self._stop,
            self._health,
            *self._more,
            *([self._diagnostics] if self._diagnostics else []),
        ]
        for publisher in (*self._of_camera.values(), *grids, *rest):
            self._node.destroy_publisher(publisher)

    def publish_frame(self, mapped: Mapped, config: Config, stride: int, organised: bool) -> None:
        """Mask, confidence and clouds of one frame, in its optical frame.

        Args:
            mapped: the frame.
            config: limits of the clouds.
            stride: clouds hold every n-th row and column.
            organised: the labelled cloud has one point a pixel instead.
        """
        pair, step = mapped.pair, mapped.step
        stamped = pair.stamp_ns, pair.color_frame
        wanted = {kind for kind in OF_CAMERA if self._heard(pair.camera, kind)}
        if wanted & {"mask", "confidence"}:
            mask, confidence = messages.mask_fields(step.segmentation, step.frame.depth.shape, *stamped)
            self._send(pair.camera, "mask", self._image, mask)
            self._send(pair.camera, "confidence", self._image, confidence)
        limits = limits_in_view(config.cloud, step.observation.ground is not None)
        seen = step.frame, step.segmentation, height_row(step), limits
        if "cloud" in wanted:
            one_a_pixel = organised_cloud_fields(frame_points(*seen), *stamped) if organised else None
            cloud = one_a_pixel or cloud_fields(*seen, stamped, stride=stride)
            self._send(pair.camera, "cloud", self._cloud, cloud)
        if "obstacles" in wanted:
            cloud = cloud_fields(*seen, stamped, MapClass.OBSTACLE, marked_by_depth_m(step), stride)
            self._send(pair.camera, "obstacles", self._cloud, cloud)
        if "ground" in wanted:
            self._send(pair.camera, "ground", self._cloud, ground_fields(step, limits, stamped, stride))

    def publish_map(self, grid: OccupancyGrid, costmap: Costmap | None, now_s: float, full_s: float) -> None:
        """Map and costmap, or what changed of them."""
        self._map.publish(grid.nav_values, grid.spec, grid.stamp_ns, now_s, full_s)
        if costmap is not None:
            values = occupancy_from_costs(costmap.costs)
            self._costmap.publish(values, costmap.spec, costmap.stamp_ns, now_s, full_s)

    def publish_cells(
        self, grid: OccupancyGrid, around_m: tuple[float, float], range_m: float, z_m: float
    ) -> None:
        """Obstacles of the map near the robot, as a cloud at the height of the robot's base."""
        if self._cells.get_subscription_count():
            self._near_frames.tell(near_frame(grid.spec.frame_id, around_m), grid.stamp_ns)
            fields = obstacle_cells_fields(grid, around_m, range_m, z_m)
            self._cells.publish(ros_message(self._cloud, fields))

    def publish_health(self, report: HealthReport, facts: Mapping[str, object]) -> None:
        """Stop flag, diagnoses and latency."""
        self._stop.publish(self._bool(data=report.stop))
        latency = report.latency
        numbers: dict[str, object] = dict(facts) | {"listened_to": self.listened_to}
        if latency is not None:
            numbers |= {"latency_p50_ms": latency.p50_ms, "latency_p99_ms": latency.p99_ms}
        faults = [
            {
                "fault": d.fault,
                "subject": d.subject,
                "severity": d.severity.name.lower(),
                "message": d.message,
            }
            for d in report.diagnoses
        ]
        told = {"stamp_ns": report.stamp_ns, "stop": report.stop, "faults": faults,
                "rates_hz": dict(report.rates_hz), **numbers}  # fmt: skip
        self._health.publish(self._string(data=json.dumps(told)))
        if self._diagnostics is not None:
            fields = messages.diagnostic_fields(report.stamp_ns, list(_statuses(report, numbers)))
            self._diagnostics.publish(ros_message(self._types["diagnostics"], fields))

    def _publish_labels(self, label_set: LabelSet) -> None:
        label_info = self._types["label_info"]
        if label_info is not None:
            publisher = self._node.create_publisher(label_info, "~/label_info", latched_qos())
            publisher.publish(ros_message(label_info, messages.label_info_fields(label_set, 0, "")))
        else:
            publisher = self._node.create_publisher(self._string, "~/labels_json", latched_qos())
            publisher.publish(self._string(data=messages.label_info_json(label_set)))
        self._more.append(publisher)

    def _heard(self, camera: str, kind: str) -> bool:
        return bool(self._of_camera[camera, kind].get_subscription_count())

    def _send(self, camera: str, kind: str, cls: Any, fields: Mapping[str, Any]) -> None:
        self._of_camera[camera, kind].publish(ros_message(cls, fields))


def _statuses(
    report: HealthReport, numbers: Mapping[str, object]
) -> Iterable[tuple[str, bytes, str, Mapping[str, object]]]:
    """One status for the node, and one for each camera and whatever else has a fault."""
    text = "stop" if report.stop else "all is well" if not report.diagnoses else "degraded"
    level = messages.ERROR if report.stop else LEVELS[report.severity]
    yield "swardmap", level, text, {"stop": report.stop, **numbers}
    for subject in dict.fromkeys([*report.rates_hz, *(d.subject for d in report.diagnoses)]):
        found = report.of(subject)
        worst = max((d.severity for d in found), default=Severity.OK)
        text = "; ".join(f"{d.fault}: {d.message}" for d in found) or "ok"
        rate = report.rates_hz.get(subject)
        yield f"swardmap: {subject}", LEVELS[worst], text, {} if rate is None else {"rate_hz": round(rate, 2)}
