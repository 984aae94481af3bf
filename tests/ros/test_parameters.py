"""Parameters of the node: the whole configuration under its own names, changed where that is safe."""

import dataclasses
from typing import Any

import pytest

from swardmap.config import Config, config_from_dict, config_to_dict
from swardmap.errors import ConfigError
from swardmap.ros.parameters import (
    LEFT_OUT,
    NodeConfig,
    Parameters,
    changed,
    declarations,
    parameters_from,
)

EVIDENCE = Parameters(config=config_from_dict({"grid": {"mode": "evidence"}}))


def leaves(tree: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in tree.items():
        found |= leaves(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found


def test_every_setting_is_declared_under_its_own_name_with_its_own_default() -> None:
    declared = {d.name: d.value for d in declarations(Parameters())}
    settings = {
        name: value
        for name, value in leaves(config_to_dict(Config())).items()
        if name not in LEFT_OUT and name.split(".")[0] not in LEFT_OUT
    }
    own = dataclasses.asdict(NodeConfig())
    assert declared == settings | own
    assert not set(settings) & set(own)


def test_every_declaration_says_what_it_is_for() -> None:
    for declaration in declarations(Parameters()):
        assert declaration.about, declaration.name
    limits = {d.name: d.limits for d in declarations(Parameters())}
    assert limits["map_rate_hz"] == "at least 0.1, at most 100"
    assert limits["grid.min_points"] == "at least 1"
    assert limits["rig_file"] == ""


def test_declared_values_make_the_parameters_again() -> None:
    base = parameters_from({"grid.origin_m": [-5.0, -5.0], "grid.size_m": [10.0, 10.0], "queue_frames": 3})
    assert base.config.grid.origin_m == (-5.0, -5.0)
    assert parameters_from({d.name: d.value for d in declarations(base)}) == base


def test_the_word_none_takes_a_value_away_where_there_may_be_none() -> None:
    assert parameters_from({"watchdog.frozen_s": "none"}).config.watchdog.frozen_s is None
    assert parameters_from({"rig_file": "none"}).node.rig_file is None
    with pytest.raises(ConfigError, match="stale_s"):
        parameters_from({"watchdog.stale_s": "none"})


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"grid.resolution": 0.1}, "resolution_m"),
        ({"grid.resolution_m": "fine"}, "resolution_m"),
        ({"queue_frames": 0}, "queue_frames"),
        ({"image_reliability": "maybe"}, "best_effort, reliable"),
        ({"cloud.min_range_m": 9.0}, "min_range_m below max_range_m"),
        ({"cloud.voxel_m": 0.05}, "backend: plain"),
        ({"backend.length": 1.0}, "backend"),
    ],
)
def test_what_cannot_be_right_is_refused(values: dict[str, Any], expected: str) -> None:
    with pytest.raises(ConfigError, match=expected):
        parameters_from(values)


SAFE: dict[str, Any] = {
    "cloud.max_range_m": 6.0, "cloud.consistent_neighbours": 2, "costmap.margin_m": 0.3,
    "costmap.inflation_radius_m": 0.8, "segmenter.min_confidence": 0.5, "geometry.enabled": True,
    "geometry.min_height_m": 0.2, "organised_cloud": True, "obstacle_cells_range_m": 5.0,
    "map_rate_hz": 2.0, "full_map_s": 0.0,
    "speed_zone_m": 5.0, "speed_zone_percent": 20.0,
    "robot_radius_m": 2.0, "start_area_radius_m": 0.4, "start_area_ahead_m": 1.5, "start_area_s": 30.0,
    "start_area_at_start": True,
    "pose_wait_ms": 100.0, "save_folder": "elsewhere", "cloud_stride": 4, "grid.min_points": 2,
}  # fmt: skip


@pytest.mark.parametrize("name", SAFE)
def test_what_is_read_for_each_frame_is_changed_at_once(name: str) -> None:
    after = changed(Parameters(), {name: SAFE[name]}, configured=True)
    assert {d.name: d.value for d in declarations(after)}[name] == SAFE[name]


UNSAFE: dict[str, tuple[Any, str]] = {
    "grid.resolution_m": (0.1, "begin anew"), "grid.mode": ("evidence", "begin anew"),
    "evidence.mark_at": (0.2, "begin anew"), "area.keep_out_cost": (253, "begin anew"),
    "segmenter.name": ("colour", "network is loaded"), "source.color_topic": ("rgb", "topics are chosen"),
    "rig_file": ("rig.yaml", "topics are chosen"), "mount.height_m": (1.0, "topics are chosen"),
    "watchdog.stale_s": (1.0, "memory"), "margin_file": ("margin.yaml", "costmap.margin_m"),
    "autostart": (False, "has started"), "queue_frames": (4, "topics are chosen"),
    "image_reliability": ("reliable", "topics are chosen"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNSAFE)
def test_what_the_map_is_built_on_is_refused_with_the_reason(name: str) -> None:
    value, reason = UNSAFE[name]
    with pytest.raises(ConfigError, match=reason):
        changed(Parameters(), {name: value}, configured=True)
    assert changed(Parameters(), {name: value}, configured=False) != Parameters()
    same = {d.name: d.value for d in declarations(Parameters())}[name]
    assert changed(Parameters(), {name: same}, configured=True) == Parameters()  # no change at all


@pytest.mark.parametrize("name", ["grid.min_points", "cloud.min_height_m"])
def test_what_the_evidence_is_built_on_cannot_change_under_it(name: str) -> None:
    value = 2 if name == "grid.min_points" else -0.4
    assert changed(Parameters(), {name: value}, configured=True) != Parameters()
    with pytest.raises(ConfigError, match="begin anew"):
        changed(EVIDENCE, {name: value}, configured=True)


def test_of_several_changes_all_are_made_or_none() -> None:
    both = {"cloud.max_range_m": 6.0, "grid.resolution_m": 0.1}
    with pytest.raises(ConfigError, match=r"grid\.resolution_m"):
        changed(Parameters(), both, configured=True)


@pytest.mark.parametrize(
    "name", sorted({d.name for d in declarations(Parameters())} - set(SAFE) - set(UNSAFE))
)
def test_every_parameter_is_either_safe_or_has_a_reason(name: str) -> None:
    """A section that is new must not become changeable by oversight."""
    from swardmap.ros.parameters import refusal

    section = name.split(".")[0]
    per_frame = {"cloud", "costmap", "geometry", "backend", "segmenter"} | {n for n in SAFE if "." not in n}
    assert (refusal(name, Config()) is None) <= (
        section in per_frame or name.startswith("grid.min_") or name == "grid.clear_together"
    )
