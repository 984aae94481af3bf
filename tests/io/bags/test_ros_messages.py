"""Messages to arrays and back, for both dialects of ROS, against what the message definitions say."""

import struct
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from swardmap.errors import InputError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose
from swardmap.grid import GridSpec
from swardmap.io.bags import ros_fields as rf
from swardmap.io.bags import ros_messages as rm
from swardmap.io.bags.ros_camera import calibration_from_camera_info
from tests import bags

STORES = {kind: bags.typestore(kind) for kind in bags.KINDS[:2]}
RGB = np.random.default_rng(0).integers(0, 255, (4, 5, 3), dtype=np.uint8)


def image(pixels: Any, encoding: str, padding: int = 0, big: bool = False) -> Any:
    pixels = np.asarray(pixels)
    rows = (
        pixels.astype(pixels.dtype.newbyteorder(">" if big else "<")).reshape(len(pixels), -1).view(np.uint8)
    )
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    return SimpleNamespace(
        encoding=encoding, height=pixels.shape[0], width=pixels.shape[1], step=rows.shape[1],
        is_bigendian=int(big), data=rows.reshape(-1),
    )  # fmt: skip


def through(kind: bags.Kind, name: str, fields: rf.Fields) -> Any:
    """Serialised and read back: only what is in the message definition survives."""
    store = STORES[kind]
    data = bags.serialized(store, kind, name, fields)
    return (store.deserialize_ros1 if kind == "ros1" else store.deserialize_cdr)(data, name)


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize(
    ("encoding", "stored"),
    [
        ("rgb8", RGB),
        ("bgr8", RGB[..., ::-1]),
        ("8UC3", RGB[..., ::-1]),
        ("rgba8", np.dstack([RGB, np.full((4, 5), 9, np.uint8)])),
        ("bgra8", np.dstack([RGB[..., ::-1], np.full((4, 5), 9, np.uint8)])),
    ],
)
def test_every_color_encoding_becomes_rgb(encoding: str, stored: Any, padding: int) -> None:
    np.testing.assert_array_equal(rm.color_from_image(image(stored, encoding, padding)), RGB)


def test_brightness_becomes_gray() -> None:
    gray = rm.color_from_image(image(RGB[..., 0], "mono8"))
    assert gray.shape == (4, 5, 3)
    for channel in range(3):
        np.testing.assert_array_equal(gray[..., channel], RGB[..., 0])


@given(
    depth=hnp.arrays(np.uint16, st.tuples(st.integers(1, 6), st.integers(1, 6))),
    padding=st.integers(0, 5),
    big=st.booleans(),
)
def test_depth_honours_step_and_byte_order(depth: Any, padding: int, big: bool) -> None:
    out = rm.depth_from_image(image(depth, "16UC1", padding, big))
    assert out.dtype == np.uint16
    np.testing.assert_array_equal(out, depth)
    metres = depth.astype(np.float32) / 1000
    np.testing.assert_array_equal(rm.depth_from_image(image(metres, "32FC1", padding, big)), metres)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"data": np.zeros(59, np.uint8)}, "got 59 bytes"),
        ({"data": np.zeros(61, np.uint8)}, "got 61 bytes"),
        ({"step": 14}, "rows of 14 bytes"),
        ({"height": 0}, "0 rows"),
        ({"encoding": "yuv422"}, "even number of columns"),
        ({"encoding": "nv24"}, "not supported"),
        ({"encoding": ""}, "not supported"),
    ],
)
def test_refuses_what_does_not_hold_together(change: dict[str, Any], words: str) -> None:
    message = image(RGB, "rgb8")
    vars(message).update(change)
    with pytest.raises(InputError, match=words):
        rm.color_from_image(message)


def test_refuses_depth_as_color_and_color_as_depth() -> None:
    with pytest.raises(InputError, match="no depth image"):
        rm.depth_from_image(image(RGB, "rgb8"))
    with pytest.raises(InputError, match="no colour image"):
        rm.color_from_image(image(np.zeros((2, 2), np.uint16), "16UC1"))


