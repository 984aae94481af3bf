"""A live camera through the SDK itself: its software device, syncer, filters and rs.align."""

import logging
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from swardmap.config import CameraConfig, SourceConfig
from swardmap.errors import ConfigError, InputError, MissingExtraError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io import is_live, open_source
from swardmap.io.bags.rosbag import REASON_DAMAGED
from swardmap.io.sources.limited import LimitedSource
from swardmap.io.sources.pairing import REASON_COLOR, REASON_DEPTH, REASON_ORDER
from swardmap.io.sources.realsense_camera import calibration_of
from swardmap.io.sources.realsense_live import REASON_MISSED, RealsenseSource
from swardmap.perception.align import align_depth_to_color
from swardmap.types import Frame
from tests.io.contract import check_source
from tests.realsense import (
    HEIGHT,
    PERIOD_MS,
    START_MS,
    WIDTH,
    SoftwareCamera,
    color_image,
    depth_image,
    feeding,
    intrinsics,
    rs,
    steady,
)

SMALL: dict[str, Any] = {"width": WIDTH, "height": HEIGHT, "timeout_s": 0.4, "reconnect_s": 4.0, "queue": 100}
COLOR = Intrinsics(WIDTH, HEIGHT, 50.0, 50.0, 31.5, 23.5)
DEPTH = Intrinsics(WIDTH, HEIGHT, 60.0, 60.0, 31.5, 23.5)
T_COLOR_DEPTH = Pose("color", "depth", np.array([[1, 0, 0, 0.015], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))


def live(
    feed: Callable[[SoftwareCamera], None],
    make: Callable[[], SoftwareCamera] = SoftwareCamera,
    source: SourceConfig | None = None,
    **camera: Any,
) -> RealsenseSource:
    config = CameraConfig(**{**SMALL, **camera})
    return RealsenseSource(rs, feeding(make, feed), source or SourceConfig(), config)


def first(source: RealsenseSource, count: int = 1) -> list[Frame]:
    return list(LimitedSource(source, frames=count))


def stamp(number: int) -> int:
    return round((START_MS + number * PERIOD_MS) * 1e6)


def test_contract() -> None:
    frames = check_source(lambda: LimitedSource(live(steady(6)), frames=5))
    for number, frame in enumerate(frames, start=1):  # the SDK gives the images of the first pair apart
        assert abs(frame.stamp_ns - stamp(number)) < 1000  # its clock is a float64 of milliseconds
        assert frame.name == f"{number - 1:06d}"
        assert frame.intrinsics == COLOR
        assert frame.depth_unit_m == 0.001
        assert frame.T_map_camera is None
        np.testing.assert_array_equal(frame.rgb, color_image(number))


def test_what_the_source_says_of_itself() -> None:
    source = live(steady(3))
    assert source.name == "Software D435I 123"
    assert source.frame_count is None
    assert source.label_set is None
    assert len(first(source)) == 1
    assert source.skipped == {REASON_COLOR: 1, REASON_DEPTH: 1}


def test_depth_comes_into_the_colour_image_by_our_rule() -> None:
    (frame,) = first(live(steady(2)))
    expected = align_depth_to_color(depth_image(1), 0.001, DEPTH, COLOR, T_COLOR_DEPTH)
    np.testing.assert_array_equal(frame.depth, expected)
    # the closed form: the left edge of the wall, -32 px of depth at 1.001 m, in the colour image
    seen = np.flatnonzero(frame.depth[5])
    left = 50.0 * ((-31.5 / 60.0) * 1.001 + 0.015) / 1.001 + 31.5
    assert seen[0] == pytest.approx(left, abs=1)


def test_depth_by_rs_align_is_ours_like_sdk_bit_for_bit() -> None:
    (frame,) = first(live(steady(2), align="sdk"))
    expected = align_depth_to_color(depth_image(1), 0.001, DEPTH, COLOR, T_COLOR_DEPTH, like_sdk=True)
    np.testing.assert_array_equal(frame.depth, expected)


@pytest.mark.parametrize("align", ["swardmap", "sdk"])
def test_flying_pixels_are_taken_out_before_depth_is_aligned(
    align: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def spiked(number: int) -> Any:
        depth = depth_image(number).copy()
        depth[20, 30] = 400  # before the wall, and alone
        return depth

    monkeypatch.setattr("tests.realsense.depth_image", spiked)
    (frame,) = first(live(steady(2), align=align))
    ours = align == "swardmap"  # the SDK's block aligns what it gets
    assert frame.depth_filtered is ours
    assert bool((frame.depth == 400).any()) is not ours


def test_the_unit_is_the_sensors() -> None:
    (frame,) = first(live(steady(2), lambda: SoftwareCamera(unit_m=0.0001)))
    assert frame.depth_unit_m == 0.0001


def test_colour_is_rectified_as_opencv_does() -> None:
    coefficients = (0.1, -0.05, 0.001, -0.002, 0.01)
    make = lambda: SoftwareCamera(color=intrinsics(50.0, rs.distortion.brown_conrady, coefficients))  # noqa: E731
    (frame,) = first(live(steady(2), make))
    expected = cv2.undistort(color_image(1), COLOR.matrix, np.array(coefficients))
    off = np.abs(frame.rgb.astype(int) - expected)
    assert off.max() <= 16  # both round places to 1/32 pixel, of an image of noise: 255 / 32 an axis
    assert np.abs(color_image(1).astype(int) - expected).max() > 100
    assert frame.intrinsics == COLOR


def test_an_inverse_polynomial_is_told_apart() -> None:
    found = calibration_of(intrinsics(50.0, rs.distortion.inverse_brown_conrady, [0.1, 0, 0, 0, 0]), "x")
    assert found.inverse
    assert found.distortion == pytest.approx((0.1, 0, 0, 0, 0))
    assert calibration_of(intrinsics(50.0, rs.distortion.inverse_brown_conrady), "x").distortion == ()


@pytest.mark.parametrize("model", ["ftheta", "kannala_brandt4", "modified_brown_conrady"])
def test_other_lenses_are_refused(model: str) -> None:
    camera = intrinsics(50.0, getattr(rs.distortion, model), [0.1, 0, 0, 0, 0])
    with pytest.raises(InputError, match=f"lens model '{model}'"):
        live(steady(2), lambda: SoftwareCamera(color=camera))


def test_filters_are_the_sdks_own() -> None:
    (frame,) = first(live(steady(2), decimation=2, threshold_m=(0.2, 6.0)))
    half = rs.decimation_filter(2.0)
    assert half.get_option(rs.option.filter_magnitude) == 2
    smaller = Intrinsics(32, 24, 30.0, 30.0, 15.75, 11.75)  # as the SDK scales them
    wall = np.full((24, 32), 1001, np.uint16)
    wall[10:14, 14:18] = 0
    np.testing.assert_array_equal(
        frame.depth, align_depth_to_color(wall, 0.001, smaller, COLOR, T_COLOR_DEPTH)
    )


def test_threshold_drops_what_is_far() -> None:
    (frame,) = first(live(steady(2), threshold_m=(0.2, 0.9)))
    assert not frame.depth.any()


def test_holes_stay_holes_unless_asked_for() -> None:
    hole = (slice(22, 26), slice(31, 34))
    (plain,) = first(live(steady(2), spatial=True, temporal=True))
    (filled,) = first(live(steady(2), hole_filling=True))
    assert not plain.depth[hole].any()
    assert filled.depth[hole].all()


def test_frames_are_chosen_as_in_recordings() -> None:
    source = live(steady(12), source=SourceConfig(start=2, stop=8, every=3))
    assert [frame.name for frame in source] == ["000002", "000005"]


def test_a_lone_colour_image_is_left_out_and_counted() -> None:
    def feed(camera: SoftwareCamera) -> None:
        for number in range(8):
            camera.push(number, START_MS + number * PERIOD_MS, "c" if number in (3, 4) else "dc")

    source = live(feed)
    frames = first(source, 5)
    assert [round((f.stamp_ns / 1e6 - START_MS) / PERIOD_MS) for f in frames] == [1, 2, 5, 6, 7]
    assert source.skipped == {REASON_COLOR: 3, REASON_DEPTH: 1}


def test_images_too_far_apart_in_time_are_no_pair() -> None:
    def feed(camera: SoftwareCamera) -> None:
        for number in range(4):
            camera.push(number, START_MS + number * PERIOD_MS, "d")
            camera.push(number, START_MS + number * PERIOD_MS + 8, "c")

    source = live(feed, source=SourceConfig(pair_tolerance_ms=5), reconnect_s=0.6)
    with pytest.raises(InputError, match=f"{REASON_COLOR}"):
        list(source)
    assert len(first(live(feed, source=SourceConfig(pair_tolerance_ms=10)), 3)) == 3


def test_a_clock_that_goes_back_gives_no_frame() -> None:
    def feed(camera: SoftwareCamera) -> None:
        for number, at in enumerate([0, 1, 2, 3, 1, 2, 4]):
            camera.push(number, START_MS + at * PERIOD_MS)

    source = live(feed)
    frames = first(source, 4)
    assert [round((f.stamp_ns / 1e6 - START_MS) / PERIOD_MS) for f in frames] == [1, 2, 3, 4]
    # the SDK splits the first image that went back, and pairs the second
    assert source.skipped[REASON_ORDER] == 1


def test_the_clock_of_the_hardware_is_tied_to_the_computers() -> None:
    def feed(camera: SoftwareCamera) -> None:
        for number in range(4):
            camera.push(number, START_MS - 1e11 + number * PERIOD_MS, domain="hardware_clock")

    frames = first(live(feed), 3)
    assert abs(frames[0].stamp_ns - time.time_ns()) < 30e9
    assert np.diff([f.stamp_ns for f in frames]) == pytest.approx(PERIOD_MS * 1e6, abs=2000)


def test_an_image_of_another_size_is_left_out() -> None:
    first_numbers = [0, 20]

    def feed(camera: SoftwareCamera) -> None:
        start = first_numbers.pop(0)
        for number in range(start, start + 6):
            camera.push(number, START_MS + number * PERIOD_MS, "dC" if number == 2 else "dc")

    source = live(feed, lambda: SoftwareCamera(also=intrinsics(25.0, size=(32, 24))))
    frames = first(source, 3)
    numbers = [round((f.stamp_ns / 1e6 - START_MS) / PERIOD_MS) for f in frames]
    assert numbers == [1, 21, 22]  # the SDK's syncer stops at such an image, so the camera is opened anew
    assert source.skipped[REASON_DAMAGED] == 1


def test_an_unplugged_camera_comes_back(caplog: pytest.LogCaptureFixture) -> None:
    plugged = [feeding(SoftwareCamera, steady(4)), None, None, feeding(SoftwareCamera, steady(4, first=20))]
    asked: list[str | None] = []

    def find(serial: str | None) -> Any:
        asked.append(serial)
        now = plugged.pop(0)
        return now and now(serial)

    source = RealsenseSource(rs, find, SourceConfig(), CameraConfig(**SMALL))
    with caplog.at_level(logging.WARNING):
        frames = first(source, 6)
    numbers = [round((f.stamp_ns / 1e6 - START_MS) / PERIOD_MS) for f in frames]
    assert numbers == [1, 2, 3, 21, 22, 23]
    assert [f.name for f in frames] == [f"{i:06d}" for i in range(6)]
    assert asked == [None, "123", "123", "123"]  # never another camera
    assert "Software D435I 123: no images for" in caplog.text


def test_a_camera_that_does_not_come_back_is_lost(caplog: pytest.LogCaptureFixture) -> None:
    plugged = [feeding(SoftwareCamera, steady(4))]
    find = lambda serial: plugged.pop()(serial) if plugged else None  # noqa: E731
    source = RealsenseSource(rs, find, SourceConfig(), CameraConfig(**{**SMALL, "reconnect_s": 1.0}))
    started = time.monotonic()
    frames = list(source)  # what came is not thrown away by an error
    assert len(frames) == 3
    assert time.monotonic() - started < 4
    assert "no image that can be used" in source.lost
    assert "no RealSense camera 123 is connected" in source.lost
    assert source.lost in caplog.text


def test_a_silent_camera_is_an_error() -> None:
    source = live(lambda camera: None, reconnect_s=0.8)
    with pytest.raises(InputError, match=r"no image that can be used for \d+ s"):
        list(source)


def test_what_the_sdk_says_of_a_camera_ends_the_streams_not_the_run(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    from swardmap.io.sources.realsense_camera import RealsenseCamera

    take = RealsenseCamera.take
    failed: list[bool] = []

    def failing(self: RealsenseCamera, timeout_s: float) -> Any:
        if not failed:
            failed.append(True)
            raise RuntimeError("xioctl(VIDIOC_QBUF) failed Last Error: No such device")
        return take(self, timeout_s)

    source = live(steady(3))
    monkeypatch.setattr(RealsenseCamera, "take", failing)
    with caplog.at_level(logging.WARNING):
        assert len(first(source, 2)) == 2
    assert "No such device" in caplog.text


def test_stop_ends_the_iteration_also_while_it_waits() -> None:
    source = live(steady(3), timeout_s=60.0)
    frames = iter(source)
    next(frames), next(frames)
    source.stop()
    started = time.monotonic()
    assert list(frames) == []
    assert time.monotonic() - started < 2


def test_a_slow_reader_gets_the_newest() -> None:
    source = live(steady(30), queue=CameraConfig().queue)
    time.sleep(0.5)
    (frame,) = first(source)
    assert abs(frame.stamp_ns - stamp(29)) < 1000
    assert source.skipped == {}  # what came before the first look is nobody's loss


def test_what_a_slow_reader_missed_is_counted() -> None:
    def feed(camera: SoftwareCamera) -> None:
        for number in range(40):
            camera.push(number, START_MS + number * PERIOD_MS)
            time.sleep(0.005)

    source, seen = live(feed, queue=1, reconnect_s=0.5), []
    for frame in source:
        seen.append(round((frame.stamp_ns / 1e6 - START_MS) / PERIOD_MS))
        time.sleep(0.05)
    assert 1 < len(seen) < 20
    lone = source.skipped.get(
        REASON_COLOR, 0
    )  # of pairs which the SDK splits: the first, or more on a busy machine
    told = source.skipped[REASON_MISSED] + len(seen)
    assert told + lone >= seen[-1] - seen[0] + 1  # nothing in between is passed over in silence
    assert told <= seen[-1] + 1  # and nothing is counted twice


def test_streams_that_are_not_there_are_listed() -> None:
    with pytest.raises(InputError, match=r"no colour stream of 640x48 at 30 .* it has 64x48 at 30"):
        live(steady(1), width=640)


def test_no_camera() -> None:
    find = lambda _: None  # noqa: E731
    with pytest.raises(InputError, match="no RealSense camera 99 is connected"):
        RealsenseSource(rs, find, SourceConfig(), CameraConfig(), "99")


def test_a_location_names_a_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    assert is_live("realsense:")
    assert is_live("realsense:0123")
    assert not is_live("realsense")
    assert not is_live("C:/recording")
    with pytest.raises(InputError, match="expected one camera"):
        open_source("realsense:1,2")
    with pytest.raises(InputError, match="no RealSense camera is connected"):
        open_source("realsense:")
    monkeypatch.setitem(__import__("sys").modules, "pyrealsense2", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'swardmap\[realsense\]'"):
        open_source("realsense:")


def test_more_than_one_camera_is_not_guessed(monkeypatch: pytest.MonkeyPatch) -> None:
    from swardmap.io.sources.realsense_camera import finder

    cameras = [SoftwareCamera("1"), SoftwareCamera("2")]

    class Context:
        def query_devices(self) -> list[Any]:
            return [camera.device for camera in cameras]

    monkeypatch.setattr(rs, "context", Context)
    find = finder(rs)
    with pytest.raises(InputError, match="realsense:SERIAL, of 1, 2"):
        find(None)
    assert find("2").get_info(rs.camera_info.serial_number) == "2"
    assert find("3") is None


def test_a_range_the_wrong_way_round_is_refused() -> None:
    with pytest.raises(ConfigError, match="threshold_m"):
        CameraConfig(threshold_m=(3.0, 1.0))
