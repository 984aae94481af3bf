"""One frame, end to end: the paper's Sec. 3.3-3.5 in the paper's order."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from swardmap.config import Config, MountConfig
from swardmap.errors import ConfigError, FrameMismatchError, InputError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.mapping.costmap import Costmap, Layer, build_costmap, check_frames
from swardmap.mapping.last_seen_map import LastSeenMap, fixed_spec
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.perception import compiled, plain
from swardmap.perception.backend import Backend
from swardmap.perception.cloud import filtered_cloud, limits_in_view, within_height
from swardmap.perception.ground_surface import Ground, GroundPlane, find_ground
from swardmap.perception.observation import Observation, PixelCounts, pixel_counts
from swardmap.perception.passes import Placed
from swardmap.segmenter import Segmenter
from swardmap.types import Frame, LabeledCloud, Segmentation

BACKENDS: Mapping[str, Backend] = {"compiled": compiled, "plain": plain}
"""The two equal implementations of the passes over the pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """What a frame's depth says alone, whatever its mask: the same for every mask of it.

    Attributes:
        T_grid_camera: pose of the camera in the grid.
        placed: cell of each pixel.
        ground: of this view, or carried over from an earlier one; None = not known.
    """

    T_grid_camera: Pose
    placed: Placed
    ground: Ground | None


def locate(
    frame: Frame,
    T_map_camera: Pose,
    spec: GridSpec,
    config: Config,
    earlier: GroundPlane | None = None,
) -> Located:
    """Cells of the pixels (Eq. 1, 2) and ground of the view; arguments as of `observe`."""
    passes = BACKENDS[config.backend]
    T_grid_camera = _in_grid(T_map_camera, spec)
    placed = passes.place(frame, T_grid_camera, spec, config)
    x, y, z = T_map_camera.position_m.tolist()
    ground = find_ground(placed.sums, spec, config.geometry, (x, y, z), earlier, passes.fit_ground)
    return Located(T_grid_camera, placed, ground)


def observe(
    frame: Frame,
    segmentation: Segmentation,
    T_map_camera: Pose,
    spec: GridSpec,
    config: Config,
    earlier: GroundPlane | None = None,
    located: Located | None = None,
) -> Observation:
    """What one frame says of the cells of a grid: a pure function of what it is given.

    Cells of the pixels (Eq. 1, 2), ground of this view, points by class at their heights above it, what
    may be cleared, what stands above the ground.

    Args:
        frame: aligned images.
        segmentation: its mask, of any size.
        T_map_camera: pose of the camera in the grid's frame.
        spec: the grid.
        config: ranges, filters, points a cell needs, geometry, backend.
        earlier: ground that an earlier view has shown, for a view that shows none.
        located: what `locate` gives of the same, where it is there already.
    """
    passes = BACKENDS[config.backend]
    x, y, z = T_map_camera.position_m.tolist()
    viewpoint_m = (x, y, z)

    located = located or locate(frame, T_map_camera, spec, config, earlier)
    T_grid_camera, placed, ground = located.T_grid_camera, located.placed, located.ground
    counted = passes.count(frame, segmentation, placed, T_grid_camera, ground, spec, config)
    cells = passes.judge(counted, ground, config)
    return Observation(
        spec, cells.classes, cells.points, viewpoint_m, frame.stamp_ns, pixel_counts(placed, counted),
        cells.semantic, ground, cells.geometry, counted.height_row,
    )  # fmt: skip


def _in_grid(T_map_camera: Pose, spec: GridSpec) -> Pose:
    """spec.T_grid_map @ T_map_camera to the last digit, without checking three matrices."""
    if T_map_camera.parent != spec.frame_id:
        raise FrameMismatchError(
            f"observe: expected a pose in the grid's frame '{spec.frame_id}', got '{T_map_camera.parent}'"
        )
    matrix = T_map_camera.matrix.copy()
    matrix[:2, 3] -= spec.origin_m
    return Pose("grid", "camera", matrix)


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """What one frame gave.

    Attributes:
        frame: the input.
        segmentation: the mask, void where it was not sure.
        T_map_camera: the pose that was used.
        observation: what it says of the cells it sees.
        timings_ms: time spent in each stage, where somebody took it.
    """

    frame: Frame
    segmentation: Segmentation
    T_map_camera: Pose
    observation: Observation
    timings_ms: dict[str, float] = field(default_factory=dict)

    @property
    def seen(self) -> OccupancyGrid:
        """The standalone map of this frame alone, of all the evidence that is switched on."""
        return self.observation.grid

    @property
    def counts(self) -> PixelCounts:
        """What became of its pixels."""
        return self.observation.counts

    def cloud(self, config: Config) -> LabeledCloud:
        """The cloud the map was made of: filtered, labelled, in the map frame; for pictures and files."""
        cloud = filtered_cloud(self.frame, self.segmentation, config.cloud)
        T_map_camera = self.T_map_camera.of_child(cloud.frame_id)
        limits = limits_in_view(config.cloud, self.observation.ground is not None)
        return within_height(cloud, T_map_camera, limits, self.observation.height_row)


