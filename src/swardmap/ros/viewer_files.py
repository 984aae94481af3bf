"""A view of the node for RViz and a layout for Foxglove, with the topics of its cameras."""

import json
from collections.abc import Sequence
from typing import Any

import yaml

LATCHED = {"Depth": 5, "Durability Policy": "Transient Local", "History Policy": "Keep Last",
           "Reliability Policy": "Reliable"}  # fmt: skip
SENSOR = {"Depth": 5, "Durability Policy": "Volatile", "History Policy": "Keep Last",
          "Reliability Policy": "Best Effort"}  # fmt: skip


def rviz_config(
    cameras: Sequence[str], namespace: str = "", map_frame: str = "map", base_frame: str = "base_link"
) -> str:
    """A display config of RViz 2: map, costmap, obstacles of the map, clouds and masks of each camera.

    Args:
        cameras: names.
        namespace: of the node.
        map_frame: fixed frame.
        base_frame: of the robot, which the view follows.
    """
    at = f"{namespace}/swardmap"
    displays: list[dict[str, Any]] = [
        {"Class": "rviz_default_plugins/Grid", "Name": "Grid", "Enabled": True, "Cell Size": 1},
        _map("Map", f"{at}/map", "map", True), _map("Costmap", f"{at}/costmap", "costmap", True),
        _map("Classes", f"{at}/layers/classes", "map", False),
        _map("Evidence", f"{at}/layers/evidence", "map", False),
        _cloud("Obstacles of the map", f"{at}/obstacle_cells", True, 5),
        {"Class": "rviz_default_plugins/TF", "Name": "TF", "Enabled": False},
    ]  # fmt: skip
    for camera in cameras:
        displays.append(_cloud(f"{camera}: obstacles", f"{at}/{camera}/obstacles", True, 3))
        displays.append(_cloud(f"{camera}: cloud", f"{at}/{camera}/cloud", False, 2))
        displays.append(_mask(f"{camera}: mask", f"{at}/{camera}/mask"))
    view = {"Class": "rviz_default_plugins/TopDownOrtho", "Name": "Current View", "Scale": 60,
            "Target Frame": base_frame}  # fmt: skip
    manager = {
        "Class": "", "Displays": displays, "Enabled": True, "Name": "root",
        "Global Options": {"Fixed Frame": map_frame},
        "Tools": [{"Class": "rviz_default_plugins/MoveCamera"}, {"Class": "rviz_default_plugins/Measure"}],
        "Views": {"Current": view, "Saved": []},
    }  # fmt: skip
    return yaml.safe_dump({"Panels": [{"Class": "rviz_common/Displays", "Name": "Displays"}],
                           "Visualization Manager": manager}, sort_keys=False)  # fmt: skip


def foxglove_layout(cameras: Sequence[str], namespace: str = "", base_frame: str = "base_link") -> str:
    """A layout of Foxglove: map and clouds in 3D, a mask for each camera, the stop flag, the node's status.

    Args:
        cameras: names.
        namespace: of the node.
        base_frame: of the robot, which the view follows.
    """
    at = f"{namespace}/swardmap"
    shown = {f"{at}/costmap": True, f"{at}/map": False, f"{at}/obstacle_cells": True}
    shown |= {f"{at}/{camera}/obstacles": True for camera in cameras}
    panels: dict[str, Any] = {
        "3D!swardmap": {
            "followTf": base_frame, "topics": {topic: {"visible": on} for topic, on in shown.items()},
        },
        "Indicator!stop": {
            "path": f"{at}/stop.data", "style": "background", "fallbackLabel": "silent: stop",
            "rules": [
                {"operator": "=", "rawValue": "true", "color": "#a00000", "label": "stop"},
                {"operator": "=", "rawValue": "false", "color": "#007000", "label": "go"},
            ],
        },
        "RawMessages!status": {"topicPath": f"{at}/health_json", "expansion": "all"},
        "DiagnosticSummary!faults": {"topicToRender": "/diagnostics"},
    }  # fmt: skip
    masks = [f"Image!{camera}" for camera in cameras]
    panels |= {
        panel: {"imageMode": {"imageTopic": f"{at}/{camera}/mask", "minValue": 0, "maxValue": 3}}
        for panel, camera in zip(masks, cameras, strict=True)
    }
    side = _stacked(["Indicator!stop", *masks, "DiagnosticSummary!faults", "RawMessages!status"])
    layout = {"first": "3D!swardmap", "second": side, "direction": "row", "splitPercentage": 65}
    return (
        json.dumps({"configById": panels, "globalVariables": {}, "userNodes": {}, "layout": layout}, indent=1)
        + "\n"
    )


def _stacked(panels: Sequence[str]) -> Any:
    """Panels one below the other, all of one height."""
    first, *rest = panels
    if not rest:
        return first
    return {
        "first": first,
        "second": _stacked(rest),
        "direction": "column",
        "splitPercentage": 100 / len(panels),
    }


def _map(name: str, topic: str, scheme: str, enabled: bool) -> dict[str, Any]:
    """RViz takes the topic of updates beside that of the map."""
    return {
        "Class": "rviz_default_plugins/Map", "Name": name, "Enabled": enabled, "Color Scheme": scheme,
        "Alpha": 0.7, "Draw Behind": True, "Topic": LATCHED | {"Value": topic},
        "Update Topic": SENSOR | {"Reliability Policy": "Reliable", "Value": f"{topic}_updates"},
    }  # fmt: skip


def _cloud(name: str, topic: str, enabled: bool, pixels: int) -> dict[str, Any]:
    return {
        "Class": "rviz_default_plugins/PointCloud2", "Name": name, "Enabled": enabled, "Style": "Points",
        "Size (Pixels)": pixels, "Color Transformer": "Intensity", "Channel Name": "label",
        "Topic": SENSOR | {"Value": topic},
    }  # fmt: skip


def _mask(name: str, topic: str) -> dict[str, Any]:
    return {
        "Class": "rviz_default_plugins/Image", "Name": name, "Enabled": False, "Min Value": 0, "Max Value": 3,
        "Normalize Range": False, "Topic": SENSOR | {"Value": topic},
    }  # fmt: skip
