"""All settings: one tree of frozen dataclasses, checked when built, none of them needed to start.

Order of precedence: defaults < file < environment (`SWARDMAP_GRID__RESOLUTION_M=0.1`) < command line
(`--set grid.resolution_m=0.1`). Unknown keys are refused. `swardmap config` prints the tree.

One file on purpose, however long: every setting of the package is found here and nowhere else.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from swardmap.errors import ConfigError
from swardmap.settings import Checked, build, merge, merge_overrides, merge_text, setting, yaml_lines

ENVIRONMENT_PREFIX = "SWARDMAP_"
NOT_SETTINGS = frozenset({"SWARDMAP_DATA", "SWARDMAP_GARDEN_ASSETS"})


@dataclass(frozen=True)
class SourceConfig(Checked):
    """How to read a recording."""

    format: str | None = setting(
        None,
        "kind of recording; found by itself where possible",
        choices=("folder", "gardens", "3dmatch", "orfd", "eden", "rosbag"),
    )
    start: int = setting(0, "index of the first frame to use", minimum=0)
    stop: int | None = setting(None, "index after the last frame to use; none = to the end", minimum=0)
    every: int = setting(1, "use every n-th frame", minimum=1)
    color_topic: str | None = setting(None, "bags: image topic; none = the only candidate")
    depth_topic: str | None = setting(None, "bags: depth topic; none = the only candidate")
    color_info_topic: str | None = setting(None, "bags: CameraInfo of the colour image")
    depth_info_topic: str | None = setting(None, "bags: CameraInfo of the depth image")
    odometry_topic: str | None = setting(
        None, "bags: nav_msgs/Odometry to take the pose from, in place of tf"
    )
    map_frame: str | None = setting(
        None, "bags: fixed frame of the map; none = map, else odom, of the tf tree"
    )
    camera_frame: str | None = setting(
        None, "bags: optical frame of the colour image, where its header is wrong"
    )
    pair_tolerance_ms: float = setting(20.0, "largest distance in time of colour and depth", minimum=0)
    pose_tolerance_ms: float = setting(
        100.0, "largest gap between poses that is interpolated over", minimum=0
    )
    depth_unit_m: float | None = setting(
        None, "metres per unit of 16-bit depth; none = as the format says", minimum=1e-6
    )
    label_table: str | None = setting(None, "EDEN and others: YAML file that maps ids to classes")
    level: bool = setting(
        True, "3DMatch and others whose map is not level: turn it so that the floor is z = 0"
    )


@dataclass(frozen=True)
class CameraConfig(Checked):
    """A live RealSense camera (docs/live.md)."""

    serial: str | None = setting(None, "serial number, in quotes; none = the only camera")
    width: int = setting(640, "of colour and depth images", minimum=1)
    height: int = setting(480, "of colour and depth images", minimum=1)
    fps: int = setting(30, "images a second", minimum=1)
    align: str = setting(
        "swardmap",
        "depth to colour by our own rule, or by the SDK's rs.align; docs/live.md says how they differ",
        choices=("swardmap", "sdk"),
    )
    decimation: int = setting(1, "depth is reduced by this factor; 1 = not", minimum=1, maximum=8)
    spatial: bool = setting(False, "smooth depth within the image, edges kept")
    temporal: bool = setting(False, "smooth depth over time: for a robot that stands still")
    threshold_m: tuple[float, float] | None = setting(None, "drop readings nearer or farther than this")
    hole_filling: bool = setting(False, "fill holes with a neighbour's depth: invents free space, see docs")
    queue: int = setting(
        1, "pairs of images that wait at most; 1 = always the newest (record: at least 15)", minimum=1
    )
    timeout_s: float = setting(3.0, "without an image for so long the camera is opened anew", minimum=0.1)
    reconnect_s: float = setting(
        30.0, "without an image for so long, unplugged or not, the run ends", minimum=0.1
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.threshold_m is not None and not 0 <= self.threshold_m[0] < self.threshold_m[1]:
            raise ConfigError(
                f"camera: expected threshold_m as nearest and farthest, got {list(self.threshold_m)}"
            )


@dataclass(frozen=True)
class SegmenterConfig(Checked):
    """What tells grass from obstacles."""

    name: str = setting(
        "auto", "an .onnx file, or auto, colour (excess green), truth (labels of the recording)"
    )
    min_confidence: float = setting(
        0.0, "below it a pixel is void: not seen, never grass", minimum=0, maximum=1
    )
    threads: int = setting(0, "threads of the network; 0 = cores - 1", minimum=0)
    provider: str = setting("CPUExecutionProvider", "ONNX Runtime execution provider")


@dataclass(frozen=True)
class MountConfig(Checked):
    """Where the camera sits, for recordings without poses."""

    height_m: float | None = setting(
        None, "of the camera above the ground; none = measured from the ground seen", minimum=0
    )
    pitch_deg: float | None = setting(
        None, "how far it looks down; none = measured from the ground seen", minimum=-90, maximum=90
    )
    roll_deg: float = setting(0.0, "right side down is positive", minimum=-180, maximum=180)
    yaw_deg: float = setting(0.0, "to the left is positive", minimum=-180, maximum=180)
    x_m: float = setting(0.0, "forward of the robot's base")
    y_m: float = setting(0.0, "left of the robot's base")


@dataclass(frozen=True)
class CloudConfig(Checked):
    """Which points count (Sec. 3.4)."""

    min_range_m: float = setting(0.3, "nearest depth used", minimum=0)
    max_range_m: float = setting(8.0, "farthest depth used", minimum=0)
    min_height_m: float = setting(-0.5, "lowest point used, in the map frame")
    max_height_m: float = setting(2.0, "highest point used; what hangs higher is driven under")
    consistent_neighbours: int = setting(
        3, "of 8 neighbours that must have about the same depth; 0 = no filter", minimum=0, maximum=8
    )
    consistency_relative: float = setting(
        0.03, "about the same: within this share of the depth ...", minimum=0
    )
    consistency_m: float = setting(0.02, "... plus this many metres", minimum=0)
    voxel_m: float = setting(0.0, "edge of the voxel grid; 0 = none; needs the staged road", minimum=0)
    outliers: str = setting(
        "none",
        "outlier removal after the voxel grid; needs the staged road",
        choices=("none", "statistical", "radius"),
    )
    outlier_neighbours: int = setting(20, "statistical: k; radius: fewest neighbours", minimum=1)
    outlier_sigmas: float = setting(2.0, "statistical: kept up to mean + this many sigmas", minimum=0)
    outlier_radius_m: float = setting(0.15, "radius: neighbours are counted within it", minimum=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for low, high in (("min_range_m", "max_range_m"), ("min_height_m", "max_height_m")):
            if getattr(self, low) >= getattr(self, high):
                raise ConfigError(
                    f"cloud: expected {low} below {high}, got {getattr(self, low)} and {getattr(self, high)}"
                )


@dataclass(frozen=True)
class GridConfig(Checked):
    """The occupancy grid (Sec. 3.5)."""

    mode: str = setting(
        "paper",
        "paper: the last frame that saw a cell decides; evidence: all of them do, see `evidence`",
        choices=("paper", "evidence"),
    )
    resolution_m: float = setting(0.05, "edge of a cell", minimum=1e-3, maximum=10)
    min_points: int = setting(1, "points of obstacle or person that mark a cell", minimum=1)
    min_grass_points: int = setting(3, "points of grass that clear a cell", minimum=1)
    origin_m: tuple[float, float] | None = setting(
        None, "outer corner of cell (0, 0); none = grows with what is seen"
    )
    size_m: tuple[float, float] | None = setting(None, "extent along x and y; given together with origin_m")
    obstacle_clear_frames: int = setting(
        1, "frames that must see grass before an obstacle cell is cleared (paper: 1)", minimum=1, maximum=255
    )
    person_clear_frames: int = setting(3, "the same for a person cell", minimum=1, maximum=255)
    resume: str | None = setting(None, "living.npz of an earlier run to go on from; needs mode: evidence")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.resume is not None and self.mode != "evidence":
            raise ConfigError("grid: expected mode: evidence beside resume; only living maps can be resumed")
        if (self.origin_m is None) != (self.size_m is None):
            raise ConfigError("grid: expected origin_m and size_m together, got only one of them")


@dataclass(frozen=True)
class GeometryConfig(Checked):
    """Obstacles and holes from depth alone, beside the network's classes (docs/geometry.md)."""

    enabled: bool = setting(False, "mark what rises above the local ground, and holes in it")
    semantics: bool = setting(
        True, "use the network's classes too; false: geometric marks alone, nothing is ever free"
    )
    min_height_m: float = setting(
        0.12, "lowest obstacle above the local ground: above the longest grass", minimum=0.01
    )
    hole_depth_m: float = setting(0.15, "shallowest hole below the local ground", minimum=0.01)
    ground_block_m: float = setting(
        0.4, "the ground is estimated once in a square this wide", minimum=0.1, maximum=5
    )
    max_slope_deg: float = setting(30.0, "steepest lawn; what is steeper is no ground", minimum=0, maximum=60)
    max_bend_deg: float = setting(
        12.0, "how much steeper than the whole view the ground may get somewhere", minimum=0, maximum=45
    )
    noise_m_at_1m: float = setting(
        0.003, "sigma of the depth at 1 m; it grows with the square of the depth", minimum=0
    )
    noise_sigmas: float = setting(3.0, "that many sigmas widen both limits (root of squares)", minimum=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.enabled or self.semantics):
            raise ConfigError("geometry: expected enabled or semantics to be true, got neither")


