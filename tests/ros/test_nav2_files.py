"""The files for Nav2 against what Nav2 declares, and against what the node publishes."""

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import yaml

from swardmap.cli.app import run
from swardmap.config import Config, config_from_dict
from swardmap.errors import InvalidValueError, OutputError
from swardmap.io.bags.ros_fields import POINT
from swardmap.io.files import write_text
from swardmap.io.maps.margin_file import Margin, margin_text
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.ros.intake import ONLY_CAMERA
from swardmap.ros.map_outputs import OF_MAP
from swardmap.ros.nav2_files import NAMES, nav2_files, write_nav2_files
from swardmap.ros.parameters import Parameters, declarations, parameters_from
from tests.ros import drive
from tests.ros.nav2_parameters import (
    CLASS_TYPE,
    COSTMAP,
    FILTER_INFO,
    FILTERS,
    LAYERS,
    MONITOR,
    MONITOR_SOURCE,
    POLYGON,
    SOURCES,
)
from tests.ros.nav2_twins import JOINS_PARENT, inscribed_of, layer_topic, resolved
from tests.ros.node_process import ROOT

MARGIN = config_from_dict({"costmap": {"margin_m": 0.38, "person_margin_m": 0.5, "inscribed_radius_m": 0.32}})
COSTMAPS = ("map", "costs", "obstacles", "stvl", "semantic")

TOPICS = {
    "map_topic": ("map", "costmap"), "segmentation_topic": ("mask",), "confidence_topic": ("confidence",),
    "pointcloud_topic": ("cloud",), "labels_topic": ("label_info",),
    "topic": ("obstacles", "cloud", "ground", "obstacle_cells"),
}  # fmt: skip
"""Parameter of Nav2 -> outputs of the node of the type it takes; which these are: test_node.py."""


def trees(config: Config = MARGIN, **options: Any) -> dict[str, Any]:
    files = nav2_files(config, **options)
    return {name: yaml.safe_load(text) for name, text in files.items() if name.endswith(".yaml")}


def costmaps(tree: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        tree[name][name]["ros__parameters"] for name in ("global_costmap", "local_costmap") if name in tree
    ]


def held(values: dict[str, Any], declared: dict[str, Any], also: tuple[str, ...] = ()) -> None:
    """Every name is declared, and every value has the type of its default."""
    for name, value in values.items():
        if name in also:
            continue
        assert name in declared, name
        assert type(value) is type(declared[name]), (name, value)


def check_layer(layer: dict[str, Any]) -> None:
    plugin = layer["plugin"]
    names = tuple(layer.get("observation_sources", "").split())
    held(layer, LAYERS[plugin], ("plugin", *names))
    for name in names:
        types = tuple(layer[name].get("class_types", ()))
        held(layer[name], SOURCES[plugin], types)
        for kind in types:
            held(layer[name][kind], CLASS_TYPE)


@pytest.mark.parametrize("cameras", [("camera",), ("front_left", "front_right", "rear_left", "rear_right")])
@pytest.mark.parametrize("name", COSTMAPS)
def test_every_parameter_is_one_that_nav2_declares(name: str, cameras: tuple[str, ...]) -> None:
    found = costmaps(trees(cameras=cameras)[f"{name}.yaml"])
    assert found
    for costmap in found:
        held(costmap, COSTMAP, tuple(costmap["plugins"]))
        for layer in costmap["plugins"]:
            check_layer(costmap[layer])


def test_the_collision_monitors_are_too() -> None:
    monitor = trees()["collision_monitor.yaml"]["collision_monitor"]["ros__parameters"]
    held(monitor, MONITOR, (*monitor["polygons"], *monitor["observation_sources"]))
    for polygon in monitor["polygons"]:
        held(monitor[polygon], POLYGON)
    for source in monitor["observation_sources"]:
        held(monitor[source], MONITOR_SOURCE)


