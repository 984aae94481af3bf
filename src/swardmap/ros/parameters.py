"""The node's parameters: the whole configuration under its own names, and what only a node needs.

`grid.resolution_m` of a file for `swardmap map` is `grid.resolution_m` of the node. ROS has no null: a
parameter that may be none is declared without a value, and the word `none` takes its value away.
"""

import dataclasses
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from swardmap.config import Config, config_from_dict, config_to_dict
from swardmap.config.settings import Checked, build, setting
from swardmap.errors import ConfigError

LEFT_OUT = frozenset(
    {"output", "camera", "source.format", "source.start", "source.stop", "source.every",
     "source.label_table", "source.level", "source.tf_topic", "source.poses",
     "source.depth_aligned", "source.T_color_depth"}
)  # fmt: skip
"""Sections and settings of the configuration that mean nothing to a node: those of recordings and files."""


NONE = "none"


@dataclass(frozen=True)
class NodeConfig(Checked):
    """What only a node needs; paths are taken from where the node was started."""

    rig_file: str | None = setting(None, "YAML file that names the cameras (docs/rig.md); none = one camera")
    margin_file: str | None = setting(
        None, "margin.yaml of swardmap evaluate, in place of costmap.margin_m and costmap.person_margin_m"
    )
    pose_source: str = setting(
        "auto",
        "where poses come from; auto: the odometry if source.odometry_topic is set, else tf; "
        "none: each frame is a map of its own in the frame base",
        choices=("auto", "tf", "odometry", "none"),
    )
    pose_wait_ms: float = setting(300.0, "how long an image waits for its pose", minimum=0, maximum=10_000)
    image_reliability: str = setting(
        "auto",
        "of image subscriptions; auto: reliable where all publishers offer it, else best effort",
        choices=("auto", "best_effort", "reliable"),
    )
    image_depth: int = setting(
        2, "images and clouds that DDS holds for each subscription and publisher", minimum=1, maximum=1000
    )
    queue_frames: int = setting(
        2,
        "frames of a camera that wait for the mapper; when there are more its oldest is dropped",
        minimum=1,
        maximum=1000,
    )
    map_rate_hz: float = setting(5.0, "maps a second at most", minimum=0.1, maximum=100)
    full_map_s: float = setting(
        2.0, "a whole map that often, updates of what changed between; 0 = always whole", minimum=0
    )
    obstacle_cells_range_m: float = setting(
        10.0, "obstacles of the map this near to the camera are given as a cloud, too", minimum=0
    )
    cloud_stride: int = setting(
        2,
        "clouds of frames hold every n-th row and column; an organised one all of them",
        minimum=1,
        maximum=16,
    )
    organised_cloud: bool = setting(False, "one point a pixel, NaN where there is none")
    speed_zone_m: float = setting(
        3.0, "masks/speed: the robot drives slowly this near to a person", minimum=0.1, maximum=50
    )
    speed_zone_percent: float = setting(
        30.0, "masks/speed: of its full speed, in whole percent", minimum=1, maximum=100
    )
    robot_radius_m: float = setting(
        1.0,
        "circle about the base that holds the robot: every map reaches so far",
        minimum=0.05,
        maximum=10,
    )
    start_area_radius_m: float = setting(
        0.5, "half the width of a start area, which the operator grants", minimum=0.05, maximum=1.5
    )
    start_area_ahead_m: float = setting(
        1.0, "it reaches from the base so far ahead; negative: behind", minimum=-3, maximum=3
    )
    start_area_s: float = setting(60.0, "it lasts so long at most", minimum=1, maximum=600)
    start_area_at_start: bool = setting(
        False, "grant it each time the node becomes active: for a robot that always starts on clear ground"
    )
    save_folder: str = setting("swardmap_maps", "where the service save writes: one new folder a call")
    autostart: bool = setting(True, "configure and activate at once; false: a lifecycle manager does it")


@dataclass(frozen=True)
class Parameters:
    """All parameters of the node."""

    node: NodeConfig = field(default_factory=NodeConfig)
    config: Config = field(default_factory=Config)


@dataclass(frozen=True, slots=True)
class Declaration:
    """One parameter as it is declared to ROS.

    Attributes:
        name: dotted, such as `grid.resolution_m`.
        value: default; a list for pairs of numbers; None = no value.
        about: what it is for, and what it may be.
        optional: whether it may be without a value, or get one of another type.
        minimum, maximum: limits of a number, or None.
    """

    name: str
    value: Any
    about: str
    optional: bool
    minimum: float | None
    maximum: float | None

    @property
    def limits(self) -> str:
        """The limits in words; empty if there are none."""
        low = "" if self.minimum is None else f"at least {self.minimum:g}"
        high = "" if self.maximum is None else f"at most {self.maximum:g}"
        return ", ".join(filter(None, (low, high)))


def declarations(parameters: Parameters) -> tuple[Declaration, ...]:
    """Every parameter, with the values given as defaults."""
    return (*_walk(parameters.node, ""), *_walk(parameters.config, ""))