@dataclass(frozen=True)
class EvidenceConfig(Checked):
    """The living map (grid.mode: evidence): how much a sighting counts, in nats of log-odds."""

    obstacle_gain: float = setting(1.0, "one sighting of an obstacle at no distance", minimum=0, maximum=30)
    person_gain: float = setting(2.0, "the same of a person", minimum=0, maximum=30)
    grass_gain: float = setting(0.8, "the same of grass, against a hazard", minimum=0, maximum=30)
    ray_gain: float = setting(0.4, "a ray that passed low over the cell", minimum=0, maximum=30)
    ray_height_m: float = setting(
        0.1, "a ray passed low where it is below this; what is lower than it may be overlooked", minimum=0
    )
    half_confidence_m: float = setting(
        5.5, "distance at which a sighting counts half; falls on with its 4th power", minimum=0.01
    )
    mark_at: float = setting(0.25, "evidence that makes a cell a hazard", minimum=0.001, maximum=30)
    free_at: float = setting(0.4, "evidence of grass that frees an unknown cell", minimum=0.001, maximum=30)
    clear_at: float = setting(0.7, "evidence of grass that clears a hazard", minimum=0.001, maximum=30)
    obstacle_limit: float = setting(4.0, "evidence of an obstacle is kept up to it", maximum=30)
    person_limit: float = setting(2.0, "the same of a person, who may walk on", maximum=30)
    free_limit: float = setting(0.8, "the same of grass: what comes onto it must be seen soon", maximum=30)
    window_m: float | None = setting(
        None, "edge of a square that follows the camera; none = the whole field is kept", minimum=0.1
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.obstacle_limit, self.person_limit) < self.mark_at:
            raise ConfigError("evidence: expected obstacle_limit and person_limit of at least mark_at")
        if self.free_limit < max(self.free_at, self.clear_at):
            raise ConfigError("evidence: expected free_limit of at least free_at and clear_at")


