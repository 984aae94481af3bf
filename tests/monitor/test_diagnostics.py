"""Statistics of a frame: what they tell, and what they must not tell."""

from dataclasses import replace

import numpy as np
import pytest

from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.monitor.diagnostics import frame_stats, is_upside_down
from swardmap.synth.analytic import Box, Scene, StereoNoise, Walker, garden_scene, render, with_sensor_noise
from swardmap.types import Frame, depth_in_metres

CAMERA = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)


def seen(scene: Scene, mount: Pose, seed: int = 0) -> Frame:
    frame = render(scene, CAMERA, Pose("map", mount.child, mount.matrix))
    return with_sensor_noise(frame, np.random.default_rng(seed), StereoNoise())


def over(frame: Frame, *axes: int) -> Frame:
    return replace(frame, rgb=np.flip(frame.rgb, axes), depth=np.flip(frame.depth, axes))


MOUNTS = [(h, p, r) for h in (0.5, 0.9, 1.4) for p in (10.0, 25.0, 40.0) for r in (0.0, 8.0)]


@pytest.mark.parametrize(("height_m", "pitch_deg", "roll_deg"), MOUNTS)
def test_an_image_turned_over_is_told_from_one_that_is_not(
    height_m: float, pitch_deg: float, roll_deg: float
) -> None:
    mount = mount_pose(height_m, pitch_deg, roll_deg)
    for seed in range(3):
        frame = seen(garden_scene(seed), mount, seed)
        assert frame_stats(frame, 0, mount).upside_down is False
        assert frame_stats(over(frame, 0, 1), 0, mount).upside_down is True
        assert frame_stats(over(frame, 0), 0, mount).upside_down is True


def test_what_cannot_be_told_is_not_told() -> None:
    mount = mount_pose(0.9, 25.0)
    frame = seen(garden_scene(0), mount)
    assert frame_stats(over(frame, 0, 1), 0).upside_down is None  # without a mount
    assert frame_stats(over(frame, 1), 0, mount).upside_down is False  # mirrored left to right
    down = mount_pose(0.9, 90.0)
    assert frame_stats(over(seen(Scene((), (), ()), down), 0, 1), 0, down).upside_down is False


@pytest.mark.parametrize("slope_deg", [-20.0, -10.0, 10.0, 20.0])
def test_a_slope_is_not_taken_for_an_image_turned_over(slope_deg: float) -> None:
    mount = mount_pose(0.9, 25.0)
    on_slope = mount_pose(0.9, 25.0 + slope_deg)  # ground that tilts is a camera that tilts
    depth_m = depth_in_metres(seen(Scene((), (), ()), on_slope).depth, 0.001)
    assert not is_upside_down(depth_m, CAMERA, mount)


def test_a_wall_and_a_person_before_the_camera_are_not_either() -> None:
    mount = mount_pose(0.9, 25.0)
    wall = Scene((Box((1.2, 0.0), (0.2, 8.0, 3.0)),), (), ())
    person = Scene((), (), (Walker((0.7, 0.0)),))
    for scene in (wall, person):
        assert frame_stats(seen(scene, mount), 0, mount).upside_down is False


def test_checksums_tell_noise_and_brightness_its_darkness() -> None:
    mount = mount_pose(0.9, 25.0)
    one, two = seen(garden_scene(0), mount, 0), seen(garden_scene(0), mount, 1)
    a, b, again = frame_stats(one, 0, mount), frame_stats(two, 0, mount), frame_stats(one, 5, mount)
    assert (a.color_print, a.depth_print) == (again.color_print, again.depth_print)
    assert a.depth_print != b.depth_print
    assert a.bright_level > 50
    assert frame_stats(replace(one, rgb=one.rgb // 32), 0).bright_level < 8
    assert a.depth_share == pytest.approx(np.isfinite(one.depth_m).mean(), abs=0.02)
    assert frame_stats(replace(one, depth=np.zeros_like(one.depth)), 0, mount).depth_share == 0
    assert frame_stats(replace(one, depth=np.zeros_like(one.depth)), 0, mount).upside_down is False
