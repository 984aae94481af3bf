"""One RealSense camera that streams: its sensors, its lenses, and pairs of images as the SDK pairs them.

Colour and depth go through the SDK's syncer, which keeps the newest pair alone: what a slow reader does
not fetch is dropped, the oldest first, and counted by the numbers the camera gives its images.
"""

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import CameraConfig, CloudConfig
from swardmap.errors import InputError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.bags.depth_filter import without_flying_pixels
from swardmap.io.bags.ros_camera import Calibration
from swardmap.io.sources.pairing import REASON_COLOR, REASON_DEPTH
from swardmap.io.sources.realsense_filters import depth_filters
from swardmap.perception.align import align_depth_to_color
from swardmap.types import Frame

USB_HINT = "On Linux the SDK's udev rules must be installed, and no other program may use the camera."


@dataclass(frozen=True, slots=True)
class Shot:
    """A colour and a depth image that belong together, as the camera gave them.

    Attributes:
        time_ms, depth_time_ms: of the SDK, in the clock named `domain`.
        domain: `global_time` and `system_time` count from 1970, `hardware_clock` from anywhere.
        rgb: (H, W, 3) uint8.
        depth: (h, w) uint16 in units of `unit_m`, filtered.
        camera: of the depth image, with what `swardmap.io.bags.ros_camera` needs to rectify it.
    """

    time_ms: float
    depth_time_ms: float
    domain: str
    rgb: NDArray[np.uint8]
    depth: NDArray[np.uint16]
    unit_m: float
    camera: Calibration


class RealsenseCamera:
    """A camera that streams until `close`.

    Args:
        rs: the module pyrealsense2.
        device: an rs.device, or an rs.software_device.
        config: sizes, rate, filters, alignment, how many pairs wait at most.
        cloud: the filter for flying pixels, which comes before depth is aligned.

    Attributes:
        missed: colour images that were taken and never came here.

    Raises:
        InputError: if it has no such streams, its lens model is not supported, or it cannot be opened.
    """

    def __init__(self, rs: Any, device: Any, config: CameraConfig, cloud: CloudConfig) -> None:
        self._device, self._config, self._cloud = device, config, cloud
        self.title = _title(rs, device)
        self.serial = _info(rs, device, "serial_number")
        self._syncer = rs.syncer(config.queue)
        self._filters = depth_filters(rs, config)
        self._align = rs.align(rs.stream.color) if config.align == "sdk" else None
        self._sensors: list[Any] = []
        self._depth_cameras: dict[str, Calibration] = {}  # kept, for the maps they rectify by
        self._number: int | None = None
        self.missed = 0
        try:
            color, depth = self._profiles(rs, device)
            self.color = _calibration(color[1], f"{self.title}: colour")
            self._T_color_depth = _pose(depth[1].get_extrinsics_to(color[1]))
            self._start([color, depth])
        except RuntimeError as error:
            self.close()
            raise InputError(f"{self.title} cannot be opened: {_line(error)}. {USB_HINT}") from error

    def take(self, timeout_s: float) -> Shot | str | None:
        """The next pair of images; a reason if what came cannot be used; None if nothing came.

        Raises:
            RuntimeError: whatever the SDK finds wrong with the camera.
        """
        came, images = self._syncer.try_wait_for_frames(max(1, round(timeout_s * 1e3)))
        if not came:
            return None
        if images.get_color_frame():
            self._count(images.get_color_frame().get_frame_number())
        if not (images.get_depth_frame() and images.get_color_frame()):
            return REASON_COLOR if images.get_color_frame() else REASON_DEPTH
        for block in [*self._filters, *([self._align] if self._align else [])]:
            images = block.process(images).as_frameset()
        color, depth = images.get_color_frame(), images.get_depth_frame()
        return Shot(
            color.get_timestamp(),
            depth.get_timestamp(),
            color.get_frame_timestamp_domain().name,
            np.array(color.get_data(), np.uint8),  # a copy: the SDK uses its buffers again
            np.array(depth.get_data(), np.uint16),
            float(f"{depth.get_units():.7g}"),  # 0.001 as float32 is 0.0010000000475
            self._depth_camera(depth.profile),
        )

    def frame(self, shot: Shot, stamp_ns: int, name: str) -> Frame:
        """Rectified, and with depth in the pixels of the colour image.

        Raises:
            InputError, InvalidValueError: if an image has not the size of its stream.
        """
        camera, T_color_depth, filtered = self.color.intrinsics, self._T_color_depth, False
        if self._align is not None:
            depth = self.color.rectify_depth(shot.depth)  # the SDK rendered it into the image as taken
        else:
            apart = shot.camera.intrinsics != camera or not np.array_equal(T_color_depth.matrix, np.eye(4))
            filtered = apart and self._cloud.consistent_neighbours > 0
            raw = without_flying_pixels(shot.depth, shot.unit_m, self._cloud) if filtered else shot.depth
            depth = shot.camera.rectify_depth(raw)
            if apart:
                depth = align_depth_to_color(
                    depth, shot.unit_m, shot.camera.intrinsics, camera, T_color_depth
                )
        rgb = self.color.rectify_color(shot.rgb)
        return Frame(stamp_ns, camera, rgb, depth, shot.unit_m, name=name, depth_filtered=filtered)

    @property
    def is_connected(self) -> bool:
        """Whether the SDK still sees it."""
        try:
            return bool(self._device.is_connected())
        except RuntimeError:
            return False

    def close(self) -> None:
        """Stop the streams; a camera that was unplugged cannot complain any more."""
        for sensor in self._sensors:
            for end in (sensor.stop, sensor.close):
                with suppress(RuntimeError):
                    end()
        self._sensors = []

    def _count(self, number: int) -> None:
        """Numbers begin anew where a stream does."""
        if self._number is not None and number > self._number:
            self.missed += number - self._number - 1
        self._number = number

    def _depth_camera(self, profile: Any) -> Calibration:
        """Of a filtered image: decimation makes another camera of it."""
        key = str(profile.as_video_stream_profile().get_intrinsics())
        if key not in self._depth_cameras:
            self._depth_cameras[key] = _calibration(profile, f"{self.title}: depth")
        return self._depth_cameras[key]

    def _profiles(self, rs: Any, device: Any) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        config = self._config
        wanted = (config.width, config.height, config.fps)
        found = {}
        for what, stream, form in (
            ("colour", rs.stream.color, rs.format.rgb8),
            ("depth", rs.stream.depth, rs.format.z16),
        ):
            offered = [
                (sensor, profile.as_video_stream_profile())
                for sensor in device.query_sensors()
                for profile in sensor.get_stream_profiles()
                if profile.stream_type() == stream and profile.format() == form
            ]
            fitting = [pair for pair in offered if _size(pair[1]) == wanted]
            if not fitting:
                sizes = sorted({_size(profile) for _, profile in offered})
                listed = ", ".join(f"{w}x{h} at {fps}" for w, h, fps in sizes) or "none at all"
                raise InputError(
                    f"{self.title} has no {what} stream of {wanted[0]}x{wanted[1]} at {wanted[2]} images a "
                    f"second; it has {listed}. Set camera.width, camera.height and camera.fps."
                )
            found[what] = fitting[0]
        return found["colour"], found["depth"]

    def _start(self, chosen: Iterable[tuple[Any, Any]]) -> None:
        """Open the sensors; one sensor may give both streams (D405), and takes them in one call."""
        by_sensor: dict[str, tuple[Any, list[Any]]] = {}
        for sensor, profile in chosen:
            by_sensor.setdefault(sensor.name, (sensor, []))[1].append(profile)
        for sensor, profiles in by_sensor.values():
            sensor.open(profiles)
            self._sensors.append(sensor)
            sensor.start(self._syncer)


