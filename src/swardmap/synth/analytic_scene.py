"""Gardens of simple solids: who and what is in them, and the way a mower takes."""

from dataclasses import dataclass

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.geometry import Pose, mount_pose
from swardmap.labels import PERSON
from swardmap.synth.analytic_footprints import rotation_z
from swardmap.synth.analytic_solids import (
    GRAVEL,
    LEAVES,
    Box,
    Cylinder,
    Ellipsoid,
    Finish,
    Patch,
    Solid,
    sphere,
)

MAP_FRAME = "map"
SKIN = Finish((214, 166, 138), grain=0.04)


@dataclass(frozen=True, slots=True)
class Walker:
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

        shirt, trousers = Finish(self.shirt, grain=0.12), Finish(self.trousers, grain=0.1)
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
    persons: tuple[Walker, ...] = ()
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
        bark = Finish((104, 82, 64), "leaves", 0.4)
        middle = (*trunk, 2.1 + 0.75 * crown)
        return (
            Cylinder(trunk, float(rng.uniform(0.11, 0.17)), 2.4, material=bark),
            Ellipsoid(middle, (crown, crown, 0.8 * crown), material=LEAVES),
        )

    def bush(x: float, y: float) -> Solid:
        r = float(rng.uniform(0.35, 0.5))
        return Ellipsoid(
            (*near(x, y), 0.5 * r), (r, r, 0.9 * r), material=Finish((86, 74, 66), "leaves", 0.7)
        )

    bricks = Finish((158, 92, 74), "bricks", 0.22)
    stone = Finish((196, 190, 178), grain=0.1)
    ball = ((214, 72, 48), (236, 148, 44), (70, 110, 200))[rng.integers(3)]
    solids: tuple[Solid, ...] = (
        Box((12.4, 0.0), (0.7, 13.0, 1.5), material=LEAVES),  # hedge behind
        Box((4.0, 5.6), (17.0, 0.7, 1.3), material=LEAVES),  # hedge to the left
        Box((4.0, -5.9), (17.0, 0.25, 1.1), material=bricks),  # wall to the right
        Box(near(4.6, -2.5), (1.8, 0.9, 0.34), float(rng.uniform(-15, 15))),  # raised bed
        Box(near(8.8, 3.6), (1.6, 0.6, 0.45), float(rng.uniform(60, 100)), material=stone),
        *tree(6.6, 3.2),
        *tree(9.4, -3.6),
        Cylinder(near(3.2, 1.5), 0.05, 1.0, material=Finish((206, 206, 202), grain=0.05)),
        Cylinder(near(7.4, -1.3), 0.04, 1.2, material=Finish((70, 72, 76), grain=0.05)),
        bush(5.6, 1.6),
        bush(10.4, 0.5),
        sphere((*near(2.6, -0.9), 0.12), 0.12, material=Finish(ball, grain=0.05)),
    )  # fmt: skip
    persons = (
        Walker(near(5.6, -1.5, 0.15), (0.0, 0.55)),
        Walker(near(8.4, 1.2), height_m=float(rng.uniform(1.6, 1.9)), shirt=(60, 92, 150)),
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
