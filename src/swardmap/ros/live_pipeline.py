"""What a configured node holds: cameras, poses, queue and map; told of messages and time, ROS is not needed.

`on_*` and `check` are for the thread of the callbacks, `process` for the worker.
"""

from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from swardmap.config import Config
from swardmap.errors import InputError, SwardmapError
from swardmap.geometry import Pose
from swardmap.grid import OccupancyGrid
from swardmap.io.bags.ros_messages import pose_from_odometry, stamp_ns
from swardmap.io.bags.tf_edge import ALWAYS_NS
from swardmap.io.sources.pairing import COLOR
from swardmap.mapping.costmap import Layer, check_frames
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.monitor.change_log import ChangeLog
from swardmap.monitor.diagnostics import Diagnosis, Fault, HealthReport, Severity
from swardmap.pipeline import StepResult
from swardmap.rig.active_cameras import ActiveCameras
from swardmap.rig.rig import Rig
from swardmap.ros.camera_poses import CameraPoses
from swardmap.ros.frame_queue import FrameQueue
from swardmap.ros.given_map import GivenMap
from swardmap.ros.inputs import CameraInput, CameraPair, camera_topics
from swardmap.ros.load import Load
from swardmap.ros.parameters import Parameters
from swardmap.ros.watched_mapper import WatchedMapper
from swardmap.segmenter import Segmenter

ONLY_CAMERA = "camera"
"""Name of the camera where there is no rig."""

WAITING_PAIRS = 30
"""Images that wait for their pose at most."""

CLOCK_BACK_NS = 1_000_000_000
"""A camera whose stamps go back further has a new clock: a recording begins anew, a simulation was reset."""

EVENTS = 100
"""Lines for the log that wait for it at most."""

MAP, RIG = "map", "rig"
"""Subjects of what the pipeline itself finds wrong."""

REASON_POSE = "no pose of the camera at the time of the image"
REASON_VIEW = "no transform between colour and depth camera"
REASON_DAMAGED = "image that cannot be used"
REASON_WAITING = "image that waited for its pose when too many did"
REASON_QUEUE = "frame dropped by a full queue, the oldest first"
REASON_TURNED = "image that waited for its pose when the robot turned round"
REASON_PAUSED = "image while the node was paused"


@dataclass(frozen=True, slots=True)
class Job:
    """Images for the worker; those whose pose never came are looked at, and not mapped."""

    pair: CameraPair
    T_map_camera: Pose | None
    T_color_depth: Pose | None
    lost: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Mapped:
    """What one pair of images gave."""

    pair: CameraPair
    step: StepResult


