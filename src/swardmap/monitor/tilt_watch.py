"""Whether the ground lies as level before the camera as its pose says: a mount that is off in pitch or roll.

A robot that knows only where it is and where it heads (planar odometry) has a camera whose tilt never
changes by its pose. The ground it stands on is level to it then, whatever the slope. If it lies tilted by
the same few degrees all along the way, the mount is not what the pose says. Where a pose has the robot's own
tilt in it, the slope of the ground may be true, and nothing is said.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Pose

TILT_DEG = 2.5
SAME_DEG = 0.3
"""Tilts of the camera by its poses that differ by less are one."""
WINDOW, LEAST = 60, 10
"""Frames with ground remembered, and how many are needed."""
LEAST_WAY_M = 1.5
STEADY = 0.25
"""Spread of the tilts, as a share of their middle: a bump or a bank comes and goes, a mount stays."""

Tilted = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Up in the camera, position in the map, pitch and roll of the ground in degrees."""


@dataclass(slots=True)
class TiltWatch:
    """Tells from the ground of the last frames whether the mount of a camera can be right.

    Attributes:
        limit: so many times 2.5 degrees the ground may be tilted; None = never looked at.
        tilt_deg: (pitch, roll) of the ground, down ahead and down to the right positive, if it is; else None.
    """

    limit: float | None
    tilt_deg: tuple[float, float] | None = None
    _seen: deque[Tilted] = field(default_factory=lambda: deque(maxlen=WINDOW))

    def add(self, T_map_camera: Pose, slope: tuple[float, float]) -> bool:
        """Take the ground of a frame as (dz/dx, dz/dy) in the map; whether it is tilted."""
        return self.tilt_deg is not None if self.limit is None else self.take(tilted(T_map_camera, slope))

    def take(self, seen: Tilted) -> bool:
        """Take what `tilted` kept of a frame; whether the ground is tilted."""
        if self.limit is not None:
            self._seen.append(seen)
            self.tilt_deg = tilt_of(list(self._seen), self.limit)
        return self.tilt_deg is not None


def tilted(T_map_camera: Pose, slope: tuple[float, float]) -> Tilted:
    """What is kept of a frame."""
    matrix = T_map_camera.matrix
    ahead = matrix[:2, 2]
    if np.hypot(*ahead) < 0.2:  # it looks down: the upper edge of the image is ahead
        ahead = -matrix[:2, 1]
    x, y = ahead / max(float(np.hypot(*ahead)), 1e-9)
    falls = -(slope[0] * x + slope[1] * y), -(slope[0] * y - slope[1] * x)
    return matrix[2, :3].copy(), matrix[:3, 3].copy(), np.rad2deg(np.arctan(falls))


def tilt_of(seen: list[Tilted], limit: float = 1.0) -> tuple[float, float] | None:
    """Pitch and roll of the ground all along a way, if the camera cannot be mounted as its poses say."""
    if len(seen) < LEAST:
        return None
    ups, places, tilts = (np.stack(part) for part in zip(*seen, strict=True))
    turned = np.rad2deg(np.arccos(np.clip(ups @ ups[0], -1, 1)))
    if turned.max() > SAME_DEG or np.linalg.norm(places - places[0], axis=1).max() < LEAST_WAY_M:
        return None
    middle = np.median(tilts, axis=0)
    spread = 1.48 * np.median(np.abs(tilts - middle), axis=0)
    if not (np.abs(middle) > np.maximum(TILT_DEG * limit, spread / STEADY)).any():
        return None
    return float(middle[0]), float(middle[1])
