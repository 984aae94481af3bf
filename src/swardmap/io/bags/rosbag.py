"""Frames from ROS bags (1, 2 in SQLite and MCAP) and librealsense recordings, without ROS (Sec. 3.1).

One pass through the recording: images are paired by time, wait for the pose of their time, are
rectified, and depth is brought into the pixels of the colour image. Memory is bounded by the images
that wait, not by the length of the recording.
"""

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from swardmap.config import SourceConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Pose
from swardmap.io.bags.plan import BagPlan, make_plan
from swardmap.io.bags.poses import add_message
from swardmap.io.bags.reader import Bag, open_bag
from swardmap.io.bags.tf import TransformBuffer
from swardmap.io.sources.pairing import COLOR, DEPTH, Pair, Pairer
from swardmap.io.sources.source import Source, Tally
from swardmap.perception.align import align_depth_to_color
from swardmap.types import Frame

SUFFIXES = (".bag", ".db3", ".mcap")

REASON_POSE = "no pose of the camera at the time of the image"
REASON_DAMAGED = "image that cannot be used"
REASON_TRANSFORM = "transform that is no rotation or not finite"

WAIT_NS = 2_000_000_000
"""How long an image waits for the transform after it, in time of recording."""

WAITING_PAIRS = 60
"""How many images wait at most."""


@dataclass(frozen=True, slots=True)
class _Raw:
    """An image as it is in the recording."""

    data: bytes
    recorded_ns: int


def recognises(path: Path) -> bool:
    """Whether it is a .bag, .db3 or .mcap file, or the folder of a ROS 2 bag."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() and any(_storage_files(path))
    return path.suffix in SUFFIXES


def open_source(path: Path, config: SourceConfig) -> Source:
    """Open a recording and find its topics.

    Raises:
        InputError: if it cannot be read, or colour, depth, their cameras or their places to each other
            are missing or not to be told apart.
    """
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        files = list(_storage_files(path))
        if len(files) != 1:
            raise InputError(
                f"{path}: expected the folder of a ROS 2 bag, with metadata.yaml and its storage files; "
                f"without metadata.yaml, open one .db3 or .mcap file. Found {len(files)} such files."
            )
        path = files[0]
    with open_bag(path) as bag:
        recording = Recording(path, config, make_plan(bag, config))
    return Source(path.name, recording.frame_count, None, recording.frames)


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording, and how its frames are made."""

    path: Path
    config: SourceConfig
    plan: BagPlan

    @property
    def frame_count(self) -> int:
        """At most: images of the scarcer kind, less those not chosen; unpaired ones show as skipped."""
        return len(range(self.plan.images)[self.config.start : self.config.stop : self.config.every])

    def frames(self, tally: Tally) -> Iterator[Frame]:
        """The frames in order of time; those that cannot be used are counted, never guessed."""
        poses = self.plan.poses
        buffer = poses.new_buffer() if poses else TransformBuffer()
        with open_bag(self.path) as bag:
            for index, pair in self._pairs_with_poses(bag, buffer, tally.skipped):
                pose = self._pose_at(buffer, pair.stamp_ns)
                buffer.forget_before(pair.stamp_ns)
                if poses and pose is None:
                    tally.skip(REASON_POSE)
                    continue
                try:
                    frame = self._frame(bag, index, pair, pose)
                except (InputError, InvalidValueError) as error:
                    tally.skip(REASON_DAMAGED, str(error))
                    continue
                yield frame

    def _pairs_with_poses(
        self, bag: Bag, buffer: TransformBuffer, skipped: Counter[str]
    ) -> Iterator[tuple[int, Pair[_Raw]]]:
        """The pairs chosen by start, stop and every, each as soon as its pose can be interpolated."""
        waiting: deque[tuple[int, Pair[_Raw]]] = deque()
        paired = 0
        for now_ns, pair in self._events(bag, buffer, skipped):
            if pair is not None:
                if self.config.stop is not None and paired >= self.config.stop:
                    break
                if self._is_chosen(paired):
                    waiting.append((paired, pair))
                paired += 1
            while waiting and (len(waiting) > WAITING_PAIRS or self._is_ready(buffer, waiting[0][1], now_ns)):
                yield waiting.popleft()
        yield from waiting

    def _events(
        self, bag: Bag, buffer: TransformBuffer, skipped: Counter[str]
    ) -> Iterator[tuple[int, Pair[_Raw] | None]]:
        """Read on: time of recording with each new pair, or with None when a transform came."""
        plan, pairer = self.plan, Pairer[_Raw](round(self.config.pair_tolerance_ms * 1e6))
        kinds = {plan.color.name: COLOR, plan.depth.name: DEPTH}
        pose_topics = plan.poses.topics if plan.poses else frozenset[str]()
        now_ns = 0
        for topic, now_ns, data in bag.messages([*kinds, *pose_topics]):
            if topic in pose_topics:
                add_message(buffer, bag.decode(topic, data))
                skipped[REASON_TRANSFORM] = buffer.refused
                yield now_ns, None
                continue
            stamp_ns = bag.header_stamp_ns(data, now_ns)
            for pair in pairer.add(kinds[topic], stamp_ns, _Raw(data, now_ns)):
                yield now_ns, pair
            skipped |= Counter(pairer.skipped)  # the larger count of each reason: those only grow
        for pair in pairer.flush():
            yield now_ns, pair
        skipped |= Counter(pairer.skipped)

    def _is_chosen(self, index: int) -> bool:
        return index >= self.config.start and (index - self.config.start) % self.config.every == 0

    def _is_ready(self, buffer: TransformBuffer, pair: Pair[_Raw], now_ns: int) -> bool:
        """Whether the transform after the image has come, or is not to be waited for any longer."""
        poses = self.plan.poses
        if poses is None or now_ns - pair.color.recorded_ns > WAIT_NS:
            return True
        newest_ns = buffer.newest_ns(poses.map_frame, poses.camera_frame)
        return newest_ns is not None and newest_ns >= pair.stamp_ns

    def _pose_at(self, buffer: TransformBuffer, stamp_ns: int) -> Pose | None:
        poses = self.plan.poses
        if poses is None:
            return None
        tolerance_ns = round(self.config.pose_tolerance_ms * 1e6)
        return buffer.lookup(poses.map_frame, poses.camera_frame, stamp_ns, tolerance_ns)

    def _frame(self, bag: Bag, index: int, pair: Pair[_Raw], T_map_camera: Pose | None) -> Frame:
        plan = self.plan
        rgb = plan.color.color(bag.decode(plan.color.name, pair.color.data))
        depth = plan.depth.depth(bag.decode(plan.depth.name, pair.depth.data))
        rgb, depth = plan.color_camera.rectify_color(rgb), plan.depth_camera.rectify_depth(depth)
        camera = plan.color_camera.intrinsics
        if plan.T_color_depth is not None:
            depth_camera = plan.depth_camera.intrinsics
            depth = align_depth_to_color(depth, plan.depth_unit_m, depth_camera, camera, plan.T_color_depth)
        return Frame(
            pair.stamp_ns,
            camera,
            rgb,
            depth,
            plan.depth_unit_m,
            T_map_camera,
            name=f"{index:06d}",
        )


def _storage_files(folder: Path) -> Iterator[Path]:
    try:
        yield from (p for p in sorted(folder.iterdir()) if p.suffix in (".db3", ".mcap"))
    except OSError as error:
        raise InputError(f"cannot list {folder}: {error}") from error
