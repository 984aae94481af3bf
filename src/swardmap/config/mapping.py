"""From pixels to cells: which points count, what marks and clears, what geometry adds."""

from dataclasses import dataclass

from swardmap.config.settings import Checked, setting
from swardmap.errors import ConfigError


@dataclass(frozen=True)
class CloudConfig(Checked):
    """Which points count (Sec. 3.4)."""

    min_range_m: float = setting(0.3, "nearest depth used", minimum=0)
    max_range_m: float = setting(8.0, "farthest depth used", minimum=0)
    min_height_m: float = setting(-0.5, "lowest point used, above the ground that the view shows")
    max_height_m: float = setting(2.0, "highest point used above it; what hangs higher is driven under")
    consistent_neighbours: int = setting(
        3, "of 8 neighbours that must have about the same depth; 0 = no filter", minimum=0, maximum=8
    )
    consistency_relative: float = setting(
        0.03, "about the same: within this share of the depth ...", minimum=0
    )
    consistency_m: float = setting(0.02, "... plus this many metres", minimum=0)
    voxel_m: float = setting(0.0, "edge of the voxel grid; 0 = none; needs backend: plain", minimum=0)
    outliers: str = setting(
        "none",
        "outlier removal after the voxel grid; needs backend: plain",
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


MAX_MAP_CELLS = 64_000_000
"""Of the rectangle around all that a map holds: 16 ha in cells of 0.05 m. Map, costs and pictures of it take
about a gigabyte."""


@dataclass(frozen=True)
class GridConfig(Checked):
    """The occupancy grid (Sec. 3.5)."""

    mode: str = setting(
        "last_seen",
        "last_seen: the last frame that saw a cell decides (the paper); log_odds: all do, see `evidence`",
        choices=("last_seen", "log_odds"),
    )
    resolution_m: float = setting(0.05, "edge of a cell", minimum=1e-3, maximum=10)
    min_points: int = setting(1, "points of obstacle or person that mark a cell", minimum=1)
    min_grass_points: int = setting(8, "points of grass that clear a cell", minimum=1)
    clear_together: bool = setting(
        True, "cells of fewer points count their neighbours' too, where nothing near is marked or in doubt"
    )
    clear_below: float = setting(
        0.05,
        "largest mean P(obstacle or person) over a cell's points with which it is cleared",
        minimum=0,
        maximum=1,
    )
    origin_m: tuple[float, float] | None = setting(
        None, "outer corner of cell (0, 0); none = grows with what is seen"
    )
    size_m: tuple[float, float] | None = setting(None, "extent along x and y; given together with origin_m")
    obstacle_clear_frames: int = setting(
        1, "frames that must see grass before an obstacle cell is cleared (paper: 1)", minimum=1, maximum=255
    )
    person_clear_frames: int = setting(3, "the same for a person cell", minimum=1, maximum=255)
    resume: str | None = setting(None, "living.npz of an earlier run to go on from; needs mode: log_odds")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.resume is not None and self.mode != "log_odds":
            raise ConfigError("grid: expected mode: log_odds beside resume; no other map can be resumed")
        if (self.origin_m is None) != (self.size_m is None):
            raise ConfigError("grid: expected origin_m and size_m together, got only one of them")
        if self.size_m is not None:
            x, y = self.size_m
            cells = max(0.0, x) * max(0.0, y) / self.resolution_m**2
            if not 0.5 <= cells <= MAX_MAP_CELLS:
                raise ConfigError(
                    f"grid: expected size_m and resolution_m of 1 to {MAX_MAP_CELLS} cells, "
                    f"got {x:g} x {y:g} m in cells of {self.resolution_m:g} m"
                )


@dataclass(frozen=True)
class GeometryConfig(Checked):
    """Obstacles and holes from depth alone, beside the network's classes (docs/geometry.md)."""

    enabled: bool = setting(True, "mark what rises above the local ground, and holes in it")
    semantics: bool = setting(
        True, "use the network's classes too; false: geometric marks alone, nothing is ever free"
    )
    min_height_m: float = setting(
        0.12, "lowest obstacle above the local ground: above the longest grass", minimum=0.01
    )
    min_points: int = setting(5, "points above (below) the ground that mark a cell", minimum=1)
    doubt_height_m: float = setting(
        0.05, "as high suffices for points that the network doubts too", minimum=0.01
    )
    doubt_above: float = setting(
        0.2, "P(obstacle or person) from which a point counts as doubted; 1 = never", minimum=0, maximum=1
    )
    carry_m: float = setting(
        5.0, "the ground of an earlier view serves so far on, where a view shows none; 0 = not", minimum=0
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
    """The map of log-odds (grid.mode: log_odds): how much a sighting counts, in nats of log-odds."""

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
