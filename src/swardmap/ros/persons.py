"""The persons in the map, one by one: where, how large, how far from the robot."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swardmap.geometry import Pose
from swardmap.grid import OccupancyGrid
from swardmap.io.bags.ros_fields import Fields, header_fields
from swardmap.labels import MapClass

HEIGHT_M = 1.7
"""Of the box in a message; the map knows no heights."""


@dataclass(frozen=True, slots=True)
class MappedPerson:
    """Cells of persons that touch one another.

    Attributes:
        xy_m: middle of their box in the map.
        size_m: of the box along the map's x and y.
        distance_m: from the robot's base to the middle of the nearest cell; None if its pose is not known.
    """

    xy_m: tuple[float, float]
    size_m: tuple[float, float]
    distance_m: float | None


def persons_in(grid: OccupancyGrid, robot_xy_m: tuple[float, float] | None) -> tuple[MappedPerson, ...]:
    """All persons of a map, the nearest first.

    Args:
        grid: the map.
        robot_xy_m: base of the robot in its frame, or None.
    """
    from scipy.ndimage import find_objects, label

    marks, _ = label(grid.classes == MapClass.PERSON, np.ones((3, 3)))
    found = []
    for i, (rows, columns) in enumerate(find_objects(marks), 1):
        r = grid.spec.resolution_m
        low = grid.spec.center_of([columns.start, rows.start]) - r / 2
        high = grid.spec.center_of([columns.stop, rows.stop]) - r / 2
        iy, ix = np.nonzero(marks[rows, columns] == i)
        cells = grid.spec.center_of(np.column_stack([ix + columns.start, iy + rows.start]))
        away = None if robot_xy_m is None else float(np.hypot(*(cells - robot_xy_m).T).min())
        (x, y), (w, h) = ((low + high) / 2).tolist(), (high - low).tolist()
        found.append(MappedPerson((x, y), (w, h), away))
    return tuple(sorted(found, key=lambda p: (p.distance_m or 0.0, p.xy_m)))


def persons_fields(
    persons: Sequence[MappedPerson], T_map_base: Pose | None, frame_id: str, stamp_ns: int
) -> Fields:
    """vision_msgs/Detection3DArray, one detection each, of the class `person`.

    Args:
        persons: in the map.
        T_map_base: pose of the robot: positions are given in its base frame, so that their length is the
            distance; None = in the map's.
        frame_id: of the map.
        stamp_ns: of the map.
    """
    header = header_fields(stamp_ns, frame_id if T_map_base is None else T_map_base.child)
    T = np.eye(4) if T_map_base is None else T_map_base.inverse().matrix
    ground_m = 0.0 if T_map_base is None else float(T_map_base.position_m[2])
    detections = []
    for person in persons:
        x, y, z = (T @ [*person.xy_m, ground_m + HEIGHT_M / 2, 1.0])[:3].tolist()
        pose = {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
        edge = max(person.size_m)  # along the axes of another frame it may lie as it likes
        hypothesis = {"hypothesis": {"class_id": "person", "score": 1.0}, "pose": {"pose": pose}}
        box = {"center": pose, "size": {"x": edge, "y": edge, "z": HEIGHT_M}}
        detections.append({"header": header, "results": [hypothesis], "bbox": box})
    return {"header": header, "detections": detections}


def persons_json(persons: Sequence[MappedPerson], frame_id: str, stamp_ns: int) -> str:
    """The same as JSON in the map's frame, with the distance, for a ROS without vision_msgs."""
    told = [
        {"x_m": p.xy_m[0], "y_m": p.xy_m[1], "size_m": list(p.size_m), "distance_m": p.distance_m}
        for p in persons
    ]
    return json.dumps({"frame_id": frame_id, "stamp_ns": stamp_ns, "persons": told})