def _walk(section: Any, prefix: str) -> Iterator[Declaration]:
    hints = typing.get_type_hints(type(section))
    for f in fields(section):
        name, value = f"{prefix}{f.name}", getattr(section, f.name)
        if name in LEFT_OUT:
            continue
        if dataclasses.is_dataclass(value):
            yield from _walk(value, f"{name}.")
            continue
        optional = isinstance(hints[f.name], types.UnionType)
        choices = f.metadata["choices"]
        about = f.metadata["about"] + (f" ({', '.join(choices)})" if choices else "")
        plain = list(value) if isinstance(value, tuple) else value
        limits = f.metadata["minimum"], f.metadata["maximum"]
        yield Declaration(name, plain, about, optional, *limits)


MAY_BE_NONE = frozenset(d.name for d in declarations(Parameters()) if d.optional)


def parameters_from(values: Mapping[str, Any], base: Parameters | None = None) -> Parameters:
    """Parameters with some of their values replaced.

    Args:
        values: by dotted name; None = none.
        base: what the others are; None = the defaults.

    Raises:
        ConfigError: for an unknown name (with the nearest known one), a wrong type, a value out of range,
            or settings that contradict each other.
    """
    base = base or Parameters()
    own = {f.name for f in fields(NodeConfig)}
    tree = config_to_dict(base.config)
    of_node = dataclasses.asdict(base.node)
    for name, value in values.items():
        plain = value if value is None or isinstance(value, (str, bool, int, float)) else list(value)
        if plain == NONE and name in MAY_BE_NONE:
            plain = None
        if name in own:
            of_node[name] = plain
            continue
        *sections, last = name.split(".")
        place = tree
        for key in sections:
            place = place.setdefault(key, {})
            if not isinstance(place, dict):
                raise ConfigError(f"unknown setting '{name}'")
        place[last] = plain
    node = build(NodeConfig, of_node)
    assert isinstance(node, NodeConfig)  # noqa: S101 - narrows the type
    config = config_from_dict(tree)
    _check_backend(config)
    return Parameters(node, config)


def _check_backend(config: Config) -> None:
    """What the compiled backend would refuse at the first frame is refused here."""
    if config.backend == "compiled" and (config.cloud.voxel_m > 0 or config.cloud.outliers != "none"):
        raise ConfigError("cloud.voxel_m and cloud.outliers need backend: plain; compiled has neither")


ANEW = "the map would have to begin anew: set it in the parameter file, or cleanup and configure the node"
SUBSCRIBED = "topics are chosen when the node is configured: set it in the parameter file, or cleanup first"
LOADED = "the network is loaded when the node is configured: set it in the parameter file, or cleanup first"

REFUSALS: Mapping[str, str] = {
    "segmenter.name": LOADED, "segmenter.threads": LOADED, "segmenter.provider": LOADED,
    "margin_file": "it is read when the node is configured: set costmap.margin_m instead, or cleanup first",
    "source": SUBSCRIBED, "rig_file": SUBSCRIBED, "mount": SUBSCRIBED, "pose_source": SUBSCRIBED,
    "image_reliability": SUBSCRIBED, "image_depth": SUBSCRIBED, "queue_frames": SUBSCRIBED,
    "autostart": "the node has started",
    "grid": ANEW, "evidence": ANEW, "area": ANEW,
    "watchdog": "the watchdog's memory would not fit its new thresholds: cleanup and configure the node",
}  # fmt: skip
"""Why a section or setting is not changed while the node is configured."""

FREE_IN_LAST_SEEN_MODE = frozenset({"grid.min_points", "grid.min_grass_points", "grid.clear_together"})
"""Read for each frame; in the mode `log_odds` the map is built on them."""


def refusal(name: str, config: Config) -> str | None:
    """Why a parameter cannot be changed while the node is configured; None if it can."""
    if name in FREE_IN_LAST_SEEN_MODE and config.grid.mode == "last_seen":
        return None
    reason = REFUSALS.get(name) or REFUSALS.get(name.split(".")[0])
    if name == "cloud.min_height_m" and config.grid.mode == "log_odds":
        reason = ANEW  # the lowest ground there may be is part of the evidence
    return None if reason is None else f"{name} cannot be changed now: {reason}"


def changed(parameters: Parameters, values: Mapping[str, Any], configured: bool) -> Parameters:
    """The parameters after a change at run time.

    Args:
        parameters: as they are.
        values: to set, by name; one that stays as it is does not count as a change.
        configured: whether the node is (else everything may change).

    Raises:
        ConfigError: for a value that is not allowed, or a setting that cannot change now, with the reason.
    """
    after = parameters_from(values, parameters)
    if not configured:
        return after
    old, new = ({d.name: d.value for d in declarations(p)} for p in (parameters, after))
    for name in values:
        reason = refusal(name, parameters.config) if old.get(name) != new.get(name) else None
        if reason is not None:
            raise ConfigError(reason)
    return after
