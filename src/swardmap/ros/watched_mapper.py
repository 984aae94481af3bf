"""The mapper of a node: frames of several cameras into one map, watched; safe to ask from other threads.

A worker calls `map_frame`; all else may be called by any thread, and does not wait for a network that is slow
or hangs: the lock is held for the update of the map only.
"""

import threading
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

from swardmap.config import Config
from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.mapping.costmap import Costmap, Layer
from swardmap.mapping.last_observed import LastObserved
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.mapping.work_area import work_area_in
from swardmap.monitor.diagnostics import Diagnosis, HealthReport, frame_stats
from swardmap.monitor.watchdog import Watchdog
from swardmap.pipeline import ObstacleMapper, StepResult, configured_mount, view_spec
from swardmap.ros.ground_heights import GroundHeights
from swardmap.ros.layers import Values, evidence_values
from swardmap.ros.stage_times import StageTimes
from swardmap.runs.bounds import Bounds
from swardmap.segmenter import Segmenter
from swardmap.types import Frame, Segmentation

LATE_NS = 1_000_000_000
"""A frame this much older than the newest in the map says nothing about now; it is left out."""

REASON_UNFIT = "frame that the watchdog refused"
REASON_LATE = "frame older than the map by more than a second"
REASON_FAR = "frame so far away that the map would become too large"