def test_the_filters_are_too_and_their_masks_are_outputs_of_the_node() -> None:
    tree = trees(namespace="/mower")["filters.yaml"]
    (costmap,) = costmaps(tree)
    held(costmap, COSTMAP, tuple(costmap["filters"]))
    told = {}
    for name in costmap["filters"]:
        held(costmap[name], FILTERS[costmap[name]["plugin"]], ("plugin",))
        told[costmap[name]["filter_info_topic"]] = costmap[name]["plugin"]
    for server in ("swardmap_keepout_info", "swardmap_speed_info"):
        info = tree[server]["ros__parameters"]
        held(info, FILTER_INFO)
        plugin = told.pop(info["filter_info_topic"])
        # nav2_costmap_2d/filter_values.hpp: 0 keep-out, 1 speed in percent; limit = base + multiplier * mask
        assert (
            info["type"] == {"nav2_costmap_2d::KeepoutFilter": 0, "nav2_costmap_2d::SpeedFilter": 1}[plugin]
        )
        assert (info["base"], info["multiplier"]) == (0.0, 1.0)
        assert info["mask_topic"].removeprefix("/mower/swardmap/") in OF_MAP
    assert not told


def test_the_margin_is_in_all_of_them_the_larger_one_where_nav2_does_not_know_persons() -> None:
    found = trees()
    for name in ("map", "obstacles", "stvl", "semantic"):
        for costmap in costmaps(found[f"{name}.yaml"]):
            assert costmap["footprint_padding"] == 0.0
            assert inscribed_of(costmap) == pytest.approx(0.32 + 0.5, abs=2e-4)
            assert costmap["inflation_layer"]["inflation_radius"] == pytest.approx(0.5 + 0.55)
    monitor = found["collision_monitor.yaml"]["collision_monitor"]["ros__parameters"]
    assert monitor["stop_zone"]["radius"] == pytest.approx(0.32 + 0.5)
    for costmap in costmaps(found["costs.yaml"]):  # they have been grown already: once is enough
        assert costmap["plugins"] == ["swardmap_layer"]
        assert inscribed_of(costmap) == pytest.approx(0.32, abs=2e-4)


def test_unknown_is_free_in_none_of_them() -> None:
    for name in COSTMAPS:
        for costmap in costmaps(trees()[f"{name}.yaml"]):
            assert costmap["track_unknown_space"] is True


def named_topics(value: Any, key: str = "") -> list[tuple[str, str]]:
    if isinstance(value, dict):
        return [item for k, v in value.items() for item in named_topics(v, k)]
    return [(key, value)] if key in TOPICS and isinstance(value, str) else []


@pytest.mark.parametrize("cameras", [(ONLY_CAMERA,), tuple(drive.RIG["cameras"])])
def test_every_topic_is_one_that_the_node_publishes(cameras: tuple[str, ...]) -> None:
    from swardmap.ros.outputs import OF_CAMERA, OF_NODE

    outputs = {f"/mower/swardmap/{name}" for name in OF_NODE}
    outputs |= {f"/mower/swardmap/{camera}/{name}" for camera in cameras for name in OF_CAMERA}
    seen = set()
    for name in (*COSTMAPS, "collision_monitor"):
        for key, topic in named_topics(trees(cameras=cameras, namespace="/mower")[f"{name}.yaml"]):
            assert topic in outputs, topic
            assert topic.rpartition("/")[2] in TOPICS[key]
            seen.add(topic)
    assert {f"/mower/swardmap/{camera}/obstacles" for camera in cameras} <= seen


@pytest.mark.parametrize("distribution", JOINS_PARENT)
@pytest.mark.parametrize("namespace", ["", "/mower1", "/fleet/mower1"])
def test_nav2_subscribes_to_what_the_node_publishes(namespace: str, distribution: str) -> None:
    """Names resolved as ROS and each Nav2 do it, wherever Nav2 itself runs, and remapped on both sides."""
    at, files = namespace or "/", trees(namespace=namespace)
    for name, kind in (("map", "map"), ("costs", "costmap")):
        published = resolved(f"~/{kind}", at, "swardmap")
        remaps = {published: "/lawn/map"}
        for where, tree in files[f"{name}.yaml"].items():
            topic = tree[where]["ros__parameters"]["swardmap_layer"]["map_topic"]
            for nav2_at in ("/", "/nav", at):
                heard = layer_topic(topic, where, nav2_at, distribution)
                assert heard == published
                assert f"{heard}_updates" == resolved(f"~/{kind}_updates", at, "swardmap")
                remapped = layer_topic(topic, where, nav2_at, distribution, remaps)
                assert remapped == resolved(f"~/{kind}", at, "swardmap", remaps) == "/lawn/map"


