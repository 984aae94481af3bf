"""What the drivers of cameras publish by default, by the names in their documentation, maps without a flag.

The table in docs/recordings.md says the same; where these names come from is said there.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.config import SourceConfig
from swardmap.geometry import Intrinsics
from swardmap.io.bags import ros_fields as rf
from swardmap.io.bags.rosbag import open_source
from tests import bags
from tests.bags import IMAGE, Event
from tests.lawn_bags import MS, START_NS, Lawn, mapped, mount, pose

VGA = Intrinsics(640, 480, 520.0, 520.0, 319.5, 239.5)
QVGA = Intrinsics(320, 240, 250.0, 250.0, 160.5, 118.5)
DOCS = Path(__file__).parents[3] / "docs/recordings.md"


def bgra(rgb: Any, stamp: int, frame: str) -> Any:
    fields = rf.image_fields(rgb, stamp, frame)
    pixels = np.dstack([rgb[..., ::-1], np.full(rgb.shape[:2], 255, np.uint8)])
    return {**fields, "encoding": "bgra8", "step": 4 * rgb.shape[1], "data": pixels.reshape(-1)}


def bgr(rgb: Any, stamp: int, frame: str) -> Any:
    fields = rf.image_fields(np.ascontiguousarray(rgb[..., ::-1]), stamp, frame)
    return {**fields, "encoding": "bgr8"}


def metres(depth: Any, stamp: int, frame: str) -> Any:
    return rf.image_fields(np.where(depth > 0, depth / np.float32(1000), np.float32(np.nan)), stamp, frame)


RATIONAL = (0.5, -2.6, 0.001, -0.0003, 1.5, 0.38, -2.4, 1.4)
"""Of the order of an Azure Kinect's colour camera."""


