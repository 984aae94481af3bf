"""Frames from ROS bags (1, 2 in SQLite and MCAP) and librealsense recordings, without ROS (Sec. 3.1).

One pass through the recording: images are paired by time, wait for the pose of their time, are rectified, and
depth is brought into the pixels of the colour image. Memory is bounded by the images that wait, not by the
length of the recording.
"""

from array import array
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from swardmap.config import CloudConfig, Config, SourceConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Pose
from swardmap.io.bags.frames import FrameBuilder
from swardmap.io.bags.plan import BagPlan, make_plan
from swardmap.io.bags.pose_stream import REASON_TRANSFORM, PoseStream
from swardmap.io.bags.reader import Bag, open_bag
from swardmap.io.bags.recorded_labels import LabelStore
from swardmap.io.bags.stamps import StampFilter
from swardmap.io.bags.storage import METADATA, is_storage
from swardmap.io.sources.pairing import COLOR, DEPTH, Pair, Pairer, pairing_facts
from swardmap.io.sources.source import Source, Tally
from swardmap.types import Frame

__all__ = ["REASON_DAMAGED", "REASON_POSE", "REASON_TRANSFORM", "open_source", "recognises"]

WHOLE_CONFIG = True
"""Depth that is aligned here is filtered before, as the configuration of clouds says."""

WAITING_PAIRS = 30
"""How many images wait for the transform after them; then transforms are read ahead by themselves."""

REASON_POSE = "no pose of the camera at the time of the image"
REASON_DAMAGED = "image that cannot be used"
REASON_STAMP = "image whose time is far off from its neighbours'"


def recognises(path: Path) -> bool:
    """Whether it is a .bag, .db3 or .mcap file (packed or not), or a folder of a ROS 2 bag."""
    if path.is_dir():
        return (path / METADATA).is_file() or any(map(is_storage, path.iterdir()))
    return path.suffix == ".bag" or is_storage(path)


