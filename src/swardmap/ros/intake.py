"""From messages to frames that can be mapped: what comes is paired, given its pose, and queued.

Told of messages and time; ROS is not needed. All of it is for the thread of the callbacks; the worker takes
from the queue.
"""

from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from swardmap.errors import InputError, SwardmapError, one_line
from swardmap.geometry import Pose
from swardmap.io.bags.ros_messages import pose_from_odometry, stamp_ns
from swardmap.io.sources.pairing import COLOR
from swardmap.rig.active_cameras import ActiveCameras
from swardmap.rig.rig import Rig
from swardmap.ros.camera_poses import CameraPoses
from swardmap.ros.frame_queue import FrameQueue
from swardmap.ros.inputs import CameraInput, CameraPair, camera_topics
from swardmap.ros.parameters import Parameters
from swardmap.types import Frame

ONLY_CAMERA = "camera"
"""Name of the camera where there is no rig."""

WAITING_PAIRS = 30
"""Images that wait for their pose at most."""

CLOCK_BACK_NS = 1_000_000_000
"""A camera whose stamps go back further has a new clock: a recording begins anew, a simulation was reset."""

REASON_POSE = "no pose of the camera at the time of the image"
REASON_AXES = "image of a frame that looks up"
REASON_VIEW = "no transform between colour and depth camera"
REASON_DAMAGED = "image that cannot be used"
REASON_WAITING = "image that waited for its pose when too many did"
REASON_QUEUE = "frame dropped by a full queue, the oldest first"
REASON_TURNED = "image that waited for its pose when the robot turned round"
REASON_PAUSED = "image while the node was paused"


@dataclass(frozen=True, slots=True)
class Job:
    """Images for the worker; those whose pose never came are looked at, and not mapped.

    Attributes:
        map_version: of the map that they are for; one begun since does not take them.
    """

    pair: CameraPair
    T_map_camera: Pose | None
    T_color_depth: Pose | None
    map_version: int
    lost: bool = False


