"""Recordings whose images and cameras are as users report them: the box is found, or it is asked."""

from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.bags import ros_fields as rf
from swardmap.io.bags.encodings import to_rgb
from swardmap.io.bags.rosbag import REASON_DAMAGED, open_source
from swardmap.perception.align import align_depth_to_color
from swardmap.perception.cloud import consistent_depth
from swardmap.types import Frame, depth_in_metres
from tests import bags
from tests.bags import COMPRESSED, IMAGE, Event
from tests.lawn_bags import (
    CAMERA,
    COLOR,
    DEPTH,
    MS,
    OPTICAL,
    START_NS,
    Lawn,
    T_map_base,
    mapped,
    millimetres,
    mount,
    pose,
    render,
)

RAW_DEPTH, DEPTH_FRAME = "/camera/depth/image_rect_raw", "camera_depth_optical_frame"
BESIDE = pose(OPTICAL, DEPTH_FRAME, (-0.05, 0.01, 0.0))
VGA = Intrinsics(640, 480, 520.0, 520.0, 319.5, 239.5)


def write(folder: Path, lawn: Lawn, *more: Event) -> Path:
    return bags.write_bag(folder, "mcap", sorted([*lawn.events(), *more], key=lambda event: event[0]))


def frames_of(path: Path, **settings: Any) -> list[Frame]:
    return list(open_source(path, SourceConfig(**settings)))


def check_box(path: Path, cells: int = 72, elsewhere: int = 0, **settings: Any) -> Any:
    found = mapped(path, source=settings)
    assert (found.frames, found.on_box, found.elsewhere) == (6, cells, elsewhere), found.source.facts
    return found


def encoded(image: NDArray[Any], encoding: str, stamp: int, frame: str, height: int | None = None) -> Any:
    """sensor_msgs/Image of any encoding: rows as they are."""
    rows = np.ascontiguousarray(image).reshape(len(image), -1)
    return {
        "header": rf.header_fields(stamp, frame),
        "height": height or len(image),
        "width": CAMERA.width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": rows.view(np.uint8).shape[1],
        "data": rows.view(np.uint8).reshape(-1),
    }


# ---- which depth is whose


def rear(lawn: Lawn) -> list[Event]:
    """Depth of a second camera, aligned to its own colour image, as seen to the rear: bare lawn."""
    flat = lawn.with_(depth_topic=f"/rear{DEPTH}", depth_frame="rear_optical_frame", with_tf=False)
    return [e for e in flat.events() if e[1].startswith("/rear")]


def test_depth_of_the_rear_is_never_that_of_the_front(tmp_path: Path) -> None:
    front = Lawn(color_topic=f"/front{COLOR}")
    only_color = [e for e in front.events() if e[1] != DEPTH]
    path = bags.write_bag(tmp_path, "mcap", sorted([*only_color, *rear(front)], key=lambda e: e[0]))
    with pytest.raises(
        InputError, match=r"seen from 'rear_optical_frame' and colour from .*depth_aligned=true"
    ):
        open_source(path, SourceConfig())


def test_the_depth_of_the_colours_own_camera_is_taken(tmp_path: Path) -> None:
    unaligned = Lawn(
        color_topic=f"/front{COLOR}", depth_topic=f"/front{RAW_DEPTH}", depth_frame=DEPTH_FRAME,
        T_color_depth=BESIDE.matrix, static=(mount(), BESIDE),
    )  # fmt: skip
    path = write(tmp_path, unaligned, *rear(unaligned))
    assert open_source(path, SourceConfig()).read.__self__.plan.depth.name == f"/front{RAW_DEPTH}"  # type: ignore[attr-defined]


def test_the_colour_of_the_depth_that_is_named_is_taken(tmp_path: Path) -> None:
    two = [
        *Lawn().events(),
        *Lawn(color_topic=f"/rear{COLOR}", depth_topic=f"/rear{DEPTH}", with_tf=False).events(),
    ]
    path = bags.write_bag(tmp_path, "mcap", sorted(two, key=lambda e: e[0]))
    with pytest.raises(InputError, match="2 topics could be the color image"):
        open_source(path, SourceConfig())
    plan = open_source(path, SourceConfig(depth_topic=f"/rear{DEPTH}")).read.__self__.plan  # type: ignore[attr-defined]
    assert plan.color.name == f"/rear{COLOR}"


