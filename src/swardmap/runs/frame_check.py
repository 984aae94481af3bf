"""Frames of a recording that the node's watchdog would refuse: named, counted, and kept out of the map.

A frozen camera that drives on, a covered lens or an image upside down clears cells that nobody saw. The node
does not map such frames, and neither does a recording. Those that the network does not know clear nothing.
What needs a clock (stopped, stale, slow) cannot be told of a file.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from swardmap.config import WatchdogConfig
from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.monitor.camera_monitor import image_faults
from swardmap.monitor.diagnostics import Fault, FrameStats, frame_stats
from swardmap.monitor.step_watch import StepWatch, step_counts
from swardmap.monitor.view_watch import ViewWatch
from swardmap.types import Frame, Segmentation

CAMERA_HEIGHTS_M = (0.05, 5.0)
"""Of a camera over z = 0 of the map, if that is the ground; else nothing is said of images upside down."""


@dataclass(slots=True)
class FrameCheck:
    """Looks at each frame of one camera before it is mapped.

    Attributes:
        config: thresholds of the watchdog.
        strict: stop at the first frame with a fault.
        faults: how many frames had each fault, by the name that the node uses.
        first: name of the first frame with each fault.
        refused: frames with any that the node does not map either.
        doubts: what was last said of pose, mount or depth, by the fault; such frames are mapped.
    """

    config: WatchdogConfig
    strict: bool = False
    faults: dict[str, int] = field(default_factory=dict)
    first: dict[str, str] = field(default_factory=dict)
    refused: int = 0
    doubts: dict[str, str] = field(default_factory=dict)
    _last: FrameStats | None = None
    _step: StepWatch = field(init=False)
    _views: ViewWatch = field(init=False)

    def __post_init__(self) -> None:
        self._step = StepWatch(self.config.step_ratio)
        self._views = ViewWatch(self.config.doubt_limit)

    def is_fit(self, frame: Frame, T_base_camera: Pose | None = None) -> bool:
        """Whether a frame may go into the map; it is counted where not.

        Args:
            frame: the next of the recording.
            T_base_camera: mount; None = the frame's own pose, if the ground may be its z = 0.

        Raises:
            InputError: if it is not, and `strict` is set.
        """
        stats = frame_stats(frame, frame.stamp_ns, T_base_camera or over_ground(frame.T_map_camera))
        found = [fault for fault, bad in image_faults(stats, self._last, self.config).items() if bad]
        counts = None if self._last is None else step_counts(self._last.edges, stats.edges)
        if self._step.add(counts):
            found.append(Fault.OUT_OF_STEP)
        self._last = stats
        self.refused += bool(found)
        self._count(found, frame)
        if not found:
            self._doubt(self._views.add(stats), frame)
        return not found

    def take_mask(self, frame: Frame, segmentation: Segmentation) -> None:
        """Count a frame that went into the map and cleared nothing, for the network knows no such image.

        Raises:
            InputError: if it is one, and `strict` is set.
        """
        if segmentation.is_unfamiliar(self.config.unfamiliar):
            self._count([Fault.UNFAMILIAR], frame)

    def take_ground(self, frame: Frame, slope: tuple[float, float] | None) -> None:
        """Take the ground that a frame has shown in the map, as (dz/dx, dz/dy); None = none of its own."""
        if frame.T_map_camera is not None and slope is not None:
            self._doubt([Fault.TILTED] * self._views.add_ground(frame.T_map_camera, slope), frame)

    def _doubt(self, found: Sequence[Fault], frame: Frame) -> None:
        """Count a frame that is mapped although pose, mount or depth are in doubt."""
        self._note(found, frame)
        told = self._views.doubts()
        self.doubts |= {str(fault): told[fault] for fault in found if fault in told}

    def _count(self, found: Sequence[Fault], frame: Frame) -> None:
        self._note(found, frame)
        if found and self.strict:
            name = frame.name or str(frame.stamp_ns)
            raise InputError(f"frame {name}: {', '.join(found)} (--strict stops here)")

    def _note(self, found: Sequence[Fault], frame: Frame) -> None:
        for fault in found:
            self.faults[str(fault)] = self.faults.get(str(fault), 0) + 1
            self.first.setdefault(str(fault), frame.name or str(frame.stamp_ns))

    def fit(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """The frames that may go into the map."""
        return (frame for frame in frames if self.is_fit(frame))


DOUBTED = {
    Fault.MOTION: "check the pose, the way the camera is mounted (yaw), and the depth unit",
    Fault.MISALIGNED: "align depth to colour, with the calibration of this camera",
    Fault.TILTED: "check the pitch and roll that the camera is mounted with",
}
"""What a person is to look at."""


def doubt_warnings(watchdog: Mapping[str, Any]) -> list[str]:
    """One line for each doubt of pose, mount or depth.

    Args:
        watchdog: `faults`, `first` and `doubts` of a `FrameCheck`, by these names.
    """
    return [
        f"{fault} (from frame {watchdog['first'][fault]} on, {watchdog['faults'][fault]} frames): "
        f"{watchdog['doubts'][fault]}; {advice}"
        for fault, advice in DOUBTED.items()
        if fault in watchdog["doubts"]
    ]


def over_ground(T_map_camera: Pose | None) -> Pose | None:
    """The pose of a camera if z = 0 of its map may be the ground; else None."""
    if T_map_camera is None:
        return None
    low, high = CAMERA_HEIGHTS_M
    return T_map_camera if low < float(T_map_camera.position_m[2]) < high else None