class WatchedMapper:
    """One map, its watchdog, and the segmenter of all cameras.

    Attributes:
        left_out, mapped: counts of frames, by reason and by camera.
        stages: what takes how long.
        area: work area, or None.
        viewpoint_m: (x, y) in the map of the camera whose frame was mapped last.
        too_far: why the last frame was too far away to be mapped; empty if it was not.

    Args:
        config: all settings.
        segmenter: used by the worker alone.
        mounts: T_base_camera by name of each camera, or None where it is not known.
        layers: of costmaps, beside what is seen: a work area, a keep-out mask.
        log_odds: saved map to go on from; it is changed.

    Raises:
        InputError: if the saved map is too large to be given out.
    """

    def __init__(
        self,
        config: Config,
        segmenter: Segmenter,
        mounts: Mapping[str, Pose | None],
        layers: Sequence[Layer] = (),
        log_odds: LogOddsMap | None = None,
    ) -> None:
        self.config = config
        self.segmenter = segmenter
        self.left_out: Counter[str] = Counter()
        self.mapped: Counter[str] = Counter()
        self.stages = StageTimes()
        self._mounts, self._layers = dict(mounts), tuple(layers)
        self.area = work_area_in(self._layers)
        self._map_lock, self._watch_lock = threading.Lock(), threading.Lock()
        self._watchdog = Watchdog(tuple(mounts), config.watchdog)
        self._mapper: ObstacleMapper
        self._last_observed: LastObserved | None
        self._heights: GroundHeights | None
        self._alone: OccupancyGrid | None
        self._newest_ns: int
        self._version = 0
        self._given: GridSpec | None = None
        self._bounds: Bounds | None
        self.too_far = ""
        self.viewpoint_m = 0.0, 0.0
        self._begin(log_odds)

    @property
    def version(self) -> int:
        """How often the map was begun: what was meant for one that was cleared must not go into the next."""
        return self._version

    def map_frame(
        self, camera: str, frame: Frame, arrival_ns: int, version: int | None = None
    ) -> StepResult | None:
        """Watch a frame, segment it, and put it into the map.

        Cameras have one clock, but their frames do not come in its order: for the map a frame is as late as
        the newest before it. Its pose is that of its own stamp.

        Args:
            camera: its name.
            frame: with its pose.
            arrival_ns: when it came.
            version: of the map that it is for, as of when it was queued: while it is decoded and watched that
                may be cleared. None = the map there is.

        Returns:
            What it gave, with the frame's own stamp; None if it is not fit for the map, or that was cleared.
        """
        version = self._version if version is None else version
        if not self.watch_frame(camera, frame, arrival_ns):
            self.left_out[REASON_UNFIT] += 1
            return None
        with self.stages.measured("segment"):
            segmentation = self.segmenter(frame)
        with self._watch_lock:
            self._watchdog.observe_mask(camera, segmentation, arrival_ns)
        with self._map_lock, self.stages.measured("map"):
            if version != self._version:  # cleared meanwhile
                return None
            if self._newest_ns - frame.stamp_ns > LATE_NS:
                self.left_out[REASON_LATE] += 1
                return None
            if not self._is_near(frame):
                self.left_out[REASON_FAR] += 1
                return None
            self._newest_ns = max(self._newest_ns, frame.stamp_ns)
            step = self._step(replace(frame, stamp_ns=self._newest_ns), segmentation)
            x, y, _ = step.T_map_camera.position_m.tolist()
            self.viewpoint_m = x, y
        self.mapped[camera] += 1
        if frame.T_map_camera is not None and (slope := step.observation.ground_slope) is not None:
            with self._watch_lock:
                self._watchdog.observe_ground(camera, step.T_map_camera, slope)
        return replace(step, frame=frame)

    def watch_frame(self, camera: str, frame: Frame, arrival_ns: int) -> bool:
        """Let the watchdog look at a frame; returns whether it may go into the map."""
        with self.stages.measured("watch"):
            stats = frame_stats(frame, arrival_ns, self._mounts.get(camera))
        with self._watch_lock:
            return self._watchdog.observe_frame(camera, stats)

    def observe_refused_stamp(self, camera: str, now_ns: int) -> None:
        """Take that an image was left out since its stamp is not after the last."""
        with self._watch_lock:
            self._watchdog.observe_refused_stamp(camera, now_ns)

    def observe_mapped(self, stamp_ns: int, now_ns: int) -> None:
        """Take that an image is in the map now."""
        with self._watch_lock:
            self._watchdog.observe_mapped(stamp_ns, now_ns)

    def observe_pose(self, stamp_ns: int) -> None:
        """Take the stamp of the newest pose there is."""
        with self._watch_lock:
            self._watchdog.observe_pose(stamp_ns)

    def observe_queue(self, length: int, capacity: int, now_ns: int) -> None:
        """Take how many frames wait for the mapper."""
        with self._watch_lock:
            self._watchdog.observe_queue("queue", length, capacity, now_ns)

    def check(self, now_ns: int, active: Collection[str], others: Iterable[Diagnosis] = ()) -> HealthReport:
        """What is wrong now, of the cameras that are to be running; `others` is what the caller has found."""
        with self._watch_lock:
            return self._watchdog.check(now_ns, active, others)

    def snapshot(self, forget_before_ns: int | None) -> OccupancyGrid | None:
        """The map now, with every free cell that was last seen before a time as unknown; None if empty.

        Without poses: the map of the newest frame alone, or all unknown if that is older. A map that was
        cleared is all unknown where it was: who has been given the old one must not go on by it.
        """
        with self._map_lock:
            grid = self._snapshot(forget_before_ns)
            self._given = self._given if grid is None else grid.spec
            return grid

    def costmap(self, grid: OccupancyGrid) -> Costmap | None:
        """Costs of a snapshot."""
        return self._mapper.costmap(grid)

    def evidence(self, spec: GridSpec) -> Values | None:
        """Probability of a hazard in percent on some cells; None in a map that keeps no evidence."""
        with self._map_lock:
            log_odds = self._mapper.log_odds
            return None if log_odds is None else evidence_values(log_odds, spec)

    def heights(self, spec: GridSpec, base_z_m: float) -> Values | None:
        """Height of the ground against the robot's base on some cells; None before a frame was mapped."""
        with self._map_lock:
            return None if self._heights is None else self._heights.values(spec, base_z_m)

    def configure(self, config: Config) -> None:
        """Go on with other settings; those that the map is built on must be as they were."""
        with self._map_lock:
            self._mapper.reconfigure(config)
            self.config = config

    def clear(self) -> None:
        """Forget the map, whatever it has become: all is unknown where one was given out."""
        with self._map_lock:
            self._begin()

    def save(self, folder: Path, facts: Mapping[str, Any] | None = None) -> None:
        """Write map, costmap, evidence and settings as `swardmap map` does into a new folder.

        Frames are mapped meanwhile: what is written is a copy of the map as it is now.

        Args:
            folder: to be made.
            facts: what else summary.json says of the run; see `run_facts`.

        Raises:
            InputError: if there is no map yet.
            OutputError: if it cannot be written.
        """
        from swardmap.io.folders import new_output_folder
        from swardmap.runs.files import RunWriter

        with self._map_lock:
            grid, mapper = self._snapshot(None), copy(self._mapper)  # settings may change
            if grid is None or not self._newest_ns:
                raise InputError("there is no map yet: no frame with a pose was mapped")
            log_odds = None if mapper.log_odds is None else mapper.log_odds.copy()
            known = {"frames": dict(self.mapped), "skipped": dict(self.left_out), "stamp_ns": grid.stamp_ns}
            summary = known | dict(facts or {})
            config = replace(self.config, output=replace(self.config.output, pictures=0))
        with new_output_folder(folder, overwrite=False) as path:
            RunWriter(path, config).finish(grid, mapper.costmap(grid), summary, log_odds)

    def _snapshot(self, forget_before_ns: int | None) -> OccupancyGrid | None:
        grid = self._alone if self._alone is not None else self._mapper.map
        if grid is None:
            return None if self._given is None else OccupancyGrid.unknown(self._given)
        if self._alone is not None:
            stale = forget_before_ns is not None and grid.stamp_ns < forget_before_ns
            return OccupancyGrid.unknown(grid.spec) if stale else grid
        if self._last_observed is None:
            return grid
        return self._last_observed.forget_stale(grid, forget_before_ns)

    def _begin(self, log_odds: LogOddsMap | None = None) -> None:
        self._version += 1
        mount = configured_mount(self.config.mount)
        self._mapper = ObstacleMapper(self.segmenter, self.config, mount, self._layers, log_odds)
        self._last_observed, self._alone, self._newest_ns = None, None, 0
        self._heights = None
        self._bounds, self.too_far = self._new_bounds(log_odds), ""
        if log_odds is not None:
            self._last_observed = LastObserved(log_odds.corner_cell)  # none of it was seen in this run

    def _new_bounds(self, log_odds: LogOddsMap | None) -> Bounds | None:
        """How large the map may become; None where its size is given, or a window follows the camera."""
        grid, saved = self.config.grid, None if log_odds is None else log_odds.spec
        rolling = grid.mode == "log_odds" and self.config.evidence.window_m is not None
        if rolling or grid.size_m is not None:
            return None
        bounds = Bounds(grid.resolution_m)
        if saved is not None:
            bounds.begin_with(saved)
        return bounds

    def _is_near(self, frame: Frame) -> bool:
        """Whether the map stays one that can be given out with a frame in it; `too_far` says why not.

        The watchdog refuses the first image after a jump of the pose and knows the next ones to be steady: of
        these the map would grow to gigabytes, or beyond what a grid may be.
        """
        pose, config = frame.T_map_camera, self.config
        why = ""
        if pose is not None and self._bounds is not None:
            seen = view_spec(frame.intrinsics, pose, config.cloud.max_range_m, config.grid.resolution_m)
            try:
                self._bounds.take_in(frame.name or str(frame.stamp_ns), pose, seen)
            except InputError as error:
                why = f"{error}; the service clear begins the map anew where the robot is"
        self.too_far = why  # at once: another thread reads it
        return not why

    def _step(self, frame: Frame, segmentation: Segmentation) -> StepResult:
        step = self._mapper.integrate(frame, segmentation)
        if frame.T_map_camera is None:
            self._alone = step.seen
            return step
        self._last_observed = self._last_observed or LastObserved(step.observation.spec)
        self._last_observed.integrate(step.observation)
        self._heights = self._heights or GroundHeights(step.observation.spec)
        self._heights.integrate(step.observation)
        saved = self._mapper.log_odds
        if saved is not None and self.config.evidence.window_m is not None and saved.grid is not None:
            self._last_observed.keep_within(saved.grid.spec)
            self._heights.keep_within(saved.grid.spec)
        return step