def rational_rays(camera: Intrinsics) -> Any:
    def rays(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
        ideal = cv2.undistortPoints(pixels, camera.matrix, np.array(RATIONAL)).reshape(*u.shape, 2)
        return np.dstack([ideal, np.ones_like(u)])

    return rays


def rational(camera: Intrinsics, stamp: int, frame: str) -> Any:
    return rf.camera_info_fields(camera, stamp, frame, RATIONAL)


def beside(color: str, depth: str) -> tuple[Any, Any]:
    """Static transforms to a colour camera and to a depth camera 5 cm to the left of it."""
    return mount(color), pose(color, depth, (-0.05, 0.0, 0.0))


def realsense() -> Lawn:
    color, depth = "camera_color_optical_frame", "camera_depth_optical_frame"
    return Lawn(
        color_topic="/camera/camera/color/image_raw", depth_topic="/camera/camera/depth/image_rect_raw",
        color_frame=color, depth_frame=depth, camera=VGA, depth_camera=VGA,
        T_color_depth=pose("c", "d", (-0.05, 0.0, 0.0)).matrix, static=beside(color, depth),
    )  # fmt: skip


def realsense_aligned() -> Lawn:
    color = "camera_color_optical_frame"
    return Lawn(
        color_topic="/camera/camera/color/image_raw",
        depth_topic="/camera/camera/aligned_depth_to_color/image_raw",
        color_frame=color, depth_frame=color, camera=VGA, depth_camera=VGA,
    )  # fmt: skip


def depthai() -> Lawn:
    frame = "oak_rgb_camera_optical_frame"
    return Lawn(
        color_topic="/oak/rgb/image_raw", depth_topic="/oak/stereo/image_raw", color=bgr,
        color_frame=frame, depth_frame=frame, camera=VGA, depth_camera=VGA,
    )  # fmt: skip


def zed() -> Lawn:
    frame, node = "zed_left_camera_frame_optical", "/zed/zed_node"
    color, depth = f"{node}/rgb/color/rect/image", f"{node}/depth/depth_registered"
    return Lawn(
        color_topic=color, depth_topic=depth, color_frame=frame, depth_frame=frame, camera=VGA,
        depth_camera=VGA, color=bgra, depth=metres,
        info_topics=(f"{color}/camera_info", f"{depth}/camera_info"),
    )  # fmt: skip


def orbbec() -> Lawn:
    color, depth = "camera_color_optical_frame", "camera_depth_optical_frame"
    return Lawn(
        color_topic="/camera/color/image_raw", depth_topic="/camera/depth/image_raw",
        color_frame=color, depth_frame=depth, camera=VGA, depth_camera=VGA,
        T_color_depth=pose("c", "d", (-0.05, 0.0, 0.0)).matrix, static=beside(color, depth),
    )  # fmt: skip


def azure_kinect() -> Lawn:
    return Lawn(
        color_topic="/rgb/image_raw", depth_topic="/depth_to_rgb/image_raw", color=bgra, depth=metres,
        color_frame="rgb_camera_link", depth_frame="rgb_camera_link", camera=VGA, depth_camera=VGA,
        info=rational, rays=rational_rays(VGA),
        static=beside("rgb_camera_link", "depth_camera_link"),
    )  # fmt: skip


def gazebo() -> Lawn:
    frame = "camera_optical_frame"
    return Lawn(
        color_topic="/camera/image", depth_topic="/camera/depth_image", depth=metres,
        color_frame=frame, depth_frame=frame, camera=VGA, depth_camera=VGA,
    )  # fmt: skip


DRIVERS: dict[str, Callable[[], Lawn]] = {
    "realsense-ros": realsense,
    "realsense-ros, align_depth.enable": realsense_aligned,
    "depthai-ros": depthai,
    "zed-ros2-wrapper": zed,
    "OrbbecSDK_ROS2": orbbec,
    "Azure_Kinect_ROS_Driver": azure_kinect,
    "Gazebo": gazebo,
}


def besides(name: str) -> list[Event]:
    """Images that the driver also publishes, and that are not to be taken."""
    if name != "Azure_Kinect_ROS_Driver":
        return []
    color, depth = np.zeros((240, 320, 3), np.uint8), np.full((240, 320), 1.5, np.float32)
    out: list[Event] = []
    for i in range(6):
        t, frame = START_NS + i * 100 * MS, "depth_camera_link"
        images = (("/rgb_to_depth", bgra(color, t, frame)), ("/depth", rf.image_fields(depth, t, frame)))
        for topic, fields in images:
            out.append((t, f"{topic}/image_raw", IMAGE, fields))
            out.append((t, f"{topic}/camera_info", bags.INFO, rf.camera_info_fields(QVGA, t, frame)))
    return out


@pytest.mark.parametrize("name", DRIVERS)
def test_what_a_driver_publishes_maps_without_flags(tmp_path: Path, name: str) -> None:
    lawn = DRIVERS[name]()
    events = sorted([*lawn.events(), *besides(name)], key=lambda event: event[0])
    path = bags.write_bag(tmp_path, "mcap", events)
    found = mapped(path)
    assert found.frames == 6
    assert found.on_box >= 64
    assert found.elsewhere <= 40  # one-cell lines where two cameras see past the box
    assert found.grass > 2500
    assert found.source.notes == []
    assert found.source.skipped == {}


@pytest.mark.parametrize("name", DRIVERS)
def test_the_table_names_what_is_tested(name: str) -> None:
    lawn, text = DRIVERS[name](), DOCS.read_text(encoding="utf-8")
    (row,) = (line for line in text.splitlines() if line.startswith(f"| {name} |"))
    for word in (lawn.color_topic, lawn.depth_topic, lawn.color_frame, lawn.depth_frame):
        assert f"`{word}`" in row


def test_a_body_frame_of_gazebo_is_asked_about(tmp_path: Path) -> None:
    from swardmap.errors import InputError
    from tests.lawn_bags import down

    frame = "mower/base_link/rgbd_camera"
    body = pose("base_link", frame, (0.2, 0, 0.9), down())
    lawn = gazebo().with_(color_frame=frame, depth_frame=frame, static=(body,))
    path = bags.write_bag(tmp_path, "mcap", lawn.events())
    with pytest.raises(InputError, match=r"looks up.*source\.camera_axes=body"):
        list(open_source(path, SourceConfig()))