@pytest.mark.parametrize("distribution", JOINS_PARENT)
def test_the_map_topic_that_the_page_names_is_map_servers(distribution: str) -> None:
    """`map_topic: map` would be /global_costmap/map in Humble and Jazzy: no map at all."""
    page = (ROOT / "docs/nav2.md").read_text(encoding="utf-8")
    (topic,) = set(re.findall(r"`map_topic: ([\w/]+)`", page.split("## Maps as files")[1]))
    for costmap in ("global_costmap", "local_costmap"):
        assert layer_topic(topic, costmap, "/", distribution) == resolved("map", "/", "map_server")


def test_the_classes_of_the_semantic_layer_are_those_of_the_network() -> None:
    (costmap,) = costmaps(trees()["semantic.yaml"])
    source = costmap["semantic_segmentation_layer"]["camera"]
    named = {name: source[kind] for kind in source["class_types"] for name in source[kind]["classes"]}
    labels = {c.name: c.role for c in GRASS_OBSTACLE_PERSON.classes if c.name != "void"}
    assert set(named) == set(labels)
    for name, role in labels.items():
        assert named[name]["max_cost"] == named[name]["base_cost"] == (0 if role == "free" else 254)
        assert named[name]["dominant_priority"] == (role == "person")


def test_a_camera_of_a_rig_may_rest_and_one_alone_may_not() -> None:
    for cameras, seconds in ((("camera",), 0.5), (("front", "rear"), 0.0)):
        (costmap,) = costmaps(trees(cameras=cameras)["obstacles.yaml"])
        layer = costmap["obstacle_layer"]
        assert {layer[s]["expected_update_rate"] for s in layer["observation_sources"].split()} == {seconds}


def test_the_nodes_own_file_holds_parameters_of_the_node() -> None:
    tree = trees()["swardmap.yaml"]["/**"]["ros__parameters"]
    flat = {
        f"{section}.{key}" if isinstance(values, dict) else section: value
        for section, values in tree.items()
        for key, value in (values.items() if isinstance(values, dict) else [("", values)])
    }
    declared = {d.name: d for d in declarations(Parameters())}
    for name, value in flat.items():
        assert name in declared
        if declared[name].value is not None:
            assert type(value) is type(declared[name].value), name
    assert parameters_from(flat).config.costmap.inscribed_radius_m == 0.32


def test_the_verb_takes_the_margin_file_and_the_rig(tmp_path: Path) -> None:
    write_text(tmp_path / "margin.yaml", margin_text(Margin(0.21), "Measured."))
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(drive.RIG, sort_keys=False))
    options = ["--config", str(tmp_path / "margin.yaml"), "--rig", str(tmp_path / "rig.yaml")]
    assert run(["nav2", str(tmp_path / "out"), *options, "--namespace", "/mower"]) == 0
    assert {p.stem for p in (tmp_path / "out").iterdir()} == {*NAMES, "fastdds", "foxglove"}
    (costmap,) = costmaps(yaml.safe_load((tmp_path / "out/stvl.yaml").read_text()))
    assert inscribed_of(costmap) == pytest.approx(0.3 + 0.21, abs=2e-4)
    layer = costmap["stvl_layer"]
    assert layer["rear_left_mark"]["topic"] == "/mower/swardmap/rear_left/obstacles"
    assert run(["nav2", str(tmp_path / "out")]) == 1  # it does not write over what somebody may have changed


def test_the_profile_gives_dds_room_for_any_image_that_the_node_sends() -> None:
    root = ET.fromstring(nav2_files(Config())["fastdds.xml"])  # noqa: S314 - our own file
    (shm,) = (
        t for t in root.iter() if t.tag.endswith("transport_descriptor") and "SHM" in "".join(t.itertext())
    )
    sizes = {child.tag.rpartition("}")[2]: child.text for child in shm}
    organised_vga = 640 * 480 * POINT.itemsize
    assert int(sizes["maxMessageSize"] or 0) > organised_vga
    assert int(sizes["segment_size"] or 0) > 4 * organised_vga


def test_what_is_there_already_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text("mine")
    with pytest.raises(OutputError, match=r"map\.yaml exists"):
        write_nav2_files(tmp_path, nav2_files(Config()))
    assert [p.name for p in tmp_path.iterdir()] == ["map.yaml"]


@pytest.mark.parametrize("namespace", ["mower", "/mower/"])
def test_a_namespace_that_ros_does_not_take_is_refused(namespace: str) -> None:
    with pytest.raises(InvalidValueError, match="namespace"):
        nav2_files(Config(), namespace=namespace)
