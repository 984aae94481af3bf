"""A garden of simple solids with exact truth: depth, classes, poses and the map, in pure NumPy.

The frame `map` has z up and the lawn at z = 0. Everything is closed form, so a map made from these
frames can be compared with `true_map` cell for cell, and depth with pencil and paper.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from swardmap.errors import FrameMismatchError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import GRASS_OBSTACLE_PERSON, MAP_CLASS_OF_ROLE, LabelSet, MapClass
from swardmap.synth.analytic_noise import StereoNoise, with_sensor_noise
from swardmap.synth.analytic_render import cast, paint
from swardmap.synth.analytic_scene import MAP_FRAME, Scene, Walker, garden_scene, lane_poses
from swardmap.synth.analytic_solids import (
    GRAVEL,
    LEAVES,
    WOOD,
    Box,
    Cylinder,
    Ellipsoid,
    Finish,
    Patch,
    sphere,
)
from swardmap.types import Frame

__all__ = [
    "GRAVEL",
    "LEAVES",
    "VGA",
    "WOOD",
    "AnalyticSource",
    "Box",
    "Cylinder",
    "Ellipsoid",
    "Finish",
    "Patch",
    "Scene",
    "StereoNoise",
    "Walker",
    "garden_scene",
    "lane_poses",
    "render",
    "sphere",
    "true_map",
    "with_sensor_noise",
]

VGA = Intrinsics(640, 480, 460.0, 460.0, 319.5, 239.5)
"""A depth camera at 640 x 480 that sees 70 degrees across."""


def render(
    scene: Scene,
    intrinsics: Intrinsics,
    T_map_camera: Pose,
    stamp_ns: int = 0,
    name: str = "",
    exact: bool = False,
    max_depth_m: float = 30.0,
) -> Frame:
    """What an ideal RGB-D camera sees: exact labels, depth without noise.

    Args:
        scene: what there is.
        intrinsics: of the camera.
        T_map_camera: pose of its optical frame; the parent must be `map`, the camera above the lawn.
        stamp_ns: time, for persons who walk.
        name: of the frame.
        exact: depth as float32 metres; else uint16 millimetres, rounded.
        max_depth_m: beyond it there is no reading.

    Raises:
        FrameMismatchError: if the pose is not of the frame `map`.
        InvalidValueError: if the camera is not above the lawn.
    """
    if T_map_camera.parent != MAP_FRAME:
        raise FrameMismatchError(f"expected a pose in the frame 'map', got '{T_map_camera.parent}'")
    if T_map_camera.position_m[2] <= 0:
        raise InvalidValueError(f"expected a camera above the lawn, got z = {T_map_camera.position_m[2]} m")
    solids = scene.at(stamp_ns)
    hits = cast(solids, scene.patches, intrinsics, T_map_camera)
    reach = max_depth_m if exact else min(max_depth_m, 65.535)
    depth_m = np.where(hits.depth_m <= reach, hits.depth_m, 0.0)
    return Frame(
        stamp_ns,
        intrinsics,
        paint(hits, solids, scene.patches, T_map_camera),
        depth_m.astype(np.float32) if exact else np.rint(depth_m * 1000).astype(np.uint16),
        T_map_camera=T_map_camera,
        labels=hits.labels,
        label_set=GRASS_OBSTACLE_PERSON,
        name=name,
        tags={"scene": scene.name},
    )


def true_map(scene: Scene, spec: GridSpec, stamp_ns: int = 0, max_height_m: float = 2.0) -> OccupancyGrid:
    """The map as it is, seen or not: what stands on each cell below a height, grass elsewhere.

    Args:
        scene: what there is.
        spec: grid in the frame `map`.
        stamp_ns: time, for persons who walk.
        max_height_m: what hangs higher is driven under.

    Returns:
        Every cell is grass, obstacle or person; a person beats an obstacle, and both beat grass.
    """
    if spec.frame_id != MAP_FRAME:
        raise FrameMismatchError(f"expected a grid in the frame 'map', got '{spec.frame_id}'")
    iy, ix = np.indices(spec.shape)
    lower = np.stack((ix, iy), axis=-1).reshape(-1, 2) * spec.resolution_m + np.asarray(spec.origin_m)
    upper = lower + spec.resolution_m
    classes = np.full(len(lower), MapClass.GRASS, np.uint8)
    for patch in scene.patches:
        classes[patch.covers(lower, upper)] = MAP_CLASS_OF_ROLE[patch.label.role]
    for solid in sorted(scene.at(stamp_ns), key=lambda s: MAP_CLASS_OF_ROLE[s.label.role]):
        classes[solid.covers(lower, upper, max_height_m)] = MAP_CLASS_OF_ROLE[solid.label.role]
    return OccupancyGrid(spec, classes.reshape(spec.shape), stamp_ns)


@dataclass(frozen=True)
class AnalyticSource:
    """Frames of a scene along a way: a FrameSource that needs no file.

    Attributes:
        scene: what there is.
        poses: T_map_camera of each frame.
        intrinsics: of the camera.
        period_ns: time from frame to frame; the first is at 0.
        exact: depth as float32 without rounding.
        noise: of the depth sensor; None = ideal.
        seed: of the noise; frame i draws from (seed, i), so that every iteration is the same.
    """

    scene: Scene = field(default_factory=garden_scene)
    poses: tuple[Pose, ...] = field(default_factory=lambda: tuple(lane_poses(20)))
    intrinsics: Intrinsics = VGA
    period_ns: int = 200_000_000
    exact: bool = False
    noise: StereoNoise | None = None
    seed: int = 0

    @property
    def name(self) -> str:
        """Of the scene."""
        return self.scene.name

    @property
    def frame_count(self) -> int:
        """One a pose."""
        return len(self.poses)

    @property
    def label_set(self) -> LabelSet:
        """Other, grass, person."""
        return GRASS_OBSTACLE_PERSON

    @property
    def skipped(self) -> Mapping[str, int]:
        """Nothing, ever."""
        return {}

    def __iter__(self) -> Iterator[Frame]:
        """Render frame by frame."""
        for i, pose in enumerate(self.poses):
            frame = render(
                self.scene, self.intrinsics, pose, i * self.period_ns, f"{i:06d}", exact=self.exact
            )
            if self.noise is not None:
                frame = with_sensor_noise(frame, np.random.default_rng([self.seed, i]), self.noise)
            yield frame
