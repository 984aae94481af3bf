"""From the messages of one camera to frames: pairing, calibration, decoding; ROS itself is not needed.

Messages are read by attribute, so that those of rclpy and of rosbags do alike. Everything heavy happens in
`build_frame`, which the worker calls; the callbacks only sort.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from swardmap.config import CloudConfig, SourceConfig
from swardmap.geometry import Pose
from swardmap.io.bags.depth_view import DepthView
from swardmap.io.bags.ros_camera import Calibration, calibration_from_camera_info
from swardmap.io.bags.ros_messages import stamp_ns
from swardmap.io.bags.topics import ImageTopic
from swardmap.io.sources.pairing import COLOR, DEPTH, Pair, Pairer
from swardmap.rig.rig import RigCamera
from swardmap.types import Frame

WAITING_IMAGES = 15
"""Images held of each stream while the other is silent: half a second of a fast camera."""

LATEST_PAIRS = 3000
"""Of so many it is told how far colour and depth are apart: 100 s at 30 Hz."""

SAME_PIXEL = 1e-3
"""Cameras whose numbers differ by less are the same."""

REASON_INFO = "image without CameraInfo"

DEFAULT_COLOR, DEFAULT_DEPTH = "color/image_raw", "depth/image_raw"
"""Topics of a camera that names none, relative to the node's namespace: to be remapped."""


@dataclass(frozen=True, slots=True)
class CameraTopics:
    """Where the messages of one camera come from; compressed images by the end of the topic's name."""

    color: str
    depth: str
    color_info: str
    depth_info: str


def camera_topics(config: SourceConfig, camera: RigCamera | None = None) -> CameraTopics:
    """Topics of a camera of a rig, or of the only camera.

    Args:
        config: names of the topics where there is no rig.
        camera: of the rig, or None. Without names of its own its topics are NAME/color/image_raw and
            NAME/depth/image_raw; CameraInfo is beside the image unless it is named.
    """
    named = config if camera is None else camera
    prefix = "" if camera is None else f"{camera.name}/"
    color = named.color_topic or f"{prefix}{DEFAULT_COLOR}"
    depth = named.depth_topic or f"{prefix}{DEFAULT_DEPTH}"
    return CameraTopics(
        color, depth, named.color_info_topic or _beside(color), named.depth_info_topic or _beside(depth)
    )


def _beside(topic: str) -> str:
    """CameraInfo lies beside the raw image; image_transport puts its topics below that."""
    for suffix in ("/compressed", "/compressedDepth"):
        topic = topic.removesuffix(suffix)
    folder, slash, _ = topic.rpartition("/")
    return f"{folder}{slash}camera_info"


def is_compressed(topic: str) -> bool:
    """Whether a topic has CompressedImage, by its name."""
    return topic.endswith(("/compressed", "/compressedDepth"))


@dataclass(frozen=True, slots=True)
class Arrived:
    """A message, and when it came."""

    message: Any
    arrival_ns: int


class LivePairer:
    """Pairs colour and depth as `Pairer` does, but gives pairs of equal stamps at once.

    Nothing can be nearer than equal, so they are the pairs that `Pairer` would give; it would wait for the
    next image to be sure. Cameras that align depth stamp both images alike.

    Args:
        tolerance_ns: largest distance in time.
    """

    def __init__(self, tolerance_ns: int) -> None:
        self._pairer = Pairer[Arrived](tolerance_ns, WAITING_IMAGES)
        self._newest: dict[str, tuple[int, Arrived]] = {}
        self._given_ns: int | None = None

    @property
    def skipped(self) -> dict[str, int]:
        """Images left out, by reason."""
        return self._pairer.skipped

    @property
    def first(self) -> dict[str, str]:
        """The first of each reason in full."""
        return self._pairer.first

    def add(self, kind: str, stamp: int, item: Arrived) -> Iterator[Pair[Arrived]]:
        """Take the next image of one stream; yield the pairs that are now certain, in order of time."""
        before = self._newest.get(kind)
        for pair in self._pairer.add(kind, stamp, item):
            if self._given_ns is None or pair.stamp_ns > self._given_ns:
                self._given_ns = pair.stamp_ns
                yield pair
        if before is not None and stamp <= before[0]:
            return
        self._newest[kind] = (stamp, item)
        color, depth = self._newest.get(COLOR), self._newest.get(DEPTH)
        if color and depth and color[0] == depth[0] and (self._given_ns is None or stamp > self._given_ns):
            self._given_ns = stamp
            yield Pair(stamp, color[1], depth[1], stamp)


@dataclass(frozen=True, slots=True)
class CameraPair:
    """Two images that belong together, and the cameras they were taken with; not decoded yet.

    Attributes:
        camera: name.
        stamp_ns: of the colour image.
        arrival_ns: when the later of the two came.
        color, depth: messages.
        color_frame: optical frame whose pose is asked for: `source.camera_frame`, or that of the image.
        header_frames: of the colour and of the depth image, as they say themselves.
        color_camera, depth_camera: calibrations at that time.
    """

    camera: str
    stamp_ns: int
    arrival_ns: int
    color: Any
    depth: Any
    color_frame: str
    header_frames: tuple[str, str]
    color_camera: Calibration
    depth_camera: Calibration