def open_source(path: Path, config: SourceConfig | Config) -> Source:
    """Open a recording and find its topics.

    Raises:
        InputError: if it cannot be read, or colour, depth, their cameras or their places to each other
            are missing or not to be told apart.
    """
    source, cloud = (config.source, config.cloud) if isinstance(config, Config) else (config, CloudConfig())
    with open_bag(path) as bag:
        recording = Recording(path, source, cloud, make_plan(bag, source))
    labels = recording.plan.labels
    label_set = None if labels is None else labels.label_set
    return Source(path.name, recording.frame_count, label_set, recording.frames)


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording, and how its frames are made."""

    path: Path
    config: SourceConfig
    cloud: CloudConfig
    plan: BagPlan

    @property
    def frame_count(self) -> int:
        """At most: images of the scarcer kind, less those not chosen; unpaired ones show as skipped."""
        return len(range(self.plan.images)[self.config.start : self.config.stop : self.config.every])

    def frames(self, tally: Tally) -> Iterator[Frame]:
        """The frames in order of time; those that cannot be used are counted, never guessed.

        Raises:
            InputError: if what the recording says of poses or depth cannot be right.
        """
        for note in self.plan.notes:
            tally.note(note)
        builder, labels = FrameBuilder.of(self.plan, self.cloud), LabelStore()
        with open_bag(self.path) as bag:
            poses = self._poses(bag, tally)
            tally.facts["images"] = builder.facts
            for index, pair in self._ready(bag, poses, labels, tally):
                pose = None
                if poses is not None and (pose := poses.at(pair.stamp_ns)) is None:
                    tally.skip(REASON_POSE, poses.why_not(pair.stamp_ns))
                else:
                    yield from self._frame(bag, builder, labels, index, pair, pose, tally)
                if poses is not None:
                    poses.forget_before(pair.stamp_ns)

    def _poses(self, bag: Bag, tally: Tally) -> PoseStream | None:
        if self.plan.poses is None:
            return None
        tolerance_ns = round(self.config.pose_tolerance_ms * 1e6)
        stream = PoseStream(bag, self.plan.poses, tolerance_ns, tally)
        tally.facts["poses"] = stream.facts
        return stream

    def _frame(
        self,
        bag: Bag,
        builder: FrameBuilder,
        labels: LabelStore,
        index: int,
        pair: Pair[bytes],
        pose: Pose | None,
        tally: Tally,
    ) -> Iterator[Frame]:
        topic = self.plan.labels
        try:
            rgb, depth = builder.decode(bag, pair.color, pair.depth)
            mask = None if topic is None else labels.take(bag, topic, pair.stamp_ns)
        except InputError as error:
            tally.skip(REASON_DAMAGED, str(error))
            return
        depth = builder.view.in_metres(depth)
        try:
            frame = builder.build(pair.stamp_ns, rgb, depth, mask, pose, f"{index:06d}")
        except (InputError, InvalidValueError) as error:
            tally.skip(REASON_DAMAGED, str(error))
            return
        yield frame

    def _ready(
        self, bag: Bag, poses: PoseStream | None, labels: LabelStore, tally: Tally
    ) -> Iterator[tuple[int, Pair[bytes]]]:
        """The pairs chosen by start, stop and every, numbered, each as soon as its pose can be known."""
        config, waiting, index = self.config, deque[tuple[int, Pair[bytes]]](), 0
        offsets_ns = array("q")
        tally.facts["pairing"] = partial(pairing_facts, offsets_ns)
        for pair in self._pairs(bag, poses, labels, tally):
            if pair is not None:
                if config.stop is not None and index >= config.stop:
                    break
                if index >= config.start and (index - config.start) % config.every == 0:
                    offsets_ns.append(abs(pair.depth_stamp_ns - pair.stamp_ns))
                    waiting.append((index, pair))
                index += 1
            while waiting and (
                poses is None or len(waiting) > WAITING_PAIRS or poses.encloses(waiting[0][1].stamp_ns)
            ):
                yield waiting.popleft()
        yield from waiting

    def _pairs(
        self, bag: Bag, poses: PoseStream | None, labels: LabelStore, tally: Tally
    ) -> Iterator[Pair[bytes] | None]:
        """Pairs as they become certain, and None after each transform."""
        plan, pairer = self.plan, Pairer[bytes](round(self.config.pair_tolerance_ms * 1e6))
        streams = {
            plan.color.name: (COLOR, StampFilter[bytes]()),
            plan.depth.name: (DEPTH, StampFilter[bytes]()),
        }
        pose_topics = self.plan.poses.topics if self.plan.poses else frozenset[str]()
        masks = frozenset({self.plan.labels.name}) if self.plan.labels else frozenset[str]()
        for topic, recorded_ns, data in bag.messages([*streams, *pose_topics, *masks]):
            if topic in masks:
                labels.add(bag.header_stamp_ns(data), data)
                continue
            if poses is not None and topic in pose_topics:
                poses.feed(topic, recorded_ns, data)
                yield None
                continue
            kind, stamps = streams[topic]
            for stamp_ns, image in stamps.add(bag.header_stamp_ns(data), recorded_ns, data):
                yield from pairer.add(kind, stamp_ns, image)
            self._count(pairer, streams, tally)
        for kind, stamps in streams.values():
            for stamp_ns, image in stamps.flush():
                yield from pairer.add(kind, stamp_ns, image)
        yield from pairer.flush()
        self._count(pairer, streams, tally)
        if apart := pairer.apart():
            raise InputError(
                f"{self.path}: {apart}: two clocks. Record with one (the same use_sim_time for all nodes; "
                "realsense-ros: global_time_enabled of rgb_camera and depth_module), or correct the stamps"
            )
        if poses is not None:
            poses.end()

    def _count(
        self, pairer: Pairer[bytes], streams: dict[str, tuple[str, StampFilter[bytes]]], tally: Tally
    ) -> None:
        dropped = sum(stamps.dropped for _, stamps in streams.values())
        tally.skipped |= Counter({**pairer.skipped, REASON_STAMP: dropped})  # the larger: those only grow
        for reason, said in pairer.first.items():
            tally.first.setdefault(reason, said)
        for topic, (_, stamps) in streams.items():
            if stamps.dropped:
                said = f"an image of {topic} of {stamps.first_dropped_ns / 1e9:.3f} s"
                tally.first.setdefault(REASON_STAMP, said)
            if stamps.unstamped:
                tally.note(f"images of {topic} have no times: those of their recording are taken")
