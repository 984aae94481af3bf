"""Trajectories as text: a pose a line, as the TUM benchmark, KITTI or TartanAir write them."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Pose, interpolate_pose
from swardmap.io.door import reading
from swardmap.io.text_lines import numbered_lines

TUM, QUATERNIONS, MATRICES = 8, 7, 12
"""Numbers a line: stamp and pose; a pose; the upper rows of its matrix, row by row."""


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses in order of time.

    Attributes:
        stamps_ns: of each, ascending; None if the file has none: then there is one a frame.
        poses: T_map_camera, or of what it was measured for.
    """

    stamps_ns: Sequence[int] | None
    poses: Sequence[Pose]

    def at(self, stamp_ns: int, tolerance_ns: int) -> Pose | None:
        """The pose at a time, between two that are at most `tolerance_ns` apart; None if there are none."""
        stamps = self.stamps_ns or ()
        after = bisect_left(stamps, stamp_ns)
        if after < len(stamps) and stamps[after] == stamp_ns:
            return self.poses[after]
        if not 0 < after < len(stamps) or stamps[after] - stamps[after - 1] > tolerance_ns:
            return None
        whole = stamps[after] - stamps[after - 1]
        return interpolate_pose(
            self.poses[after - 1], self.poses[after], (stamp_ns - stamps[after - 1]) / whole
        )


def read_trajectory(file: Path, parent: str = "map") -> Trajectory:
    """Read `t tx ty tz qx qy qz qw` (t in seconds), the same without t, or the rows of 3x4 matrices.

    Raises:
        InputError: if it is none of these, or its clock goes back.
    """
    stamps: list[int] = []
    poses: list[Pose] = []
    columns = 0
    for number, words in numbered_lines(file, commas=True):
        columns = columns or len(words)
        if columns not in (TUM, QUATERNIONS, MATRICES) or len(words) != columns:
            raise InputError(
                f"{file}, line {number}: expected 't tx ty tz qx qy qz qw', the same without t, or the 12 "
                f"numbers of a 3x4 matrix, the same in every line; got {len(words)} words"
            )
        with reading(f"{file}, line {number}", "a pose"):
            stamps += [seconds_to_ns(words[0])] if columns == TUM else []
            poses.append(_pose([float(word) for word in words[columns == TUM :]], parent))
        if len(stamps) > 1 and stamps[-1] <= stamps[-2]:
            raise InputError(
                f"{file}, line {number}: expected poses in order of time, got a clock that goes back"
            )
    if not poses:
        raise InputError(f"{file}: expected at least one pose, found none")
    return Trajectory(stamps if columns == TUM else None, poses)


def seconds_to_ns(word: str) -> int:
    """A time in seconds as whole nanoseconds, to the last digit.

    >>> seconds_to_ns("1305031102.175304")
    1305031102175304000

    Raises:
        InvalidValueError: if it is no time.
    """
    try:
        ns = int(Decimal(word) * 1_000_000_000)
    except (InvalidOperation, ValueError, OverflowError):
        ns = -1
    if not 0 <= ns < 2**63:
        raise InvalidValueError(f"expected a time in seconds, got '{word}'")
    return ns


def _pose(numbers: list[float], parent: str) -> Pose:
    if len(numbers) == QUATERNIONS:
        return Pose.from_quaternion(parent, "camera", numbers[:3], numbers[3:])
    return Pose(parent, "camera", np.vstack([np.reshape(numbers, (3, 4)), (0.0, 0.0, 0.0, 1.0)]))
