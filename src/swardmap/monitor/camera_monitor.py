"""Watches one camera: its stamps, its rate, and the little that is known of its images."""

import math
from collections import deque
from collections.abc import Iterable

from swardmap.config import WatchdogConfig
from swardmap.geometry import Pose
from swardmap.monitor.diagnostics import Fault, FrameStats, in_ns
from swardmap.monitor.step_watch import StepWatch, step_counts
from swardmap.monitor.view_watch import ViewWatch

NS = 1_000_000_000
MAX_ARRIVALS = 16384
POSE_SLACK_M = 0.5
"""A pose that is corrected by less has not jumped, however short the time."""


class CameraMonitor:
    """What is remembered of one camera.

    Args:
        name: of the camera.
        config: thresholds.
    """

    def __init__(self, name: str, config: WatchdogConfig) -> None:
        self.name = name
        self._config = config
        self._arrivals: deque[int] = deque(maxlen=MAX_ARRIVALS)
        self._last: FrameStats | None = None
        self._active_since_ns: int | None = None
        self._since_ns: dict[Fault, int] = {}  # arrival at which a bad image was first seen
        self._jumped_ns: dict[Fault, int] = {}
        self._step = StepWatch(config.step_ratio)
        self._views = ViewWatch(config.doubt_limit)

    def observe(self, stats: FrameStats) -> bool:
        """Take one frame; returns whether it may go into the map."""
        last = self._last
        fit = last is None or not self._stamp_jumped(stats, last)
        found = image_faults(stats, last, self._config) | {Fault.OUT_OF_STEP: self._out_of_step(stats, last)}
        for fault, bad in found.items():
            if fault == Fault.JUMPED_POSE:  # over with the next image, and told for a while
                self._jumped_ns |= {fault: stats.arrival_ns} if bad else {}
            elif not bad:
                self._since_ns.pop(fault, None)
            elif fault == Fault.FROZEN and last is not None:
                self._since_ns.setdefault(fault, last.arrival_ns)
            else:
                self._since_ns.setdefault(fault, stats.arrival_ns)
            fit = fit and not bad
        if fit:
            self._views.add(stats)
        if last is not None and stats.arrival_ns - last.arrival_ns > in_ns(self._config.stopped_s):
            self._begin(stats.arrival_ns)  # it had stopped, which was said; its rate counts from now
        self._last = stats
        self._arrivals.append(stats.arrival_ns)
        while self._arrivals[0] < stats.arrival_ns - in_ns(self._span_s):
            self._arrivals.popleft()
        return fit

    def _stamp_jumped(self, stats: FrameStats, last: FrameStats) -> bool:
        ahead_ns = (stats.stamp_ns - last.stamp_ns) - (stats.arrival_ns - last.arrival_ns)
        if stats.stamp_ns <= last.stamp_ns:
            self._jumped_ns[Fault.JUMPED_BACK] = stats.arrival_ns
        elif ahead_ns > in_ns(self._config.jump_s):
            self._jumped_ns[Fault.JUMPED_AHEAD] = stats.arrival_ns
        else:
            return False
        return True

    def observe_mask(self, unfamiliar: bool, arrival_ns: int) -> None:
        """Take whether the segmenter knows images such as the one that arrived then.

        A frame that never came to be segmented says nothing of it: black and unfamiliar may alternate.
        """
        if unfamiliar:
            self._since_ns.setdefault(Fault.UNFAMILIAR, arrival_ns)
        else:
            self._since_ns.pop(Fault.UNFAMILIAR, None)

    def observe_ground(self, T_map_camera: Pose, slope: tuple[float, float]) -> None:
        """Take the ground that a frame has shown, as (dz/dx, dz/dy) in the map."""
        self._views.add_ground(T_map_camera, slope)

    def _out_of_step(self, stats: FrameStats, last: FrameStats | None) -> bool:
        return self._step.add(None if last is None else step_counts(last.edges, stats.edges))

    @property
    def _span_s(self) -> float:
        return self._config.rate_window_s + self._config.rate_reference_s

    def set_active(self, active: bool, now_ns: int) -> None:
        """Say whether the camera is to be running; what it did while it was not is not held against it."""
        if not active:
            self._active_since_ns = None
        elif self._active_since_ns is None:
            self._active_since_ns = now_ns
            self._begin(now_ns)

    def _begin(self, now_ns: int) -> None:
        """Count the rate from now on."""
        self._arrivals.clear()
        if self._active_since_ns is not None:
            self._active_since_ns = now_ns

    def jumped_back(self, now_ns: int) -> None:
        """Take that a frame was refused for its stamp, before anybody looked at it."""
        self._jumped_ns[Fault.JUMPED_BACK] = now_ns

    def restart(self, now_ns: int) -> None:
        """The clock went back: arrivals so far mean nothing."""
        self._last, self._since_ns, self._jumped_ns = None, {}, {}
        self._step = StepWatch(self._config.step_ratio)
        self._views = ViewWatch(self._config.doubt_limit)
        self._begin(now_ns)

    def rate_hz(self, now_ns: int) -> float:
        """Frames a second of the last window, or of the time it has been active."""
        window_ns = in_ns(self._config.rate_window_s)
        count = sum(1 for t in self._arrivals if t > now_ns - window_ns)
        return count * NS / max(1, min(window_ns, now_ns - (self._active_since_ns or 0)))

    def faults(self, now_ns: int) -> Iterable[tuple[Fault, str]]:
        """Faults at a time, with the numbers; nothing while the camera is not active."""
        config, last, active_ns = self._config, self._last, self._active_since_ns
        if active_ns is None:
            return
        came_ns = active_ns if last is None else max(active_ns, last.arrival_ns)
        ahead = last is not None and last.stamp_ns - now_ns > in_ns(config.jump_s)
        if ahead and last is not None:  # two clocks: how old an image is can no longer be told
            yield Fault.JUMPED_AHEAD, f"newest image is of {(last.stamp_ns - now_ns) / NS:.2f} s from now"
        for fault, at_ns in self._jumped_ns.items():
            if now_ns - at_ns < in_ns(config.hold_s) and not (ahead and fault == Fault.JUMPED_AHEAD):
                yield fault, f"{(now_ns - at_ns) / NS:.2f} s ago"
        if now_ns - came_ns > in_ns(config.stopped_s):
            yield Fault.STOPPED, f"no frame for {(now_ns - came_ns) / NS:.2f} s"
            return
        if last is None or last.arrival_ns < active_ns:
            return
        age_ns = now_ns - last.stamp_ns
        if age_ns > in_ns(config.stale_s):
            yield Fault.STALE, f"newest image is {age_ns / NS:.2f} s old"
        for fault, since_ns in self._since_ns.items():
            if now_ns - since_ns >= in_ns(_needed_s(fault, config)):
                yield fault, f"for {(now_ns - since_ns) / NS:.2f} s"
        yield from self._views.doubts().items()
        yield from self._rate_faults(now_ns, active_ns)

    def _rate_faults(self, now_ns: int, active_ns: int) -> Iterable[tuple[Fault, str]]:
        config = self._config
        window_ns, reference_ns = in_ns(config.rate_window_s), in_ns(config.rate_reference_s)
        if now_ns - active_ns < window_ns:
            return
        rate = self.rate_hz(now_ns)
        if rate < config.min_rate_hz:
            yield Fault.SLOW, f"{rate:.1f} frames/s, expected at least {config.min_rate_hz:g}"
        start_ns = max(active_ns, now_ns - window_ns - reference_ns)
        if now_ns - window_ns - start_ns < window_ns:
            return
        before = sum(1 for t in self._arrivals if start_ns < t <= now_ns - window_ns)
        before_hz = before * NS / (now_ns - window_ns - start_ns)
        if rate < config.falling_share * before_hz:
            yield Fault.FALLING_RATE, f"{rate:.1f} frames/s, {before_hz:.1f} before"


