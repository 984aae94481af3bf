"""What a configured node holds: what comes in, the map, and what is given out; ROS is not needed.

`intake` and `check` are for the thread of the callbacks, `process` for the worker.
"""

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial

from swardmap.config import Config, config_to_dict
from swardmap.errors import InputError, SwardmapError
from swardmap.geometry import Pose
from swardmap.grid import OccupancyGrid
from swardmap.io.bags.tf_edge import ALWAYS_NS
from swardmap.mapping.costmap import Layer, check_frames
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.monitor.change_log import ChangeLog
from swardmap.monitor.diagnostics import Diagnosis, Fault, HealthReport, Severity
from swardmap.perception.observation import PixelCounts
from swardmap.pipeline import StepResult
from swardmap.rig.rig import Rig
from swardmap.ros.drive_recorder import DriveRecorder
from swardmap.ros.given_map import GivenMap
from swardmap.ros.inputs import CameraPair
from swardmap.ros.intake import Intake
from swardmap.ros.load import Load
from swardmap.ros.parameters import Parameters
from swardmap.ros.watched_mapper import WatchedMapper
from swardmap.runs.warnings import flat_warnings, pixel_warnings
from swardmap.segmenter import Segmenter

JUDGED_FRAMES = 5
"""Frames over which most readings must be lost before the view counts as implausible."""

EVENTS = 100
"""Lines for the log that wait for it at most."""