class Intake:
    """Cameras, poses and queue of a node.

    Args:
        parameters: of the node.
        rig: cameras; None = one, by `source` and `mount` of the configuration.
        on_new_clock: called when the clock of a camera went back: all that is known is of another time.
        on_refused_stamp: called with a camera and the time when an image is not newer than the last.
        map_version: tells which map frames are for now.

    Attributes:
        paused: images are left out.
        last_error: what was wrong last.
        body_frame: why the camera's frame cannot be that of a lens; empty if it can.
        first_image_ns: when the first image came, or None.
        queue: of frames for the worker.

    Raises:
        ConfigError: if parameters contradict each other.
    """

    def __init__(
        self,
        parameters: Parameters,
        rig: Rig | None,
        on_new_clock: Callable[[], None],
        on_refused_stamp: Callable[[str, int], None],
        map_version: Callable[[], int],
    ) -> None:
        config = parameters.config
        cameras = {ONLY_CAMERA: None} if rig is None else {c.name: c for c in rig.cameras}
        self.parameters = parameters
        self.poses = CameraPoses(parameters, rig, cameras)
        self.inputs: Mapping[str, CameraInput] = {
            name: CameraInput(name, camera_topics(config.source, camera), config.source, config.cloud)
            for name, camera in cameras.items()
        }
        self.active = None if rig is None else ActiveCameras(rig)
        self.queue = FrameQueue[Job](parameters.node.queue_frames)
        self.paused, self.last_error = False, ""
        self.body_frame = self._looks_up = ""
        self.first_image_ns: int | None = None
        self._on_new_clock, self._on_refused_stamp = on_new_clock, on_refused_stamp
        self._map_version = map_version
        self._skipped: Counter[str] = Counter()
        self._first: dict[str, str] = {}
        self._waiting: deque[CameraPair] = deque()
        self._newest_ns: dict[str, int] = {}
        self._optical: dict[str, str] = {}

    @property
    def active_names(self) -> tuple[str, ...]:
        """Cameras that are processed now."""
        return tuple(self.inputs) if self.active is None else self.active.names

    @property
    def skipped(self) -> Counter[str]:
        """What did not reach the worker, by reason; cameras that look the other way are no omission."""
        total = Counter(self._skipped)
        for camera in self.inputs.values():
            total += Counter(camera.skipped)
        total[REASON_QUEUE] = self.queue.dropped.total()
        return total

    @property
    def first(self) -> dict[str, str]:
        """The first of each reason in full, where more than the reason is known."""
        told = dict(self._first)
        for camera in self.inputs.values():
            told = {**camera.first, **told}
        return told

    def configure(self, parameters: Parameters) -> None:
        """Go on with other parameters."""
        self.parameters = parameters
        for each in self.inputs.values():
            each.configure(parameters.config.cloud)

    def on_info(self, camera: str, kind: str, message: Any) -> None:
        """Take a CameraInfo."""
        try:
            self.inputs[camera].add_info(kind, message)
        except SwardmapError as error:
            self.refuse(error)

    def on_image(self, camera: str, kind: str, message: Any, now_ns: int) -> None:
        """Take an image; one of a camera that looks the other way is dropped before it costs anything."""
        is_color = kind == COLOR
        self.first_image_ns = now_ns if self.first_image_ns is None else self.first_image_ns
        if self.paused:
            self._skipped[REASON_PAUSED] += is_color
            return
        if self.active is not None:
            admitted = self.active.admits(camera) if is_color else camera in self.active.names
            if not admitted:
                return
        self._check_clock(camera, kind, stamp_ns(message.header.stamp), now_ns)
        for pair in self.inputs[camera].add_image(kind, message, now_ns):
            self._optical[camera] = pair.color_frame
            self._waiting.append(pair)
            if len(self._waiting) > WAITING_PAIRS:
                self._waiting.popleft()
                self._skipped[REASON_WAITING] += 1
        self.release(now_ns)

    def on_odometry(self, message: Any, now_ns: int) -> None:
        """Take an odometry: it moves the robot, and tells the direction of travel."""
        self.poses.live.add_odometry(message)
        if self.active is not None:
            try:
                self.active.selector.step_pose(stamp_ns(message.header.stamp), pose_from_odometry(message))
            except SwardmapError as error:
                self.refuse(error)
        self.release(now_ns)

    def on_tf(self, message: Any, static: bool, now_ns: int) -> None:
        """Take a message of /tf or /tf_static."""
        self.poses.add_tf(message, static)
        self.release(now_ns)

    def release(self, now_ns: int) -> None:
        """Hand over the images whose pose is known now, and give up those that waited too long."""
        wait_ns = round(self.parameters.node.pose_wait_ms * 1e6)
        waiting, self._waiting = self._waiting, deque()
        for pair in waiting:
            overdue = now_ns - pair.arrival_ns >= wait_ns
            if pair.camera not in self.active_names:
                self._skipped[REASON_TURNED] += 1
                continue
            T_map_camera = self._pose_of(pair, overdue)
            if T_map_camera is None and self.poses.posed and not self._looks_up:
                if not overdue:
                    self._waiting.append(pair)
                    continue
                self._skipped[REASON_POSE] += 1
                self._say(REASON_POSE, self.poses.live.missing(pair.color_frame))
            elif self._looks_up:
                self._skipped[REASON_AXES] += 1
                self._say(REASON_AXES, self._looks_up)
            self._hand_over(pair, T_map_camera)

    def _pose_of(self, pair: CameraPair, overdue: bool) -> Pose | None:
        """The pose of a pair; none, and why, if its frame cannot be that of a lens."""
        self._looks_up = ""
        try:
            return self.poses.of_pair(pair, overdue)
        except InputError as error:
            self._looks_up = self.body_frame = one_line(error)
            return None

    @property
    def optical_frames(self) -> tuple[str, ...]:
        """Frames of the cameras that images came of."""
        return tuple(dict.fromkeys(self._optical.values()))

    def newest_pose_ns(self, now_ns: int) -> int | None:
        """Stamp of the newest pose of the active camera that is worst off; None if there is none of any."""
        frames = [self._optical[name] for name in self.active_names if name in self._optical]
        return self.poses.newest_ns(frames, now_ns)

    def follow_direction(self) -> None:
        """Take the direction of travel from tf; an odometry tells it as it comes."""
        if self.active is not None and not self.poses.from_odometry:
            base = self.poses.newest_base()
            if base is not None:
                self.active.selector.step_pose(*base)

    def build_frame(self, job: Job) -> Frame:
        """Decode, rectify and align the images of a job: what takes time (the worker).

        Raises:
            InputError: if an image cannot be decoded, or has another size than its CameraInfo.
        """
        return self.inputs[job.pair.camera].build_frame(job.pair, job.T_map_camera, job.T_color_depth)

    def clear(self) -> None:
        """Forget all that waits for the map."""
        self._waiting.clear()
        self.queue.clear()

    def refuse(self, error: SwardmapError) -> None:
        """Count what cannot be used."""
        self._skipped[REASON_DAMAGED] += 1
        self._say(REASON_DAMAGED, str(error))

    def _say(self, reason: str, text: str) -> None:
        self.last_error = text
        self._first.setdefault(reason, text)

    def _hand_over(self, pair: CameraPair, T_map_camera: Pose | None) -> None:
        T_color_depth = self.poses.view_of(pair)
        if T_color_depth is None and not self.inputs[pair.camera].is_aligned:
            self._skipped[REASON_VIEW] += 1
            return
        if T_color_depth is not None and np.array_equal(T_color_depth.matrix, np.eye(4)):
            T_color_depth = None
        lost = T_map_camera is None and self.poses.posed
        self.queue.put(pair.camera, Job(pair, T_map_camera, T_color_depth, self._map_version(), lost))

    def _check_clock(self, camera: str, kind: str, stamp: int, now_ns: int) -> None:
        key = f"{camera}/{kind}"
        newest = self._newest_ns.get(key)
        if newest is not None and stamp < newest - CLOCK_BACK_NS:
            self._newest_ns.clear()
            for each in self.inputs.values():
                each.restart()
            self.poses.live.forget_moving()  # or poses of the new times would be made of old transforms
            self._on_new_clock()
        elif newest is not None and stamp <= newest and kind == COLOR:
            self._on_refused_stamp(camera, now_ns)  # the pairing will leave it out
        self._newest_ns[key] = max(stamp, self._newest_ns.get(key, stamp))
