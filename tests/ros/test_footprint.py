"""The robot's shape in Nav2: what swardmap calls blocked for its centre, Nav2 calls so too."""

import math
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from swardmap.config import Config, config_from_dict
from swardmap.errors import ConfigError, InvalidValueError
from swardmap.mapping.costmap import INSCRIBED, cost_of_squared_distance
from swardmap.ros.footprint import Footprint, footprint_from_text, nav2_radius
from swardmap.ros.nav2_files import nav2_files
from tests.ros.nav2_twins import blocked, inscribed_of, inscribed_radius_m

INFLATED = ("map", "obstacles", "stvl", "semantic")
RADII_M = (0.1, 0.2, 0.25, 0.3, 0.32, 0.345, 0.5, 0.75, 1.0)
MARGINS_M = (0.0, 0.05, 0.1, 0.1414, 0.21, 0.28, 0.38, 0.5)
RESOLUTIONS_M = (0.03, 0.05, 0.1)
SHAPES = {
    "mower": [[0.5, 0.3], [0.5, -0.3], [-0.3, -0.3], [-0.3, 0.3]],
    "diamond": [[0.5, 0.0], [0.0, 0.5], [-0.5, 0.0], [0.0, -0.5]],
    "triangle": [[0.6, 0.0], [-0.4, 0.5], [-0.4, -0.5]],
    "notched": [[0.5, 0.4], [0.1, 0.0], [0.5, -0.4], [-0.5, -0.4], [-0.5, 0.4]],
}


def config_of(radius_m: float, margin_m: float, resolution_m: float = 0.05) -> Config:
    costs = {"inscribed_radius_m": radius_m, "margin_m": margin_m, "inflation_radius_m": radius_m + 0.25}
    return config_from_dict({"costmap": costs, "grid": {"resolution_m": resolution_m}})


def costmaps(config: Config, name: str, footprint: Footprint | None = None) -> list[dict[str, Any]]:
    tree = yaml.safe_load(nav2_files(config, footprint=footprint)[f"{name}.yaml"])
    return [tree[at][at]["ros__parameters"] for at in ("global_costmap", "local_costmap") if at in tree]


def short_and_more(config: Config, costmap: dict[str, Any]) -> tuple[int, int]:
    """Distances at which a cell is blocked in our costs and not in Nav2's, and the other way round."""
    costs, resolution_m = config.costmap, config.grid.resolution_m
    table = cost_of_squared_distance(resolution_m, costs, costs.obstacle_margin_m)
    squared = np.arange(len(table) - 1)
    ours = table[:-1] >= INSCRIBED
    inflation_m = costmap["inflation_layer"]["inflation_radius"]
    theirs = blocked(squared, inscribed_of(costmap), inflation_m, resolution_m)
    return int((ours & ~theirs).sum()), int((theirs & ~ours).sum())


@pytest.mark.parametrize("name", INFLATED)
def test_no_cell_is_short_for_any_radius_and_margin(name: str) -> None:
    for radius_m in RADII_M:
        for margin_m in MARGINS_M:
            for resolution_m in RESOLUTIONS_M if name == "map" else (0.05,):
                config = config_of(radius_m, margin_m, resolution_m)
                for costmap in costmaps(config, name):
                    short, more = short_and_more(config, costmap)
                    assert short == 0, (radius_m, margin_m, resolution_m)
                    assert more <= 1, (radius_m, margin_m, resolution_m)  # rounded up by 0.1 mm at most


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("margin_m", MARGINS_M)
def test_no_cell_is_short_for_a_polygon(shape: str, margin_m: float) -> None:
    footprint = Footprint(np.array(SHAPES[shape]))
    config = config_of(round(footprint.inscribed_radius_m, 6), margin_m)
    for name in INFLATED:
        for costmap in costmaps(config_of(0.3, margin_m), name, footprint):
            assert "robot_radius" not in costmap  # Nav2 takes it before the footprint where both are set
            assert costmap["footprint_padding"] == 0.0
            assert short_and_more(config, costmap)[0] == 0


def test_nav2s_radius_without_the_correction_is_short() -> None:
    """Why: the polygon that Nav2 makes of a radius lies inside the circle."""
    radius_m, margin_m = 0.32, 0.28
    plain = {"robot_radius": radius_m, "footprint_padding": margin_m}
    assert inscribed_of(plain) < radius_m + margin_m - 0.005
    assert inscribed_of({"robot_radius": nav2_radius(0.6), "footprint_padding": 0.0}) >= 0.6
    assert nav2_radius(0.6) < 0.6 / math.cos(math.pi / 16) + 2e-4


corners = st.lists(
    st.tuples(st.floats(0.15, 1.5), st.floats(0.0, 2 * math.pi)),
    min_size=3,
    max_size=12,
    unique_by=lambda c: c[1],
)


@given(corners, st.floats(0.0, 0.6))
def test_a_grown_outline_keeps_the_margin_on_every_side(
    polar: list[tuple[float, float]], margin_m: float
) -> None:
    points = np.array([(r * math.cos(a), r * math.sin(a)) for r, a in sorted(polar, key=lambda c: c[1])])
    try:
        footprint = Footprint(points)
    except InvalidValueError:
        return  # the base is outside, or all corners lie on a line
    grown = footprint.grown(margin_m)
    radius_m = inscribed_radius_m([(x, y) for x, y in grown.tolist()])
    assert radius_m == pytest.approx(footprint.inscribed_radius_m + margin_m, abs=1e-6)
    # every corner of the robot is farther inside than the margin
    sides = zip(grown, np.roll(grown, -1, axis=0), strict=True)
    for a, b in sides:
        along = (b - a) / max(np.hypot(*(b - a)), 1e-12)
        inside = along[0] * (points[:, 1] - a[1]) - along[1] * (points[:, 0] - a[0])
        assert inside.min() >= margin_m - 1e-6 or np.hypot(*(b - a)) < 1e-6


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[[0.4, 0.3], [0.4, -0.3]]", "3 to"),
        ("[[0.4, 0.3], [0.6, 0.3], [0.5, 0.6]]", "base"),
        ("[[0.4, 0.3], [0.0, 0.0], [-0.4, -0.3]]", "line"),
        ("[[0.4, 0.3], [0.4, NaN], [-0.4, -0.3]]", "finite"),
        ("[[0.4, 0.3], [0.4], [-0.4, -0.3]]", r"\[\[x, y\]"),
        ("round", r"\[\[x, y\]"),
    ],
)
def test_what_is_no_outline_is_refused_in_one_line(text: str, expected: str) -> None:
    with pytest.raises(ConfigError, match=expected) as error:
        footprint_from_text(text)
    assert "\n" not in str(error.value)


def test_the_collision_monitor_gets_the_outline_too() -> None:
    footprint = Footprint(np.array(SHAPES["mower"]))
    tree = yaml.safe_load(nav2_files(config_of(0.3, 0.2), footprint=footprint)["collision_monitor.yaml"])
    zone = tree["collision_monitor"]["ros__parameters"]["stop_zone"]
    assert zone["type"] == "polygon"
    assert "radius" not in zone
    found = np.array(yaml.safe_load(zone["points"]))
    expected = np.array([[0.7, 0.5], [0.7, -0.5], [-0.5, -0.5], [-0.5, 0.5]])
    np.testing.assert_allclose(sorted(map(tuple, found)), sorted(map(tuple, expected)), atol=5e-4)
