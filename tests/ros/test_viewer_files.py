"""RViz's and Foxglove's files name topics that the node has, with the type that each display takes."""

import json
from collections.abc import Iterator
from typing import Any

import pytest
import yaml

from swardmap.config import Config
from swardmap.ros.map_outputs import OF_MAP
from swardmap.ros.nav2_files import nav2_files
from swardmap.ros.outputs import CLOUD, GRID, IMAGE, OF_CAMERA, OF_NODE, UPDATE

TAKES = {"rviz_default_plugins/Map": GRID, "rviz_default_plugins/PointCloud2": CLOUD,
         "rviz_default_plugins/Image": IMAGE}  # fmt: skip
RIGS = [("camera",), ("front_left", "front_right", "rear_left", "rear_right")]


def outputs(cameras: tuple[str, ...], at: str) -> dict[str, str]:
    found = {f"{at}/swardmap/{name}": kind for name, kind in (*OF_NODE.items(), *OF_MAP.items())}
    return found | {f"{at}/swardmap/{c}/{name}": kind for c in cameras for name, kind in OF_CAMERA.items()}


@pytest.mark.parametrize("cameras", RIGS)
@pytest.mark.parametrize("at", ["", "/mower1"])
def test_each_display_of_rviz_shows_what_it_can_take(cameras: tuple[str, ...], at: str) -> None:
    files = nav2_files(Config(), cameras, at, base_frame="base", map_frame="odom")
    manager = yaml.safe_load(files["swardmap.rviz"])["Visualization Manager"]
    known, shown = outputs(cameras, at), set()
    assert manager["Global Options"]["Fixed Frame"] == "odom"
    assert manager["Views"]["Current"]["Target Frame"] == "base"
    for display in manager["Displays"]:
        if "Topic" not in display:
            continue
        topic = display["Topic"]["Value"]
        assert known[topic] == TAKES[display["Class"]]
        shown.add(topic)
        if display["Class"].endswith("Map"):  # the last one must reach who comes later
            assert display["Topic"]["Durability Policy"] == "Transient Local"
            updates = display["Update Topic"]["Value"]
            assert known.get(updates, UPDATE) == UPDATE
    assert {f"{at}/swardmap/map", f"{at}/swardmap/costmap", f"{at}/swardmap/obstacle_cells"} <= shown
    assert {f"{at}/swardmap/{c}/obstacles" for c in cameras} <= shown


def topics_in(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from topics_in(key)
            yield from topics_in(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from topics_in(inner)
    elif isinstance(value, str) and value.startswith("/"):
        yield value


@pytest.mark.parametrize("cameras", RIGS)
@pytest.mark.parametrize("at", ["", "/mower1"])
def test_every_topic_of_the_layout_is_one_of_the_node(cameras: tuple[str, ...], at: str) -> None:
    layout = json.loads(nav2_files(Config(), cameras, at)["foxglove.json"])
    known = {*outputs(cameras, at), "/diagnostics"}
    found = {topic.removesuffix(".data") for topic in topics_in(layout["configById"])}
    assert found <= known
    assert {f"{at}/swardmap/{name}" for name in ("costmap", "stop", "health_json")} <= found
    assert {f"{at}/swardmap/{c}/mask" for c in cameras} <= found


@pytest.mark.parametrize("cameras", RIGS)
def test_every_panel_of_the_layout_is_in_it_once(cameras: tuple[str, ...]) -> None:
    layout = json.loads(nav2_files(Config(), cameras)["foxglove.json"])

    def leaves(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(layout["layout"])) == sorted(layout["configById"])
