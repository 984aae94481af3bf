"""Depth to colour against its NumPy twin, geometry, and the camera maker's own code."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from swardmap.errors import InvalidValueError
from swardmap.geometry import Intrinsics, Pose, deproject, project
from swardmap.perception.align import align_depth_reference, align_depth_to_color


def pose(angles_deg: Any = (0, 0, 0), translation_m: Any = (0, 0, 0)) -> Pose:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix()
    matrix[:3, 3] = translation_m
    return Pose("color", "depth", matrix)


def camera(width: int, height: int, focal: float) -> Intrinsics:
    return Intrinsics(width, height, focal, focal * 1.01, width / 2 - 0.37, height / 2 + 0.21)


def scene(height: int, width: int, seed: int, holes: float = 0.1) -> NDArray[np.uint16]:
    """A tilted ground with boxes before it, noise and holes, in millimetres."""
    rng = np.random.default_rng(seed)
    depth = np.linspace(4000, 900, height)[:, None] + np.linspace(-200, 200, width)[None, :]
    for _ in range(4):
        v, u = rng.integers(0, height), rng.integers(0, width)
        depth[v : v + height // 3, u : u + width // 4] = rng.integers(400, 3000)
    depth += rng.normal(0, 4, depth.shape)
    depth[rng.random(depth.shape) < holes] = 0
    return depth.astype(np.uint16)


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_coinciding_cameras_change_nothing(dtype: type) -> None:
    depth = scene(48, 64, 0)
    image = depth if dtype is np.uint16 else (depth * np.float32(0.001))
    same = camera(64, 48, 60.0)
    np.testing.assert_array_equal(align_depth_to_color(image, 0.001, same, same, pose()), image)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 1000),
    sizes=st.tuples(*[st.integers(2, 24)] * 4),
    focals=st.tuples(*[st.floats(5, 60)] * 2),
    angles=st.tuples(*[st.floats(-180, 180)] * 3),
    shift=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    as_float=st.booleans(),
    keep=st.booleans(),
)
def test_compiled_equals_numpy(
    seed: int,
    sizes: tuple[int, int, int, int],
    focals: tuple[float, float],
    angles: tuple[float, float, float],
    shift: tuple[float, float, float],
    as_float: bool,
    keep: bool,
) -> None:
    depth_camera, color_camera = camera(sizes[0], sizes[1], focals[0]), camera(sizes[2], sizes[3], focals[1])
    raw = scene(sizes[1], sizes[0], seed)
    depth: Any = raw
    if as_float:
        depth = raw * np.float32(0.001)
        depth.flat[:: max(1, seed % 7)] = [np.nan, np.inf, -1.0][seed % 3]
    args = (depth, 0.001, depth_camera, color_camera, pose(angles, shift), keep)
    np.testing.assert_array_equal(align_depth_to_color(*args), align_depth_reference(*args))


def test_a_plane_is_where_geometry_says() -> None:
    # a plane that is not parallel to either image, seen by a turned camera beside
    depth_camera, color_camera = camera(160, 120, 150.0), camera(160, 120, 120.0)
    T = pose((4, -6, 3), (0.05, -0.02, 0.01))
    normal, distance = np.array([0.1, -0.5, -1.0]), -2.0  # normal . p = distance, in the depth frame
    rays = deproject(np.ones((120, 160)), depth_camera).astype(float)
    depth = (distance / (rays @ normal)).astype(np.float32)
    aligned = align_depth_to_color(depth, 1.0, depth_camera, color_camera, T)
    moved = T.inverse()
    rays_c = deproject(np.ones((120, 160)), color_camera).astype(float)
    expected = (distance - normal @ moved.position_m) / ((rays_c @ moved.matrix[:3, :3].T) @ normal)
    seen = aligned > 0
    assert seen.mean() > 0.6
    # a reading lands up to a pixel from where it belongs, and here a pixel is 0.5 % of the depth
    assert np.abs(aligned[seen] / expected[seen] - 1).max() < 0.012


def test_the_nearer_surface_hides_the_farther() -> None:
    depth_camera = camera(64, 48, 60.0)
    depth = np.full((48, 64), 3000, np.uint16)
    depth[:, 20:30] = 1000  # a post; the colour camera sits to its left and sees the post shifted
    aligned = align_depth_to_color(depth, 0.001, depth_camera, depth_camera, pose(translation_m=(0.1, 0, 0)))
    _, columns = np.nonzero(aligned == 1000)
    assert columns.min() == 20 + 6
    assert columns.max() == 29 + 6
    assert set(np.unique(aligned)) == {0, 1000, 3000}  # 0: what the depth camera could not see


def test_a_finer_color_image_has_no_gaps() -> None:
    depth = np.full((48, 64), 2000, np.uint16)
    coarse = camera(64, 48, 60.0)
    aligned = align_depth_to_color(depth, 0.001, coarse, coarse.scaled_to(640, 480), pose())
    assert (aligned == 2000).all()


def test_distances_become_those_of_the_color_camera() -> None:
    camera_d = camera(64, 48, 60.0)
    T = pose((0, 20, 0))
    depth = np.zeros((48, 64), np.uint16)
    depth[24, 40] = 2000
    point = deproject(depth * np.float32(0.001), camera_d)[24, 40]
    uv, z = project(T.apply(point), camera_d)
    aligned = align_depth_to_color(depth, 0.001, camera_d, camera_d, T)
    assert aligned.max() == pytest.approx(1000 * float(z), abs=15)
    assert align_depth_to_color(depth, 0.001, camera_d, camera_d, T, True).max() == 2000
    where = np.argwhere(aligned)
    assert np.abs(where - uv[::-1]).max() <= 1.5


def test_what_lies_behind_the_color_camera_is_not_drawn() -> None:
    depth = np.full((4, 4), 500, np.uint16)
    aligned = align_depth_to_color(
        depth, 0.001, camera(4, 4, 4.0), camera(4, 4, 4.0), pose(translation_m=(0, 0, -1))
    )
    assert not aligned.any()


def test_refuses_wrong_sizes_and_units() -> None:
    small = camera(4, 4, 4.0)
    with pytest.raises(InvalidValueError, match="expected uint16 or float32"):
        align_depth_to_color(np.zeros((3, 4), np.uint16), 0.001, small, small, pose())
    with pytest.raises(InvalidValueError, match="depth unit"):
        align_depth_to_color(np.zeros((4, 4), np.uint16), 0.0, small, small, pose())


def sdk_align(rs: Any, depth: Any, depth_camera: Intrinsics, color_camera: Intrinsics, T: Pose) -> Any:
    """What librealsense makes of it, through its software device, syncer and `rs.align`."""

    def video_stream(kind: Any, uid: int, bytes_per_pixel: int, form: Any, c: Intrinsics) -> Any:
        intrinsics = rs.intrinsics()
        intrinsics.width, intrinsics.height = c.width, c.height
        intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy = c.fx, c.fy, c.cx, c.cy
        intrinsics.model, intrinsics.coeffs = rs.distortion.brown_conrady, [0.0] * 5
        stream = rs.video_stream()
        stream.type, stream.uid, stream.index, stream.fps = kind, uid, 0, 30
        stream.width, stream.height, stream.bpp, stream.fmt = c.width, c.height, bytes_per_pixel, form
        stream.intrinsics = intrinsics
        return stream

    device = rs.software_device()
    sensors = [device.add_sensor("Stereo Module"), device.add_sensor("RGB Camera")]
    profiles = [
        sensors[0].add_video_stream(video_stream(rs.stream.depth, 1, 2, rs.format.z16, depth_camera)),
        sensors[1].add_video_stream(video_stream(rs.stream.color, 2, 3, rs.format.rgb8, color_camera)),
    ]
    sensors[0].add_read_only_option(rs.option.depth_units, 0.001)
    extrinsics = rs.extrinsics()
    extrinsics.rotation = list(T.matrix[:3, :3].T.reshape(-1))  # column by column
    extrinsics.translation = list(T.position_m)
    profiles[0].register_extrinsics_to(profiles[1], extrinsics)
    device.create_matcher(rs.matchers.default)
    syncer = rs.syncer()
    images = [depth, np.zeros((color_camera.height, color_camera.width, 3), np.uint8)]
    for sensor, profile in zip(sensors, profiles, strict=True):
        sensor.open(profile)
        sensor.start(syncer)
    frames = None
    for number in range(1, 6):
        for sensor, profile, image in zip(sensors, profiles, images, strict=True):
            frame = rs.software_video_frame()
            frame.pixels = image
            frame.bpp = image.itemsize * (image.shape[2] if image.ndim == 3 else 1)
            frame.stride = frame.bpp * image.shape[1]
            frame.timestamp, frame.frame_number = 33.0 * number, number
            frame.profile = profile.as_video_stream_profile()
            if image.ndim == 2:
                frame.depth_units = 0.001
            sensor.on_video_frame(frame)
        done, frames = syncer.try_wait_for_frames(1000)
        if done and frames.size() == 2:
            break
    assert frames is not None
    assert frames.size() == 2
    aligned = np.asanyarray(rs.align(rs.stream.color).process(frames).get_depth_frame().get_data()).copy()
    for sensor in sensors:
        sensor.stop()
        sensor.close()
    return aligned


D435_TURN = (0.12, -0.31, 0.22)
CASES = {
    "same size, baseline": (camera(640, 480, 615.0), camera(640, 480, 615.0), pose(), (0.015, 0.0, 0.0)),
    "finer colour": (
        camera(640, 480, 385.0),
        camera(1280, 720, 920.0),
        pose(D435_TURN),
        (0.0148, 2e-4, 3e-4),
    ),
    "coarser colour": (camera(848, 480, 425.0), camera(640, 480, 300.0), pose(D435_TURN), (0.0148, 0, 3e-4)),
    "same size, finer": (camera(640, 480, 385.0), camera(640, 480, 615.0), pose(D435_TURN), (0.015, 0, 0)),
    "cropped, exception": (camera(640, 480, 600.0), camera(640, 360, 450.0), pose(), (-0.05, 0.01, 0)),
    "far apart, turned": (
        camera(320, 240, 200.0),
        camera(424, 240, 300.0),
        pose((3, -5, 2)),
        (0.2, -0.1, 0.05),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_equals_the_sdk_in_every_pixel(name: str) -> None:
    rs = pytest.importorskip(
        "pyrealsense2", reason="compares with the camera maker's SDK", exc_type=ImportError
    )
    depth_camera, color_camera, turn, shift = CASES[name]
    matrix = turn.matrix.copy()
    matrix[:3, 3] = shift
    T = Pose("color", "depth", matrix)
    depth = scene(depth_camera.height, depth_camera.width, 5)
    theirs = sdk_align(rs, depth, depth_camera, color_camera, T)
    ours = align_depth_to_color(depth, 0.001, depth_camera, color_camera, T, like_sdk=True)
    assert (theirs > 0).mean() > 0.1
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.slow
def test_one_frame_takes_a_few_milliseconds() -> None:
    import time

    args = (scene(480, 640, 1), 0.001, camera(640, 480, 385.0), camera(1280, 720, 920.0), pose(D435_TURN))
    align_depth_to_color(*args)
    times = []
    for _ in range(10):
        start = time.perf_counter()
        align_depth_to_color(*args)
        times.append(time.perf_counter() - start)
    assert min(times) < 0.05
