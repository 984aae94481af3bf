"""Watches cameras, pose, queues and map, and names what is wrong. No threads and no clock: time is passed in.

All times are integer nanoseconds of one clock, the one the image stamps are of. docs/watchdog.md lists the
faults, what each is told by, and what cannot be told.
"""

from collections import deque
from collections.abc import Collection, Iterable

from swardmap.config import WatchdogConfig
from swardmap.errors import InvalidValueError
from swardmap.health import WARNINGS, Diagnosis, Fault, FrameStats, HealthReport, Latency, Severity

NS = 1_000_000_000
MAX_LATENCIES = 4096
MAX_ARRIVALS = 16384


def _ns(seconds: float) -> int:
    return round(seconds * NS)


class CameraWatch:
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

    def observe(self, stats: FrameStats) -> bool:
        """Take one frame; returns whether it may go into the map."""
        last, fit = self._last, True
        if last is not None:
            ahead_ns = (stats.stamp_ns - last.stamp_ns) - (stats.arrival_ns - last.arrival_ns)
            if stats.stamp_ns <= last.stamp_ns:
                self._jumped_ns[Fault.JUMPED_BACK], fit = stats.arrival_ns, False
            elif ahead_ns > _ns(self._config.jump_s):
                self._jumped_ns[Fault.JUMPED_AHEAD], fit = stats.arrival_ns, False
        for fault, bad in self._looks(stats, last).items():
            if bad:
                frozen = fault == Fault.FROZEN and last is not None
                self._since_ns.setdefault(fault, last.arrival_ns if frozen and last else stats.arrival_ns)
            else:
                self._since_ns.pop(fault, None)
            fit = fit and not bad
        self._last = stats
        self._arrivals.append(stats.arrival_ns)
        while self._arrivals[0] < stats.arrival_ns - _ns(self._span_s):
            self._arrivals.popleft()
        return fit

    @property
    def _span_s(self) -> float:
        return self._config.rate_window_s + self._config.rate_reference_s

    def _looks(self, stats: FrameStats, last: FrameStats | None) -> dict[Fault, bool]:
        """Faults of the image itself; what is black or without depth is named so, not frozen."""
        config = self._config
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
        }

    def set_active(self, active: bool, now_ns: int) -> None:
        """Say whether the camera is to be running; what it did while it was not is not held against it."""
        if active and self._active_since_ns is None:
            self._active_since_ns = now_ns
            self._arrivals.clear()
        elif not active:
            self._active_since_ns = None

    def restart(self, now_ns: int) -> None:
        """The clock went back: arrivals so far mean nothing."""
        self._arrivals.clear()
        self._last, self._since_ns, self._jumped_ns = None, {}, {}
        if self._active_since_ns is not None:
            self._active_since_ns = now_ns

    def rate_hz(self, now_ns: int) -> float:
        """Frames a second of the last window, or of the time it has been active."""
        window_ns = _ns(self._config.rate_window_s)
        count = sum(1 for t in self._arrivals if t > now_ns - window_ns)
        return count * NS / max(1, min(window_ns, now_ns - (self._active_since_ns or 0)))

    def faults(self, now_ns: int) -> Iterable[tuple[Fault, str]]:
        """Faults at a time, with the numbers; nothing while the camera is not active."""
        config, last, active_ns = self._config, self._last, self._active_since_ns
        if active_ns is None:
            return
        came_ns = active_ns if last is None else max(active_ns, last.arrival_ns)
        ahead = last is not None and last.stamp_ns - now_ns > _ns(config.jump_s)
        if ahead and last is not None:  # two clocks: how old an image is can no longer be told
            yield Fault.JUMPED_AHEAD, f"newest image is of {(last.stamp_ns - now_ns) / NS:.2f} s from now"
        for fault, at_ns in self._jumped_ns.items():
            if now_ns - at_ns < _ns(config.hold_s) and not (ahead and fault == Fault.JUMPED_AHEAD):
                yield fault, f"{(now_ns - at_ns) / NS:.2f} s ago"
        if now_ns - came_ns > _ns(config.stopped_s):
            yield Fault.STOPPED, f"no frame for {(now_ns - came_ns) / NS:.2f} s"
            return
        if last is None or last.arrival_ns < active_ns:
            return
        age_ns = now_ns - last.stamp_ns
        if age_ns > _ns(config.stale_s):
            yield Fault.STALE, f"newest image is {age_ns / NS:.2f} s old"
        for fault, since_ns in self._since_ns.items():
            needed_s = config.frozen_s if fault == Fault.FROZEN else config.image_s
            if now_ns - since_ns >= _ns(needed_s or 0):
                yield fault, f"for {(now_ns - since_ns) / NS:.2f} s"
        yield from self._rate_faults(now_ns, active_ns)

    def _rate_faults(self, now_ns: int, active_ns: int) -> Iterable[tuple[Fault, str]]:
        config = self._config
        window_ns, reference_ns = _ns(config.rate_window_s), _ns(config.rate_reference_s)
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