MAP, RIG = "map", "rig"
"""Subjects of what the pipeline itself finds wrong."""


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
        self.parameters = parameters
        self.intake = Intake(parameters, rig, self.clear, self._refused_stamp, lambda: self.mapper.version)
        if not self.intake.poses.posed:  # nobody can lose what was never there
            config = replace(config, watchdog=replace(config.watchdog, pose_s=None))
        self.mapper = WatchedMapper(config, segmenter, self.intake.poses.mounts, *_layers_and_map(config))
        self.failure = ""
        self.report: HealthReport | None = None
        self.robot: tuple[int, Pose] | None = None
        self.events: deque[tuple[Severity, str]] = deque(maxlen=EVENTS)
        self.events += [(Severity.WARN, text) for text in flat_warnings(config_to_dict(config))]
        self.given = GivenMap(lambda *event: self.events.append(event))
        self._pixels: deque[PixelCounts] = deque(maxlen=JUDGED_FRAMES)
        self.pixels: PixelCounts | None = None
        self.load, self.stages = Load(), self.mapper.stages
        self.recorder: DriveRecorder | None = None
        self.first_map_s: float | None = None
        self._mapped_ns: int | None = None
        self._dropped = 0
        self._changes = ChangeLog()

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
        total = self.intake.skipped + Counter(self.mapper.left_out)
        return {reason: count for reason, count in total.items() if count}

    @property
    def facts(self) -> dict[str, object]:
        """Numbers for whoever wants to know, beside the report."""
        intake = self.intake
        told: dict[str, object] = {
            "mapped": dict(self.mapper.mapped), "left_out": self.skipped, "active": list(intake.active_names),
            "paused": intake.paused, "error": intake.last_error, "stages_ms": self.stages.means_ms,
            "first_map_s": self.first_map_s, "start_area": self.given.area is not None,
            "dropped_by_queue": dict(intake.queue.dropped), **self.load.facts,
        }  # fmt: skip
        if intake.active is not None:
            told |= {"direction": intake.active.selector.direction, "dropped": dict(intake.active.dropped)}
        return told

    def configure(self, parameters: Parameters) -> None:
        """Go on with other parameters; those that the map is built on must be as they were."""
        self.mapper.configure(parameters.config)
        self.intake.configure(parameters)
        self.parameters = parameters

    def process(self, timeout_s: float) -> Mapped | None:
        """Map the next frame (the worker); None if none came, or it cannot be used."""
        job = self.intake.queue.get(timeout_s)
        if job is None:
            return None
        pair = job.pair
        try:
            with self.stages.measured("decode"):
                frame = self.intake.build_frame(job)
            if (recorder := self.recorder) is not None:  # a callback may take it away meanwhile
                recorder.offer(pair.camera, frame)
            if job.map_version != self.mapper.version:  # the watchdog has begun anew, too
                return None
            if job.lost:
                self.mapper.watch_frame(pair.camera, frame, pair.arrival_ns)
                return None
            step = self.mapper.map_frame(pair.camera, frame, pair.arrival_ns, job.map_version)
        except SwardmapError as error:
            self.intake.refuse(error)
            return None
        return None if step is None else Mapped(pair, step)

    def mapped(self, mapped: Mapped, now_ns: int) -> None:
        """Say that a pair of images is in the map now (the worker)."""
        first_ns = self.intake.first_image_ns
        if self.first_map_s is None and first_ns is not None:
            self.first_map_s = max(0, now_ns - first_ns) / 1e9
            self.events.append((Severity.OK, f"first map: {self.first_map_s:.2f} s after the first image"))
        self._mapped_ns, self.intake.body_frame = now_ns, ""
        counts = mapped.step.counts
        self._pixels.append(counts)
        self.pixels = counts if self.pixels is None else self.pixels + counts
        self.mapper.observe_mapped(mapped.pair.stamp_ns, now_ns)

    def check(self, now_ns: int) -> HealthReport:
        """Say what is wrong now; call it about ten times a second."""
        intake, queue = self.intake, self.intake.queue
        intake.release(now_ns)
        self._observe_poses(now_ns)
        dropped = queue.dropped.total()
        full = queue.capacity if dropped > self._dropped else queue.longest
        self._dropped = dropped
        self.mapper.observe_queue(full, queue.capacity, now_ns)
        running = () if intake.paused else intake.active_names  # nobody listens: the camera is not at fault
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
        self.intake.clear()
        self.mapper.clear()
        self.given.end("the map was cleared")

    def grant_start_area(self, now_ns: int) -> str:
        """Take that a person sees the ground under and ahead of the robot to be free; what to tell them.

        Raises:
            InputError: if nobody knows where the robot is.
        """
        node, config = self.parameters.node, self.mapper.config.watchdog
        if not self.intake.poses.posed:
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
        if not self.intake.poses.posed:
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
        elif self.intake.paused:
            yield Diagnosis.named(MAP, Fault.IDLE, f"paused; nothing was mapped for {idle_s:.2f} s")
        elif idle_s > config.stopped_s + config.stale_s:
            yield Diagnosis.named(MAP, Fault.IDLE, f"nothing was mapped for {idle_s:.2f} s")
        if self.mapper.too_far:
            yield Diagnosis.named(MAP, Fault.TOO_FAR, self.mapper.too_far)
        if self.intake.body_frame:
            yield Diagnosis.named(MAP, Fault.IMPLAUSIBLE, self.intake.body_frame)
        pixels = tuple(self._pixels)  # the worker appends
        if len(pixels) == JUDGED_FRAMES:
            for warning in pixel_warnings(asdict(sum(pixels[1:], pixels[0]))):
                yield Diagnosis.named(MAP, Fault.IMPLAUSIBLE, warning)
        active = self.intake.active
        if active is not None and active.blind:
            text = f"travels {active.selector.direction}, where no camera looks"
            yield Diagnosis.named(RIG, Fault.BLIND, text)

    def _observe_poses(self, now_ns: int) -> None:
        poses = self.intake.poses
        self.robot = poses.newest_robot() if poses.posed else None
        self.intake.follow_direction()
        newest = self.intake.newest_pose_ns(now_ns)
        if newest is not None:
            self.mapper.observe_pose(newest)

    def _refused_stamp(self, camera: str, now_ns: int) -> None:
        self.mapper.observe_refused_stamp(camera, now_ns)


def _layers_and_map(config: Config) -> tuple[tuple[Layer, ...], LogOddsMap | None]:
    """Work area and masks, and the saved map to go on from, where the configuration names them."""
    from swardmap.io.maps.costmap_layers import zone_layers
    from swardmap.io.maps.log_odds_files import read_living_map

    layers = zone_layers(config)
    living = None if config.grid.resume is None else read_living_map(config.grid.resume, config)
    if living is not None:
        check_frames(layers, living.corner_cell.frame_id)
    return layers, living
