"""Depth of a camera of the node is read as that of a recording is: units, sparse grids, whose camera."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.config import SourceConfig, config_from_dict
from swardmap.errors import InputError
from swardmap.geometry import R_BODY_OPTICAL, Intrinsics, Pose
from swardmap.io.bags.ros_fields import camera_info_fields, image_fields
from swardmap.io.bags.rosbag import open_source
from swardmap.io.sources.pairing import COLOR
from swardmap.io.sources.pairing import DEPTH as DEPTH_KIND
from swardmap.ros.camera_poses import CameraPoses
from swardmap.ros.inputs import CameraInput, CameraTopics
from swardmap.ros.parameters import Parameters
from swardmap.types import Frame
from tests import bags
from tests.lawn_bags import CAMERA, DEPTH, OPTICAL, START_NS, Lawn, T_map_base, millimetres, mount, render
from tests.lawn_bags import COLOR as COLOR_TOPIC
from tests.ros import drive

INFO_OF_DEPTH = "/camera/aligned_depth_to_color/camera_info"
FINE = Intrinsics(640, 480, 520.0, 520.0, 319.5, 239.5)


def live(
    depth: NDArray[Any], camera: Intrinsics, depth_camera: Intrinsics | None = None, **settings: Any
) -> Frame:
    """The first image of the lawn as the node makes a frame of it."""
    topics = CameraTopics(COLOR_TOPIC, DEPTH, "/camera/color/camera_info", INFO_OF_DEPTH)
    inputs = CameraInput("camera", topics, SourceConfig(**settings))
    rgb = render(camera, (T_map_base(0) @ mount("c")).matrix)[0]
    for kind, of in ((COLOR, camera), (DEPTH_KIND, depth_camera or camera)):
        inputs.add_info(kind, drive.message(bags.INFO, camera_info_fields(of, START_NS, OPTICAL)))
    pairs: list[Any] = []
    for stamp_ns in (START_NS, START_NS + 10**8):  # a pair is certain when the next image is there
        for kind, image in ((COLOR, rgb), (DEPTH_KIND, depth)):
            message = drive.message(bags.IMAGE, image_fields(image, stamp_ns, OPTICAL))
            pairs += inputs.add_image(kind, message, stamp_ns)
    return inputs.build_frame(pairs[0], None, None)


def recorded(folder: Path, lawn: Lawn, **settings: Any) -> Frame:
    path = bags.write_bag(folder, "mcap", replace(lawn, frames=1).events())
    return next(iter(open_source(path, SourceConfig(**settings))))


def seen(camera: Intrinsics) -> NDArray[np.uint16]:
    return millimetres(render(camera, (T_map_base(0) @ mount("c")).matrix)[1])


def test_float_depth_in_millimetres() -> None:
    depth = seen(CAMERA).astype(np.float32)
    with pytest.raises(InputError, match=r"32FC1 depth in metres .*source\.depth_unit_m=0\.001"):
        live(depth, CAMERA)
    told = live(depth, CAMERA, depth_unit_m=0.001)
    np.testing.assert_allclose(np.nan_to_num(told.depth_m), depth / 1000, rtol=1e-6)


def test_registered_depth_with_holes(tmp_path: Path) -> None:
    sparse = np.zeros((480, 640), np.uint16)
    sparse[::2, ::2] = seen(FINE)[::2, ::2]
    frame = live(sparse, FINE)
    assert frame.depth_filtered
    lawn = Lawn(camera=FINE, depth_camera=FINE, depth=lambda _, *at: image_fields(sparse, *at))
    np.testing.assert_array_equal(frame.depth, recorded(tmp_path, lawn).depth)


def test_aligned_depth_with_the_camera_of_the_depth_sensor(tmp_path: Path) -> None:
    sensor = Intrinsics(CAMERA.width, CAMERA.height, 95.0, 95.0, 79.5, 59.5)
    frame = live(seen(CAMERA), CAMERA, sensor)
    np.testing.assert_array_equal(frame.depth, seen(CAMERA))
    lawn = Lawn(depth_info=lambda _, *at: camera_info_fields(sensor, *at))
    np.testing.assert_array_equal(frame.depth, recorded(tmp_path, lawn).depth)


def test_a_named_optical_frame_does_not_turn_depth_that_shares_the_frame_of_colour() -> None:
    """Both headers name the body, and the node advises to name the lens. A recording compares headers."""
    config = config_from_dict({"source": {"camera_frame": "lens"}})
    poses = CameraPoses(Parameters(config=config), None, ("camera",))
    T_body_lens = np.eye(4)
    T_body_lens[:3, :3] = R_BODY_OPTICAL
    poses.add_tf(drive.transforms([Pose(OPTICAL, "lens", T_body_lens)], 0), static=True)
    topics = CameraTopics(COLOR_TOPIC, DEPTH, "/camera/color/camera_info", INFO_OF_DEPTH)
    inputs = CameraInput("camera", topics, config.source)
    inputs.add_info(COLOR, drive.message(bags.INFO, camera_info_fields(CAMERA, START_NS, OPTICAL)))
    images: dict[str, NDArray[Any]] = {
        COLOR: render(CAMERA, (T_map_base(0) @ mount("c")).matrix)[0],
        DEPTH_KIND: seen(CAMERA),
    }
    pairs: list[Any] = []
    for stamp_ns in (START_NS, START_NS + 10**8):
        for kind, image in images.items():
            message = drive.message(bags.IMAGE, image_fields(image, stamp_ns, OPTICAL))
            pairs += inputs.add_image(kind, message, stamp_ns)
    view = poses.view_of(pairs[0])
    assert pairs[0].color_frame == "lens"  # whose pose is asked for
    assert view is not None
    np.testing.assert_array_equal(view.matrix, np.eye(4))