@pytest.mark.parametrize("kind", STORES)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_image_round_trip(kind: bags.Kind, dtype: Any) -> None:
    pixels = RGB if dtype is np.uint8 else (RGB[..., 0] * 7).astype(dtype)
    message = through(kind, bags.IMAGE, rf.image_fields(pixels, 1_234_567_890_123, "camera"))
    read = rm.color_from_image if dtype is np.uint8 else rm.depth_from_image
    np.testing.assert_array_equal(read(message), pixels)
    assert rm.stamp_ns(message.header.stamp) == 1_234_567_890_123
    assert message.header.frame_id == "camera"


@pytest.mark.parametrize("kind", STORES)
def test_compressed_round_trip(kind: bags.Kind) -> None:
    png = through(kind, bags.COMPRESSED, rf.compressed_image_fields(RGB, 5, "camera", "png"))
    np.testing.assert_array_equal(rm.color_from_compressed(png), RGB)
    smooth = np.full((16, 16, 3), (200, 60, 20), np.uint8)
    jpeg = through(kind, bags.COMPRESSED, rf.compressed_image_fields(smooth, 5, "camera"))
    assert np.abs(rm.color_from_compressed(jpeg).astype(int) - smooth).max() <= 3
    depth = (RGB[..., 0].astype(np.uint16) * 257).copy()
    message = through(kind, bags.COMPRESSED, rf.compressed_image_fields(depth, 5, "camera"))
    np.testing.assert_array_equal(rm.depth_from_compressed(message), depth)


def test_a_file_written_without_swapping_colors_says_so() -> None:
    data = cv2.imencode(".png", RGB)[1].reshape(-1)  # RGB handed to OpenCV as if it were BGR
    message = SimpleNamespace(format="rgb8; png compressed rgb8", data=data)
    np.testing.assert_array_equal(rm.color_from_compressed(message), RGB)


def quantised(metres: Any, a: float, b: float) -> Any:
    """As compressed_depth_image_transport encodes 32FC1 (codec.cpp): inverse depth in whole numbers."""
    with np.errstate(divide="ignore", invalid="ignore"):
        numbers = np.where(np.isfinite(metres), a / metres + b, 0).astype(np.uint16)
    head = struct.pack("<iff", 0, a, b)
    data = np.frombuffer(head + cv2.imencode(".png", numbers)[1].tobytes(), np.uint8)
    return SimpleNamespace(format="32FC1; compressedDepth png", data=data)


def test_quantised_depth_comes_back() -> None:
    metres = np.linspace(0.5, 9.5, 60, dtype=np.float32).reshape(6, 10)
    metres[0, 0] = np.nan
    a = 100.0 * (100.0 + 1.0)  # the transport's defaults: depth_quantization 100, depth_max 10
    out = rm.depth_from_compressed(quantised(metres, a, 1.0 - a / 10.0))
    assert out.dtype == np.float32
    assert np.isnan(out[0, 0])
    good = np.isfinite(metres)
    step = metres[good] ** 2 / a  # one whole number of inverse depth, in metres there
    assert (np.abs(out[good] - metres[good]) <= 1.01 * step + 1e-6).all()


@pytest.mark.parametrize(
    ("form", "data", "words"),
    [
        ("16UC1; compressedDepth rvl", b"x" * 40, "RVL"),
        ("16UC1; compressedDepth png", b"", "12-byte header"),
        ("16UC1; compressedDepth png", b"x" * 40, "expected a PNG, JPEG"),
        ("16UC1; compressedDepth png", b"\0" * 12 + cv2.imencode(".png", RGB)[1].tobytes(), "one channel"),
        (
            "32FC1; compressedDepth png",
            cv2.imencode(".png", np.ones((2, 2), np.uint16))[1].tobytes(),
            "header",
        ),
        (
            "32FC1; compressedDepth png",
            struct.pack("<iff", 0, np.nan, 1) + cv2.imencode(".png", np.ones((2, 2), np.uint16))[1].tobytes(),
            "unusable",
        ),
    ],
)
def test_refuses_compressed_depth_that_is_none(form: str, data: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words):
        rm.depth_from_compressed(SimpleNamespace(format=form, data=np.frombuffer(data, np.uint8)))