def _needed_s(fault: Fault, config: WatchdogConfig) -> float:
    """How long an image must be faulty before it is said."""
    if fault == Fault.FROZEN:
        return config.frozen_s or 0
    return config.unfamiliar_s if fault == Fault.UNFAMILIAR else config.image_s


def image_faults(stats: FrameStats, last: FrameStats | None, config: WatchdogConfig) -> dict[Fault, bool]:
    """Faults of an image itself; what is black or without depth is named so, not frozen.

    Args:
        stats: of the frame.
        last: of the frame before it; None = there is none.
        config: thresholds.
    """
    black, blind = stats.bright_level < config.black_level, stats.depth_share < config.min_depth_share
    same = last is not None and (
        (not black and stats.color_print == last.color_print)
        or (not blind and stats.depth_print == last.depth_print)
    )
    return {
        Fault.BLACK: black,
        Fault.NO_DEPTH: blind,
        Fault.FLIPPED: stats.upside_down is True,
        Fault.FROZEN: same and config.frozen_s is not None,
        Fault.JUMPED_POSE: last is not None and _pose_jumped(stats, last, config.pose_speed_mps),
    }


def _pose_jumped(stats: FrameStats, last: FrameStats, speed_mps: float | None) -> bool:
    """Whether the camera went farther between two images than a robot can; without stamps it did not."""
    a, b, passed_ns = last.position_m, stats.position_m, stats.stamp_ns - last.stamp_ns
    if speed_mps is None or a is None or b is None or passed_ns <= 0:
        return False
    away_m = math.dist(a, b)
    return away_m > POSE_SLACK_M and away_m > speed_mps * passed_ns / NS
