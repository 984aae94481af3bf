"""Fields and messages against rosbags' typestore, CDR of two implementations, and closed forms."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from swardmap.geometry import Intrinsics
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.bags.ros_fields import (
    camera_info_fields,
    image_fields,
    occupancy_grid_fields,
    rosbags_message,
)
from swardmap.io.bags.ros_messages import image_array
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.mapping.costmap import occupancy_from_costs
from swardmap.ros import messages as m
from swardmap.types import Segmentation

STORE = get_typestore(Stores.ROS2_JAZZY)
UPDATE, CLASS, INFO = (
    "map_msgs/msg/OccupancyGridUpdate",
    "vision_msgs/msg/VisionClass",
    "vision_msgs/msg/LabelInfo",
)
# the definitions of ros-planning/navigation_msgs and ros-perception/vision_msgs
STORE.register(
    get_types_from_msg(
        "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\nint8[] data", UPDATE
    )
    | get_types_from_msg("uint16 class_id\nstring class_name", CLASS)
    | get_types_from_msg("std_msgs/Header header\nVisionClass[] class_map\nfloat32 threshold", INFO)
)
SPEC = GridSpec(0.1, 4, 3, (-1.0, 2.0), "map")
CLASSES = np.array([[0, 1, 2, 3], [1, 1, 0, 2], [3, 0, 1, 1]], np.uint8)


def received(name: str, fields: dict[str, Any]) -> Any:
    """The message as another program gets it: through CDR."""
    return STORE.deserialize_cdr(STORE.serialize_cdr(rosbags_message(STORE, name, fields), name), name)


def test_a_map_and_its_costs_arrive_as_nav2_has_them() -> None:
    values = OccupancyGrid(SPEC, CLASSES).nav_values
    fields = occupancy_grid_fields(values, SPEC, 1_500_000_000, SPEC.frame_id)
    grid = received("nav_msgs/msg/OccupancyGrid", fields)
    assert grid.data.tolist() == [-1, 0, 100, 100, 0, 0, -1, 100, 100, -1, 0, 0]
    assert (grid.info.width, grid.info.height) == (4, 3)
    assert grid.info.resolution == np.float32(0.1)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (-1.0, 2.0)
    assert (grid.header.frame_id, grid.header.stamp.sec, grid.header.stamp.nanosec) == ("map", 1, 500_000_000)
    costs = np.array([[0, 1, 50, 127], [128, 251, 252, 253], [254, 255, 0, 0]], np.uint8)
    fields = occupancy_grid_fields(occupancy_from_costs(costs), SPEC, 0, SPEC.frame_id)
    cost = received("nav_msgs/msg/OccupancyGrid", fields)
    # nav2_costmap_2d/src/costmap_2d_publisher.cpp
    assert cost.data.tolist() == [0, 1, 19, 49, 50, 97, 98, 99, 100, -1, 0, 0]


@given(hnp.arrays(np.int8, (5, 7), elements=st.sampled_from([-1, 0, 100])), st.data())
def test_an_update_turns_the_map_before_into_the_map_after(before: Any, data: st.DataObject) -> None:
    after = before.copy()
    for y, x in data.draw(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 6)), max_size=4)):
        after[y, x] = data.draw(st.sampled_from([-1, 0, 100]))
    rectangle = m.changed_rectangle(before, after)
    if rectangle is None:
        np.testing.assert_array_equal(before, after)
        return
    spec = GridSpec(0.05, 7, 5, (0.0, 0.0), "map")
    update = received(UPDATE, m.update_fields(after, rectangle, spec, 3))
    # as nav2's StaticLayer::incomingUpdate applies it
    patched = before.copy()
    for i, value in enumerate(update.data):
        patched[update.y + i // update.width, update.x + i % update.width] = value
    np.testing.assert_array_equal(patched, after)
    changed = before != after
    edges = changed[update.y], changed[update.y + update.height - 1], changed[:, update.x]
    assert all(
        edge.any() for edge in (*edges, changed[:, update.x + update.width - 1])
    )  # no larger than needed


def test_mask_and_confidence_have_the_size_of_the_photo() -> None:
    labels = np.array([[0, 1], [2, 255]], np.uint8)
    confidence = np.array([[0.5, 1.0], [np.nan, 0.9]], np.float32)
    fields = m.mask_fields(Segmentation(labels, GRASS_OBSTACLE_PERSON, confidence), (4, 4), 7, "camera")
    mask, sure = (received("sensor_msgs/msg/Image", f) for f in fields)
    assert mask.encoding == sure.encoding == "mono8"
    np.testing.assert_array_equal(image_array(mask), np.kron(labels, np.ones((2, 2), np.uint8)))
    expected = np.array([[127, 255], [0, 0]], np.uint8)  # void is not sure, whatever its number says
    np.testing.assert_array_equal(image_array(sure), np.kron(expected, np.ones((2, 2), np.uint8)))


def test_a_segmenter_without_confidence_is_sure_where_it_says_something() -> None:
    labels = np.array([[1, 255]], np.uint8)
    _, sure = m.mask_fields(Segmentation(labels, GRASS_OBSTACLE_PERSON), (1, 2), 0, "camera")
    assert sure["data"].tolist() == [255, 0]


def test_label_info_names_every_id_of_the_mask() -> None:
    info = received(INFO, m.label_info_fields(GRASS_OBSTACLE_PERSON, 0, "camera"))
    named = {c.class_id: c.class_name for c in info.class_map}
    assert named == {0: "other", 1: "grass", 2: "person"}  # 255 is "unlabelled" in LabelInfo.msg
    plain = json.loads(m.label_info_json(GRASS_OBSTACLE_PERSON))
    assert {c["class_id"]: c["class_name"] for c in plain} == named | {255: "void"}
    assert {c["class_name"] for c in plain if c["role"] == "free"} == {"grass"}


def test_diagnostics_arrive() -> None:
    fields = m.diagnostic_fields(5, [("swardmap: front", m.WARN, "slow camera", {"rate_hz": 3.5})])
    status = received("diagnostic_msgs/msg/DiagnosticArray", rosbags_levels(fields)).status[0]
    assert (status.level, status.name, status.message) == (1, "swardmap: front", "slow camera")
    assert [(v.key, v.value) for v in status.values] == [("rate_hz", "3.5")]


def rosbags_levels(fields: dict[str, Any]) -> dict[str, Any]:
    """rclpy takes a byte as bytes, rosbags as a number."""
    return fields | {"status": [s | {"level": s["level"][0]} for s in fields["status"]]}


@pytest.mark.filterwarnings("ignore:module 'sre_.*' is deprecated:DeprecationWarning")  # ROS's parser
@pytest.mark.parametrize("name", ["image", "info", "grid", "cloud", "diagnostics"])
def test_rclpy_writes_what_rosbags_writes(name: str) -> None:
    """Two implementations of the same wire format, from the same fields."""
    pytest.importorskip("rclpy", reason="rclpy is not installed (pip install 'swardmap[ros]')")
    import importlib

    from rclpy.serialization import serialize_message

    from swardmap.io.bags.ros_fields import point_cloud_fields

    rng = np.random.default_rng(0)
    fields, kind = {
        "image": (image_fields(rng.integers(0, 255, (3, 5, 3), np.uint8), 12, "c"), "sensor_msgs/msg/Image"),
        "info": (
            camera_info_fields(Intrinsics(8, 6, 5.0, 5.5, 3.5, 2.5), 9, "c"),
            "sensor_msgs/msg/CameraInfo",
        ),
        "grid": (
            occupancy_grid_fields(OccupancyGrid(SPEC, CLASSES).nav_values, SPEC, 3, "map"),
            "nav_msgs/msg/OccupancyGrid",
        ),
        "cloud": (
            point_cloud_fields(rng.random((7, 3), np.float32), np.arange(7, dtype=np.uint8), 4, "c"),
            "sensor_msgs/msg/PointCloud2",
        ),
        "diagnostics": (
            m.diagnostic_fields(5, [("a", m.ERROR, "b", {"k": 1})]),
            "diagnostic_msgs/msg/DiagnosticArray",
        ),
    }[name]
    package, _, cls = kind.split("/")
    message = m.ros_message(getattr(importlib.import_module(f"{package}.msg"), cls), fields)
    ours = rosbags_message(STORE, kind, rosbags_levels(fields) if name == "diagnostics" else fields)
    # bytes between aligned fields are not defined, so rclpy's are read by rosbags and written again
    again = STORE.serialize_cdr(STORE.deserialize_cdr(serialize_message(message), kind), kind)
    assert bytes(again) == bytes(STORE.serialize_cdr(ours, kind))


def test_costs_of_an_update_are_those_of_the_whole() -> None:
    costs = np.arange(12, dtype=np.uint8).reshape(3, 4)
    values = occupancy_from_costs(costs)
    update = m.update_fields(values, (1, 0, 2, 3), SPEC, 0)
    np.testing.assert_array_equal(update["data"].reshape(3, 2), values[:, 1:3])
