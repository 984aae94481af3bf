"""Direction of travel from odometry, with hysteresis, and the cameras that are processed because of it."""

from collections import deque

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.geometry import Pose
from swardmap.rig.rig import Direction, Rig, RigCamera, SelectorConfig

NS = 1_000_000_000


class DirectionSelector:
    """Tells the direction of travel from signed speeds or poses, standing still keeps the last one.

    Time is that of the odometry. What goes back in time, or jumps, starts the measurement anew and changes
    nothing.

    Args:
        config: thresholds.
    """

    def __init__(self, config: SelectorConfig | None = None) -> None:
        self._config = config or SelectorConfig()
        self._direction = Direction(self._config.initial)
        self._other_since_ns: int | None = None
        self._last_ns: int | None = None
        self._steps: deque[tuple[int, Pose, float]] = deque()  # stamp, pose, way driven since the first

    @property
    def direction(self) -> Direction:
        """The direction so far."""
        return self._direction

    def step_speed(self, stamp_ns: int, forward_mps: float) -> Direction:
        """Take a signed speed along the robot's x axis, such as a twist's linear.x.

        Raises:
            InvalidValueError: for a speed that is not finite.
        """
        if not np.isfinite(forward_mps):
            raise InvalidValueError(f"direction: expected a finite speed in m/s, got {forward_mps}")
        if self._last_ns is not None and stamp_ns < self._last_ns:
            self._other_since_ns = None
        self._last_ns = stamp_ns
        toward = Direction.FORWARD if forward_mps > 0 else Direction.BACKWARD
        if abs(forward_mps) < self._config.min_speed_mps or toward == self._direction:
            self._other_since_ns = None
            return self._direction
        if self._other_since_ns is None:
            self._other_since_ns = stamp_ns
        if stamp_ns - self._other_since_ns >= round(self._config.hold_s * NS):
            self._direction, self._other_since_ns = toward, None
        return self._direction

    def step_pose(self, stamp_ns: int, T_map_base: Pose) -> Direction:
        """Take a pose of the robot; the speed is the way driven along its x axis within `window_s`."""
        if self._steps:
            last_ns, last, way_m = self._steps[-1]
            step_m = forward_step_m(last, T_map_base)
            limit_m = self._config.max_speed_mps * (stamp_ns - last_ns) / NS
            if stamp_ns <= last_ns or abs(step_m) > limit_m:
                self._steps.clear()
                self._other_since_ns = None
            else:
                self._steps.append((stamp_ns, T_map_base, way_m + step_m))
        if not self._steps:
            self._steps.append((stamp_ns, T_map_base, 0.0))
            self._last_ns = stamp_ns
            return self._direction
        window_ns = round(self._config.window_s * NS)
        while len(self._steps) > 2 and stamp_ns - self._steps[1][0] >= window_ns:
            self._steps.popleft()
        first_ns, _, first_m = self._steps[0]
        if stamp_ns - first_ns < window_ns:
            return self._direction
        return self.step_speed(stamp_ns, (self._steps[-1][2] - first_m) / ((stamp_ns - first_ns) / NS))


def forward_step_m(before: Pose, after: Pose) -> float:
    """Signed way along the robot's x axis between two poses, metres; turning on the spot gives 0.

    Args:
        before: T_map_base, of the earlier time.
        after: T_map_base, of the later time; of the same frames.
    """
    if (before.parent, before.child) != (after.parent, after.child):
        raise InvalidValueError(
            f"direction: expected poses of the same frames, got {before.parent} <- {before.child} and "
            f"{after.parent} <- {after.child}"
        )
    middle = before.matrix[:3, 0] + after.matrix[:3, 0]
    length = float(np.linalg.norm(middle))
    moved = after.position_m - before.position_m
    return float(moved @ middle) / length if length > 1e-6 else 0.0


class ActiveCameras:
    """The cameras that face the direction of travel; counts what the others would have given.

    If no camera faces a direction, all are processed there, and `blind` says so.

    Args:
        rig: all cameras.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.selector = DirectionSelector(rig.selector)
        self.processed = dict.fromkeys(rig.names, 0)
        self.dropped = dict.fromkeys(rig.names, 0)

    @property
    def cameras(self) -> tuple[RigCamera, ...]:
        """Cameras to process now."""
        return self.rig.facing(self.selector.direction) or self.rig.cameras

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(camera.name for camera in self.cameras)

    @property
    def blind(self) -> bool:
        """Whether the robot travels in a direction in which no camera looks."""
        return not self.rig.facing(self.selector.direction)

    def admits(self, name: str) -> bool:
        """Whether a frame of a camera is to be processed; call it once a frame, before decoding it."""
        self.rig[name]
        admitted = name in self.names
        counter = self.processed if admitted else self.dropped
        counter[name] += 1
        return admitted