class Watchdog:
    """Takes what happens, and says at any time what is wrong, whether to stop, and what to forget.

    The stop flag is set from the start; it is taken back once all has been well for `recover_s`.

    Args:
        cameras: names of all cameras.
        config: thresholds.
    """

    def __init__(self, cameras: Collection[str], config: WatchdogConfig | None = None) -> None:
        self._config = config or WatchdogConfig()
        self._cameras = {name: CameraWatch(name, self._config) for name in cameras}
        self._pose_ns: int | None = None
        self._full_since_ns: dict[str, int | None] = {}
        self._latencies: deque[tuple[int, int]] = deque(maxlen=MAX_LATENCIES)
        self._started_ns: int | None = None
        self._last_check_ns: int | None = None
        self._clock_back_ns: int | None = None
        self._sick_ns: int | None = None  # last check with a fault that demands a stop; none after recovery

    def observe_frame(self, camera: str, stats: FrameStats) -> bool:
        """Take one frame of a camera.

        Returns:
            Whether it may go into the map. Not: a stamp that jumped, an image that repeats the one before,
            black, flipped, or without depth. The diagnosis waits, the map does not.

        Raises:
            InvalidValueError: for a camera that was not named.
        """
        if camera not in self._cameras:
            raise InvalidValueError(
                f"watchdog: no camera '{camera}'; it watches {', '.join(self._cameras) or 'none'}"
            )
        return self._cameras[camera].observe(stats)

    def observe_pose(self, stamp_ns: int) -> None:
        """Take the stamp of a pose, or of an image whose pose was found."""
        self._pose_ns = stamp_ns

    def observe_queue(self, name: str, length: int, capacity: int, now_ns: int) -> None:
        """Take the length of a queue."""
        if length < capacity:
            self._full_since_ns[name] = None
        elif self._full_since_ns.get(name) is None:
            self._full_since_ns[name] = now_ns

    def observe_mapped(self, stamp_ns: int, now_ns: int) -> None:
        """Take that an image has just gone into the map."""
        self._latencies.append((now_ns, now_ns - stamp_ns))

    def check(self, now_ns: int, active: Collection[str] | None = None) -> HealthReport:
        """Say what is wrong now.

        Args:
            now_ns: the time.
            active: cameras that are to be running; None = all.
        """
        config = self._config
        if self._started_ns is None:
            self._started_ns = self._sick_ns = now_ns
        if self._last_check_ns is not None and now_ns < self._last_check_ns - _ns(config.jump_s):
            self._restart(now_ns)
        self._last_check_ns = now_ns
        for name, camera in self._cameras.items():
            camera.set_active(active is None or name in active, now_ns)
        diagnoses = tuple(
            Diagnosis(fault, Severity.WARN if fault in WARNINGS else Severity.STOP, subject, message)
            for subject, fault, message in self._found(now_ns)
        )
        sick = any(d.severity == Severity.STOP for d in diagnoses)
        if sick:
            self._sick_ns = now_ns
        elif self._sick_ns is not None and now_ns - self._sick_ns >= _ns(config.recover_s):
            self._sick_ns = None
        stop = self._sick_ns is not None
        age_s = config.forget_s if stop else config.free_age_s
        if stop and config.free_age_s is not None:
            age_s = min(config.forget_s, config.free_age_s)
        rates = {name: camera.rate_hz(now_ns) for name, camera in self._cameras.items()}
        forget_ns = None if age_s is None else now_ns - _ns(age_s)
        return HealthReport(now_ns, diagnoses, stop, forget_ns, rates, self._latency(now_ns))

    def _found(self, now_ns: int) -> Iterable[tuple[str, Fault, str]]:
        config = self._config
        for name, camera in self._cameras.items():
            for fault, message in camera.faults(now_ns):
                yield name, fault, message
        if config.pose_s is not None:
            since_ns = self._started_ns if self._pose_ns is None else self._pose_ns
            age_ns = 0 if since_ns is None else now_ns - since_ns
            if age_ns > _ns(config.pose_s) or age_ns < -_ns(config.jump_s):
                yield "pose", Fault.LOST_POSE, f"the last is {age_ns / NS:.2f} s old"
        for name, full_ns in self._full_since_ns.items():
            if full_ns is not None and now_ns - full_ns >= _ns(config.queue_s):
                yield name, Fault.FULL_QUEUE, f"for {(now_ns - full_ns) / NS:.2f} s"
        if self._clock_back_ns is not None and now_ns - self._clock_back_ns < _ns(config.hold_s):
            yield "clock", Fault.JUMPED_BACK, f"{(now_ns - self._clock_back_ns) / NS:.2f} s ago"

    def _restart(self, now_ns: int) -> None:
        """The clock went back; measured by the old one, everything would look fresh for too long."""
        for camera in self._cameras.values():
            camera.restart(now_ns)
        self._pose_ns, self._started_ns, self._clock_back_ns = None, now_ns, now_ns
        self._full_since_ns.clear()
        self._latencies.clear()

    def _latency(self, now_ns: int) -> Latency | None:
        """Exact percentiles by nearest rank."""
        oldest_ns = now_ns - _ns(self._config.latency_window_s)
        while self._latencies and self._latencies[0][0] < oldest_ns:
            self._latencies.popleft()
        values = sorted(latency for _, latency in self._latencies)
        if not values:
            return None
        p50, p99 = (values[-(-len(values) * share // 100) - 1] for share in (50, 99))
        return Latency(len(values), p50 / 1e6, p99 / 1e6, values[-1] / 1e6)
