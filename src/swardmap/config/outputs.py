"""What is made of the map: costs, work area, files; and when what comes in counts as sick."""

from dataclasses import dataclass

from swardmap.config.settings import Checked, setting
from swardmap.errors import ConfigError

DEFAULT_MARGIN_M = 0.10
"""Where none was measured; docs/evaluation.md says how many of the cells called free it covers."""

YAML_SUFFIXES = (".yaml", ".yml")
"""Of files in metres of the map, which need no datum."""


@dataclass(frozen=True)
class CostmapConfig(Checked):
    """Costs for Nav2: what is seen, grown by the margin, then inflated."""

    margin_m: float | None = setting(
        None,
        "obstacles are grown by it; none = 0.10 m until one is measured (swardmap evaluate)",
        minimum=0,
        maximum=10,
    )
    person_margin_m: float | None = setting(
        None, "the same for persons; none = margin_m", minimum=0, maximum=10
    )
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

    @property
    def obstacle_margin_m(self) -> float:
        """What obstacles are grown by: the margin that was given, or the default."""
        return DEFAULT_MARGIN_M if self.margin_m is None else self.margin_m

    @property
    def people_margin_m(self) -> float:
        """What persons are grown by."""
        return self.obstacle_margin_m if self.person_margin_m is None else self.person_margin_m


@dataclass(frozen=True)
class AreaConfig(Checked):
    """Where to work, and where not (docs/work_area.md)."""

    file: str | None = setting(
        None,
        "GeoJSON or KML with the boundary and exclusion zones, or YAML with polygon_m in metres of the map; "
        "none = no area",
    )
    mask: str | None = setting(
        None, "map (YAML) whose occupied cells are kept out of, as Nav2's KeepoutFilter; none = no mask"
    )
    mask_beyond: int = setting(
        0, "cost outside of the mask's image: 0 says nothing, 254 is lethal", minimum=0, maximum=254
    )
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
        metric = self.file is None or self.file.lower().endswith(YAML_SUFFIXES)
        if not metric and (self.datum_lat is None or self.datum_lon is None):
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
    step_ratio: float | None = setting(
        1.6,
        "out of step: edges of depth lie so many times as often on another frame's colour; none = never",
        minimum=1.2,
    )
    image_s: float = setting(
        0.3, "so long an image must be black, flipped, out of step or without depth", minimum=0
    )
    unfamiliar: float | None = setting(
        1.0,
        "an image this many times as far from what the network knows as its file allows clears nothing; "
        "none = never",
        minimum=0,
    )
    unfamiliar_s: float = setting(0.5, "images must be unfamiliar for so long", minimum=0)
    jump_s: float = setting(0.5, "stamps that run ahead of the arrival by more have jumped", minimum=0.001)
    hold_s: float = setting(1.0, "so long a jump stays in the report", minimum=0)
    pose_s: float | None = setting(
        0.5, "no pose for so long is a lost pose; none = poses are not watched", minimum=0.01
    )
    pose_speed_mps: float | None = setting(
        8.0,
        "a camera that went faster than this, and over 0.5 m, between two images; none = never",
        minimum=0.1,
    )
    doubt_limit: float | None = setting(
        1.0,
        "view, pose and mount may differ by so many times what is usual before a warning; none = never",
        minimum=0.1,
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