@given(st.binary(max_size=60))
def test_random_bytes_are_refused(data: bytes) -> None:
    message = SimpleNamespace(format="jpeg", data=np.frombuffer(data, np.uint8))
    with pytest.raises(InputError):
        rm.color_from_compressed(message)


CAMERA = Intrinsics(64, 48, 60.0, 61.0, 31.2, 24.3)


@pytest.mark.parametrize("kind", STORES)
def test_camera_info_round_trip(kind: bags.Kind) -> None:
    message = through(kind, bags.INFO, rf.camera_info_fields(CAMERA, 0, "camera"))
    for rectified in (False, True):
        calibration = calibration_from_camera_info(message, rectified)
        assert calibration.intrinsics == CAMERA
        assert calibration.distortion == ()


def info(**changes: Any) -> Any:
    fields = rf.camera_info_fields(CAMERA, 0, "camera")
    roi = SimpleNamespace(**{**fields.pop("roi"), **changes.pop("roi", {})})
    return SimpleNamespace(**{**fields, "roi": roi, **changes})


def test_rectified_images_take_p() -> None:
    p = np.hstack([Intrinsics(64, 48, 50.0, 51.0, 30.0, 20.0).matrix, np.zeros((3, 1))]).reshape(-1)
    message = info(p=p, d=np.array([0.1, 0, 0, 0, 0]))
    assert calibration_from_camera_info(message, rectified=True).intrinsics.fx == 50.0
    raw = calibration_from_camera_info(message, rectified=False)
    assert (raw.intrinsics.fx, raw.distortion[0]) == (60.0, 0.1)


def test_binning_and_region_of_interest() -> None:
    # image_geometry: shift by the region, then divide
    message = info(binning_x=2, binning_y=2, roi={"x_offset": 10, "y_offset": 4, "width": 40, "height": 20})
    intrinsics = calibration_from_camera_info(message).intrinsics
    assert (intrinsics.width, intrinsics.height) == (20, 10)
    assert (intrinsics.fx, intrinsics.fy) == (30.0, 30.5)
    assert (intrinsics.cx, intrinsics.cy) == pytest.approx(((31.2 - 10) / 2, (24.3 - 4) / 2))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"k": np.zeros(9), "p": np.zeros(12)}, "not calibrated"),
        ({"k": np.full(9, np.nan)}, "finite"),
        ({"k": np.zeros(4)}, "expected 9 numbers"),
        ({"width": 0}, "positive size"),
        ({"d": np.array([0.1, 0, 0, 0]), "distortion_model": "double_sphere"}, "'double_sphere'"),
        ({"d": np.zeros(5), "distortion_model": "omnidirectional"}, "'omnidirectional'"),
        ({"d": np.array([0.1, 0, 0, 0, 0]), "distortion_model": "equidistant"}, "5 coefficients"),
        ({"d": np.full(6, 0.1), "distortion_model": "rational_polynomial"}, "6 coefficients"),
        ({"d": np.array([0.1, 0, 0, 0, np.nan])}, "not supported"),
    ],
)
def test_refuses_cameras_that_cannot_be_used(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        calibration_from_camera_info(info(**changes), topic="/camera_info")


@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("plumb_bob", [-0.25, 0.08, 0.001, -0.002, 0.0]),
        ("rational_polynomial", [-0.25, 0.08, 0.001, -0.002, 0.01, 0.02, 0.01, 0.0]),
        ("Inverse Brown Conrady", [-0.05, 0.03, 0.001, -0.002, 0.0]),
    ],
)
def test_rectification_puts_points_where_a_pinhole_sees_them(model: str, d: list[float]) -> None:
    camera = Intrinsics(320, 240, 300.0, 301.0, 158.0, 121.0)
    fields = rf.camera_info_fields(camera, 0, "camera", d)
    message = SimpleNamespace(
        **{**fields, "distortion_model": model, "roi": SimpleNamespace(**fields["roi"])}
    )
    calibration = calibration_from_camera_info(message)
    ideal = np.array([[40.0, 60.0], [160.0, 30.0], [280.0, 200.0]])
    K = camera.matrix
    taken = np.zeros((240, 320), np.uint16)
    rays = np.c_[(ideal - [158.0, 121.0]) / [300.0, 301.0], np.ones(3)]
    if model.startswith("Inverse"):  # librealsense: the polynomial takes the distorted ray to the ideal one
        spots = cv2.undistortPoints(ideal[:, None], K, np.array(d), P=K)[:, 0]
        back = cv2.projectPoints(
            np.c_[(spots - [158.0, 121.0]) / [300.0, 301.0], np.ones(3)],
            np.zeros(3),
            np.zeros(3),
            K,
            np.array(d),
        )[0][:, 0]
        np.testing.assert_allclose(back, ideal, atol=0.01)
    else:
        spots = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, np.array(d))[0][:, 0]
    for number, (u, v) in enumerate(spots.tolist(), start=1):
        row, column = round(v), round(u)
        taken[row - 1 : row + 2, column - 1 : column + 2] = 1000 * number
    depth = calibration.rectify_depth(taken)
    assert set(np.unique(depth)) == {0, 1000, 2000, 3000}  # nothing blended
    for number, (u, v) in enumerate(ideal, start=1):
        rows, columns = np.nonzero(depth == 1000 * number)
        assert abs(columns.mean() - u) < 0.6
        assert abs(rows.mean() - v) < 0.6
    color = calibration.rectify_color(np.full((240, 320, 3), 128, np.uint8))
    assert color.shape == (240, 320, 3)
    assert color[121, 158].tolist() == [128, 128, 128]


