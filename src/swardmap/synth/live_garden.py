"""Gardens that a simulated mower drives through live: a bed in the way, and somebody who walks in.

Both kinds lie in the frame `map`, with the mower's start at (0, 0), heading along +x: one of simple solids in
pure NumPy, one drawn by OpenGL (`rendered_garden`).
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.synth.analytic_noise import StereoNoise, with_sensor_noise
from swardmap.synth.analytic_scene import MAP_FRAME, Scene, Walker
from swardmap.synth.analytic_solids import Box, Cylinder, Finish
from swardmap.types import Frame

BED_M, BED_HALF_M = (4.2, 0.0), (0.45, 0.8)
"""Middle of the bed, and half its sides."""

VIA_M, GOAL_M = (2.7, 0.0), (7.0, 0.0)
"""Where the mower is to go, and come back from; on its way there straight on first, to meet the visitor
whatever it knows of the lawn beside the bed."""

HEIGHT_M, PITCH_DEG, FORWARD_M = 0.9, 25.0, 0.3
T_base_camera = mount_pose(HEIGHT_M, PITCH_DEG, xy_m=(FORWARD_M, 0.0), parent="base_link", child="camera")
CAMERA = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
NOISE_8_BIT = 2.0

SOLIDS_NETWORK = Path(__file__).parent.parent / "data/models/solids.onnx"
"""Tells lawn, and persons in pink, by colour (`tests/synth/test_live_garden.py` makes it)."""

PINK, DARK_PINK = (220, 44, 196), (168, 30, 150)
_POST = Finish((206, 206, 202), grain=0.05)
_BARK = Finish((104, 82, 64), "leaves", 0.4)
SOLIDS = (
    Box(BED_M, (2 * BED_HALF_M[0], 2 * BED_HALF_M[1], 0.34)),
    Box((4.0, 4.6), (12.0, 0.6, 1.3)),
    Box((4.0, -4.6), (12.0, 0.6, 1.3)),
    Box((9.6, 0.0), (0.6, 9.0, 1.5)),
    Cylinder((5.9, 2.9), 0.14, 2.4, material=_BARK),
    Cylinder((1.2, 2.4), 0.05, 1.0, material=_POST),
)
"""What stands still in the garden of simple solids."""


@dataclass(frozen=True, slots=True)
class Visit:
    """Somebody who walks into the mower's lane, stands there for a while, and walks back.

    Attributes:
        from_m: (x, y) where they wait.
        lane_m: (x, y) where they stand in the lane.
        speed_mps: while walking.
        stands_s: in the lane.
        began_ns: when they set out; None = they wait.
    """

    from_m: tuple[float, float] = (5.0, -3.6)
    lane_m: tuple[float, float] = (3.0, 0.0)
    speed_mps: float = 1.2
    stands_s: float = 2.0
    began_ns: int | None = None

    @property
    def length_m(self) -> float:
        """Of the way in."""
        return math.dist(self.from_m, self.lane_m)

    def walked_m(self, stamp_ns: int) -> float:
        """Way gone at a time, in and back."""
        if self.began_ns is None:
            return 0.0
        way = self.speed_mps * (stamp_ns - self.began_ns) / 1e9
        if way > self.length_m:
            way = max(self.length_m, way - self.speed_mps * self.stands_s)
        return min(max(way, 0.0), 2 * self.length_m)

    def away_m(self, stamp_ns: int) -> float:
        """How far they are from where they wait."""
        walked = self.walked_m(stamp_ns)
        return min(walked, 2 * self.length_m - walked)

    def position_m(self, stamp_ns: int) -> tuple[float, float]:
        """(x, y) at a time."""
        share = self.away_m(stamp_ns) / self.length_m
        (x0, y0), (x1, y1) = self.from_m, self.lane_m
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0)


class SolidGarden:
    """A lawn between fences, a bed, a tree, a post, and the visitor: simple solids, in pure NumPy.

    Attributes:
        name: in words.
        intrinsics, T_base_camera, rate_hz: of the mower's camera.
        via_m, goal_m: (x, y) to pass, and where the mower is to go, and come back from.
        visit: of the person.
    """

    def __init__(self) -> None:
        self.name, self.intrinsics, self.rate_hz = "a garden of simple solids", CAMERA, 5.0
        self.visit = Visit()
        self.T_base_camera, self.via_m, self.goal_m = T_base_camera, VIA_M, GOAL_M
        self._rng = np.random.default_rng(0)
        way = np.subtract(self.visit.lane_m, self.visit.from_m)
        vx, vy = (way / self.visit.length_m * self.visit.speed_mps).tolist()
        person = Walker(self.visit.from_m, (vx, vy), shirt=PINK, trousers=DARK_PINK)
        self._scene = Scene(SOLIDS, persons=(person,), name="live")

    def begin_visit(self, stamp_ns: int | None) -> None:
        """Let the person set out at a time; None = they wait where they begin."""
        self.visit = replace(self.visit, began_ns=stamp_ns)

    def base_at(self, x_m: float, y_m: float, yaw_rad: float) -> Pose:
        """T_map_base: the lawn is level."""
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        matrix = np.array([[c, -s, 0, x_m], [s, c, 0, y_m], [0, 0, 1, 0], [0, 0, 0, 1]])
        return Pose(MAP_FRAME, "base_link", matrix)

    def look(self, T_map_base: Pose, stamp_ns: int) -> Frame:
        """What the camera sees, with the noise of stereo depth and of a colour camera."""
        from swardmap.synth.analytic import render

        walked_ns = round(self.visit.away_m(stamp_ns) / self.visit.speed_mps * 1e9)  # back they go backwards
        frame = render(self._scene, self.intrinsics, T_map_base @ T_base_camera, walked_ns)
        frame = with_sensor_noise(frame, self._rng, StereoNoise())
        noisy = frame.rgb + self._rng.normal(0, NOISE_8_BIT, frame.rgb.shape)
        return replace(frame, rgb=np.clip(noisy, 0, 255).astype(np.uint8), stamp_ns=stamp_ns)
