"""A garden of simple solids with exact truth: depth, classes, poses and the map, in pure NumPy.

The frame `map` has z up and the lawn at z = 0. Everything is closed form, so a map made from these
frames can be compared with `true_map` cell for cell, and depth with pencil and paper.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from swardmap.errors import FrameMismatchError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import GRASS_OBSTACLE_PERSON, MAP_CLASS_OF_ROLE, PERSON, LabelSet, MapClass
from swardmap.synth.analytic_noise import StereoNoise, with_sensor_noise
from swardmap.synth.analytic_render import cast, paint
from swardmap.synth.analytic_solids import (
    GRAVEL,
    LEAVES,
    WOOD,
    Box,
    Cylinder,
    Ellipsoid,
    Material,
    Patch,
    Solid,
    rotation_z,
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
    "Material",
    "Patch",
    "Person",
    "Scene",
    "StereoNoise",
    "garden_scene",
    "lane_poses",
    "render",
    "sphere",
    "true_map",
    "with_sensor_noise",
]

MAP_FRAME = "map"
VGA = Intrinsics(640, 480, 460.0, 460.0, 319.5, 239.5)
"""A depth camera at 640 x 480 that sees 70 degrees across."""

SKIN = Material((214, 166, 138), grain=0.04)


@dataclass(frozen=True, slots=True)
class Person:
    """Somebody who walks straight on: two legs, body, arms and head.

    Attributes:
        start_m: (x, y) at time zero.
        velocity_mps: along x and y; (0, 0) stands and looks along -x.
        height_m: from the ground to the top of the head.
        shirt, trousers: colours.
    """

    start_m: tuple[float, float]
    velocity_mps: tuple[float, float] = (0.0, 0.0)
    height_m: float = 1.75
    shirt: tuple[int, int, int] = (190, 62, 52)
    trousers: tuple[int, int, int] = (52, 62, 92)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.height_m) and self.height_m > 0):
            raise InvalidValueError(f"person: expected a positive height in metres, got {self.height_m}")

    def position_m(self, stamp_ns: int) -> tuple[float, float]:
        """(x, y) at a time."""
        seconds = stamp_ns * 1e-9
        (x, y), (vx, vy) = self.start_m, self.velocity_mps
        return x + vx * seconds, y + vy * seconds

    def solids(self, stamp_ns: int) -> tuple[Solid, ...]:
        """What the body is made of at a time; the legs swing with the way walked."""
        h, speed = self.height_m, float(np.hypot(*self.velocity_mps))
        heading = np.rad2deg(np.arctan2(self.velocity_mps[1], self.velocity_mps[0])) if speed else 180.0
        swing = 0.16 * h * np.sin(2 * np.pi * speed * stamp_ns * 1e-9 / (0.8 * h)) if speed else 0.0
        turn, here = rotation_z(heading)[:2, :2], np.asarray(self.position_m(stamp_ns))

        def at(forward: float, left: float) -> tuple[float, float]:
            x, y = here + turn @ np.array([forward, left])
            return float(x), float(y)

        shirt, trousers = Material(self.shirt, grain=0.12), Material(self.trousers, grain=0.1)
        legs = (
            Cylinder(at(side * swing, side * 0.055 * h), 0.045 * h, 0.48 * h, 0.0, PERSON, trousers)
            for side in (1, -1)
        )
        arms = (
            Ellipsoid((*at(-side * 0.6 * swing, side * 0.135 * h), 0.62 * h),
                      (0.033 * h, 0.033 * h, 0.19 * h), PERSON, shirt)
            for side in (1, -1)
        )  # fmt: skip
        body = Ellipsoid((*at(0, 0), 0.64 * h), (0.105 * h, 0.105 * h, 0.215 * h), PERSON, shirt)
        head = Ellipsoid((*at(0, 0), 0.925 * h), (0.055 * h, 0.055 * h, 0.075 * h), PERSON, SKIN)
        return (*legs, *arms, body, head)


@dataclass(frozen=True, slots=True)
class Scene:
    """A lawn at z = 0 and what is on it.

    Attributes:
        solids: what stands still.
        patches: flat parts of the ground that are not lawn; the first one counts where two overlap.
        persons: who may walk.
        name: shown in tags.
    """

    solids: tuple[Solid, ...] = ()
    patches: tuple[Patch, ...] = ()
    persons: tuple[Person, ...] = ()
    name: str = "scene"

    def at(self, stamp_ns: int) -> tuple[Solid, ...]:
        """All solids at a time, those of the persons last."""
        return (*self.solids, *(part for person in self.persons for part in person.solids(stamp_ns)))


def garden_scene(seed: int = 0) -> Scene:
    """A garden with a mowing lane along +x at y = 0: path, beds, trees, poles, ball, hedge, wall, persons.

    Args:
        seed: moves, turns and recolours things; the lane's first two metres stay free.
    """
    rng = np.random.default_rng(seed)

    def near(x: float, y: float, spread: float = 0.25) -> tuple[float, float]:
        dx, dy = rng.uniform(-spread, spread, 2)
        return float(x + dx), float(y + dy)

    def tree(x: float, y: float) -> tuple[Solid, ...]:
        trunk, crown = near(x, y), float(rng.uniform(0.9, 1.2))
        bark = Material((104, 82, 64), "leaves", 0.4)
        middle = (*trunk, 2.1 + 0.75 * crown)
        return (
            Cylinder(trunk, float(rng.uniform(0.11, 0.17)), 2.4, material=bark),
            Ellipsoid(middle, (crown, crown, 0.8 * crown), material=LEAVES),
        )

    def bush(x: float, y: float) -> Solid:
        r = float(rng.uniform(0.35, 0.5))
        return Ellipsoid(
            (*near(x, y), 0.5 * r), (r, r, 0.9 * r), material=Material((86, 74, 66), "leaves", 0.7)
        )

    bricks = Material((158, 92, 74), "bricks", 0.22)
    stone = Material((196, 190, 178), grain=0.1)
    ball = ((214, 72, 48), (236, 148, 44), (70, 110, 200))[rng.integers(3)]
    solids: tuple[Solid, ...] = (
        Box((12.4, 0.0), (0.7, 13.0, 1.5), material=LEAVES),  # hedge behind
        Box((4.0, 5.6), (17.0, 0.7, 1.3), material=LEAVES),  # hedge to the left
        Box((4.0, -5.9), (17.0, 0.25, 1.1), material=bricks),  # wall to the right
        Box(near(4.6, -2.5), (1.8, 0.9, 0.34), float(rng.uniform(-15, 15))),  # raised bed
        Box(near(8.8, 3.6), (1.6, 0.6, 0.45), float(rng.uniform(60, 100)), material=stone),
        *tree(6.6, 3.2),
        *tree(9.4, -3.6),
        Cylinder(near(3.2, 1.5), 0.05, 1.0, material=Material((206, 206, 202), grain=0.05)),
        Cylinder(near(7.4, -1.3), 0.04, 1.2, material=Material((70, 72, 76), grain=0.05)),
        bush(5.6, 1.6),
        bush(10.4, 0.5),
        sphere((*near(2.6, -0.9), 0.12), 0.12, material=Material(ball, grain=0.05)),
    )  # fmt: skip
    persons = (
        Person(near(5.6, -1.5, 0.15), (0.0, 0.55)),
        Person(near(8.4, 1.2), height_m=float(rng.uniform(1.6, 1.9)), shirt=(60, 92, 150)),
    )
    patches = (Patch((4.0, -4.2), (17.0, 1.1)), Patch((1.2, 4.0), (1.6, 3.0), material=GRAVEL))
    return Scene(solids, patches, persons, f"garden-{seed}")


def lane_poses(
    n: int,
    start_m: tuple[float, float] = (0.0, 0.0),
    heading_deg: float = 0.0,
    step_m: float = 0.1,
    height_m: float = 0.9,
    pitch_deg: float = 20.0,
) -> list[Pose]:
    """Poses T_map_camera of a mower on a straight lane.

    Args:
        n: how many.
        start_m: (x, y) of the first.
        heading_deg: of the lane, from x towards y.
        step_m: way from one pose to the next.
        height_m: of the camera above the lawn.
        pitch_deg: how far the camera looks down.
    """
    turn = rotation_z(heading_deg)
    mount = mount_pose(height_m, pitch_deg)
    poses = []
    for i in range(n):
        matrix = np.eye(4)
        matrix[:3, :3] = turn
        matrix[:3, 3] = np.array([*start_m, 0.0]) + turn @ np.array([i * step_m, 0, 0])
        poses.append(Pose(MAP_FRAME, "base", matrix) @ mount)
    return poses


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
        paint(hits, solids, scene.patches, intrinsics, T_map_camera),
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