def test_an_image_of_another_size_than_its_camera_is_refused() -> None:
    with pytest.raises(InputError, match="expected 64 x 48 as in its CameraInfo, got 32 x 24"):
        calibration_from_camera_info(info()).rectify_color(np.zeros((24, 32, 3), np.uint8))


@pytest.mark.parametrize("kind", STORES)
def test_poses_round_trip(kind: bags.Kind) -> None:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix()
    matrix[:3, 3] = [1, 2, 3]
    pose = Pose("odom", "base", matrix)
    message = through(kind, bags.ODOMETRY, rf.odometry_fields(pose, 7))
    odometry = rm.pose_from_odometry(message)
    transform = through(kind, bags.TF, rf.tf_fields([pose], 7)).transforms[0]
    place, turn = rm.vectors(transform.transform.translation, transform.transform.rotation)
    for back in (odometry, Pose.from_quaternion("odom", "base", place, turn)):
        assert (back.parent, back.child) == ("odom", "base")
        np.testing.assert_allclose(back.matrix, matrix, atol=1e-12)
    message.pose.pose.orientation.w = float("nan")
    with pytest.raises(InvalidValueError, match="quaternion"):
        rm.pose_from_odometry(message)


@pytest.mark.parametrize("kind", STORES)
def test_grid_and_cloud_messages(kind: bags.Kind) -> None:
    spec = GridSpec(0.05, 3, 2, (-1.0, 2.0))
    data = np.array([[-1, 0, 100], [0, 0, 100]], np.int8)
    grid = through(kind, "nav_msgs/msg/OccupancyGrid", rf.occupancy_grid_fields(data, spec, 9, "map"))
    assert (grid.info.width, grid.info.height, grid.info.origin.position.x) == (3, 2, -1.0)
    np.testing.assert_array_equal(np.asarray(grid.data).reshape(2, 3), data)
    xyz = np.arange(9, dtype=np.float32).reshape(3, 3)
    labels = np.array([0, 1, 2], np.uint8)
    cloud = through(kind, "sensor_msgs/msg/PointCloud2", rf.point_cloud_fields(xyz, labels, 9, "map"))
    assert cloud.row_step == cloud.point_step * cloud.width == len(cloud.data)
    where = {f.name: f.offset for f in cloud.fields}
    for i in range(3):  # as a reader of PointCloud2 does it: by offset
        point = bytes(cloud.data[i * cloud.point_step :])
        assert [struct.unpack_from("<f", point, where[n])[0] for n in "xyz"] == xyz[i].tolist()
        assert struct.unpack_from("<I", point, where["label"])[0] == labels[i]


def test_image_fields_refuse_what_has_no_encoding() -> None:
    with pytest.raises(InvalidValueError, match="expected uint8 RGB"):
        rf.image_fields(np.zeros((2, 2), np.float64), 0, "camera")