@dataclass(frozen=True)
class CostmapConfig(Checked):
    """Costs for Nav2: what is seen, grown by the margin, then inflated."""

    margin_m: float = setting(
        0.0, "obstacles are grown by it: the measured margin, in place of a guess", minimum=0
    )
    person_margin_m: float | None = setting(None, "the same for persons; none = margin_m", minimum=0)
    inscribed_radius_m: float = setting(0.3, "radius of the circle inside the robot's footprint", minimum=0)
    inflation_radius_m: float = setting(0.55, "costs reach this far beyond a grown obstacle", minimum=0)
    cost_scaling_factor: float = setting(10.0, "decay of the cost, 1/m", minimum=0)
    inflate_unknown: bool = setting(
        False, "write costs into unknown cells too, as Nav2's option of that name"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.inflation_radius_m < self.inscribed_radius_m:
            raise ConfigError(
                "costmap: expected inflation_radius_m of at least inscribed_radius_m, "
                f"got {self.inflation_radius_m:g} and {self.inscribed_radius_m:g}"
            )


@dataclass(frozen=True)
class AreaConfig(Checked):
    """The work area in GPS coordinates (docs/work_area.md)."""

    file: str | None = setting(None, "GeoJSON or KML with the boundary and exclusion zones; none = no area")
    datum_lat: float | None = setting(
        None, "latitude in degrees of the map's origin (WGS84)", minimum=-90, maximum=90
    )
    datum_lon: float | None = setting(
        None, "longitude in degrees of the map's origin (WGS84)", minimum=-180, maximum=180
    )
    datum_heading_deg: float = setting(
        0.0, "of the map's x axis, from east towards north (REP-103)", minimum=-360, maximum=360
    )
    datum_alt_m: float = setting(
        0.0, "height of the map's origin above the ellipsoid; counts for topocentric alone"
    )
    projection: str = setting(
        "tmerc",
        "tmerc: transverse Mercator at the datum; topocentric: plane that touches the earth there; utm: "
        "as navsat_transform_node without use_local_cartesian",
        choices=("tmerc", "topocentric", "utm"),
    )
    frame_id: str = setting("map", "frame of the poses, whose origin the datum is")
    keep_out_cost: int = setting(
        254, "cost of cells outside or excluded: 254 is lethal", minimum=1, maximum=254
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.file is not None and (self.datum_lat is None or self.datum_lon is None):
            raise ConfigError(
                "area: expected datum_lat and datum_lon beside file: where is the map's origin?"
            )


@dataclass(frozen=True)
class WatchdogConfig(Checked):
    """When a camera, the pose or the map counts as sick (docs/watchdog.md says why)."""

    stopped_s: float = setting(0.5, "no frame of a camera for so long", minimum=0.01)
    stale_s: float = setting(0.5, "image stamp to now, of the newest frame", minimum=0.01)
    min_rate_hz: float = setting(5.0, "a camera that gives fewer frames a second is slow", minimum=0)
    rate_window_s: float = setting(2.0, "frames are counted over this time", minimum=0.1, maximum=60)
    rate_reference_s: float = setting(
        20.0, "the time before it that a falling rate is compared with", minimum=0.1, maximum=600
    )
    falling_share: float = setting(0.6, "falling: below this share of the rate before", minimum=0, maximum=1)
    frozen_s: float | None = setting(
        0.5, "identical images for so long; none = never, for simulators without noise", minimum=0
    )
    black_level: float = setting(16.0, "black: 99 % of the image is darker (0-255)", minimum=0, maximum=255)
    min_depth_share: float = setting(
        0.05, "no depth: fewer pixels than this share have a reading", minimum=0, maximum=1
    )
    image_s: float = setting(0.3, "so long an image must be black, flipped or without depth", minimum=0)
    jump_s: float = setting(0.5, "stamps that run ahead of the arrival by more have jumped", minimum=0.001)
    hold_s: float = setting(1.0, "so long a jump stays in the report", minimum=0)
    pose_s: float | None = setting(
        0.5, "no pose for so long is a lost pose; none = poses are not watched", minimum=0.01
    )
    queue_s: float = setting(1.0, "a queue that was full for so long", minimum=0)
    forget_s: float = setting(
        2.0, "while something demands a stop: free cells not seen for so long turn unknown", minimum=0
    )
    free_age_s: float | None = setting(
        None, "the same while all is well; none = what was seen free stays so", minimum=0
    )
    recover_s: float = setting(2.0, "so long all must be well before the stop flag is taken back", minimum=0)
    latency_window_s: float = setting(
        60.0, "latencies of the frames of this time (at most 4096) make p50 and p99", minimum=0.1
    )


@dataclass(frozen=True)
class OutputConfig(Checked):
    """What `map` writes."""

    pictures: int | None = setting(
        None, "a picture of every n-th frame; 0 = none; none = about 50 of the recording", minimum=0
    )
    clouds: str = setting("none", "labelled cloud of each frame", choices=("none", "pcd", "ply"))
    frame_maps: bool = setting(False, "one standalone map a frame as well (the paper's evaluation)")


@dataclass(frozen=True)
class Config(Checked):
    """The whole tree."""

    source: SourceConfig = field(default_factory=SourceConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    segmenter: SegmenterConfig = field(default_factory=SegmenterConfig)
    mount: MountConfig = field(default_factory=MountConfig)
    cloud: CloudConfig = field(default_factory=CloudConfig)
    grid: GridConfig = field(default_factory=GridConfig)
    geometry: GeometryConfig = field(default_factory=GeometryConfig)
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    costmap: CostmapConfig = field(default_factory=CostmapConfig)
    area: AreaConfig = field(default_factory=AreaConfig)
    watchdog: WatchdogConfig = field(default_factory=WatchdogConfig)
    output: OutputConfig = field(default_factory=OutputConfig)
    road: str = setting(
        "fused",
        "from depth to grid: fused (compiled) or staged (NumPy); cell for cell the same",
        choices=("fused", "staged"),
    )


def load_config(
    file: Path | None = None,
    environment: Mapping[str, str] | None = None,
    overrides: Iterable[str] = (),
) -> Config:
    """Build the configuration: defaults < file < environment < overrides.

    Args:
        file: YAML with any part of the tree.
        environment: such as os.environ; names `SWARDMAP_SECTION__KEY`.
        overrides: `section.key=value`, values in YAML.

    Raises:
        ConfigError: for an unknown key, a wrong type, or a value out of range.
    """
    tree: dict[str, Any] = {}
    if file is not None:
        merge(tree, _read_yaml(file), str(file))
    for name, text in (environment or {}).items():
        if name.startswith(ENVIRONMENT_PREFIX) and name not in NOT_SETTINGS:
            keys = name.removeprefix(ENVIRONMENT_PREFIX).lower().split("__")
            merge_text(tree, keys, text, f"environment variable {name}")
    merge_overrides(tree, overrides)
    return config_from_dict(tree)


def config_from_dict(tree: Mapping[str, Any]) -> Config:
    """Build the configuration from a nested dict with any part of the tree.

    Raises:
        ConfigError: for an unknown key (with the nearest known one), a wrong type, a value out of range.
    """
    built = build(Config, tree)
    assert isinstance(built, Config)  # noqa: S101 - narrows the type; build returns its first argument's
    return built


def config_to_dict(config: Config) -> dict[str, Any]:
    """The tree as plain dicts, lists, strings and numbers, as `config_from_dict` takes it."""
    plain: dict[str, Any] = dataclasses.asdict(config, dict_factory=_plain_dict)
    return plain


def config_to_yaml(config: Config, comments: bool = True) -> str:
    """The tree as YAML, each setting with what it is for and what it may be."""
    lines: list[str] = []
    for f in fields(config):
        value = getattr(config, f.name)
        if not dataclasses.is_dataclass(value):
            lines += yaml_lines(f, value, "", comments)
            continue
        about = (type(value).__doc__ or "").strip()
        lines += ["", f"# {about}"] if comments else []
        lines.append(f"{f.name}:")
        for inner in fields(value):
            lines += yaml_lines(inner, getattr(value, inner.name), "  ", comments)
    return "\n".join(lines).strip() + "\n"


def _plain_dict(items: list[tuple[str, Any]]) -> dict[str, Any]:
    return {key: list(value) if isinstance(value, tuple) else value for key, value in items}


def _read_yaml(file: Path) -> Any:
    import yaml

    try:
        return yaml.safe_load(file.read_text(encoding="utf-8")) or {}
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        reason = " ".join(str(error).split())  # YAML's errors draw the place over several lines
        raise ConfigError(f"cannot read the configuration {file}: {reason}") from error