class CameraInput:
    """Sorts what comes from one camera.

    Args:
        name: of the camera.
        topics: where its messages come from.
        config: pairing tolerance, unit of depth.
    """

    def __init__(
        self, name: str, topics: CameraTopics, config: SourceConfig, cloud: CloudConfig | None = None
    ) -> None:
        self.name, self.topics = name, topics
        self.without_info = 0
        self.offsets_ns = deque[int](maxlen=LATEST_PAIRS)
        self._config = config
        unit_m = config.depth_unit_m
        self._view = DepthView(topics.depth, cloud or CloudConfig(), unit_m or 0.001, unit_m)
        self._color = ImageTopic(topics.color, is_compressed(topics.color), "", topics.color_info)
        self._depth = ImageTopic(topics.depth, is_compressed(topics.depth), "", topics.depth_info)
        self._calibrations: dict[str, tuple[bytes, Calibration]] = {}
        self._pairer = self._new_pairer()

    @property
    def skipped(self) -> dict[str, int]:
        """Images left out, by reason."""
        return {**self._pairer.skipped, REASON_INFO: self.without_info}

    @property
    def first(self) -> dict[str, str]:
        """The first of each reason in full, since the clock went back last."""
        return self._pairer.first

    @property
    def is_aligned(self) -> bool:
        """Whether the depth topic says of itself that it is in the pixels of the colour image."""
        return self._depth.aligned

    def configure(self, cloud: CloudConfig) -> None:
        """Filter flying pixels by other settings from the next frame on."""
        self._view.cloud = cloud

    def restart(self) -> None:
        """The clock of the camera went back: what came before it cannot be paired."""
        self._pairer = self._new_pairer()

    def add_info(self, kind: str, message: Any) -> None:
        """Take a CameraInfo; one that says the same as before costs nothing.

        Raises:
            InputError: if the camera is not calibrated, or its lens model is not supported.
        """
        print_ = _info_print(message)
        if kind in self._calibrations and self._calibrations[kind][0] == print_:
            return
        topic = self._color if kind == COLOR else self._depth
        calibration = calibration_from_camera_info(message, topic.rectified, topic.info or "")
        self._calibrations[kind] = (print_, calibration)

    def add_image(self, kind: str, message: Any, arrival_ns: int) -> Iterator[CameraPair]:
        """Take an image; yield what can now be mapped, once both cameras are known."""
        for pair in self._pairer.add(kind, stamp_ns(message.header.stamp), Arrived(message, arrival_ns)):
            self.offsets_ns.append(abs(pair.depth_stamp_ns - pair.stamp_ns))
            color, depth = pair.color.message, pair.depth.message
            headers = color.header.frame_id.strip("/"), depth.header.frame_id.strip("/")
            cameras = self._cameras(headers[0] == headers[1])
            if cameras is None:
                self.without_info += 1
                continue
            came_ns = max(pair.color.arrival_ns, pair.depth.arrival_ns)
            yield CameraPair(
                self.name, pair.stamp_ns, came_ns, color, depth,
                (self._config.camera_frame or headers[0]).strip("/"), headers, *cameras,
            )  # fmt: skip

    def build_frame(self, pair: CameraPair, T_map_camera: Pose | None, T_color_depth: Pose | None) -> Frame:
        """Decode, rectify and align a pair: what takes time.

        Args:
            pair: of this camera.
            T_map_camera: its pose at the image stamp; None = not known.
            T_color_depth: where depth is seen from; None = in the pixels of the colour image.

        Raises:
            InputError: if an image cannot be decoded, or has another size than its CameraInfo.
        """
        rgb = pair.color_camera.rectify_color(self._color.color(pair.color))
        color, name = pair.color_camera.intrinsics, f"{self.name}:{pair.stamp_ns}"
        camera = pair.depth_camera
        if T_color_depth is None and not _same_pixels(pair):
            if self.is_aligned and _same_size(pair):  # some drivers publish the depth sensor's CameraInfo
                camera = pair.color_camera
            else:
                T_color_depth = Pose.identity("color", "depth")
        depth = self._view.in_metres(self._depth.depth(pair.depth))
        depth, filtered = self._view.in_color_view(depth, camera, color, T_color_depth)
        unit_m = self._view.unit_m
        return Frame(
            pair.stamp_ns, color, rgb, depth, unit_m, T_map_camera, name=name, depth_filtered=filtered
        )

    def _cameras(self, same_view: bool) -> tuple[Calibration, Calibration] | None:
        color, depth = self._calibrations.get(COLOR), self._calibrations.get(DEPTH)
        if depth is None and (same_view or self.is_aligned):
            depth = color
        return None if color is None or depth is None else (color[1], depth[1])

    def _new_pairer(self) -> LivePairer:
        return LivePairer(round(self._config.pair_tolerance_ms * 1e6))


def _info_print(message: Any) -> bytes:
    """What of a CameraInfo the calibration depends on."""
    roi = message.roi
    numbers = np.array(
        [message.width, message.height, message.binning_x, message.binning_y, roi.x_offset, roi.y_offset,
         roi.width, roi.height, *message.k, *message.d, *message.p], np.float64,
    )  # fmt: skip
    return numbers.tobytes() + str(message.distortion_model).encode()


def _same_size(pair: CameraPair) -> bool:
    a, b = pair.color_camera.intrinsics, pair.depth_camera.intrinsics
    return (a.width, a.height) == (b.width, b.height)


def _same_pixels(pair: CameraPair) -> bool:
    a, b = pair.color_camera.intrinsics, pair.depth_camera.intrinsics
    first, second = ((c.width, c.height, c.fx, c.fy, c.cx, c.cy) for c in (a, b))
    return bool(np.allclose(first, second, rtol=0, atol=SAME_PIXEL))
