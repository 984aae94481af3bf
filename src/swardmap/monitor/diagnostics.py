"""What a watchdog says, and what it looks at in a frame: names of faults, reports, small image statistics."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Intrinsics, Pose
from swardmap.monitor.seen_motion import View, view_of
from swardmap.monitor.step_watch import STEP as EDGE_STEP
from swardmap.monitor.step_watch import EdgeLook, edge_look, ranked
from swardmap.types import Frame, depth_in_metres

SAMPLE_STEP = 4
"""Statistics look at every 4th row and column."""

GROUND_TOLERANCE = 0.15
"""Readings within this share of the depth at which level ground would lie count as ground."""

MIN_GROUND_SHARE = 0.3
"""Share of the readings that must be ground after turning the image over, before it counts as upside down."""


class Severity(IntEnum):
    """As the levels of diagnostic_msgs/DiagnosticStatus: OK, WARN, ERROR; an error demands a stop."""

    OK = 0
    WARN = 1
    STOP = 2


class Fault(StrEnum):
    """What can be wrong, by name."""

    STOPPED = "stopped"
    STALE = "stale"
    SLOW = "slow"
    FALLING_RATE = "falling frame rate"
    FROZEN = "frozen"
    BLACK = "black"
    FLIPPED = "flipped"
    NO_DEPTH = "no depth"
    UNFAMILIAR = "unfamiliar"
    OUT_OF_STEP = "out of step"
    JUMPED_BACK = "stamp jumped back"
    JUMPED_AHEAD = "stamp jumped ahead"
    LOST_POSE = "lost pose"
    FULL_QUEUE = "full queue"
    BLIND = "blind"
    IDLE = "idle"
    IMPLAUSIBLE = "implausible view"
    JUMPED_POSE = "pose jumped"
    TOO_FAR = "too far"
    MOTION = "motion mismatch"
    MISALIGNED = "misaligned"
    TILTED = "tilted ground"


DOUBTS = frozenset({Fault.MOTION, Fault.MISALIGNED, Fault.TILTED})
"""Of pose, mount or depth: told by many frames together, each of which is mapped."""

MAPPED = DOUBTS | {Fault.UNFAMILIAR}
"""Faults of frames that go into the map; an unfamiliar one clears nothing there."""

WARNINGS = DOUBTS | {Fault.SLOW, Fault.FALLING_RATE, Fault.FULL_QUEUE, Fault.BLIND, Fault.IMPLAUSIBLE}
"""Faults that a person is to look at; every other one demands a stop."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """One fault, named.

    Attributes:
        fault: its name.
        severity: WARN or STOP.
        subject: name of the camera or queue, or `pose`, `clock`, `rig` or `map`.
        message: the numbers, for a person.
    """

    fault: Fault
    severity: Severity
    subject: str
    message: str

    @classmethod
    def named(cls, subject: str, fault: Fault, message: str) -> "Diagnosis":
        """A fault with the severity that its kind has."""
        return cls(fault, Severity.WARN if fault in WARNINGS else Severity.STOP, subject, message)


@dataclass(frozen=True, slots=True)
class Latency:
    """From image stamp to map: exact order statistics of a window, in milliseconds."""

    count: int
    p50_ms: float
    p99_ms: float


@dataclass(frozen=True, slots=True)
class HealthReport:
    """What the watchdog says at one time.

    Attributes:
        stamp_ns: of the check.
        diagnoses: every fault there is, by subject.
        stop: whether the robot must stand still; taken back with a delay.
        forget_before_ns: free cells last seen before it must be given as unknown; None = none.
        rates_hz: frames a second of each camera that has given any.
        latency: from image stamp to map; None before the first frame was mapped.
    """

    stamp_ns: int
    diagnoses: tuple[Diagnosis, ...]
    stop: bool
    forget_before_ns: int | None
    rates_hz: Mapping[str, float]
    latency: Latency | None

    @property
    def severity(self) -> Severity:
        """The worst there is."""
        return max((d.severity for d in self.diagnoses), default=Severity.OK)

    def of(self, subject: str) -> tuple[Diagnosis, ...]:
        """Diagnoses of one camera, queue, `pose` or `clock`."""
        return tuple(d for d in self.diagnoses if d.subject == subject)

    def faults(self, subject: str | None = None) -> frozenset[Fault]:
        """Names of the faults, of one subject or all."""
        return frozenset(d.fault for d in self.diagnoses if subject in (None, d.subject))


@dataclass(frozen=True, slots=True)
class FrameStats:
    """The little that the watchdog looks at.

    Attributes:
        stamp_ns: of the image.
        arrival_ns: when it came, by the clock that `check` is asked with.
        bright_level: 99th percentile of the colour image, 0..255.
        depth_share: pixels with a depth reading, 0..1.
        color_print, depth_print: checksums; equal ones are identical images.
        upside_down: whether the ground lies where it would be in an image turned over; None = not judged.
        edges: of colour and depth, to tell whether they are of one time; None = not looked for.
        position_m: of the camera in the map; None = not known.
        view: to tell whether the camera moves as its poses say; None = that cannot be told of it.
    """

    stamp_ns: int
    arrival_ns: int
    bright_level: float
    depth_share: float
    color_print: int
    depth_print: int
    upside_down: bool | None = None
    edges: EdgeLook | None = None
    position_m: tuple[float, float, float] | None = None
    view: View | None = None


def in_ns(seconds: float) -> int:
    """Whole nanoseconds of seconds."""
    return round(seconds * 1e9)


def frame_stats(frame: Frame, arrival_ns: int, T_base_camera: Pose | None = None) -> FrameStats:
    """Statistics of a frame, from every 4th row and column; its edges from every 2nd.

    Args:
        frame: colour and depth.
        arrival_ns: when it came.
        T_base_camera: mount, z = 0 the ground; without it nobody can tell whether the image is flipped.
    """
    step, finer = SAMPLE_STEP, EDGE_STEP
    rgb, raw = frame.rgb[::step, ::step], frame.depth[::step, ::step]
    finer_m = depth_in_metres(frame.depth[::finer, ::finer], frame.depth_unit_m)
    depth_m = finer_m[:: step // finer, :: step // finer]
    flipped = (
        None if T_base_camera is None else is_upside_down(depth_m, frame.intrinsics, T_base_camera, step)
    )
    x, y, z = (0.0,) * 3 if frame.T_map_camera is None else frame.T_map_camera.position_m.tolist()
    return FrameStats(
        frame.stamp_ns,
        arrival_ns,
        percentile_of_bytes(rgb, 99),
        float(np.mean(np.isfinite(depth_m))),
        zlib.crc32(rgb.tobytes()),
        zlib.crc32(raw.tobytes()),
        flipped,
        edge_look(frame.rgb[::finer, ::finer], finer_m),
        None if frame.T_map_camera is None else (x, y, z),
        view_of(frame),
    )


def percentile_of_bytes(values: NDArray[np.uint8], percent: float) -> float:
    """`np.percentile`, to the last digit, in a third of the time."""
    at = percent / 100 * (values.size - 1)
    low, high = (float(v) for v in ranked(values, int(at), min(int(at) + 1, values.size - 1)))
    share = at - int(at)
    return high - (high - low) * (1 - share) if share >= 0.5 else low + (high - low) * share


def is_upside_down(
    depth_m: NDArray[np.float32], intrinsics: Intrinsics, T_base_camera: Pose, step: int = 1
) -> bool:
    """Whether a depth image fits the ground only after it is turned over.

    The mount says at which depth level ground lies in each pixel. If at least 30 % of the readings lie there
    after the image is turned over (by 180 degrees, or top to bottom), and less than half as many as it is,
    the image is upside down. It cannot tell: an image mirrored left to right (level ground looks the same),
    a camera that looks straight down, and a view with little ground in it; these give False.

    Args:
        depth_m: (h, w) every `step`-th row and column of the depth image, NaN = no reading.
        intrinsics: of the whole depth image.
        T_base_camera: mount, z = 0 the ground.
        step: see `depth_m`.
    """
    ray_x, ray_y = intrinsics.ray_tables()
    down_x, down_y, down_z = -T_base_camera.matrix[2, :3]
    fall = (
        down_x * ray_x[None, ::step] + down_y * ray_y[::step, None] + down_z
    )  # metres down, a metre of depth
    height_m = float(T_base_camera.position_m[2])
    ground_m = np.where(fall > 1e-3, height_m / np.maximum(fall, 1e-3), np.inf)
    readings = int(np.count_nonzero(np.isfinite(depth_m)))
    if readings == 0:
        return False

    def share(depth: NDArray[np.float32]) -> float:
        near = np.abs(depth - ground_m) <= GROUND_TOLERANCE * depth  # NaN compares false
        return int(np.count_nonzero(near)) / readings

    turned = max(share(depth_m[::-1, ::-1]), share(depth_m[::-1]))
    return turned >= MIN_GROUND_SHARE and turned > 2 * share(depth_m)
