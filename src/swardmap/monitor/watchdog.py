"""Watches cameras, pose, queues and map, and names what is wrong. No threads and no clock: time is passed in.

All times are integer nanoseconds of one clock, the one the image stamps are of. docs/watchdog.md lists the
faults, what each is told by, and what cannot be told.
"""

from collections import deque
from collections.abc import Collection, Iterable

from swardmap.config import WatchdogConfig
from swardmap.errors import InvalidValueError
from swardmap.geometry import Pose
from swardmap.monitor.camera_monitor import CameraMonitor
from swardmap.monitor.diagnostics import Diagnosis, Fault, FrameStats, HealthReport, Latency, Severity, in_ns
from swardmap.types import Segmentation

NS = 1_000_000_000
MAX_LATENCIES = 4096


class Watchdog:
    """Takes what happens, and says at any time what is wrong, whether to stop, and what to forget.

    The stop flag is set from the start; it is taken back once all has been well for `recover_s`.

    Args:
        cameras: names of all cameras.
        config: thresholds.
    """

    def __init__(self, cameras: Collection[str], config: WatchdogConfig | None = None) -> None:
        self._config = config or WatchdogConfig()
        self._cameras = {name: CameraMonitor(name, self._config) for name in cameras}
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
        return self._camera(camera).observe(stats)

    def observe_mask(self, camera: str, segmentation: Segmentation, arrival_ns: int) -> None:
        """Take the mask of a frame that was observed: whether the segmenter knows such images.

        Args:
            camera: its name.
            segmentation: of the frame; one that cannot tell how familiar the image is counts as familiar.
            arrival_ns: when the frame came.

        Raises:
            InvalidValueError: for a camera that was not named.
        """
        self._camera(camera).observe_mask(segmentation.is_unfamiliar(self._config.unfamiliar), arrival_ns)

    def observe_ground(self, camera: str, T_map_camera: Pose, slope: tuple[float, float]) -> None:
        """Take the ground that a frame of a camera has shown.

        Args:
            camera: its name.
            T_map_camera: pose of the frame.
            slope: (dz/dx, dz/dy) of the ground in the map.

        Raises:
            InvalidValueError: for a camera that was not named.
        """
        self._camera(camera).observe_ground(T_map_camera, slope)

    def observe_refused_stamp(self, camera: str, now_ns: int) -> None:
        """Take that a frame was left out before it could be looked at: its stamp is not after the last.

        Raises:
            InvalidValueError: for a camera that was not named.
        """
        self._camera(camera).jumped_back(now_ns)

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

    def check(
        self, now_ns: int, active: Collection[str] | None = None, others: Iterable[Diagnosis] = ()
    ) -> HealthReport:
        """Say what is wrong now.

        Args:
            now_ns: the time.
            active: cameras that are to be running; None = all.
            others: what the caller knows to be wrong; it counts as what is found here.
        """
        config = self._config
        if self._started_ns is None:
            self._started_ns = self._sick_ns = now_ns
        if self._last_check_ns is not None and now_ns < self._last_check_ns - in_ns(config.jump_s):
            self._restart(now_ns)
        self._last_check_ns = now_ns
        for name, camera in self._cameras.items():
            camera.set_active(active is None or name in active, now_ns)
        found = (Diagnosis.named(*item) for item in self._found(now_ns))
        diagnoses = (*found, *others)
        sick = any(d.severity == Severity.STOP for d in diagnoses)
        if sick:
            self._sick_ns = now_ns
        elif self._sick_ns is not None and now_ns - self._sick_ns >= in_ns(config.recover_s):
            self._sick_ns = None
        stop = self._sick_ns is not None
        age_s = config.forget_s if stop else config.free_age_s
        if stop and config.free_age_s is not None:
            age_s = min(config.forget_s, config.free_age_s)
        rates = {name: camera.rate_hz(now_ns) for name, camera in self._cameras.items()}
        forget_ns = None if age_s is None else now_ns - in_ns(age_s)
        return HealthReport(now_ns, diagnoses, stop, forget_ns, rates, self._latency(now_ns))

    def _camera(self, name: str) -> CameraMonitor:
        if name not in self._cameras:
            raise InvalidValueError(
                f"watchdog: no camera '{name}'; it watches {', '.join(self._cameras) or 'none'}"
            )
        return self._cameras[name]

    def _found(self, now_ns: int) -> Iterable[tuple[str, Fault, str]]:
        config = self._config
        for name, camera in self._cameras.items():
            for fault, message in camera.faults(now_ns):
                yield name, fault, message
        if config.pose_s is not None:
            since_ns = self._started_ns if self._pose_ns is None else self._pose_ns
            age_ns = 0 if since_ns is None else now_ns - since_ns
            if age_ns > in_ns(config.pose_s) or age_ns < -in_ns(config.jump_s):
                yield "pose", Fault.LOST_POSE, f"the last is {age_ns / NS:.2f} s old"
        for name, full_ns in self._full_since_ns.items():
            if full_ns is not None and now_ns - full_ns >= in_ns(config.queue_s):
                yield name, Fault.FULL_QUEUE, f"for {(now_ns - full_ns) / NS:.2f} s"
        if self._clock_back_ns is not None and now_ns - self._clock_back_ns < in_ns(config.hold_s):
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
        oldest_ns = now_ns - in_ns(self._config.latency_window_s)
        while self._latencies and self._latencies[0][0] < oldest_ns:
            self._latencies.popleft()
        values = sorted(latency for _, latency in self._latencies)
        if not values:
            return None
        p50, p99 = (values[-(-len(values) * share // 100) - 1] for share in (50, 99))
        return Latency(len(values), p50 / 1e6, p99 / 1e6)
