"""The pose of the camera at the times of its images, by transforms that are read as far ahead as is needed.

A recording is a file: a transform that was written late is as good as one that came in time. Transforms are
taken as they come between the images; where images would have to wait for long, a reader of their own goes
ahead until the transforms enclose the time that is asked for.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.io.bags.pose_facts import pose_facts
from swardmap.io.bags.poses import PosePlan
from swardmap.io.bags.reader import Bag
from swardmap.io.bags.stamps import StampFilter
from swardmap.io.bags.tf import TransformBuffer
from swardmap.io.bags.tf_messages import Transform, transforms_of
from swardmap.io.sources.source import Tally

REASON_TRANSFORM = "transform that is none"
REASON_STAMP = "transform whose time is far off from its neighbours'"


@dataclass(slots=True)
class PoseStream:
    """Poses of the camera, asked for in order of time.

    Attributes:
        bag: the recording; it is opened once more if transforms have to be read ahead.
        plan: where poses come from.
        tolerance_ns: largest gap between two transforms that is interpolated over.
        tally: counts what is left out.
    """

    bag: Bag
    plan: PosePlan
    tolerance_ns: int
    tally: Tally
    given: int = 0
    _buffer: TransformBuffer = field(init=False)
    _static: set[str] = field(init=False)
    _fed: int = 0
    _ahead: Iterator[tuple[str, int, bytes]] | None = None
    _spans: dict[str, tuple[int, int]] = field(default_factory=dict)
    _filters: dict[str, StampFilter[Transform]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._buffer = self.plan.new_buffer()
        self._static = {t.child.strip("/") for message in self.plan.static for t in transforms_of(message)}

    def feed(self, topic: str, recorded_ns: int, data: bytes) -> None:
        """Take a message that came between the images; it is known already if it was read ahead."""
        if self._ahead is None:
            self._fed += 1
            self._take(topic, recorded_ns, data)

    def end(self) -> None:
        """Nothing more comes between the images."""
        if self._ahead is None:
            self._ahead = iter(())
            self._flush()

    def at(self, stamp_ns: int) -> Pose | None:
        """T_map_camera at a time not before the last one asked for; None if it is not known.

        Raises:
            InputError: if what lies between map and camera contradicts itself.
        """
        while not self.encloses(stamp_ns) and self._read_ahead():
            pass
        plan = self.plan
        pose = self._buffer.lookup(plan.map_frame, plan.camera_frame, stamp_ns, self.tolerance_ns)
        if pose is not None:
            self.given += 1
            pose = plan.optical(pose)
        return pose

    def forget_before(self, stamp_ns: int) -> None:
        """Drop what no lookup at or after a time can need."""
        self._buffer.forget_before(stamp_ns)

    def why_not(self, stamp_ns: int) -> str:
        """Why there is no pose at a time: which edge, from when to when, and the setting that allows gaps."""
        plan = self.plan
        return (
            self._buffer.why_not(plan.map_frame, plan.camera_frame, stamp_ns, self.tolerance_ns, self.spans)
            + f" (source.pose_tolerance_ms={self.tolerance_ns / 1e6:g})"
        )

    @property
    def spans(self) -> dict[str, tuple[int, int]]:
        """First and last time of each frame that moves, as far as was read."""
        return dict(self._spans)

    def facts(self) -> dict[str, Any]:
        """How the poses were found, for a person: frames, topics, largest gaps."""
        plan = self.plan
        frames = plan.map_frame, plan.camera_frame
        return pose_facts(self._buffer, frames, plan.origin, plan.topics, self.tolerance_ns)

    def encloses(self, stamp_ns: int) -> bool:
        """Whether the transforms so far reach beyond a time."""
        newest = self._buffer.newest_ns(self.plan.map_frame, self.plan.camera_frame)
        return newest is not None and newest >= stamp_ns

    def _read_ahead(self) -> bool:
        """Take the next message; False at the end."""
        if self._ahead is None:
            self._ahead = islice(self.bag.again().messages(self.plan.topics), self._fed, None)
        found = next(self._ahead, None)
        if found is None:
            return self._flush()
        self._take(*found)
        return True

    def _flush(self) -> bool:
        """Take what was held back, at the end; whether there was something."""
        left = [item for f in self._filters.values() for item in f.flush()]
        self._filters = {}
        for stamp_ns, item in left:
            self._add(stamp_ns, item)
        return bool(left)

    def _take(self, topic: str, recorded_ns: int, data: bytes) -> None:
        for item in transforms_of(self.bag.decode(topic, data)):
            child = item.child
            stream = self._filters.setdefault(child, StampFilter())
            was, dropped = stream.unstamped, stream.dropped
            for stamp_ns, ready in stream.add(item.stamp_ns, recorded_ns, item):
                self._add(stamp_ns, ready)
            if stream.unstamped and not was:
                self.tally.note(f"transforms of '{child}' have no times: those of their recording are taken")
            if stream.dropped > dropped:
                detail = f"{item.parent} <- {child} of {stream.first_dropped_ns / 1e9:.3f} s"
                self.tally.skip(REASON_STAMP, detail, stream.dropped - dropped)

    def _add(self, stamp_ns: int, item: Transform) -> None:
        before = self._buffer.refused
        if self._buffer.add(item.parent, item.child, stamp_ns, item.translation_m, item.quaternion_xyzw):
            child = item.child.strip("/")
            first_ns, last_ns = self._spans.get(child, (stamp_ns, stamp_ns))
            self._spans[child] = min(first_ns, stamp_ns), max(last_ns, stamp_ns)
        if self._buffer.refused > before:
            self.tally.skip(REASON_TRANSFORM, next(reversed(self._buffer.faults)))
        if item.child.strip("/") in self._static:
            self._judge_static(item)

    def _judge_static(self, item: Transform) -> None:
        """What came as static begins to move: said, or refused if poses were given by its static value."""
        for parent, child in self._buffer.conflicts(self.plan.map_frame, self.plan.camera_frame):
            if child != item.child.strip("/"):
                continue
            if self.given:
                raise InputError(
                    f"{self.bag.path}: tf gives {parent} <- {child} as static, and after the first "
                    f"{self.given} frames as moving and elsewhere. Leave out what is before with --set "
                    "source.start=..., or name another source.map_frame"
                )
            self._static.discard(child)
            self.tally.note(f"tf gives {parent} <- {child} as static and as moving: the moving one is used")
