"""Persons of the map one by one, as detections with position and distance."""

import json
import math
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.ros.persons import persons_fields, persons_in, persons_json

SPEC = GridSpec(0.1, 100, 80, (-2.0, -4.0))


def two_persons() -> OccupancyGrid:
    grid = OccupancyGrid(SPEC, np.full(SPEC.shape, MapClass.GRASS, np.uint8), 7_000_000_001)
    grid.classes[40:44, 50:53] = MapClass.PERSON  # x 3.0..3.3, y 0.0..0.4
    grid.classes[44, 53] = MapClass.PERSON  # touches by a corner
    grid.classes[10:12, 90:92] = MapClass.PERSON
    grid.classes[60, 60] = MapClass.OBSTACLE
    return grid


def test_each_is_found_once_the_nearest_first() -> None:
    near, far = persons_in(two_persons(), (0.0, 0.0))
    assert near.xy_m == pytest.approx((3.2, 0.25))
    assert near.size_m == pytest.approx((0.4, 0.5))
    assert near.distance_m == pytest.approx(math.hypot(3.05, 0.05))
    assert far.xy_m == pytest.approx((7.1, -2.9))
    assert persons_in(OccupancyGrid.unknown(SPEC), (0.0, 0.0)) == ()
    assert [p.distance_m for p in persons_in(two_persons(), None)] == [None, None]


def test_in_the_message_the_length_of_a_position_is_the_distance() -> None:
    """vision_msgs/Detection3DArray of Jazzy: every field is one of it, and of its type."""
    matrix = np.eye(4)
    matrix[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]  # the robot looks along y
    matrix[:3, 3] = 3.2, -5.0, 120.0
    T_map_base = Pose("map", "base_link", matrix)
    persons = persons_in(two_persons(), (3.2, -5.0))
    fields = persons_fields(persons, T_map_base, "map", 7_000_000_001)
    assert fields["header"]["frame_id"] == "base_link"
    assert fields["header"]["stamp"] == {"sec": 7, "nanosec": 1}
    by_hand = sorted(fields["detections"], key=lambda d: -d["bbox"]["center"]["position"]["x"])
    ahead = by_hand[0]["bbox"]["center"]["position"]
    assert (ahead["x"], ahead["y"]) == pytest.approx((5.25, 0.0), abs=1e-9)
    assert 0 < ahead["z"] < 2  # above the ground, wherever the map has its z = 0
    for detection in fields["detections"]:
        (result,) = detection["results"]
        assert result["hypothesis"]["class_id"] == "person"
        assert result["pose"]["pose"] == detection["bbox"]["center"]


def test_the_fields_are_those_of_the_message() -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    names = {
        "vision_msgs/msg/Detection3D": {"header", "results", "bbox"},
        "vision_msgs/msg/BoundingBox3D": {"center", "size"},
        "vision_msgs/msg/ObjectHypothesisWithPose": {"hypothesis", "pose"},
        "vision_msgs/msg/ObjectHypothesis": {"class_id", "score"},
    }
    # as vision_msgs 4.1 (jazzy) defines them; rosbags does not carry the package
    assert not set(names) & set(store.types)
    fields: dict[str, Any] = persons_fields(persons_in(two_persons(), None), None, "map", 1)
    assert fields["header"]["frame_id"] == "map"
    detection = fields["detections"][0]
    assert set(detection) == names["vision_msgs/msg/Detection3D"]
    assert set(detection["bbox"]) == names["vision_msgs/msg/BoundingBox3D"]
    (result,) = detection["results"]
    assert set(result) == names["vision_msgs/msg/ObjectHypothesisWithPose"]
    assert set(result["hypothesis"]) == names["vision_msgs/msg/ObjectHypothesis"]


def test_without_the_package_they_are_told_as_json() -> None:
    told = json.loads(persons_json(persons_in(two_persons(), (0.0, 0.0)), "map", 5))
    assert told["frame_id"] == "map"
    assert told["stamp_ns"] == 5
    assert [p["x_m"] for p in told["persons"]] == pytest.approx([3.2, 7.1])
    assert told["persons"][0]["distance_m"] == pytest.approx(3.0504, abs=1e-3)
