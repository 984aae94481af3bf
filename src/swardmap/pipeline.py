"""One frame, end to end: the paper's Sec. 3.3-3.5 in the paper's order."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config, MountConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.mapping.costmap import Costmap, build_costmap
from swardmap.mapping.last_seen_map import GridMapper, fixed_spec
from swardmap.mapping.log_odds_map import LivingMap
from swardmap.mapping.work_area import WorkArea
from swardmap.perception.frame_grid import PixelCounts, filtered_cloud, fused_grid, staged_grid, within_height
from swardmap.perception.geometric_obstacles import GroundEvidence, see_ground, with_ground
from swardmap.segmenter import Segmenter
from swardmap.types import Frame, LabeledCloud, Segmentation


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """What one frame gave.

    Attributes:
        frame: the input.
        segmentation: the mask, void where it was not sure.
        T_map_camera: the pose that was used.
        seen: the standalone map of this frame alone, of all the evidence that is switched on.
        counts: what became of its pixels.
        timings_ms: time spent in each stage.
        semantic: the same map from the network's classes alone; None = as `seen`.
        geometry: what depth alone says; None = switched off.
    """

    frame: Frame
    segmentation: Segmentation
    T_map_camera: Pose
    seen: OccupancyGrid
    counts: PixelCounts
    timings_ms: dict[str, float] = field(default_factory=dict)
    semantic: OccupancyGrid | None = None
    geometry: GroundEvidence | None = None

    @property
    def by_geometry(self) -> NDArray[np.bool_] | None:
        """(height, width) bool, cells that geometry alone marks; None if it is switched off."""
        if self.geometry is None or self.semantic is None:
            return None
        return self.geometry.grid.is_obstacle & ~self.semantic.is_obstacle

    def cloud(self, config: Config) -> LabeledCloud:
        """The cloud the map was made of: filtered, labelled, in the map frame; for pictures and files."""
        cloud = filtered_cloud(self.frame, self.segmentation, config.cloud)
        T_map_camera = Pose(self.T_map_camera.parent, cloud.frame_id, self.T_map_camera.matrix)
        return within_height(cloud, T_map_camera, config.cloud, above_lawn(self.geometry))


class ObstacleMapper:
    """Turns aligned RGB-D frames into an obstacle map.

    Frames with a pose accumulate in `map`. Frames without one are mapped each on its own, in the
    frame `base` on the ground under the camera, by the configured or measured mount.

    Args:
        segmenter: tells grass from obstacles.
        config: all settings.
        T_base_camera: mount of the camera, for frames without a pose.
        area: work area, whose outside is kept out of in costmaps; None = everywhere is inside.
        living: saved living map to go on from; it is changed.
    """

    def __init__(
        self,
        segmenter: Segmenter,
        config: Config | None = None,
        T_base_camera: Pose | None = None,
        area: WorkArea | None = None,
        living: LivingMap | None = None,
    ) -> None:
        self.segmenter = segmenter
        self.config = config or Config()
        self.T_base_camera = T_base_camera
        self.area = area
        self._mapper: GridMapper | LivingMap | None = living
        self._area_layer: tuple[GridSpec, NDArray[np.uint8]] | None = None
        self._last_stamp_ns: int | None = None

    def step(self, frame: Frame) -> StepResult:
        """Map one frame: segment, label the cloud, filter, to the map frame, update the grid.

        Raises:
            InputError: if the clock goes backwards, or the frame has no pose and no mount is known.
            InvalidValueError: if the pose is in another frame than the work area.
        """
        config, started = self.config, perf_counter()
        self._check_clock(frame)
        T_map_camera = self._pose_of(frame)
        segmentation = self.segmenter(frame).confident(config.segmenter.min_confidence)
        segmented = perf_counter()

        spec = self._window(frame.intrinsics, T_map_camera)
        geometry = see_ground(frame, T_map_camera, spec, config)
        grounded = perf_counter()
        semantic, counts = semantic_grid(frame, segmentation, T_map_camera, spec, config, geometry)
        seen = with_ground(semantic, geometry, config)
        gridded = perf_counter()

        if frame.T_map_camera is not None:
            if self.area is not None:
                self.area.check_frame(T_map_camera.parent)
            self._mapper = self._mapper or new_map(config, T_map_camera.parent)
            self._mapper.integrate(seen)
        done = perf_counter()
        stages = {"segment": segmented - started}
        stages |= {} if geometry is None else {"geometry": grounded - segmented}
        stages |= {"grid": gridded - grounded, "update": done - gridded}
        timings_ms = {name: 1e3 * seconds for name, seconds in stages.items()}
        return StepResult(frame, segmentation, T_map_camera, seen, counts, timings_ms, semantic, geometry)

    def run(self, frames: Iterable[Frame]) -> Iterator[StepResult]:
        """Map every frame of a source, one after another."""
        return map(self.step, frames)

    @property
    def map(self) -> OccupancyGrid | None:
        """The accumulated map; None until a frame with a pose has seen something."""
        return None if self._mapper is None else self._mapper.grid

    @property
    def living(self) -> LivingMap | None:
        """The map with its evidence, to be saved; None in the paper's mode, or before the first pose."""
        return self._mapper if isinstance(self._mapper, LivingMap) else None

    def costmap(self, grid: OccupancyGrid | None = None) -> Costmap | None:
        """Costmap of `grid`, or of the accumulated map; without a pose the work area says nothing."""
        grid = self.map if grid is None else grid
        if grid is None:
            return None
        placed = self.T_base_camera is None or grid.spec.frame_id != self.T_base_camera.parent
        layer = self._layer_of_area(grid.spec) if placed else None
        return build_costmap(grid, self.config.costmap, layer)

    def _layer_of_area(self, spec: GridSpec) -> NDArray[np.uint8] | None:
        """The work area as a layer; drawn once for each extent of the map."""
        if self.area is not None and (self._area_layer is None or self._area_layer[0] != spec):
            self._area_layer = spec, self.area.layer(spec)
        return None if self._area_layer is None else self._area_layer[1]

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


def semantic_grid(
    frame: Frame,
    segmentation: Segmentation,
    T_map_camera: Pose,
    spec: GridSpec,
    config: Config,
    geometry: GroundEvidence | None = None,
) -> tuple[OccupancyGrid, PixelCounts]:
    """One frame's grid from its mask, by the configured road; on slopes heights are those above the lawn."""
    road = fused_grid if config.road == "fused" else staged_grid
    return road(
        frame, segmentation, T_map_camera, spec, config.cloud, config.grid.min_points,
        config.grid.min_grass_points, above_lawn(geometry),
    )  # fmt: skip


def above_lawn(geometry: GroundEvidence | None) -> NDArray[np.float32] | None:
    """What gives heights above the lawn, if geometry is on and saw it."""
    return None if geometry is None else geometry.above_lawn


def new_map(config: Config, frame_id: str) -> GridMapper | LivingMap:
    """An empty accumulated map of the configured mode."""
    if config.grid.mode == "evidence":
        return LivingMap(config.grid, config.evidence, config.cloud.min_height_m, frame_id)
    return GridMapper(config.grid, frame_id)


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
