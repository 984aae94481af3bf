"""One edge of the tree of frames: a frame, its parent, and where it was in it at which times."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field

from swardmap.geometry import Pose, interpolate_pose

Sample = tuple[int, tuple[float, float, float], tuple[float, float, float, float]]
"""stamp_ns, translation in metres, quaternion x y z w."""

ALWAYS_NS = 2**63 - 1
"""Newest time of a chain that consists of static transforms."""


@dataclass(slots=True)
class Edge:
    """A frame, its parent, and where it was in it.

    What is sent as static and as moving is moving where the two differ: a static placeholder, until the
    localisation speaks, is common; a static transform that is sent again and again as well.
    """

    parent: str
    static: Sample | None = None
    samples: list[Sample] = field(default_factory=list)
    moves: bool = False
    widest_ns: int = 0
    """Longest time between two samples that came in order, of those forgotten too."""

    @property
    def is_static(self) -> bool:
        """Whether it never moves."""
        return self.static is not None and not self.moves

    def compare(self, sample: Sample) -> None:
        """Mark the edge as moving if it is static too, and elsewhere."""
        self.moves = self.moves or (self.static is not None and not same_place(self.static, sample))

    def at(self, child: str, stamp_ns: int, tolerance_ns: int) -> Pose | None:
        """T_parent_child at a time, interpolated over at most a tolerance; None if it is not known."""
        if self.static is not None and not self.moves:
            return Pose.from_quaternion(self.parent, child, *self.static[1:])
        index = bisect_left(self.samples, stamp_ns, key=stamp_of)
        if index < len(self.samples) and self.samples[index][0] == stamp_ns:
            return self._pose(child, index)
        if index in (0, len(self.samples)):
            return None
        start, end = self.samples[index - 1][0], self.samples[index][0]
        if end - start > tolerance_ns:
            return None
        fraction = (stamp_ns - start) / (end - start)
        return interpolate_pose(self._pose(child, index - 1), self._pose(child, index), fraction)

    def _pose(self, child: str, index: int) -> Pose:
        _, translation, quaternion = self.samples[index]
        return Pose.from_quaternion(self.parent, child, translation, quaternion)


def sample_of(stamp_ns: int, translation_m: Sequence[float], quaternion_xyzw: Sequence[float]) -> Sample:
    """Plain numbers of a transform."""
    x, y, z = map(float, translation_m)
    qx, qy, qz, qw = map(float, quaternion_xyzw)
    return stamp_ns, (x, y, z), (qx, qy, qz, qw)


def same_place(a: Sample, b: Sample) -> bool:
    """Whether two transforms differ by less than a millimetre and 0.1 degrees."""
    dot = sum(p * q for p, q in zip(a[2], b[2], strict=True))
    half = abs(dot) / (math.hypot(*a[2]) * math.hypot(*b[2]))  # cosine of half the angle
    return math.dist(a[1], b[1]) < 1e-3 and half > 1 - 4e-7


def stamp_of(sample: Sample) -> int:
    """What samples are ordered by."""
    return sample[0]
