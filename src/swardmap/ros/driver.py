"""A small controller that lives by what the node publishes: costmap, obstacles, persons and stop flag.

For the simulated mower and for tests; a robot has Nav2. It stands while the flag is set or silent, while the
costmap is old, and while a person is in the way; around everything else it drives.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from swardmap.geometry import Pose
from swardmap.grid import GridSpec
from swardmap.ros.gate import Command, GateConfig, GateInputs, away_in_zone_m, refusal
from swardmap.ros.route import INSCRIBED, Route, route

STILL = Command(0.0, 0.0)
NOWHERE = "no free cell is near"
HALF_WIDTH_M, FRONT_M, REAR_M, TURN_RADIUS_M = 0.3, 0.4, 0.3, 0.45
INSCRIBED_M = 0.5
"""Radius of the costmap that the ways are planned on: the circle that turning sweeps, and some air."""

GATE = GateConfig(
    flag_timeout_s=1.0, map_timeout_s=1.0, pose_timeout_s=1.0, front_m=FRONT_M, rear_m=REAR_M,
    half_width_m=HALF_WIDTH_M, turn_radius_m=TURN_RADIUS_M, reaction_s=0.4, brake_mps2=1.0,
)  # fmt: skip
FOR_PERSONS = replace(GATE, margin_m=0.5, reaction_s=3.2)
"""Persons are given half a metre on all sides and two ahead: from there the camera sees them leave, too."""

STILL_FOR_PERSONS = replace(FOR_PERSONS, margin_m=0.6, reaction_s=3.8)
"""Once it stands for somebody they must be a little farther away before it goes on."""

PATIENCE_S = 15.0
"""So long it stands still for somebody; then it may turn away from them."""

STRIDE_M = 1.0
"""Who shows up farther than this from everybody that it stands for is somebody else."""

PLAN_S = 0.5
COSTMAP_TIMEOUT_S = 2.0
AHEAD_M = 0.5
"""It steers towards the point of the way that is so far ahead."""

SHARP_RAD = 0.6
"""Beyond it the mower turns on the spot."""

BLOCKED_M = 0.3
"""A way that ends so much short of the goal, right here, is none: the mower turns and looks for another."""


@dataclass
class Heard:
    """What has been heard, and when (seconds of a clock that never goes back); None = nothing yet.

    Attributes:
        gate: stop flag, obstacles and pose.
        persons_m: (N, 2) points of persons that the last image shows, in the map.
        costs: (height, width) of the costmap's message.
        spec: where they lie.
        costs_s: when they came.
    """

    gate: GateInputs = field(default_factory=GateInputs)
    persons_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    costs: NDArray[np.int8] | None = None
    spec: GridSpec | None = None
    costs_s: float = -math.inf


class Driver:
    """Drives to one place after another.

    Args:
        speed_mps: on the straight.
        turn_rps: on the spot.

    Attributes:
        way: the last one planned.
    """

    def __init__(self, speed_mps: float = 0.5, turn_rps: float = 0.9) -> None:
        self.way: Route | None = None
        self._ahead, self._turn_rps = Command(speed_mps, 0.0), turn_rps
        self._planned: tuple[float, tuple[float, float]] | None = None
        self._waits_since_s: float | None = None
        self._waits_for_m = np.zeros((0, 2))

    def command(self, goal_m: tuple[float, float], heard: Heard, now_s: float) -> tuple[Command, str]:
        """What to do, and why not more; the reason is empty while it drives.

        Args:
            goal_m: (x, y) in the map.
            heard: all that is known.
            now_s: of the same clock.
        """
        T_map_base = heard.gate.T_map_base
        if T_map_base is None or heard.costs is None or heard.spec is None:
            return STILL, "no costmap is heard"
        if now_s - heard.costs_s > COSTMAP_TIMEOUT_S:
            return STILL, "the costmap is old"
        x, y, _ = T_map_base.position_m.tolist()
        self._plan((x, y), goal_m, heard.costs, heard.spec, now_s)
        if self.way is None:
            return STILL, NOWHERE
        blocked = self.way.short_m > BLOCKED_M and np.hypot(*(self.way.xy_m[-1] - (x, y))) < BLOCKED_M
        wish = Command(0.0, self._turn_rps) if blocked else self._towards(self.way, T_map_base)
        reason = self._person(wish, T_map_base, heard, now_s) or refusal(wish, heard.gate, now_s, GATE)
        if blocked and not reason:
            return wish, "no way through free cells is known: it looks around"
        return (STILL, reason) if reason else (wish, "")

    def _plan(
        self,
        here_m: tuple[float, float],
        goal_m: tuple[float, float],
        costs: NDArray[np.int8],
        spec: GridSpec,
        now_s: float,
    ) -> None:
        """A new way now and then, and at once when the old one is blocked or leads elsewhere."""
        planned, way = self._planned, self.way
        if planned is not None and way is not None and planned[1] == goal_m and now_s - planned[0] < PLAN_S:
            columns, rows = np.clip(spec.cell_of(way.xy_m).T, 0, np.array([[spec.width], [spec.height]]) - 1)
            if (costs[rows, columns] < INSCRIBED).all():
                return
        self.way, self._planned = route(costs, spec, here_m, goal_m), (now_s, goal_m)

    def _person(self, wish: Command, T_map_base: Pose, heard: Heard, now_s: float) -> str:
        """Whether somebody is ahead; after a while it may turn away from them, but never drive at them."""
        rules = FOR_PERSONS if self._waits_since_s is None else STILL_FOR_PERSONS
        away_m = away_in_zone_m(heard.persons_m, T_map_base, self._ahead, rules)
        ahead = np.isfinite(away_m)
        waited_s = self._waited_s(heard.persons_m[ahead], now_s)
        if waited_s >= PATIENCE_S and not wish.forward_mps:
            away_m = away_in_zone_m(heard.persons_m, T_map_base, wish, rules)
        nearest_m = away_m.min(initial=math.inf)
        return f"a person is {nearest_m:.1f} m from the base" if math.isfinite(nearest_m) else ""

    def _waited_s(self, ahead_m: NDArray[np.float64], now_s: float) -> float:
        """How long it has stood for those who are ahead; for somebody new, or back again, it begins anew."""
        away_m, _ = KDTree(self._waits_for_m).query(ahead_m)
        self._waits_for_m = ahead_m
        if not len(ahead_m):
            self._waits_since_s = None
            return 0.0
        if self._waits_since_s is None or away_m.max() > STRIDE_M:
            self._waits_since_s = now_s
        return now_s - self._waits_since_s

    def _towards(self, way: Route, T_map_base: Pose) -> Command:
        """Towards the point some way ahead; it turns on the spot where that lies beside or behind."""
        here = T_map_base.position_m[:2]
        away_m = np.hypot(*(way.xy_m - here).T)
        beyond = np.flatnonzero((away_m >= AHEAD_M) & (np.arange(len(away_m)) > away_m.argmin()))
        dx, dy = way.xy_m[beyond[0] if len(beyond) else -1] - here
        heading = math.atan2(T_map_base.matrix[1, 0], T_map_base.matrix[0, 0])
        error = math.remainder(math.atan2(dy, dx) - heading, 2 * math.pi)
        if abs(error) > SHARP_RAD:
            return Command(0.0, math.copysign(self._turn_rps, error))
        return Command(self._ahead.forward_mps * math.cos(error), self._turn_rps * error / SHARP_RAD)
