"""What is made of the map beside map and costmap; each is computed only while somebody listens."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.bags.ros_fields import occupancy_grid_fields
from swardmap.mapping.work_area import WorkArea
from swardmap.ros.layers import Values, class_values, keepout_mask, speed_mask
from swardmap.ros.messages import ros_message
from swardmap.ros.parameters import NodeConfig
from swardmap.ros.persons import persons_fields, persons_in, persons_json
from swardmap.ros.topics import Types, latched_qos

Layer = Callable[[GridSpec], Values | None]
"""Values on the cells of a grid; None where the map has none."""

GRID = "nav_msgs/msg/OccupancyGrid"
GRIDS = ("layers/classes", "layers/evidence", "layers/height", "masks/keepout", "masks/speed")
PERSONS, PERSONS_JSON = "persons", "persons_json"

OF_MAP: Mapping[str, str] = {
    **dict.fromkeys(GRIDS, GRID),
    PERSONS: "vision_msgs/msg/Detection3DArray", PERSONS_JSON: "std_msgs/msg/String",
}  # fmt: skip
"""Topics below ~ and their types; persons are told by one of the last two."""


class MapOutputs:
    """Publishers of layers, masks and persons.

    Args:
        node: of rclpy.
        types: optional messages that there are.
        area: work area, for the mask to keep out of.
    """

    def __init__(self, node: Any, types: Types, area: WorkArea | None) -> None:
        from nav_msgs.msg import OccupancyGrid as GridMessage
        from std_msgs.msg import String

        self._node, self._area = node, area
        self._grid, self._string, self._detections = GridMessage, String, types["persons"]
        self._publishers = {
            name: node.create_publisher(GridMessage, f"~/{name}", latched_qos()) for name in GRIDS
        }
        kind, name = (String, PERSONS_JSON) if self._detections is None else (self._detections, PERSONS)
        self._publishers[name] = node.create_publisher(kind, f"~/{name}", 5)

    def destroy(self) -> None:
        """Take all publishers back."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)

    def publish(
        self, grid: OccupancyGrid, layers: Mapping[str, Layer], T_map_base: Pose | None, node: NodeConfig
    ) -> None:
        """Send what somebody listens to.

        Args:
            grid: the map that is given out.
            layers: what else the map holds, by topic; asked only while somebody listens.
            T_map_base: pose of the robot, or None.
            node: size and speed of the zone around persons.
        """
        made: dict[str, Callable[[], Values | None]] = {
            "layers/classes": lambda: class_values(grid),
            **{name: partial(layer, grid.spec) for name, layer in layers.items()},
            "masks/keepout": lambda: keepout_mask(grid.spec, self._area),
            "masks/speed": lambda: speed_mask(grid, node.speed_zone_m, node.speed_zone_percent),
        }
        for name, make in made.items():
            values = make() if self.heard(name) else None
            if values is not None:
                fields = occupancy_grid_fields(values, grid.spec, grid.stamp_ns, grid.spec.frame_id)
                self._publishers[name].publish(ros_message(self._grid, fields))
        self._publish_persons(grid, T_map_base)

    def heard(self, name: str) -> bool:
        """Whether somebody listens."""
        publisher = self._publishers.get(name)
        return publisher is not None and bool(publisher.get_subscription_count())

    def _publish_persons(self, grid: OccupancyGrid, T_map_base: Pose | None) -> None:
        if not (self.heard(PERSONS) or self.heard(PERSONS_JSON)):
            return
        xy_m = (
            None if T_map_base is None else (float(T_map_base.position_m[0]), float(T_map_base.position_m[1]))
        )
        persons, frame_id, stamp_ns = persons_in(grid, xy_m), grid.spec.frame_id, grid.stamp_ns
        if self._detections is None:
            text = persons_json(persons, frame_id, stamp_ns)
            self._publishers[PERSONS_JSON].publish(self._string(data=text))
        else:
            fields = persons_fields(persons, T_map_base, frame_id, stamp_ns)
            self._publishers[PERSONS].publish(ros_message(self._detections, fields))