class ObstacleMapper:
    """Turns aligned RGB-D frames into an obstacle map.

    Frames with a pose accumulate in `map`. Frames without one are mapped each on its own, in the
    frame `base` on the ground under the camera, by the configured or measured mount.

    Args:
        segmenter: tells grass from obstacles.
        config: all settings.
        T_base_camera: mount of the camera, for frames without a pose.
        layers: of costmaps, beside what is seen and its inflation: a work area, a keep-out mask.
        log_odds: saved map to go on from; it is changed.
    """

    def __init__(
        self,
        segmenter: Segmenter,
        config: Config | None = None,
        T_base_camera: Pose | None = None,
        layers: Sequence[Layer] = (),
        log_odds: LogOddsMap | None = None,
    ) -> None:
        self.segmenter = segmenter
        self.config = config or Config()
        self.T_base_camera = T_base_camera
        self.layers = tuple(layers)
        self._map: LastSeenMap | LogOddsMap | None = log_odds
        self._last_stamp_ns: int | None = None
        self._ground: GroundPlane | None = None

    def step(self, frame: Frame) -> StepResult:
        """Segment one frame, and map it.

        Raises:
            InputError: if the clock goes backwards, or the frame has no pose and no mount is known.
            InvalidValueError: if the pose is in another frame than the work area.
        """
        return self.integrate(frame, self.segmenter(frame))

    def integrate(self, frame: Frame, segmentation: Segmentation) -> StepResult:
        """Map one frame whose mask is known: what it says of its cells, into the map.

        Raises:
            SwardmapError: as `step`.
        """
        if not isinstance(segmentation, Segmentation):
            raise InvalidValueError(
                f"segmenter '{getattr(self.segmenter, 'name', type(self.segmenter).__name__)}': expected a "
                f"Segmentation, got {type(segmentation).__name__}; return Segmentation(labels, label_set)"
            )
        self._check_clock(frame)
        T_map_camera = self._pose_of(frame)
        spec = self._window(frame.intrinsics, T_map_camera)
        posed = frame.T_map_camera is not None  # else nobody knows how far away an earlier view was
        earlier = self._ground if posed else None
        seen = observe(frame, segmentation, T_map_camera, spec, self.config, earlier)
        if posed and seen.ground is not None and not seen.ground.carried:
            self._ground = GroundPlane.of(seen.ground, spec, seen.viewpoint_m)
        if posed:
            self._map_in(T_map_camera.parent).integrate(seen)
        config = self.config
        sure = segmentation.confident(config.segmenter.min_confidence, config.watchdog.unfamiliar)
        return StepResult(frame, sure, T_map_camera, seen)

    def run(self, frames: Iterable[Frame]) -> Iterator[StepResult]:
        """Map every frame of a source, one after another, with the time that each took."""
        for frame in frames:
            started = perf_counter()
            segmentation = self.segmenter(frame)
            segmented = perf_counter()
            step = self.integrate(frame, segmentation)
            stages = {"segment": segmented - started, "map": perf_counter() - segmented}
            yield replace(step, timings_ms={name: 1e3 * seconds for name, seconds in stages.items()})

    def mounted(self, T_base_camera: Pose) -> None:
        """Take the mount of the camera, for frames without a pose."""
        self.T_base_camera = T_base_camera

    def reconfigure(self, config: Config) -> None:
        """Go on with other settings.

        Raises:
            ConfigError: for another mode or other cells, or other evidence of log-odds: what the map so far
                is built on.
        """
        old, new = self.config.grid, config.grid
        if (old.mode, old.resolution_m, old.origin_m, old.size_m) != (
            new.mode, new.resolution_m, new.origin_m, new.size_m
        ):  # fmt: skip
            raise ConfigError("grid: expected mode and cells as the map was begun with; clear the map first")
        if old.mode == "log_odds" and _evidence_of(self.config) != _evidence_of(config):
            raise ConfigError(
                "grid: expected evidence, min_points, min_grass_points and cloud.min_height_m as the map of "
                "log-odds was begun with; clear the map first"
            )
        if isinstance(self._map, LastSeenMap):
            self._map.reconfigure(new)
        self.config = config

    @property
    def map(self) -> OccupancyGrid | None:
        """The accumulated map; None until a frame with a pose has seen something."""
        return None if self._map is None else self._map.grid

    @property
    def log_odds(self) -> LogOddsMap | None:
        """The map with its evidence, to be saved; None in the paper's mode, or before the first pose."""
        return self._map if isinstance(self._map, LogOddsMap) else None

    def costmap(self, grid: OccupancyGrid | None = None) -> Costmap | None:
        """Costmap of `grid`, or of the accumulated map; without a pose layers of the map say nothing."""
        grid = self.map if grid is None else grid
        if grid is None:
            return None
        alone = self.T_base_camera is not None and grid.spec.frame_id == self.T_base_camera.parent
        layers = [layer for layer in self.layers if not alone or layer.frame_id is None]
        return build_costmap(grid, self.config.costmap, layers)

    def _map_in(self, frame_id: str) -> LastSeenMap | LogOddsMap:
        """The accumulated map, begun with the first pose."""
        check_frames(self.layers, frame_id)
        self._map = self._map or new_map(self.config, frame_id)
        return self._map

    def _pose_of(self, frame: Frame) -> Pose:
        if frame.T_map_camera is not None:
            return frame.T_map_camera
        if self.T_base_camera is None:
            self.T_base_camera = configured_mount(self.config.mount)
        if self.T_base_camera is None:
            raise InputError(
                f"frame {frame.name or frame.stamp_ns} has no pose and the mount is not known: "
                "set mount.height_m and mount.pitch_deg"
            )
        return self.T_base_camera

    def _check_clock(self, frame: Frame) -> None:
        last = self._last_stamp_ns
        if last is not None and frame.stamp_ns < last:
            raise InputError(
                f"frame {frame.name or frame.stamp_ns}: the clock went back by "
                f"{(last - frame.stamp_ns) / 1e9:.3f} s; expected frames in order of time"
            )
        self._last_stamp_ns = frame.stamp_ns

    def _window(self, intrinsics: Intrinsics, T_map_camera: Pose) -> GridSpec:
        """The part of the lattice this frame can see: the configured grid, or the view cone's box."""
        cloud, grid = self.config.cloud, self.config.grid
        view = view_spec(intrinsics, T_map_camera, cloud.max_range_m, grid.resolution_m)
        fixed = fixed_spec(grid, T_map_camera.parent)
        return view if fixed is None else fixed.part_within(view)


