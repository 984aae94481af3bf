"""Ready files for Nav2, DDS and the node, filled in with the margin, radii and cameras of a robot.

The templates are in `swardmap/data/nav2`; what they name is held against Nav2's source by
`tests/ros/test_nav2_files.py`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from string import Template

from swardmap.config import Config
from swardmap.errors import InvalidValueError
from swardmap.ros.footprint import Footprint, corners_text, nav2_shape
from swardmap.ros.viewer_files import foxglove_layout, rviz_config

FOLDER = Path(__file__).parent.parent / "data" / "nav2"

NAMES = ("swardmap", "map", "costs", "obstacles", "stvl", "semantic", "collision_monitor", "filters")
"""Parameter files, without their ending .yaml."""

DDS_PROFILE = "fastdds.xml"
"""Room for images in Fast DDS's shared memory."""

RVIZ, FOXGLOVE = "swardmap.rviz", "foxglove.json"
"""What shows all of it: `rviz2 -d swardmap.rviz`, and a layout to import in Foxglove."""

FRESH_S = 0.5
"""A camera's clouds are older than this when something is wrong."""

COMMENT_COLUMN = 48

BLOCK_BEGIN, BLOCK_END = "#{ camera\n", "#}\n"


def nav2_files(
    config: Config,
    cameras: Sequence[str] = ("camera",),
    namespace: str = "",
    base_frame: str = "base_link",
    map_frame: str = "map",
    footprint: Footprint | None = None,
) -> dict[str, str]:
    """The text of each file, by its name.

    Args:
        config: margin, radii, resolution and limits of the cloud.
        cameras: names; one alone must always be fresh, of several some may look the other way and rest.
        namespace: of the node, such as `/mower1`; empty = none.
        base_frame: of the robot.
        map_frame: of the poses.
        footprint: outline of the robot, whose inscribed radius is then that of the costs; None = a circle of
            `costmap.inscribed_radius_m`.

    Raises:
        InvalidValueError: for a namespace that ROS does not take, or no camera.
        ConfigError: if the costs do not reach beyond the footprint.
    """
    if namespace and (not namespace.startswith("/") or namespace.endswith("/")):
        raise InvalidValueError(
            f"namespace: expected it to begin with / and not to end so, got '{namespace}'"
        )
    if not cameras:
        raise InvalidValueError("expected at least one camera, got none")
    if footprint is not None:
        inscribed_m = round(footprint.inscribed_radius_m, 6)
        config = replace(config, costmap=replace(config.costmap, inscribed_radius_m=inscribed_m))
    values = _values(config) | _shapes(config, footprint) | {
        "namespace": namespace, "base_frame": base_frame, "map_frame": map_frame,
        "update_s": repr(FRESH_S if len(cameras) == 1 else 0.0),
    }  # fmt: skip
    files = {f"{name}.yaml": _filled(name, values, cameras) for name in NAMES}
    return files | {
        DDS_PROFILE: (FOLDER / DDS_PROFILE).read_text(encoding="utf-8"),
        RVIZ: rviz_config(cameras, namespace, map_frame, base_frame),
        FOXGLOVE: foxglove_layout(cameras, namespace, base_frame),
    }


def write_nav2_files(folder: str | Path, files: Mapping[str, str]) -> None:
    """Write them into a folder; files that are there already are left alone.

    Raises:
        OutputError: if one of them exists, or cannot be written.
    """
    from swardmap.errors import OutputError
    from swardmap.io.files import write_text

    for name in files:
        if (Path(folder) / name).exists():
            raise OutputError(f"{Path(folder) / name} exists: name another folder, or take it away")
    for name, text in files.items():
        write_text(Path(folder) / name, text)


def _values(config: Config) -> dict[str, str]:
    """Numbers of the configuration, as YAML that ROS takes for a float."""
    costs, cloud, margin_m = config.costmap, config.cloud, _margin_m(config)
    numbers = {
        "margin_m": margin_m, "inscribed_radius_m": costs.inscribed_radius_m,
        "own_inflation_radius_m": costs.inflation_radius_m,
        "inflation_radius_m": costs.inflation_radius_m + margin_m,
        "cost_scaling_factor": costs.cost_scaling_factor, "resolution_m": config.grid.resolution_m,
        "min_range_m": cloud.min_range_m, "max_range_m": cloud.max_range_m,
    }  # fmt: skip
    told = "persons, the larger" if margin_m > costs.obstacle_margin_m else "costmap.margin_m"
    return {name: repr(round(float(value), 6)) for name, value in numbers.items()} | {"margin_of": told}


def _margin_m(config: Config) -> float:
    """The larger of both margins: Nav2 does not know persons from other obstacles."""
    costs = config.costmap
    return max(costs.obstacle_margin_m, costs.people_margin_m)


def _shapes(config: Config, footprint: Footprint | None) -> dict[str, str]:
    """The robot as costmaps and the collision monitor are told it: with the margin, and bare."""
    radius_m, margin_m = config.costmap.inscribed_radius_m, _margin_m(config)
    circle = f"radius: {round(radius_m + margin_m, 6)!r}"
    return {
        "grown_shape": nav2_shape(radius_m, margin_m, footprint),
        "bare_shape": nav2_shape(radius_m, 0.0, footprint),
        "zone_type": "circle" if footprint is None else "polygon",
        "zone_size": circle if footprint is None else f'points: "{corners_text(footprint, margin_m)}"',
    }


def _filled(name: str, values: Mapping[str, str], cameras: Sequence[str]) -> str:
    text = (FOLDER / f"{name}.yaml").read_text(encoding="utf-8")
    sources = (
        cameras if name == "semantic" else [f"{c}_{what}" for c in cameras for what in ("mark", "clear")]
    )
    if BLOCK_BEGIN in text:
        before, _, rest = text.partition(BLOCK_BEGIN)
        block, _, after = rest.partition(BLOCK_END)
        text = before + "".join(block.replace("${camera}", c).replace("$camera", c) for c in cameras) + after
    return "".join(
        map(_aligned, Template(text).substitute(values, sources=" ".join(sources)).splitlines(True))
    )


def _aligned(line: str) -> str:
    """The comment behind a value where the others are, however long the value has become."""
    value, sign, comment = line.partition("# ")
    value = f"{value.rstrip()}  " if value.strip() else value
    return line if not (value.strip() and sign) else f"{value:<{COMMENT_COLUMN}}# {comment}"