def test_a_name_that_says_aligned_and_a_tf_that_says_elsewhere_is_asked_about(tmp_path: Path) -> None:
    path = write(tmp_path, Lawn(depth_frame=DEPTH_FRAME, static=(mount(), BESIDE)))
    with pytest.raises(InputError, match=r"which tf puts elsewhere.*source\.depth_aligned=true or false"):
        open_source(path, SourceConfig())
    check_box(path, depth_aligned=True)
    assert frames_of(path, depth_aligned=False)[0].depth_filtered


def test_an_old_bag_without_extrinsics(tmp_path: Path) -> None:
    lawn = Lawn(depth_topic=RAW_DEPTH, depth_frame=DEPTH_FRAME, T_color_depth=BESIDE.matrix)
    path = write(tmp_path, lawn)
    with pytest.raises(InputError, match=r"no tf says how they stand.*source\.T_color_depth=\[x, y, z"):
        open_source(path, SourceConfig())
    by_setting = frames_of(path, T_color_depth=(-0.05, 0.01, 0, 0, 0, 0, 1))
    with_tf = lawn.with_(static=(mount(), BESIDE))
    (tmp_path / "tf").mkdir()
    for one, two in zip(by_setting, frames_of(write(tmp_path / "tf", with_tf)), strict=True):
        np.testing.assert_array_equal(one.depth, two.depth)


# ---- cameras that contradict each other


def info_of(camera: Intrinsics) -> Any:
    return lambda _, stamp, frame: rf.camera_info_fields(camera, stamp, frame)


SENSOR = Intrinsics(160, 120, 90.0, 90.0, 80.5, 60.5)


def test_aligned_depth_with_the_camera_of_the_depth_sensor(tmp_path: Path) -> None:
    found = check_box(write(tmp_path, Lawn(depth_info=info_of(SENSOR))))
    (note,) = found.source.notes
    assert "fx 90" in note
    assert "depth that is aligned has the camera of the colour image" in note


def test_depth_in_the_same_frame_with_another_camera_is_asked_about(tmp_path: Path) -> None:
    path = write(tmp_path, Lawn(depth_topic="/camera/depth/image_raw", depth_info=info_of(SENSOR)))
    with pytest.raises(
        InputError, match=r"another camera \(fx 90, colour 130\).*depth_aligned=true or false"
    ):
        open_source(path, SourceConfig())
    check_box(path, depth_aligned=True)


HALF = Intrinsics(320, 240, 260.0, 260.0, 159.5, 119.5)


def mixed() -> NDArray[np.uint16]:
    """Depth of half the resolution as a sensor sees it: at edges something between near and far."""
    fine = render(VGA, (T_map_base(0) @ mount("c")).matrix)[1]
    return millimetres(fine.reshape(240, 2, 320, 2).mean(axis=(1, 3)))


