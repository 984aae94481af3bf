"""What frames that are each fit for the map say together: whether pose, mount and depth can be right.

The map takes such frames: what is told is a warning, for a person to look at the robot.
"""

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Pose
from swardmap.monitor.align_watch import AlignWatch
from swardmap.monitor.diagnostics import Fault, FrameStats
from swardmap.monitor.motion_watch import MotionWatch, PairOff
from swardmap.monitor.tilt_watch import Tilted, TiltWatch


class ViewWatch:
    """What is remembered of the views of one camera.

    Args:
        limit: so many times as much as usual view, pose and mount may differ; None = never looked at.
    """

    def __init__(self, limit: float | None) -> None:
        self._motion, self._align, self._tilt = MotionWatch(limit), AlignWatch(limit), TiltWatch(limit)

    def add(self, stats: FrameStats) -> list[Fault]:
        """Take a frame that is fit for the map; what is in doubt by it and those before it."""
        return _told(self._motion.add(stats.view), self._align.add(stats.edges))

    def take(self, pair: PairOff | None, counts: NDArray[np.int64] | None) -> list[Fault]:
        """The same of a frame of which only this is known: see `PairFinder` and `shifted_counts`."""
        return _told(self._motion.take(pair), self._align.take(counts))

    def add_ground(self, T_map_camera: Pose, slope: tuple[float, float]) -> bool:
        """Take the ground that a frame has shown, as (dz/dx, dz/dy) in the map; whether it is tilted."""
        return self._tilt.add(T_map_camera, slope)

    def take_ground(self, seen: Tilted) -> bool:
        """The same of a frame of which only what `tilted` kept is known."""
        return self._tilt.take(seen)

    def doubts(self) -> dict[Fault, str]:
        """What is found now, with the numbers."""
        found = {}
        if self._motion.found:
            found[Fault.MOTION] = self._motion.message()
        if self._align.shift:
            side = "right" if self._align.shift > 0 else "left"
            found[Fault.MISALIGNED] = (
                f"depth lies {abs(self._align.shift):.1%} of the width to the {side} of colour"
            )
        if self._tilt.tilt_deg is not None:
            pitch, roll = self._tilt.tilt_deg
            found[Fault.TILTED] = (
                f"level ground falls by {pitch:.1f} degrees ahead and {roll:.1f} to the right"
            )
        return found


def _told(motion: bool, misaligned: bool) -> list[Fault]:
    return [Fault.MOTION] * motion + [Fault.MISALIGNED] * misaligned
