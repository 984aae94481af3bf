"""The tree of coordinate frames that ROS publishes: who is where, at which time."""

import math
from bisect import bisect_left, insort
from collections.abc import Sequence
from dataclasses import dataclass, field

from swardmap.errors import InputError
from swardmap.geometry import Pose, interpolate_pose

Sample = tuple[int, tuple[float, float, float], tuple[float, float, float, float]]
"""stamp_ns, translation in metres, quaternion x y z w."""

ALWAYS_NS = 2**63 - 1
"""Newest time of a chain that consists of static transforms."""


@dataclass(slots=True)
class _Edge:
    """A frame, its parent, and where it was in it."""

    parent: str
    static: Pose | None = None
    samples: list[Sample] = field(default_factory=list)

    def at(self, child: str, stamp_ns: int, tolerance_ns: int) -> Pose | None:
        if self.static is not None:
            return self.static
        index = bisect_left(self.samples, stamp_ns, key=_stamp)
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


class TransformBuffer:
    """Transforms as they come from /tf and /tf_static, and lookups between any two frames of the tree.

    A lookup interpolates between the transforms before and after its time. It never takes the latest
    transform in place of the right one, and never extrapolates.

    Attributes:
        refused: transforms left out for NaN, infinity or a quaternion that is not of length 1.
        late: transforms older than one that came before; they are sorted in.
    """

    def __init__(self) -> None:
        self.refused = 0
        self.late = 0
        self._edges: dict[str, _Edge] = {}

    @property
    def frames(self) -> frozenset[str]:
        """Names of all frames heard of."""
        return frozenset(self._edges) | {edge.parent for edge in self._edges.values()}

    def add(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        translation_m: Sequence[float],
        quaternion_xyzw: Sequence[float],
    ) -> None:
        """Add where `child` was in `parent` at a time; the first of two at the same time stays.

        Raises:
            InputError: if the child has another parent already.
        """
        if not _is_rigid(translation_m, quaternion_xyzw):
            self.refused += 1
            return
        edge = self._edge(parent, child)
        x, y, z = map(float, translation_m)
        qx, qy, qz, qw = map(float, quaternion_xyzw)
        sample: Sample = (stamp_ns, (x, y, z), (qx, qy, qz, qw))
        if not edge.samples or stamp_ns > edge.samples[-1][0]:
            edge.samples.append(sample)
            return
        self.late += stamp_ns < edge.samples[-1][0]
        index = bisect_left(edge.samples, stamp_ns, key=_stamp)
        if edge.samples[index][0] != stamp_ns:
            insort(edge.samples, sample, key=_stamp)

    def add_static(
        self, parent: str, child: str, translation_m: Sequence[float], quaternion_xyzw: Sequence[float]
    ) -> None:
        """Add where `child` is in `parent` at all times; a later one replaces it.

        Raises:
            InputError: for NaN, a quaternion that is not of length 1, or a second parent.
        """
        if not _is_rigid(translation_m, quaternion_xyzw):
            raise InputError(
                f"static transform {parent} <- {child}: expected three finite numbers and a quaternion of "
                f"length 1, got {tuple(translation_m)} and {tuple(quaternion_xyzw)}"
            )
        pose = Pose.from_quaternion(_name(parent), _name(child), translation_m, quaternion_xyzw)
        self._edge(parent, child).static = pose

    def lookup(self, parent: str, child: str, stamp_ns: int, tolerance_ns: int) -> Pose | None:
        """Pose T_parent_child at a time.

        Args:
            parent: frame to express the pose in.
            child: frame whose pose is asked for.
            stamp_ns: the time.
            tolerance_ns: largest gap between two transforms that is interpolated over.

        Returns:
            The pose; None if the frames are not connected, or the transforms on the way between them do
            not enclose the time closely enough.
        """
        parent, child = _name(parent), _name(child)
        up, down = self._ways(parent, child)
        if up is None or down is None:
            return None
        T_top_child = self._climb(child, up, stamp_ns, tolerance_ns)
        T_top_parent = self._climb(parent, down, stamp_ns, tolerance_ns)
        if T_top_child is None or T_top_parent is None:
            return None
        return T_top_parent.inverse() @ T_top_child

    def connected(self, parent: str, child: str) -> bool:
        """Whether there is a way between two frames, at whatever time."""
        return self._ways(_name(parent), _name(child))[0] is not None

    def newest_ns(self, parent: str, child: str) -> int | None:
        """Last time at which a lookup between two frames can succeed so far; None if not connected."""
        up, down = self._ways(_name(parent), _name(child))
        if up is None or down is None:
            return None
        edges = [self._edges[name] for name in (*up, *down)]
        return min((e.samples[-1][0] for e in edges if e.static is None), default=ALWAYS_NS)

    def forget_before(self, stamp_ns: int) -> None:
        """Drop transforms that no lookup at or after a time can need."""
        for edge in self._edges.values():
            keep_from = bisect_left(edge.samples, stamp_ns, key=_stamp) - 1
            if keep_from > 0:
                del edge.samples[:keep_from]

    def _edge(self, parent: str, child: str) -> _Edge:
        parent, child = _name(parent), _name(child)
        if not parent or not child or parent == child:
            raise InputError(f"transform '{parent}' <- '{child}': expected the names of two frames")
        edge = self._edges.setdefault(child, _Edge(parent))
        if edge.parent != parent:
            raise InputError(
                f"frame '{child}' has two parents in tf: '{edge.parent}' and '{parent}'. Which is right "
                "cannot be told; filter the recording so that one is left."
            )
        return edge

    def _ancestors(self, name: str) -> list[str]:
        """The frame, its parent, and so on to the root."""
        chain = [name]
        while chain[-1] in self._edges:
            chain.append(self._edges[chain[-1]].parent)
            if chain[-1] in chain[:-1]:
                raise InputError(f"the frames of tf go round in a circle: {' <- '.join(chain)}")
        return chain

    def _ways(self, parent: str, child: str) -> tuple[list[str] | None, list[str] | None]:
        """Frames to climb from child and from parent until both are at the same frame."""
        from_child, from_parent = self._ancestors(child), self._ancestors(parent)
        for count, name in enumerate(from_child):
            if name in from_parent:
                return from_child[:count], from_parent[: from_parent.index(name)]
        return None, None

    def _climb(self, start: str, names: list[str], stamp_ns: int, tolerance_ns: int) -> Pose | None:
        """Pose of `start` in the parent of the last of `names`."""
        pose = Pose.identity(start, start)
        for name in names:
            step = self._edges[name].at(name, stamp_ns, tolerance_ns)
            if step is None:
                return None
            pose = step @ pose
        return pose


def _is_rigid(translation_m: Sequence[float], quaternion_xyzw: Sequence[float]) -> bool:
    """Whether all numbers are finite and the quaternion has length 1 within 1 %."""
    finite = all(math.isfinite(v) for v in (*translation_m, *quaternion_xyzw))
    return finite and abs(math.hypot(*quaternion_xyzw) - 1) < 0.01


def _stamp(sample: Sample) -> int:
    return sample[0]


def _name(frame_id: str) -> str:
    """ROS 1 wrote some names with a slash before them."""
    return frame_id.strip("/")
