"""The tree of coordinate frames that ROS publishes: who is where, at which time."""

import math
from bisect import bisect_left, insort
from collections import Counter
from collections.abc import Mapping, Sequence

from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.io.bags.tf_edge import ALWAYS_NS, Edge, same_place, sample_of, stamp_of

CLOCKS_APART_S = 60.0
"""An image so far from all transforms was hardly taken by their clock."""


class TransformBuffer:
    """Transforms as they come from /tf and /tf_static, and lookups between any two frames of the tree.

    A lookup interpolates between the transforms before and after its time. It never takes the latest
    transform in place of the right one, and never extrapolates. Only what lies on the way between two frames
    is judged: a marker that two cameras see under two parents does no harm.

    Attributes:
        faults: transforms left out, by what is wrong with them, as tf2 leaves them out.
        late: transforms older than one that came before; they are sorted in.
    """

    def __init__(self) -> None:
        self.faults: Counter[str] = Counter()
        self.late = 0
        self._edges: dict[str, dict[str, Edge]] = {}

    @property
    def refused(self) -> int:
        """How many transforms were left out."""
        return self.faults.total()

    @property
    def frames(self) -> frozenset[str]:
        """Names of all frames heard of."""
        return frozenset(self._edges) | {parent for edges in self._edges.values() for parent in edges}

    def add(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        translation_m: Sequence[float],
        quaternion_xyzw: Sequence[float],
    ) -> bool:
        """Add where `child` was in `parent` at a time; the first of two at the same time stays.

        Returns:
            Whether it was taken; if not, it is counted in `faults`.
        """
        edge = self._edge(parent, child, translation_m, quaternion_xyzw)
        if edge is None:
            return False
        sample = sample_of(stamp_ns, translation_m, quaternion_xyzw)
        edge.compare(sample)
        if not edge.samples or stamp_ns > edge.samples[-1][0]:
            if edge.samples:
                edge.widest_ns = max(edge.widest_ns, stamp_ns - edge.samples[-1][0])
            edge.samples.append(sample)
            return True
        self.late += stamp_ns < edge.samples[-1][0]
        index = bisect_left(edge.samples, stamp_ns, key=stamp_of)
        if edge.samples[index][0] != stamp_ns:
            insort(edge.samples, sample, key=stamp_of)
        return True

    def add_static(
        self, parent: str, child: str, translation_m: Sequence[float], quaternion_xyzw: Sequence[float]
    ) -> bool:
        """Add where `child` is in `parent` at all times; a later one replaces it.

        Returns:
            Whether it was taken; if not, it is counted in `faults`.
        """
        edge = self._edge(parent, child, translation_m, quaternion_xyzw)
        if edge is None:
            return False
        edge.static = sample_of(ALWAYS_NS, translation_m, quaternion_xyzw)
        for sample in edge.samples[-1:]:
            edge.compare(sample)
        return True

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
        edges = [self._up(name) for name in (*up, *down)]
        return min((e.samples[-1][0] for e in edges if not e.is_static), default=ALWAYS_NS)

    def way(self, parent: str, child: str) -> list[tuple[str, str, bool]]:
        """Edges between two frames as (parent, child, whether it moves), from the child on; empty if none."""
        up, down = self._ways(_name(parent), _name(child))
        names = [*(up or []), *reversed(down or [])] if up is not None and down is not None else []
        return [(self._up(name).parent, name, not self._up(name).is_static) for name in names]

    def gaps_ns(self, parent: str, child: str) -> dict[str, int]:
        """Longest time between two transforms of each edge between two frames that moves, by its frames."""
        way = [(p, c, self._up(c)) for p, c, _ in self.way(parent, child)]
        return {f"{p} <- {c}": edge.widest_ns for p, c, edge in way if edge.samples}

    def conflicts(self, parent: str, child: str) -> list[tuple[str, str]]:
        """Edges between two frames that came as static and as moving, and differ."""
        edges = [(p, c, self._up(c)) for p, c, _ in self.way(parent, child)]
        return [(p, c) for p, c, edge in edges if edge.static and edge.moves]

    def root_of(self, name: str) -> tuple[str, bool]:
        """The frame above all others that a frame hangs on, and whether the frame moved in it."""
        chain = self._ancestors(_name(name))
        edges = [self._up(n) for n in chain[:-1]]
        return chain[-1], any(not same_place(e.samples[0], s) for e in edges for s in e.samples[1:])

    def why_not(
        self, parent: str, child: str, stamp_ns: int, tolerance_ns: int, spans: Mapping[str, tuple[int, int]]
    ) -> str:
        """What a lookup failed for, for a person; `spans`: first and last times, with those forgotten."""
        for above, name, moves in self.way(parent, child):
            edge = self._up(name)
            if not moves or edge.at(name, stamp_ns, tolerance_ns) is not None:
                continue
            at = stamp_ns / 1e9
            first, last = (t / 1e9 for t in spans.get(name, (edge.samples[0][0], edge.samples[-1][0])))
            if not first <= at <= last:
                far = max(first - at, at - last) > CLOCKS_APART_S
                return (
                    f"{above} <- {name} is known from {first:.3f} to {last:.3f} s, the image is of {at:.3f} s"
                    + (": two clocks? Record with the same use_sim_time for all nodes" if far else "")
                )
            after = bisect_left(edge.samples, stamp_ns, key=stamp_of)
            gap_ms = (edge.samples[after][0] - edge.samples[after - 1][0]) / 1e6
            return f"{above} <- {name} has a gap of {gap_ms:.0f} ms at {at:.3f} s"
        return f"tf has no way between '{_name(parent)}' and '{_name(child)}'"

    def newest_of(self, parent: str, child: str) -> int | None:
        """Time of the newest transform of one edge; None if none came that moves."""
        edge = self._edges.get(_name(child), {}).get(_name(parent))
        return edge.samples[-1][0] if edge is not None and edge.samples else None

    def forget_edge(self, parent: str, child: str) -> None:
        """Drop what came of one edge, but for where it is at all times."""
        edges = self._edges.get(_name(child), {})
        edge = edges.pop(_name(parent), None)
        if edge is not None and edge.static is not None:
            edges[_name(parent)] = Edge(edge.parent, edge.static)
        if not edges:
            self._edges.pop(_name(child), None)

    def forget_moving(self) -> None:
        """Drop all but where frames are at all times."""
        for parent, child in [(p, c) for c, edges in self._edges.items() for p in edges]:
            self.forget_edge(parent, child)

    def forget_older(self, than_ns: int) -> None:
        """Drop of each edge what is older by more than this than its own newest, as tf2 does.

        A parent that was not told for so long, while another was, is forgotten: the frame has moved to that.
        """
        for child, edges in list(self._edges.items()):
            newest = {parent: edge.samples[-1][0] for parent, edge in edges.items() if edge.samples}
            for parent, at_ns in newest.items():
                _drop_before(edges[parent], at_ns - than_ns)
                if at_ns < max(newest.values()) - than_ns:
                    self.forget_edge(parent, child)

    def forget_before(self, stamp_ns: int) -> None:
        """Drop transforms that no lookup at or after a time can need."""
        for edges in self._edges.values():
            for edge in edges.values():
                _drop_before(edge, stamp_ns)

    def _edge(
        self, parent: str, child: str, translation_m: Sequence[float], quaternion_xyzw: Sequence[float]
    ) -> Edge | None:
        """Where a transform belongs; None if it cannot be one."""
        parent, child = _name(parent), _name(child)
        if not parent or not child or parent == child:
            self.faults[f"transform '{parent}' <- '{child}' does not name two frames"] += 1
            return None
        if not _is_rigid(translation_m, quaternion_xyzw):
            self.faults[f"transform {parent} <- {child} is no rotation and translation, or not finite"] += 1
            return None
        return self._edges.setdefault(child, {}).setdefault(parent, Edge(parent))

    def _up(self, name: str) -> Edge:
        return next(iter(self._edges[name].values()))

    def _ancestors(self, name: str) -> list[str]:
        """The frame, its parent, and so on to the root, or to the first frame with more than one parent."""
        chain = [name]
        while len(self._edges.get(chain[-1], ())) == 1:
            chain.append(self._up(chain[-1]).parent)
            if chain[-1] in chain[:-1]:
                raise InputError(f"the frames of tf go round in a circle: {' <- '.join(chain)}")
        return chain

    def _ways(self, parent: str, child: str) -> tuple[list[str] | None, list[str] | None]:
        """Frames to climb from child and from parent until both are at the same frame.

        Raises:
            InputError: if a frame on the way has two parents.
        """
        from_child, from_parent = self._ancestors(child), self._ancestors(parent)
        for count, name in enumerate(from_child):
            if name in from_parent:
                return from_child[:count], from_parent[: from_parent.index(name)]
        for name in (from_child[-1], from_parent[-1]):
            if len(parents := self._edges.get(name, {})) > 1:
                raise InputError(
                    f"frame '{name}' has two parents in tf: {' and '.join(map(repr, parents))}. Which is "
                    "right cannot be told; filter the recording so that one is left."
                )
        return None, None

    def _climb(self, start: str, names: list[str], stamp_ns: int, tolerance_ns: int) -> Pose | None:
        """Pose of `start` in the parent of the last of `names`."""
        pose = Pose.identity(start, start)
        for name in names:
            step = self._up(name).at(name, stamp_ns, tolerance_ns)
            if step is None:
                return None
            pose = step @ pose
        return pose


def _drop_before(edge: Edge, stamp_ns: int) -> None:
    """Drop samples that no lookup at or after a time can need."""
    keep_from = bisect_left(edge.samples, stamp_ns, key=stamp_of) - 1
    if keep_from > 0:
        del edge.samples[:keep_from]


def _is_rigid(translation_m: Sequence[float], quaternion_xyzw: Sequence[float]) -> bool:
    """Whether all numbers are finite and the quaternion has length 1 within 1 %."""
    finite = all(math.isfinite(v) for v in (*translation_m, *quaternion_xyzw))
    return finite and abs(math.hypot(*quaternion_xyzw) - 1) < 0.01


def _name(frame_id: str) -> str:
    """ROS 1 wrote some names with a slash before them."""
    return frame_id.strip("/")