def flying(depth_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Readings that lie on nothing: more than 5 % from all that is seen within three pixels."""
    truth = render(VGA, (T_map_base(0) @ mount("c")).matrix)[1].astype(np.float32)
    near, far = (f(truth, np.ones((7, 7), np.uint8)) for f in (cv2.erode, cv2.dilate))
    around = [np.roll(truth, (dv, du), (0, 1)) for dv in range(-3, 4) for du in range(-3, 4)]
    close = np.min([np.abs(a - depth_m) for a in around], axis=0) < 0.05 * truth
    inside = (near > 0) & (far < 8)  # where nothing is sky, and the filter is meant to hold
    return np.asarray(np.isfinite(depth_m) & ~close & inside)


def test_depth_of_half_the_resolution_is_filtered_as_it_came(tmp_path: Path) -> None:
    def depth(_: Any, stamp: int, frame: str) -> Any:
        return rf.image_fields(mixed(), stamp, frame)

    path = write(tmp_path, Lawn(camera=VGA, depth_camera=HALF, frames=1, depth=depth))
    frame = frames_of(path)[0]
    assert frame.depth_filtered
    late = align_depth_to_color(mixed(), 0.001, HALF, VGA, Pose.identity("color", "depth"))
    late_m = consistent_depth(depth_in_metres(late, 0.001), 3, 0.03, 0.02)
    before, after = int(flying(frame.depth_m).sum()), int(flying(late_m).sum())
    assert after > 300
    assert before < 0.05 * after
    found = mapped(path)
    assert found.on_box >= 70  # 72 of depth of the full resolution at a quarter of the pixels
    assert found.elsewhere <= 10


def sparse(depth: NDArray[np.uint16], stride: int) -> NDArray[np.uint16]:
    """As depth_image_proc registers a coarse image into a fine one: lone pixels."""
    out = np.zeros_like(depth)
    out[::stride, ::stride] = depth[::stride, ::stride]
    return out


@pytest.mark.parametrize("stride", [2, 3])
def test_registered_depth_with_holes(tmp_path: Path, stride: int) -> None:
    def holed(depth: Any, stamp: int, frame: str) -> Any:
        return rf.image_fields(sparse(depth, stride), stamp, frame)

    path = write(
        tmp_path,
        Lawn(camera=VGA, depth_camera=VGA, depth_topic="/camera/depth_registered/image", depth=holed),
    )
    source = open_source(path, SourceConfig())
    frames = list(source)
    assert source.facts["images"]["depth_grid_px"] == stride
    for i, frame in enumerate(frames):
        assert frame.depth_filtered
        truth = sparse(millimetres(render(VGA, (T_map_base(i) @ mount("c")).matrix)[1]), stride)
        kept = frame.depth > 0
        np.testing.assert_array_equal(frame.depth[kept], truth[kept])  # nothing invented
        near = (truth > 0) & (truth < 4000)
        assert kept[near].mean() > 0.7


def test_flying_pixels_of_a_sparse_grid_are_taken_out(tmp_path: Path) -> None:
    def flying(depth: Any, stamp: int, frame: str) -> Any:
        depth = sparse(depth, 2)
        depth[200:204:2, 100] = 700
        return rf.image_fields(depth, stamp, frame)

    topic = "/camera/depth_registered/image"
    frame = frames_of(write(tmp_path, Lawn(camera=VGA, depth_camera=VGA, depth_topic=topic, depth=flying)))[0]
    assert not (frame.depth == 700).any()


# ---- lenses


def fisheye_rays(camera: Intrinsics) -> Any:
    """r = f theta: the equidistant lens without coefficients."""

    def rays(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
        theta = np.hypot(x, y)
        scale = np.where(theta > 0, np.tan(theta) / np.maximum(theta, 1e-12), 1)
        return np.stack([x * scale, y * scale, np.ones_like(x)], -1)

    return rays


def test_a_fisheye_without_coefficients_is_no_pinhole(tmp_path: Path) -> None:
    wide = Intrinsics(640, 480, 300.0, 300.0, 319.5, 239.5)

    def info(camera: Intrinsics, stamp: int, frame: str) -> Any:
        fields = rf.camera_info_fields(camera, stamp, frame, (0.0,) * 4)
        return {**fields, "distortion_model": "equidistant"}

    path = write(tmp_path, Lawn(camera=wide, depth_camera=wide, rays=fisheye_rays(wide), info=info))
    frame = frames_of(path)[0]
    rgb, truth = render(wide, (T_map_base(0) @ mount("c")).matrix)  # the ideal pinhole of the same camera
    same = np.abs(frame.depth_m - truth) < 0.05 * truth
    assert same[truth > 0].mean() > 0.97
    assert (np.abs(frame.rgb.astype(int) - rgb).max(axis=-1) < 40).mean() > 0.97
    found = mapped(path)
    assert found.on_box >= 60
    assert found.elsewhere <= 6


@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("plumb_bob", [-0.1, 0.03, 0.001, -0.001]),
        ("plumb_bob", [-0.1, 0.03, 0.001, -0.001, 0.01]),
        ("rational_polynomial", [0.3, 0.05, 0.001, -0.001, 0.01, 0.4, 0.1, 0.02]),
        ("rational_polynomial", [0.3, 0.05, 0.001, -0.001, 0.01, 0.4, 0.1, 0.02, 0.01, 0.002, -0.01, 0.001]),
        ("rational_polynomial", [0.3, 0.05, 0.0, 0.0, 0.01, 0.4, 0.1, 0.02, 0.01, 0, -0.01, 0, 0.02, -0.01]),
        ("equidistant", [0.02, -0.01, 0.003, -0.001]),
    ],
)
def test_lenses_are_rectified_as_opencv_does(tmp_path: Path, model: str, d: list[float]) -> None:
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    smooth = np.stack([u, v * 2, 100 + u // 2], axis=-1).astype(np.uint8)

    def info(camera: Intrinsics, stamp: int, frame: str) -> Any:
        fields = rf.camera_info_fields(camera, stamp, frame, d)
        return {**fields, "distortion_model": model}

    lawn = Lawn(info=info, color=lambda _, stamp, frame: rf.image_fields(smooth, stamp, frame), frames=1)
    frame = frames_of(write(tmp_path, lawn))[0]
    K = CAMERA.matrix
    if model == "equidistant":
        expected = cv2.fisheye.undistortImage(smooth, K, np.array(d), Knew=K)
    else:
        expected = cv2.undistort(smooth, K, np.array(d))
    assert np.abs(expected.astype(int) - smooth).max() > 3
    np.testing.assert_allclose(frame.rgb.astype(int), expected, atol=1)


# ---- units and encodings


def in_millimetres(depth: Any, stamp: int, frame: str) -> Any:
    return rf.image_fields(depth.astype(np.float32), stamp, frame)


def test_float_depth_in_millimetres_is_asked_about(tmp_path: Path) -> None:
    path = write(tmp_path, Lawn(depth=in_millimetres))
    with pytest.raises(InputError, match=r"32FC1 depth in metres .*source\.depth_unit_m=0\.001"):
        frames_of(path)
    check_box(path, depth_unit_m=0.001)
    with pytest.raises(Exception, match="frame"):
        mapped(path, source={"depth_unit_m": 1.0})  # as told: all of it is far away


def test_the_reason_why_images_cannot_be_used_is_told(tmp_path: Path) -> None:
    twice = Intrinsics(320, 240, 260.0, 260.0, 159.5, 119.5)
    source = open_source(write(tmp_path, Lawn(info=info_of(twice))), SourceConfig())
    assert list(source) == []
    said = source.facts["left_out"][REASON_DAMAGED]
    assert said["count"] == 6
    assert "expected 320 x 240 as in its CameraInfo, got 160 x 120" in said["first"]


def test_an_empty_first_message_is_passed_over(tmp_path: Path) -> None:
    empty = {**rf.image_fields(np.zeros((1, 1), np.uint8), START_NS - MS, ""), "encoding": "", "height": 0,
             "width": 0, "step": 0, "data": np.zeros(0, np.uint8)}  # fmt: skip
    blank = rf.camera_info_fields(Intrinsics(1, 1, 1, 1, 0, 0), START_NS, "")
    blank = {**blank, "k": np.zeros(9), "p": np.zeros(12)}
    before: list[Event] = [
        (START_NS - 2 * MS, COLOR, IMAGE, empty),
        (START_NS - 2 * MS, DEPTH, IMAGE, empty),
        (START_NS - MS, "/camera/color/camera_info", bags.INFO, blank),
    ]
    path = write(tmp_path, Lawn(), *before)
    found = mapped(path)
    assert (found.frames, found.on_box, found.elsewhere) == (6, 72, 0)


def bt601(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Y, U, V as cameras send them (ITU-R BT.601: 16 to 235 and 16 to 240)."""
    weights = np.array([[65.481, 128.553, 24.966], [-37.797, -74.203, 112.0], [112.0, -93.786, -18.214]])
    return np.asarray(rgb / 255.0 @ weights.T + (16, 128, 128))


def yuv(rgb: NDArray[np.uint8], order: str) -> NDArray[np.uint8]:
    """4:2:2, colour of each pair of pixels averaged."""
    y, u, v = np.moveaxis(bt601(rgb), -1, 0)
    out = np.empty((*y.shape, 2), np.uint8)
    light, color = (0, 1) if order == "yuyv" else (1, 0)
    out[..., light] = np.round(y)
    out[:, 0::2, color] = np.round((u[:, 0::2] + u[:, 1::2]) / 2)
    out[:, 1::2, color] = np.round((v[:, 0::2] + v[:, 1::2]) / 2)
    return out


def planar(rgb: NDArray[np.uint8], order: str) -> NDArray[np.uint8]:
    """4:2:0, brightness and then interleaved colour of each 2 x 2 pixels."""
    planes = bt601(rgb)
    height, width = rgb.shape[:2]
    coarse = planes[..., 1:].reshape(height // 2, 2, width // 2, 2, 2).mean(axis=(1, 3))
    both = coarse if order == "nv12" else coarse[..., ::-1]
    return np.vstack([np.round(planes[..., 0]), np.round(both).reshape(height // 2, width)]).astype(np.uint8)


def mosaic(rgb: NDArray[Any], order: str, bits: int) -> NDArray[Any]:
    out = np.empty(rgb.shape[:2], rgb.dtype)
    for place, letter in zip(((0, 0), (0, 1), (1, 0), (1, 1)), order, strict=True):
        out[place[0] :: 2, place[1] :: 2] = rgb[place[0] :: 2, place[1] :: 2, "rgb".index(letter)]
    return out if bits == 8 else out.astype(np.uint16) * 257


ENCODERS: dict[str, Any] = {
    "yuv422": lambda rgb: yuv(rgb, "uyvy"),
    "uyvy": lambda rgb: yuv(rgb, "uyvy"),
    "yuv422_yuy2": lambda rgb: yuv(rgb, "yuyv"),
    "yuyv": lambda rgb: yuv(rgb, "yuyv"),
    "nv12": lambda rgb: planar(rgb, "nv12"),
    "nv21": lambda rgb: planar(rgb, "nv21"),
    "rgb16": lambda rgb: rgb.astype(np.uint16) * 257,
    "bgr16": lambda rgb: rgb[..., ::-1].astype(np.uint16) * 257,
    **{
        f"bayer_{order}{bits}": partial(mosaic, order=order, bits=bits)
        for order in ("rggb", "bggr", "gbrg", "grbg")
        for bits in (8, 16)
    },
}


@pytest.fixture(scope="module")
def lawn_cells(tmp_path_factory: pytest.TempPathFactory) -> int:
    """Of the control, in plain RGB."""
    return mapped(write(tmp_path_factory.mktemp("control"), Lawn())).grass


@pytest.mark.parametrize("encoding", ENCODERS)
def test_colours_of_every_encoding(tmp_path: Path, encoding: str, lawn_cells: int) -> None:
    def color(rgb: Any, stamp: int, frame: str) -> Any:
        return encoded(ENCODERS[encoding](rgb), encoding, stamp, frame, CAMERA.height)

    path = write(tmp_path, Lawn(color=color))
    frame = frames_of(path)[0]
    truth = render(CAMERA, (T_map_base(0) @ mount("c")).matrix)[0]
    # away from edges, where half the colours are a neighbour's
    around = cv2.morphologyEx(truth, cv2.MORPH_GRADIENT, np.ones((9, 9))).max(axis=-1)
    np.testing.assert_allclose(frame.rgb[around == 0].astype(int), truth[around == 0], atol=3)
    # as in the control, but for cells two away from the edge, which clear with their neighbours
    # (of 4:2:0 a row of pixels more has a neighbour's colour)
    assert abs(check_box(path).grass - lawn_cells) <= (8 if encoding.startswith("nv") else 4)


def rgb_of(y: NDArray[np.float64], u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """RGB by the inverse of ITU-R BT.601."""
    y, u, v = 255 / 219 * (y - 16), (u - 128) / 224, (v - 128) / 224
    green = (0.299 * 1.402 * v + 0.114 * 1.772 * u) / 0.587
    return np.clip(np.stack([y + 255 * 1.402 * v, y - 255 * green, y + 255 * 1.772 * u], -1), 0, 255)


@pytest.mark.parametrize("order", ["uyvy", "yuyv"])
@pytest.mark.parametrize("size", [(1, 2), (3, 6), (5, 16), (120, 162)])
def test_at_edges_a_pair_of_pixels_has_one_colour_and_its_own_brightness(
    order: str, size: tuple[int, int]
) -> None:
    """Whatever is beside it, and in the first and last column too: nothing is smoothed across pairs."""
    stored = np.random.default_rng(3).integers(16, 236, (*size, 2), np.uint8)
    light, color = (0, 1) if order == "yuyv" else (1, 0)
    u, v = (np.repeat(stored[:, first::2, color], 2, axis=1).astype(float) for first in (0, 1))
    expected = rgb_of(stored[..., light].astype(float), u, v)
    np.testing.assert_allclose(to_rgb(order, stored).astype(float), expected, atol=1.5)


@pytest.mark.parametrize("order", ["nv12", "nv21"])
@pytest.mark.parametrize("size", [(2, 2), (6, 10), (120, 162)])
def test_at_edges_four_pixels_have_one_colour_and_their_own_brightness(
    order: str, size: tuple[int, int]
) -> None:
    rows, columns = size
    stored = np.random.default_rng(4).integers(16, 236, (rows * 3 // 2, columns), np.uint8)
    coarse = stored[rows:].reshape(rows // 2, columns // 2, 2).astype(float)
    u, v = (
        coarse[..., i].repeat(2, axis=0).repeat(2, axis=1) for i in ((0, 1) if order == "nv12" else (1, 0))
    )
    expected = rgb_of(stored[:rows].astype(float), u, v)
    np.testing.assert_allclose(to_rgb(order, stored).astype(float), expected, atol=1.5)


def test_rows_of_colour_may_be_counted_or_not(tmp_path: Path) -> None:
    def counted(rgb: Any, stamp: int, frame: str) -> Any:
        return encoded(planar(rgb, "nv12"), "nv12", stamp, frame)  # height: 3/2 of the image's

    frame = frames_of(write(tmp_path, Lawn(color=counted)))[0]
    assert frame.rgb.shape == (120, 160, 3)


def jpeg(image: Any, form: str) -> Any:
    def make(rgb: Any, stamp: int, frame: str) -> Any:
        data = image(rgb)
        return {
            "header": rf.header_fields(stamp, frame),
            "format": form,
            "data": np.frombuffer(data, np.uint8),
        }

    return make


def test_video_is_refused_with_the_remedy(tmp_path: Path) -> None:
    for form in ("h264", "hevc", "rgb8; h265 compressed"):
        (tmp_path / form[:4]).mkdir()
        color = jpeg(lambda rgb: b"\0\0\0\1\x67" + bytes(100), form)
        lawn = Lawn(color_topic=f"{COLOR}/compressed", color=color, kind_of=_kind)
        with pytest.raises(InputError, match=r"no topic with color images; .*video stream.*republish"):
            open_source(write(tmp_path / form[:4], lawn), SourceConfig())


def _kind(topic: str) -> str:
    return COMPRESSED if topic.endswith(("compressed", "compressedDepth")) else IMAGE


def test_gray_is_taken_with_a_word(tmp_path: Path) -> None:
    def gray(rgb: Any, stamp: int, frame: str) -> Any:
        return rf.image_fields(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), stamp, frame)

    source = open_source(write(tmp_path, Lawn(color=gray)), SourceConfig())
    assert len(list(source)) == 6
    assert source.notes == [f"the images of {COLOR} are gray (mono8): no colour tells grass"]

    only_light = jpeg(
        lambda rgb: cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))[1].tobytes(),
        "yuv422_yuy2; jpeg compressed mono8",
    )
    (tmp_path / "jpeg").mkdir()
    lawn = Lawn(color_topic=f"{COLOR}/compressed", color=only_light, kind_of=_kind)
    source = open_source(write(tmp_path / "jpeg", lawn), SourceConfig())
    assert len(list(source)) == 6
    assert "are gray" in source.notes[0]