class LivePipeline:
    """Everything between the subscriptions and the publishers.

    Args:
        parameters: of the node.
        segmenter: for all cameras.
        rig: cameras; None = one, by `source` and `mount` of the configuration.

    Raises:
        ConfigError: if parameters contradict each other.
        InputError: if the work area or the saved map cannot be read.
        MissingExtraError: for a work area without pyproj.
    """

    def __init__(self, parameters: Parameters, segmenter: Segmenter, rig: Rig | None = None) -> None:
        config = parameters.config
        self.parameters, self.rig = parameters, rig
        self.paused = False
        self.last_error = self.failure = ""
        self.report: HealthReport | None = None
        self._mapped_ns: int | None = None
        cameras = {ONLY_CAMERA: None} if rig is None else {c.name: c for c in rig.cameras}
        self.poses = CameraPoses(parameters, rig, cameras)
        if not self.poses.posed:  # nobody can lose what was never there
            config = replace(config, watchdog=replace(config.watchdog, pose_s=None))
        self.inputs: Mapping[str, CameraInput] = {
            name: CameraInput(name, camera_topics(config.source, camera), config.source, config.cloud)
            for name, camera in cameras.items()
        }
        self.active = None if rig is None else ActiveCameras(rig)
        self.queue = FrameQueue[Job](parameters.node.queue_frames)
        self.mapper = WatchedMapper(config, segmenter, self.poses.mounts, *_layers_and_map(config))
        self._skipped: Counter[str] = Counter()
        self._waiting: deque[CameraPair] = deque()
        self._newest_ns: dict[str, int] = {}
        self._optical: dict[str, str] = {}
        self._dropped = 0
        self.robot: tuple[int, Pose] | None = None
        self.events: deque[tuple[Severity, str]] = deque(maxlen=EVENTS)
        self._changes, self.load = ChangeLog(), Load()
        self.given = GivenMap(lambda *event: self.events.append(event))
        self._first_image_ns: int | None = None
        self.first_map_s: float | None = None
        self.stages = self.mapper.stages

    @property
    def active_names(self) -> tuple[str, ...]:
        """Cameras that are processed now."""
        return tuple(self.inputs) if self.active is None else self.active.names

    @property
    def T_map_base(self) -> Pose | None:
        """The newest pose of the robot's base; None where it is not known."""
        robot = self.robot
        return None if robot is None else robot[1]

    @property
    def robot_z_m(self) -> float:
        """Height of the robot's base, on the ground, in the map frame; 0 where its pose is not known."""
        robot = self.robot
        return 0.0 if robot is None else float(robot[1].position_m[2])

    @property
    def skipped(self) -> dict[str, int]:
        """What did not reach the map, by reason; cameras that look the other way are no omission."""
        total = Counter(self._skipped) + Counter(self.mapper.left_out)
        for camera in self.inputs.values():
            total += Counter(camera.skipped)
        total[REASON_QUEUE] = self.queue.dropped.total()
        return {reason: count for reason, count in total.items() if count}

    @property
    def facts(self) -> dict[str, object]:
        """Numbers for whoever wants to know, beside the report."""
        told: dict[str, object] = {
            "mapped": dict(self.mapper.mapped), "left_out": self.skipped, "active": list(self.active_names),
            "paused": self.paused, "error": self.last_error, "stages_ms": self.stages.means_ms,
            "first_map_s": self.first_map_s, "start_area": self.given.area is not None,
            "dropped_by_queue": dict(self.queue.dropped), **self.load.facts,
        }  # fmt: skip
        if self.active is not None:
            told |= {"direction": self.active.selector.direction, "dropped": dict(self.active.dropped)}
        return told

    def on_info(self, camera: str, kind: str, message: Any) -> None:
        """Take a CameraInfo."""
        try:
            self.inputs[camera].add_info(kind, message)
        except SwardmapError as error:
            self._damaged(error)

    def on_image(self, camera: str, kind: str, message: Any, now_ns: int) -> None:
        """Take an image; one of a camera that looks the other way is dropped before it costs anything."""
        is_color = kind == COLOR
        self._first_image_ns = now_ns if self._first_image_ns is None else self._first_image_ns
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
                self._damaged(error)
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
            T_map_camera = self.poses.of_pair(pair, overdue)
            if T_map_camera is None and self.poses.posed:
                if not overdue:
                    self._waiting.append(pair)
                    continue
                self._skipped[REASON_POSE] += 1
                self.last_error = self.poses.live.missing(pair.color_frame)
            self._hand_over(pair, T_map_camera)

    def process(self, timeout_s: float) -> Mapped | None:
        """Map the next frame (the worker); None if none came, or it cannot be used."""
        job = self.queue.get(timeout_s)
        if job is None:
            return None
        pair = job.pair
        try:
            with self.stages.measured("decode"):
                frame = self.inputs[pair.camera].build_frame(pair, job.T_map_camera, job.T_color_depth)
            if job.lost:
                self.mapper.watch_frame(pair.camera, frame, pair.arrival_ns)
                return None
            step = self.mapper.map_frame(pair.camera, frame, pair.arrival_ns)
        except SwardmapError as error:
            self._damaged(error)
            return None
        return None if step is None else Mapped(pair, step)

    def mapped(self, pair: CameraPair, now_ns: int) -> None:
        """Say that a pair of images is in the map now (the worker)."""
        if self.first_map_s is None and self._first_image_ns is not None:
            self.first_map_s = max(0, now_ns - self._first_image_ns) / 1e9
            self.events.append((Severity.OK, f"first map: {self.first_map_s:.2f} s after the first image"))
        self._mapped_ns = now_ns
        self.mapper.observe_mapped(pair.stamp_ns, now_ns)

    def check(self, now_ns: int) -> HealthReport:
        """Say what is wrong now; call it about ten times a second."""
        self.release(now_ns)
        active = self.active_names
        self._observe_poses(now_ns, active)
        dropped = self.queue.dropped.total()
        full = self.queue.capacity if dropped > self._dropped else self.queue.longest
        self._dropped = dropped
        self.mapper.observe_queue(full, self.queue.capacity, now_ns)
        running = () if self.paused else active  # a camera that nobody listens to is not at fault
        before, self.report = self.report, self.mapper.check(now_ns, running, self._found(now_ns))
        change = self._changes.line(self.report)
        if change is not None:
            self.events.append(change)
        stopped = self.report.stop and before is not None and not before.stop
        xy_m = None if self.robot is None else self._robot_xy_m(self.robot[1].parent)
        self.given.check(now_ns, xy_m, stopped, partial(self.grant_start_area, now_ns))
        return self.report

    def begin(self) -> None:
        """Take that the node has become active."""
        self.given.to_grant = self.parameters.node.start_area_at_start

    def clear(self) -> None:
        """Forget the map, the start area, and all that waits for the map."""
        self._waiting.clear()
        self.queue.clear()
        self.mapper.clear()
        self.given.end("the map was cleared")

    def grant_start_area(self, now_ns: int) -> str:
        """Take that a person sees the ground under and ahead of the robot to be free; what to tell them.

        Raises:
            InputError: if nobody knows where the robot is.
        """
        node, config = self.parameters.node, self.mapper.config.watchdog
        if not self.poses.posed:
            raise InputError("no start area: pose_source is none, so there is no map to put it into")
        if self.robot is None:
            raise InputError("no start area: the pose of the robot's base is not known yet")
        stamp, T_map_base = self.robot
        age_s = 0.0 if stamp == ALWAYS_NS else (now_ns - stamp) / 1e9
        if config.pose_s is not None and age_s > config.pose_s:
            raise InputError(f"no start area: the last pose of the robot's base is {age_s:.2f} s old")
        return self.given.grant(T_map_base, node, self.mapper.snapshot(None), now_ns)

    def given_out(self, forget_before_ns: int | None, nothing_free: bool = False) -> OccupancyGrid | None:
        """The map as it is published: with the robot in its extent, and the start area while it lasts.

        Args:
            forget_before_ns: as `WatchedMapper.snapshot` takes it.
            nothing_free: leave the start area out.
        """
        grid = self.mapper.snapshot(forget_before_ns)
        if grid is None:
            return None
        xy_m = self._robot_xy_m(grid.spec.frame_id)
        return self.given.of(grid, xy_m, self.parameters.node.robot_radius_m, nothing_free)

    def fail(self, reason: str) -> None:
        """Say that a thread of the node has ended: nothing will be mapped again."""
        self.failure = reason

    def _robot_xy_m(self, frame_id: str) -> tuple[float, float] | None:
        """Where the robot's base is in a frame; without poses the map lies in that of the base."""
        if not self.poses.posed:
            return 0.0, 0.0
        if self.robot is None or self.robot[1].parent != frame_id:
            return None
        x, y, _ = self.robot[1].position_m.tolist()
        return x, y

    def _found(self, now_ns: int) -> Iterator[Diagnosis]:
        """What is wrong, whatever the cameras look like: nothing reaches the map, or nobody looks ahead."""
        config = self.mapper.config.watchdog
        if self._mapped_ns is None or self._mapped_ns > now_ns:  # not yet, or the clock went back
            self._mapped_ns = now_ns
        idle_s = (now_ns - self._mapped_ns) / 1e9
        if self.failure:
            yield Diagnosis.named(MAP, Fault.IDLE, self.failure)
        elif self.paused:
            yield Diagnosis.named(MAP, Fault.IDLE, f"paused; nothing was mapped for {idle_s:.2f} s")
        elif idle_s > config.stopped_s + config.stale_s:
            yield Diagnosis.named(MAP, Fault.IDLE, f"nothing was mapped for {idle_s:.2f} s")
        if self.active is not None and self.active.blind:
            text = f"travels {self.active.selector.direction}, where no camera looks"
            yield Diagnosis.named(RIG, Fault.BLIND, text)

    def _hand_over(self, pair: CameraPair, T_map_camera: Pose | None) -> None:
        T_color_depth = self.poses.view_of(pair)
        if T_color_depth is None and not self.inputs[pair.camera].is_aligned:
            self._skipped[REASON_VIEW] += 1
            return
        if T_color_depth is not None and np.array_equal(T_color_depth.matrix, np.eye(4)):
            T_color_depth = None
        lost = T_map_camera is None and self.poses.posed
        self.queue.put(pair.camera, Job(pair, T_map_camera, T_color_depth, lost))

    def _check_clock(self, camera: str, kind: str, stamp: int, now_ns: int) -> None:
        key = f"{camera}/{kind}"
        newest = self._newest_ns.get(key)
        if newest is not None and stamp < newest - CLOCK_BACK_NS:
            self._newest_ns.clear()
            for each in self.inputs.values():
                each.restart()
            self.clear()
        elif newest is not None and stamp <= newest and kind == COLOR:
            self.mapper.observe_refused_stamp(camera, now_ns)  # the pairing will leave it out
        self._newest_ns[key] = max(stamp, self._newest_ns.get(key, stamp))

    def _observe_poses(self, now_ns: int, active: tuple[str, ...]) -> None:
        self.robot = self.poses.newest_robot() if self.poses.posed else None
        if self.active is not None and not self.poses.from_odometry:  # which tells the direction as it comes
            base = self.poses.newest_base()
            if base is not None:
                self.active.selector.step_pose(*base)
        frames = [self._optical[name] for name in active if name in self._optical]
        newest = self.poses.newest_ns(frames, now_ns)
        if newest is not None:
            self.mapper.observe_pose(newest)

    def _damaged(self, error: SwardmapError) -> None:
        self._skipped[REASON_DAMAGED] += 1
        self.last_error = str(error)


def _layers_and_map(config: Config) -> tuple[tuple[Layer, ...], LogOddsMap | None]:
    """Work area and masks, and the saved map to go on from, where the configuration names them."""
    from swardmap.io.maps.costmap_layers import zone_layers
    from swardmap.io.maps.log_odds_files import read_living_map

    layers = zone_layers(config)
    living = None if config.grid.resume is None else read_living_map(config.grid.resume, config)
    if living is not None:
        check_frames(layers, living.corner_cell.frame_id)
    return layers, living
