"""What Nav2 makes of its parameters, written from its sources for the tests; nothing of swardmap is in it.

ros-navigation/navigation2, branches humble 3c3db59, jazzy f4108e5, kilted 71a1d84, main a3a9704 (2026-08-21).
"""

import json
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]

JOINS_PARENT = {"humble": False, "jazzy": False, "kilted": True, "main": True}
"""Whether layers put a relative topic beside the costmap's namespace (Layer::joinWithParentNamespace)."""


def footprint_from_radius(radius_m: float) -> list[Point]:
    """nav2_costmap_2d/src/footprint.cpp, makeFootprintFromRadius."""
    angles = [i * 2 * math.pi / 16 for i in range(16)]
    return [(math.cos(angle) * radius_m, math.sin(angle) * radius_m) for angle in angles]


def footprint_from_string(text: str) -> list[Point]:
    """makeFootprintFromString: nav2_util/src/array_parser.cpp reads numbers as float."""
    return [(float(np.float32(x)), float(np.float32(y))) for x, y in json.loads(text)]


def padded(footprint: list[Point], padding_m: float) -> list[Point]:
    """padFootprint: each corner is moved by the sign of its coordinates."""
    return [(x + np.sign(x) * padding_m, y + np.sign(y) * padding_m) for x, y in footprint]


def inscribed_radius_m(footprint: list[Point]) -> float:
    """calculateMinAndMaxDistances, its first number: nearest corner or side."""
    ends = [*footprint[1:], footprint[0]]
    return min(
        min(math.hypot(*a), distance_to_line(0.0, 0.0, *a, *b)) for a, b in zip(footprint, ends, strict=True)
    )


def distance_to_line(px: float, py: float, x0: float, y0: float, x1: float, y1: float) -> float:
    """nav2_costmap_2d/src/costmap_math.cpp, distanceToLine."""
    along = ((px - x0) * (x1 - x0) + (py - y0) * (y1 - y0)) / ((x1 - x0) ** 2 + (y1 - y0) ** 2)
    along = min(max(along, 0.0), 1.0)
    return math.hypot(px - (x0 + along * (x1 - x0)), py - (y0 + along * (y1 - y0)))


def inscribed_of(costmap: Mapping[str, object]) -> float:
    """costmap_2d_ros.cpp, getParameters and setRobotFootprint: the radius that the inflation layer gets."""
    text, radius_m = str(costmap.get("footprint", "[]")), costmap.get("robot_radius", 0.1)
    assert isinstance(radius_m, float)
    shape = footprint_from_radius(radius_m) if text in ("", "[]") else footprint_from_string(text)
    padding_m = costmap.get("footprint_padding", 0.01)
    assert isinstance(padding_m, float)
    return inscribed_radius_m(padded(shape, padding_m))


def blocked(
    squared_cells: NDArray[np.int64], inscribed_m: float, inflation_m: float, resolution_m: float
) -> NDArray[np.bool_]:
    """Whether a cell so far from a lethal one is lethal or inscribed.

    inflation_layer.hpp, computeCost; a map message gives the resolution as float32, and the layer reaches
    cellDistance(inflation_radius) cells.
    """
    resolution = float(np.float32(resolution_m))
    distance = np.sqrt(squared_cells.astype(np.float64))
    within = distance <= max(0.0, math.ceil(inflation_m / resolution))
    return np.asarray(within & ((distance == 0) | (distance * resolution <= inscribed_m)))


def resolved(topic: str, namespace: str, node: str, remaps: dict[str, str] | None = None) -> str:
    """A topic's full name (design.ros2.org, topic names and static remapping): expand, then remap."""

    def expanded(name: str) -> str:
        if name.startswith("~"):
            return f"{namespace.rstrip('/')}/{node}/{name[1:].lstrip('/')}"
        return name if name.startswith("/") else f"{namespace.rstrip('/')}/{name}"

    rules = {expanded(old): expanded(new) for old, new in (remaps or {}).items()}
    return rules.get(expanded(topic), expanded(topic))


def layer_topic(
    topic: str, costmap: str, namespace: str, distribution: str, remaps: dict[str, str] | None = None
) -> str:
    """What a layer of a costmap subscribes to.

    The costmap is a node of its own in a namespace of its own (costmap_2d_ros.cpp: add_namespaces(parent,
    local)); a relative topic resolves below that in Humble and Jazzy (static_layer.cpp, obstacle_layer.cpp
    take it as it is), and beside it from Kilted on (layer.cpp, joinWithParentNamespace).
    """
    own = f"{namespace.rstrip('/')}/{costmap}"
    if JOINS_PARENT[distribution] and not topic.startswith("/"):
        topic = f"{own.rpartition('/')[0]}/{topic}"
    return resolved(topic, own, costmap, remaps)
