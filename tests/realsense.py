"""A camera without a camera: the SDK's own software device, fed by the test."""

import os
import signal
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.io.sources.limited import LimitedSource

rs: Any = pytest.importorskip(
    "pyrealsense2", reason="the camera maker's SDK is the judge", exc_type=ImportError
)

WIDTH, HEIGHT = 64, 48
START_MS = 1.7e12
PERIOD_MS = 100.0 / 3


def intrinsics(fx: float, model: Any = None, coeffs: Sequence[float] = (0,) * 5, size: Any = None) -> Any:
    found = rs.intrinsics()
    found.width, found.height = size or (WIDTH, HEIGHT)
    found.fx = found.fy = fx
    found.ppx, found.ppy = (found.width - 1) / 2, (found.height - 1) / 2
    found.model, found.coeffs = model or rs.distortion.none, list(coeffs)
    return found


class SoftwareCamera:
    """Colour (focal length 50) and depth (60), 15 mm apart, through the SDK's syncer and filters."""

    def __init__(
        self, serial: str = "123", color: Any = None, unit_m: float = 0.001, also: Any = None
    ) -> None:
        self.unit_m = unit_m
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.serial_number, serial)
        self.device.register_info(rs.camera_info.name, "Software D435I")
        self.sensors = {
            "d": self.device.add_sensor("Stereo Module"),
            "c": self.device.add_sensor("RGB Camera"),
        }
        self.sensors["d"].add_read_only_option(rs.option.depth_units, unit_m)
        self.profiles = {
            "d": self._stream("d", rs.stream.depth, rs.format.z16, 2, 0, intrinsics(60.0)),
            "c": self._stream("c", rs.stream.color, rs.format.rgb8, 3, 1, color or intrinsics(50.0)),
        }
        if also is not None:
            self.profiles["C"] = self._stream("c", rs.stream.color, rs.format.rgb8, 3, 2, also)
        place = rs.extrinsics()
        place.rotation, place.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [0.015, 0, 0]
        self.profiles["d"].register_extrinsics_to(self.profiles["c"], place)
        self.device.create_matcher(rs.matchers.default)

    def _stream(self, sensor: str, kind: Any, form: Any, bpp: int, uid: int, camera: Any) -> Any:
        stream = rs.video_stream()
        stream.type, stream.fmt, stream.bpp, stream.uid, stream.index = kind, form, bpp, uid, 0
        stream.width, stream.height, stream.fps, stream.intrinsics = camera.width, camera.height, 30, camera
        return self.sensors[sensor].add_video_stream(stream, uid < 2).as_video_stream_profile()

    def push(self, number: int, time_ms: float, what: str = "dc", domain: str = "global_time") -> None:
        """Give one image of each stream named."""
        for name in what:
            profile = self.profiles[name]
            pixels = depth_image(number) if name == "d" else color_image(number, profile)
            frame = rs.software_video_frame()
            frame.pixels, frame.bpp, frame.stride = pixels, 2 if name == "d" else 3, pixels.strides[0]
            frame.timestamp, frame.frame_number, frame.profile = time_ms, number + 1, profile
            frame.domain = getattr(rs.timestamp_domain, domain)
            if name == "d":
                frame.depth_units = self.unit_m
            self.sensors[name.lower()].on_video_frame(frame)

    def wait_until_streaming(self) -> None:
        while not all(sensor.get_active_streams() for sensor in self.sensors.values()):
            time.sleep(0.005)
        time.sleep(0.05)  # opened; started a moment later


def color_image(number: int, profile: Any = None) -> NDArray[np.uint8]:
    height, width = (profile.height(), profile.width()) if profile else (HEIGHT, WIDTH)
    return np.random.default_rng(number).integers(0, 255, (height, width, 3), dtype=np.uint8)


def depth_image(number: int) -> NDArray[np.uint16]:
    """A wall at 1 m + 1 mm an image, with a hole in the middle."""
    wall = np.full((HEIGHT, WIDTH), 1000 + number, np.uint16)
    wall[20:28, 28:36] = 0
    return wall


def feeding(make: Callable[[], SoftwareCamera], feed: Callable[[SoftwareCamera], None]) -> Any:
    """A `find` whose camera gives what `feed` pushes, from when it streams on."""
    cameras = []

    def find(_: str | None) -> Any:
        camera = make()
        cameras.append(camera)  # kept alive

        def run() -> None:
            camera.wait_until_streaming()
            feed(camera)

        threading.Thread(target=run, daemon=True).start()
        return camera.device

    return find


def steady(count: int, start_ms: float = START_MS, first: int = 0) -> Callable[[SoftwareCamera], None]:
    """Feed `count` pairs; the SDK's syncer gives the images of the first one apart, then pairs."""

    def feed(camera: SoftwareCamera) -> None:
        for number in range(first, first + count):
            camera.push(number, start_ms + number * PERIOD_MS)

    return feed


def plug_in(
    monkeypatch: pytest.MonkeyPatch, feed: Callable[[SoftwareCamera], None], serial: str = "123"
) -> None:
    """Let `realsense:` mean a software camera with a serial number, for as long as the test runs."""
    find = feeding(lambda: SoftwareCamera(serial), feed)
    found = lambda wanted: find(wanted) if wanted in (None, serial) else None  # noqa: E731
    monkeypatch.setattr("swardmap.io.sources.realsense_live.finder", lambda _: found)


def ctrl_c_after(
    monkeypatch: pytest.MonkeyPatch, frames: int, feed: Callable[[SoftwareCamera], None]
) -> Callable[[SoftwareCamera], None]:
    """A feed that presses Ctrl-C once a command has taken so many frames."""
    made: list[LimitedSource] = []
    init = LimitedSource.__init__

    def remembered(self: LimitedSource, *arguments: Any) -> None:
        init(self, *arguments)
        made.append(self)

    def then(camera: SoftwareCamera) -> None:
        feed(camera)
        while made[0].given < frames:
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(LimitedSource, "__init__", remembered)
    return then


SETTINGS = ["--set", f"camera.width={WIDTH}", "--set", f"camera.height={HEIGHT}"]
"""For a command line: streams as the software camera has them."""
