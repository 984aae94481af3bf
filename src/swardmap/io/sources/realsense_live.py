"""Frames of a live RealSense camera, without ROS: `realsense:` or `realsense:SERIAL` (docs/live.md).

An endless source, until `stop()`. A camera that was unplugged is opened anew when it comes back. If no image
could be used for `camera.reconnect_s` it is lost: before the first frame that is an InputError; later the
frames end, and `lost` says why, so that what was made of them can be kept.
"""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from threading import Event
from typing import Any

from swardmap.config import CameraConfig, CloudConfig, Config, SourceConfig
from swardmap.errors import InputError, InvalidValueError, require
from swardmap.io.bags.rosbag import REASON_DAMAGED
from swardmap.io.sources.pairing import REASON_COLOR, REASON_ORDER
from swardmap.io.sources.realsense_camera import RealsenseCamera, Shot, finder
from swardmap.io.sources.source import Tally, tally_facts
from swardmap.types import Frame

SLICE_S = 0.2
"""The longest wait in one call of the SDK, in which Ctrl-C is not heard."""

REASON_MISSED = "image the camera took and nobody fetched in time"

APT_HINT = "On Debian it needs: apt-get install libusb-1.0-0"

Find = Callable[[str | None], Any]
"""From a serial number, or None for the only camera, to its device; None if it is not there."""

_log = logging.getLogger(__name__)


def open_live(address: str, config: Config) -> "RealsenseSource":
    """Open the camera with a serial number, or the only one for an empty address.

    Raises:
        MissingExtraError: without pyrealsense2.
        InputError: if it is not there, more than one could be meant, or it cannot stream as configured.
    """
    if "," in address:
        raise InputError(
            f"realsense:{address}: expected one camera; frames of several belong into one map only by their "
            "poses, so several are for the ROS node and its rig file (docs/robot.md)"
        )
    rs = require("pyrealsense2", "realsense", APT_HINT)
    serial = address or config.camera.serial
    return RealsenseSource(rs, finder(rs), config.source, config.camera, serial, config.cloud)