def new_map(config: Config, frame_id: str) -> LastSeenMap | LogOddsMap:
    """An empty accumulated map of the configured mode."""
    if config.grid.mode == "log_odds":
        return LogOddsMap(config.grid, config.evidence, config.cloud.min_height_m, frame_id)
    return LastSeenMap(config.grid, frame_id)


def _evidence_of(config: Config) -> tuple[object, ...]:
    """What a map of log-odds takes when it is begun."""
    return config.evidence, config.grid.min_points, config.grid.min_grass_points, config.cloud.min_height_m


def view_spec(
    intrinsics: Intrinsics, T_map_camera: Pose, max_range_m: float, resolution_m: float
) -> GridSpec:
    """Smallest lattice grid around all that a camera can see up to a depth.

    Args:
        intrinsics: of the image.
        T_map_camera: pose of the optical frame, z of the map up.
        max_range_m: largest depth along the optical axis.
        resolution_m: edge of a cell.

    Returns:
        The grid, in the pose's parent frame, on the lattice of whole cells from (0, 0).
    """
    ray_x, ray_y = intrinsics.ray_tables()
    corners = [(x, y, 1.0) for x in (ray_x[0], ray_x[-1]) for y in (ray_y[0], ray_y[-1])]
    points = T_map_camera.apply(np.array([(0.0, 0.0, 0.0), *corners]) * max_range_m)
    edge = 2 * resolution_m  # rounding of the float32 kernel must not push a point over the rim
    low, high = points[:, :2].min(axis=0) - edge, points[:, :2].max(axis=0) + edge
    return GridSpec.covering(resolution_m, (low[0], low[1]), (high[0], high[1]), frame_id=T_map_camera.parent)


def configured_mount(config: MountConfig) -> Pose | None:
    """T_base_camera from the configuration, or None if it is to be measured from the ground seen.

    Raises:
        InvalidValueError: if only one of height and pitch is given.
    """
    if config.height_m is None and config.pitch_deg is None:
        return None
    if config.height_m is None or config.pitch_deg is None:
        raise InvalidValueError("mount: expected height_m and pitch_deg together, or neither to measure both")
    return mount_pose(
        config.height_m, config.pitch_deg, config.roll_deg, config.yaw_deg, (config.x_m, config.y_m)
    )
