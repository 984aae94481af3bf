"""A garden drawn by OpenGL that a simulated mower drives through live; laid out as that of `live_garden`."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.geometry import Intrinsics, Pose
from swardmap.synth.config import SynthConfig
from swardmap.synth.live_garden import BED_HALF_M, BED_M, GOAL_M, VIA_M, T_base_camera, Visit
from swardmap.synth.model import Float64Array, Garden, Thing
from swardmap.synth.people.path import Path, Walker, walker
from swardmap.synth.scene.areas import inside_convex_m
from swardmap.synth.scene.camera_path import on_wheels
from swardmap.synth.scene.place import tilted
from swardmap.synth.scene.plants import raised_bed
from swardmap.synth.sensor.camera import CameraFaults, photograph
from swardmap.synth.sensor.stereo import draw_stereo
from swardmap.synth.sequence import sensed_depth
from swardmap.synth.stage import GardenStage
from swardmap.types import Frame

SEED = 0
CAMERA = Intrinsics(320, 240, 230.0, 230.0, 159.5, 119.5)
LANE_M = ((-1.2, -4.0), (8.6, 4.0))
"""Corners of the part of the lawn that the mower and the visitor use; what stands there is taken away."""

TRIES = 3000
STEEPEST_M = 0.6
"""The lane rises and falls by so much at most."""


@dataclass(frozen=True, slots=True, eq=False)
class VisitingWalker:
    """The walker of a visit, as somebody of a garden.

    Attributes:
        walker: along the way of the visit, from its begin on.
        visit: tells the visit, which says how far they are.
    """

    walker: Walker
    visit: Callable[[], Visit]

    def at(self, stamp_ns: int) -> Thing:
        """The person at a time."""
        return self.walker.at(round(self.visit().walked_m(stamp_ns) / self.walker.speed_mps * 1e9))


class RenderedGarden:
    """A garden of the package, cleared along a lane, with a bed in it and somebody who crosses it.

    Attributes:
        name: in words.
        intrinsics, T_base_camera, rate_hz: of the mower's camera.
        via_m, goal_m: (x, y) to pass, and where the mower is to go, and come back from.
        visit: of the person.

    Raises:
        MissingExtraError: if OpenGL or the assets are not installed.
    """

    def __init__(self, seed: int = SEED, illumination: str = "cloudy") -> None:
        config = SynthConfig()
        config = replace(config, rig=replace(config.rig, width=CAMERA.width, height=CAMERA.height))
        self.name, self.intrinsics, self.rate_hz = f"rendered garden {seed}", CAMERA, 3.0
        self.visit = Visit()
        self.T_base_camera, self.via_m, self.goal_m = T_base_camera, VIA_M, GOAL_M
        self._rng = np.random.default_rng([seed, 5])
        self._stage = GardenStage(config)
        whole = self._stage.garden(seed)
        self._light = self._stage.light(illumination, self._rng)
        self._sensor = draw_stereo(config.stereo, self._rng)
        self._lane = lane_in(whole, np.random.default_rng([seed, 6]))
        x, y, yaw = self._lane
        flat = np.eye(4)
        flat[:2, :2] = [(math.cos(yaw), -math.sin(yaw)), (math.sin(yaw), math.cos(yaw))]
        flat[:3, 3] = x, y, whole.ground.height_at(np.array([(x, y)]))[0]
        self._T_garden_map = Pose("garden", "map", flat)
        way = Path(self._in_garden(np.array([self.visit.from_m, self.visit.lane_m])))
        assets = self._stage.assets
        assert assets is not None  # noqa: S101 - the settings ask for them
        person = walker(self._rng, assets, way, whole.ground, self.visit.speed_mps, group="woman")
        visitor = VisitingWalker(replace(person, start_m=0.0), lambda: self.visit)
        self._garden = replace(
            self._cleared(whole), actors=(visitor,)
        )  # one and the same, drawn again and again

    def begin_visit(self, stamp_ns: int | None) -> None:
        """Let the person set out at a time; None = they wait where they begin."""
        self.visit = replace(self.visit, began_ns=stamp_ns)

    def base_at(self, x_m: float, y_m: float, yaw_rad: float) -> Pose:
        """T_map_base of a mower whose wheels stand on the ground."""
        (x, y), yaw = self._in_garden(np.array([(x_m, y_m)]))[0], self._lane[2] + yaw_rad
        T_garden_base = Pose("garden", "base_link", on_wheels(self._garden.ground, float(x), float(y), yaw))
        return self._T_garden_map.inverse() @ T_garden_base

    def look(self, T_map_base: Pose, stamp_ns: int) -> Frame:
        """What the camera sees: a picture with noise, depth of the stereo sensor."""
        T = self._T_garden_map @ T_map_base @ self.T_base_camera
        view = self._stage.view(self._garden, self._light, CAMERA, Pose("map", "camera", T.matrix), stamp_ns)
        rgb = photograph(view.radiance, CameraFaults(shot_noise=0.01, read_noise=0.004), self._rng)
        depth = sensed_depth(view, rgb, CAMERA, self._sensor, self._rng)
        return Frame(stamp_ns, CAMERA, rgb, depth)

    def _in_garden(self, xy_m: Float64Array) -> Float64Array:
        """(N, 2) points of the map in the garden."""
        T = self._T_garden_map.matrix
        points: Float64Array = xy_m @ T[:2, :2].T + T[:2, 3]
        return points

    def _cleared(self, garden: Garden) -> Garden:
        """Without what stands in the lane, and with the bed."""
        places = np.array([thing.T_map_model[:2, 3] for thing in garden.things])
        T = self._T_garden_map.inverse().matrix
        x, y = (places @ T[:2, :2].T + T[:2, 3]).T
        (x0, y0), (x1, y1) = LANE_M
        there = (x > x0) & (x < x1) & (y > y0) & (y < y1)
        kept = [thing for thing, inside in zip(garden.things, there, strict=True) if not inside]
        return replace(garden, things=(*kept, self._bed(garden)))

    def _bed(self, garden: Garden) -> Thing:
        model = raised_bed(self._rng)
        low, high = model.bounds_m()
        size = high - low
        middle = self._in_garden(np.array([BED_M]))[0]
        T = tilted(garden.ground, model, (float(middle[0]), float(middle[1])), self._lane[2])
        T[:3, :3] = T[:3, :3] @ np.diag([2 * BED_HALF_M[0] / size[0], 2 * BED_HALF_M[1] / size[1], 1.0])
        return Thing(model, "raised bed", T)


def lane_in(garden: Garden, rng: np.random.Generator) -> tuple[float, float, float]:
    """Place and heading (rad) of a mower that has the whole lane on a lawn that is nearly level.

    Args:
        garden: where.
        rng: source of chance.

    Raises:
        InvalidValueError: if there is no room.
    """
    (x0, y0), (x1, y1) = LANE_M
    grid = np.stack(np.meshgrid(np.arange(x0, x1, 0.4), np.arange(y0, y1, 0.4)), axis=-1).reshape(-1, 2)
    low, high = garden.lot_m.min(axis=0), garden.lot_m.max(axis=0)
    for x, y, yaw in rng.uniform((*low, -math.pi), (*high, math.pi), (TRIES, 3)).tolist():
        c, s = math.cos(yaw), math.sin(yaw)
        points = grid @ np.array([(c, s), (-s, c)]) + (x, y)
        px, py = points.astype(np.float32).T
        if (inside_convex_m(garden.lot_m, px, py) > 0).all() and garden.ground.is_lawn(points).all():
            heights = garden.ground.height_at(points)
            if heights.max() - heights.min() < STEEPEST_M:
                return x, y, yaw
    raise InvalidValueError(f"{garden.name}: found no lane of {x1 - x0:g} x {y1 - y0:g} m on its lawn")