class RealsenseSource:
    """Frames of a camera as they come; see `swardmap.io.FrameSource`.

    Attributes:
        name: model and serial number.
        frame_count, label_set: None: nobody knows when it ends, and a camera knows no truth.
        tally: of the last iteration so far.
        lost: why the camera stopped giving images; empty if it did not.

    Args:
        rs: the module pyrealsense2.
        find: gives the device.
        source: which frames, and how far colour and depth may be apart in time.
        camera: sizes, rate, filters, alignment, patience.
        serial: of the camera; None = the only one, and that one again after unplugging.
        cloud: the filter for flying pixels, which comes before depth is aligned.

    Raises:
        InputError: if the camera is not there or cannot stream as configured.
    """

    frame_count = None
    label_set = None

    def __init__(
        self,
        rs: Any,
        find: Find,
        source: SourceConfig,
        camera: CameraConfig,
        serial: str | None = None,
        cloud: CloudConfig | None = None,
    ) -> None:
        self._rs, self._find, self._serial = rs, find, serial
        self._source, self._config, self._cloud = source, camera, cloud or CloudConfig()
        self.tally = Tally()
        self._stopped = Event()
        self.lost = ""
        with_it = self._open()  # now, so that what is wrong is told before any work
        self.name, self._serial = with_it.title, with_it.serial if serial is None else serial
        self._waiting: RealsenseCamera | None = with_it

    @property
    def skipped(self) -> dict[str, int]:
        """Images left out by the last iteration so far, by reason."""
        return {reason: count for reason, count in self.tally.skipped.items() if count}

    @property
    def facts(self) -> dict[str, Any]:
        """What was left out by the last iteration so far, the first of each reason in full."""
        return tally_facts(self.tally)

    def stop(self) -> None:
        """End the iteration after the frame in progress; may be called from a signal handler or a thread."""
        self._stopped.set()

    def close(self) -> None:
        """Let go of a camera that was opened and never iterated."""
        if self._waiting is not None:
            self._waiting.close()
            self._waiting = None

    def __iter__(self) -> Iterator[Frame]:
        """Yield frames until `stop`; what cannot be used is counted, never guessed.

        Raises:
            InputError: if the camera gives no image at all.
        """
        self.tally, self.lost = Tally(), ""
        count = 0
        try:
            for frame in self._frames():
                yield frame
                count += 1
        except InputError as error:
            if not count:
                raise
            self.lost = str(error)
            _log.error("%s", error)

    def _frames(self) -> Iterator[Frame]:
        index, last_ns, heard = 0, -1, time.monotonic()
        while not self._stopped.is_set():
            self._give_up_after(heard)
            camera, clock = self._connected(heard), _Clock()  # unplugged, a camera's clock starts anew
            if camera is None:
                return
            missed_before = self.tally.skipped[REASON_MISSED]
            with closing(camera):
                for shot in self._shots(camera):
                    self.tally.skipped[REASON_MISSED] = missed_before + camera.missed
                    stamp_ns = clock.stamp_ns(shot, time.time_ns())
                    frame = self._frame(camera, shot, stamp_ns, last_ns, index)
                    if frame is None:
                        self._give_up_after(heard)
                        continue
                    if self._source.stop is not None and index >= self._source.stop:
                        return
                    if index >= self._source.start and (index - self._source.start) % self._source.every == 0:
                        yield frame
                    # the work between frames is no silence
                    index, last_ns, heard = index + 1, stamp_ns, time.monotonic()

    def _frame(
        self, camera: RealsenseCamera, shot: Shot, stamp_ns: int, last_ns: int, index: int
    ) -> Frame | None:
        if abs(shot.time_ms - shot.depth_time_ms) > self._source.pair_tolerance_ms:
            self.tally.skipped[REASON_COLOR] += 1
            return None
        if stamp_ns <= last_ns:
            self.tally.skipped[REASON_ORDER] += 1
            return None
        try:
            return camera.frame(shot, stamp_ns, f"{index:06d}")
        except (InputError, InvalidValueError) as error:
            self.tally.skip(REASON_DAMAGED, str(error))
            return None

    def _shots(self, camera: RealsenseCamera) -> Iterator[Shot]:
        """Pairs of images until the camera is gone, falls silent, or `stop`."""
        heard = time.monotonic()
        while not self._stopped.is_set():
            try:
                taken = camera.take(SLICE_S)
            except RuntimeError as error:
                _log.warning("%s: %s", self.name, " ".join(str(error).split()))
                return
            if isinstance(taken, Shot):
                yield taken
                heard = time.monotonic()
                continue
            if taken is not None:
                self.tally.skipped[taken] += 1
            silent_s = time.monotonic() - heard
            if silent_s > self._config.timeout_s or not camera.is_connected:
                _log.warning("%s: no images for %.1f s, opening it anew", self.name, silent_s)
                return

    def _connected(self, heard: float) -> RealsenseCamera | None:
        """The camera, streaming; waits for it to come back. None after `stop`."""
        if self._waiting is not None:
            camera, self._waiting = self._waiting, None
            return camera
        while not self._stopped.is_set():
            try:
                return self._open()
            except InputError as error:
                self._give_up_after(heard, str(error))
            self._stopped.wait(SLICE_S)
        return None

    def _open(self) -> RealsenseCamera:
        device = self._find(self._serial)
        if device is None:
            who = f"RealSense camera {self._serial}" if self._serial else "RealSense camera"
            raise InputError(
                f"no {who} is connected. `swardmap doctor` lists what the SDK sees; on Linux its udev rules "
                "must be installed"
            )
        return RealsenseCamera(self._rs, device, self._config, self._cloud)

    def _give_up_after(self, heard: float, why: str = "") -> None:
        silent_s = time.monotonic() - heard
        if silent_s > self._config.reconnect_s:
            left_out = ", ".join(f"{n} x {reason}" for reason, n in self.skipped.items())
            raise InputError(
                f"{self.name}: no image that can be used for {silent_s:.0f} s (camera.reconnect_s). "
                + (why or f"Left out: {left_out}")
            )


class _Clock:
    """Time of an image in nanoseconds since 1970.

    The SDK's global and system time are that already. The hardware clock of a camera starts anywhere: it
    is tied to the computer's clock by the first image that shows it.
    """

    def __init__(self) -> None:
        self._domain, self._offset_ns = "", 0

    def stamp_ns(self, shot: Shot, now_ns: int) -> int:
        time_ns = round(shot.time_ms * 1e6)
        if shot.domain != "hardware_clock":
            self._domain = shot.domain
            return time_ns
        if self._domain != shot.domain:
            self._domain, self._offset_ns = shot.domain, now_ns - time_ns
        return time_ns + self._offset_ns
