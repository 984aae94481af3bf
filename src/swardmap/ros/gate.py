"""The last one before the wheels: lets velocities through while all is well and the way is free, else zeros.

The pure functions need no ROS. On a robot with Nav2 its collision monitor does the part of the zone.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swardmap.config.settings import Checked, setting
from swardmap.errors import ConfigError
from swardmap.geometry import Pose

EDGE_M = 1e-6
"""What lies on the edge of the zone is in it, however it was rounded."""

STANDING_MPS, STANDING_RPS = 1e-3, 1e-3
"""Slower than this nobody moves."""


@dataclass(frozen=True)
class GateConfig(Checked):
    """When the robot may move."""

    flag_timeout_s: float = setting(0.5, "the stop flag must have come within it", minimum=0.01)
    map_timeout_s: float = setting(1.0, "the obstacles of the map must be newer", minimum=0.01)
    pose_timeout_s: float = setting(0.5, "the pose must be newer", minimum=0.01)
    front_m: float = setting(0.5, "from the base to the front of the robot", minimum=0)
    rear_m: float = setting(0.5, "from the base to its rear", minimum=0)
    half_width_m: float = setting(0.35, "half its width", minimum=0)
    margin_m: float = setting(0.0, "the measured margin, on all sides", minimum=0, maximum=10)
    reaction_s: float = setting(0.5, "from the image to the brakes", minimum=0)
    brake_mps2: float = setting(0.7, "how hard it can brake", minimum=0.01)
    turn_radius_m: float = setting(0.6, "turning on the spot sweeps this radius", minimum=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.turn_radius_m < self.half_width_m:
            raise ConfigError("gate: expected turn_radius_m of at least half_width_m")


@dataclass(frozen=True, slots=True)
class Command:
    """What the robot is to do: forward in m/s, turn to the left in rad/s."""

    forward_mps: float
    turn_rps: float

    @property
    def moves(self) -> bool:
        """Whether it does anything; what is not a number does."""
        return not (abs(self.forward_mps) < STANDING_MPS and abs(self.turn_rps) < STANDING_RPS)


@dataclass
class GateInputs:
    """What has been heard, and when (seconds of a clock that never goes back); None = nothing yet.

    Attributes:
        stop: the flag.
        cells_m: (N, 2) obstacles in the map.
        T_map_base: where the robot is.
        flag_s, cells_s, pose_s: when each came.
    """

    stop: bool | None = None
    cells_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    T_map_base: Pose | None = None
    flag_s: float = -math.inf
    cells_s: float = -math.inf
    pose_s: float = -math.inf


def refusal(command: Command, inputs: GateInputs, now_s: float, config: GateConfig) -> str:
    """Why the robot must not do what it is told; empty if it may.

    Args:
        command: forward and turning speed.
        inputs: what has been heard.
        now_s: of the same clock.
        config: limits.
    """
    if not command.moves:
        return ""
    if not (math.isfinite(command.forward_mps) and math.isfinite(command.turn_rps)):
        return "the command is not a number"
    if inputs.stop is None or now_s - inputs.flag_s > config.flag_timeout_s:
        return "no stop flag is heard"
    if inputs.stop:
        return "the stop flag is set"
    if now_s - inputs.cells_s > config.map_timeout_s:
        return "no map is heard"
    if inputs.T_map_base is None or now_s - inputs.pose_s > config.pose_timeout_s:
        return "no pose is heard"
    distance_m = nearest_in_zone_m(inputs.cells_m, inputs.T_map_base, command, config)
    return "" if distance_m is None else f"an obstacle is {distance_m:.2f} m from the base"


def reach_m(speed_mps: float, config: GateConfig) -> float:
    """Way until the robot stands: at full speed while nobody reacts, then braking."""
    return speed_mps * config.reaction_s + speed_mps**2 / (2 * config.brake_mps2)


def nearest_in_zone_m(
    cells_m: NDArray[np.float64], T_map_base: Pose, command: Command, config: GateConfig
) -> float | None:
    """Distance from the base to the nearest obstacle that the robot would run over; None if there is none."""
    away_m = away_in_zone_m(cells_m, T_map_base, command, config).min(initial=math.inf)
    return float(away_m) if math.isfinite(away_m) else None


def away_in_zone_m(
    cells_m: NDArray[np.float64], T_map_base: Pose, command: Command, config: GateConfig
) -> NDArray[np.float64]:
    """Distance (N,) from the base to each obstacle that the robot would run over; inf for the others.

    The zone is the robot and its way to a stand in the direction of travel, and a circle where it turns.

    Args:
        cells_m: (N, 2) in the map.
        T_map_base: pose of the robot.
        command: what it is to do.
        config: its size, and how it brakes.
    """
    edge_m = EDGE_M + config.margin_m
    to_base = T_map_base.inverse().matrix
    points = np.column_stack([cells_m, np.full(len(cells_m), T_map_base.position_m[2])])
    x, y = (points @ to_base[:3, :3].T + to_base[:3, 3])[:, :2].T
    speed = command.forward_mps
    way_m = reach_m(abs(speed), config) + edge_m
    inside = np.zeros(len(cells_m), bool)
    if speed >= STANDING_MPS:
        inside = (x >= -EDGE_M) & (x <= config.front_m + way_m)
    elif speed <= -STANDING_MPS:
        inside = (x <= EDGE_M) & (x >= -config.rear_m - way_m)
    inside &= np.abs(y) <= config.half_width_m + edge_m
    if abs(command.turn_rps) >= STANDING_RPS:
        inside |= np.hypot(x, y) <= config.turn_radius_m + edge_m
    return np.where(inside, np.hypot(x, y), np.inf)
