"""Frames from ROS bags (1, 2 in SQLite and MCAP) and librealsense recordings, without ROS (Sec. 3.1).

One pass through the recording: images are paired by time, wait for the pose of their time, are
rectified, and depth is brought into the pixels of the colour image. Memory is bounded by the images
that wait, not by the length of the recording.
"""

from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swardmap.align import align_depth_to_color
from swardmap.config import SourceConfig
from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io import realsense_recording
from swardmap.io.bag_poses import PosePlan, add_message, latest_between, plan_poses, static_messages
from swardmap.io.bag_reader import Bag, open_bag
from swardmap.io.bag_topics import ImageTopic, choose_topics
from swardmap.io.pairing import COLOR, DEPTH, Pair, Pairer
from swardmap.io.ros_camera import Calibration, calibration_from_camera_info
from swardmap.io.tf import TransformBuffer
from swardmap.labels import LabelSet
from swardmap.types import Frame

SUFFIXES = (".bag", ".db3", ".mcap")

REASON_POSE = "no pose of the camera at the time of the image"
REASON_DAMAGED = "image that cannot be used"
REASON_TRANSFORM = "transform that is no rotation or not finite"

WAIT_NS = 2_000_000_000
"""How long an image waits for the transform after it, in time of recording."""

WAITING_PAIRS = 60
"""How many images wait at most."""

SAME_PIXEL = 1e-3
"""Cameras whose numbers differ by less are the same."""


@dataclass(frozen=True, slots=True)
class _Plan:
    """What was found in the recording when it was opened."""

    color: ImageTopic
    depth: ImageTopic
    color_camera: Calibration
    depth_camera: Calibration
    depth_unit_m: float
    T_color_depth: Pose | None  # None: depth is in the pixels of the colour image already
    poses: PosePlan | None


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


def open_source(path: Path, config: SourceConfig) -> "RosbagSource":
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
        return RosbagSource(path, config, _make_plan(bag, config))


class RosbagSource:
    """Frames of a recording; see `swardmap.io.FrameSource`."""

    def __init__(self, path: Path, config: SourceConfig, plan: _Plan) -> None:
        self._path, self._config, self._plan = path, config, plan
        self._skipped: Counter[str] = Counter()

    @property
    def name(self) -> str:
        """File or folder name of the recording."""
        return self._path.name

    @property
    def frame_count(self) -> int | None:
        """Not known before the images are paired."""
        return None

    @property
    def label_set(self) -> LabelSet | None:
        """Bags have no true labels."""
        return None

    @property
    def skipped(self) -> Mapping[str, int]:
        """Images left out by the last iteration so far, by reason."""
        return {reason: count for reason, count in self._skipped.items() if count}

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order of time; those that cannot be used are counted, never guessed."""
        skipped: Counter[str] = Counter()
        self._skipped = skipped
        poses = self._plan.poses
        buffer = poses.new_buffer() if poses else TransformBuffer()
        with open_bag(self._path) as bag:
            for index, pair in self._pairs_with_poses(bag, buffer, skipped):
                pose = self._pose_at(buffer, pair.stamp_ns)
                buffer.forget_before(pair.stamp_ns)
                if poses and pose is None:
                    skipped[REASON_POSE] += 1
                    continue
                try:
                    frame = self._frame(bag, index, pair, pose)
                except (InputError, InvalidValueError):
                    skipped[REASON_DAMAGED] += 1
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
                if self._config.stop is not None and paired >= self._config.stop:
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
        plan, pairer = self._plan, Pairer[_Raw](round(self._config.pair_tolerance_ms * 1e6))
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
        return index >= self._config.start and (index - self._config.start) % self._config.every == 0

    def _is_ready(self, buffer: TransformBuffer, pair: Pair[_Raw], now_ns: int) -> bool:
        """Whether the transform after the image has come, or is not to be waited for any longer."""
        poses = self._plan.poses
        if poses is None or now_ns - pair.color.recorded_ns > WAIT_NS:
            return True
        newest_ns = buffer.newest_ns(poses.map_frame, poses.camera_frame)
        return newest_ns is not None and newest_ns >= pair.stamp_ns

    def _pose_at(self, buffer: TransformBuffer, stamp_ns: int) -> Pose | None:
        poses = self._plan.poses
        if poses is None:
            return None
        tolerance_ns = round(self._config.pose_tolerance_ms * 1e6)
        return buffer.lookup(poses.map_frame, poses.camera_frame, stamp_ns, tolerance_ns)

    def _frame(self, bag: Bag, index: int, pair: Pair[_Raw], T_map_camera: Pose | None) -> Frame:
        plan = self._plan
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


def _make_plan(bag: Bag, config: SourceConfig) -> _Plan:
    color, depth = choose_topics(bag, config)
    color_camera = _calibration(bag, color)
    is_same_view = depth.frame_id == color.frame_id and not realsense_recording.is_sdk_bag(bag, depth.name)
    depth_camera = color_camera if depth.info is None and is_same_view else _calibration(bag, depth)
    static = static_messages(bag)
    unit_m = config.depth_unit_m or realsense_recording.depth_unit_m(bag, depth.name) or 0.001
    camera_frame = (config.camera_frame or color.frame_id).strip("/")
    T_color_depth = _color_from_depth(bag, color, depth, static)
    coincide = np.array_equal(T_color_depth.matrix, np.eye(4))
    aligned = coincide and _same_pixels(color_camera.intrinsics, depth_camera.intrinsics)
    poses = plan_poses(bag, config, camera_frame, static)
    return _Plan(color, depth, color_camera, depth_camera, unit_m, None if aligned else T_color_depth, poses)


def _calibration(bag: Bag, topic: ImageTopic) -> Calibration:
    if topic.info is None or (data := bag.first(topic.info)) is None:
        raise InputError(
            f"{bag.path}: no CameraInfo beside {topic.name}. Record it, or name its topic with "
            "--set source.color_info_topic=... or source.depth_info_topic=..."
        )
    return calibration_from_camera_info(bag.decode(topic.info, data), topic.rectified, topic.info)


def _color_from_depth(bag: Bag, color: ImageTopic, depth: ImageTopic, static: tuple[object, ...]) -> Pose:
    """T_color_depth of the two cameras.

    Raises:
        InputError: if it is not recorded.
    """
    if realsense_recording.is_sdk_bag(bag, depth.name):
        return realsense_recording.color_from_depth(bag, color.name, depth.name)
    if depth.frame_id == color.frame_id:
        return Pose.identity("color", "depth")
    T = latest_between(bag, color.frame_id, depth.frame_id, static)
    if T is None and not depth.aligned:
        raise InputError(
            f"{bag.path}: depth is seen from '{depth.frame_id}' and colour from '{color.frame_id}', and no "
            "tf says how they stand to each other. Record /tf_static, or the aligned depth topic "
            "(realsense-ros: align_depth.enable:=true; else depth_image_proc register)."
        )
    return Pose.identity("color", "depth") if T is None else T


def _same_pixels(a: Intrinsics, b: Intrinsics) -> bool:
    first, second = ((c.width, c.height, c.fx, c.fy, c.cx, c.cy) for c in (a, b))
    return bool(np.allclose(first, second, rtol=0, atol=SAME_PIXEL))


def _storage_files(folder: Path) -> Iterator[Path]:
    try:
        yield from (p for p in sorted(folder.iterdir()) if p.suffix in (".db3", ".mcap"))
    except OSError as error:
        raise InputError(f"cannot list {folder}: {error}") from error