def finder(rs: Any) -> Callable[[str | None], Any]:
    """A function that finds a connected camera by its serial number, or the only one for None.

    It returns None if that camera is not there, and raises InputError if more than one could be meant.
    """
    context = rs.context()

    def find(serial: str | None) -> Any:
        devices = list(context.query_devices())
        if serial is not None:
            return next((d for d in devices if _info(rs, d, "serial_number") == serial), None)
        if len(devices) > 1:
            listed = ", ".join(_info(rs, d, "serial_number") for d in devices)
            raise InputError(
                f"{len(devices)} RealSense cameras are connected: name one as realsense:SERIAL, of {listed}"
            )
        return devices[0] if devices else None

    return find


def calibration_of(intrinsics: Any, who: str) -> Calibration:
    """Calibration of an rs.intrinsics.

    Raises:
        InputError: for a lens model other than the polynomial ones.
    """
    model, coefficients = intrinsics.model.name, tuple(map(float, intrinsics.coeffs))
    camera = Intrinsics(
        intrinsics.width, intrinsics.height, intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy
    )
    fisheye = model in ("ftheta", "kannala_brandt4")
    if not fisheye and not any(coefficients):
        return Calibration(camera)
    if model not in ("brown_conrady", "inverse_brown_conrady") or not np.isfinite(coefficients).all():
        raise InputError(
            f"{who}: lens model '{model}' with coefficients {coefficients} is not supported; expected "
            "brown_conrady or inverse_brown_conrady, as the D400 cameras have"
        )
    return Calibration(camera, coefficients, model == "inverse_brown_conrady")


def _calibration(profile: Any, who: str) -> Calibration:
    return calibration_of(profile.as_video_stream_profile().get_intrinsics(), who)


def _pose(extrinsics: Any) -> Pose:
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(extrinsics.rotation, (3, 3)).T  # column by column
    matrix[:3, 3] = extrinsics.translation
    return Pose("color", "depth", matrix)


def _size(profile: Any) -> tuple[int, int, int]:
    return profile.width(), profile.height(), profile.fps()


def _info(rs: Any, device: Any, what: str) -> str:
    key = getattr(rs.camera_info, what)
    return str(device.get_info(key)) if device.supports(key) else "unknown"


def _title(rs: Any, device: Any) -> str:
    return f"{_info(rs, device, 'name')} {_info(rs, device, 'serial_number')}"


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200].rstrip(".")
