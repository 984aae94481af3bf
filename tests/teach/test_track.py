"""The way of the robot: where its base was, where it jumped, what its footprint covered."""

import numpy as np
import pytest

from swardmap.config import MountConfig
from swardmap.errors import ConfigError
from swardmap.geometry import Pose, mount_pose
from swardmap.grid import GridSpec
from swardmap.teach.plan import circle, read_span
from swardmap.teach.track import Track, base_of, driven_cells, in_spans, steady

SPEC = GridSpec(0.05, 200, 120, (-2.0, -3.0))
SQUARE = np.array([[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]])


def track_of(
    xy_m: list[tuple[float, float]], yaw_rad: list[float] | None = None, step_s: float = 0.5
) -> Track:
    stamps = (np.arange(len(xy_m)) * step_s * 1e9).astype(np.int64)
    return Track(stamps, np.array(xy_m, np.float64), np.array(yaw_rad or [0.0] * len(xy_m)))


def test_the_base_is_found_from_the_camera_and_its_mount() -> None:
    mount = MountConfig(height_m=0.6, pitch_deg=25, yaw_deg=30, x_m=0.4, y_m=-0.1)
    T_base_camera = mount_pose(0.6, 25, 0, 30, (0.4, -0.1))
    turn = np.eye(4)
    turn[:2, :2] = [[0, -1], [1, 0]]
    turn[:3, 3] = (3, 2, 0)
    x, y, yaw = base_of(Pose("map", "base", turn) @ T_base_camera, mount)
    assert (x, y, yaw) == pytest.approx((3.0, 2.0, np.pi / 2), abs=1e-9)


def test_the_covered_cells_are_those_of_the_outline_on_its_way() -> None:
    track = track_of([(0, 0), (0.5, 0), (1.0, 0)])
    covered = driven_cells(track, np.ones(3, np.bool_), SQUARE, SPEC) > 0
    assert covered.sum() * 0.0025 == pytest.approx(1.6 * 0.4, rel=0.05)
    turning = track_of([(0, 0), (0, 0)], [0.0, np.pi / 2])
    covered = driven_cells(turning, np.ones(2, np.bool_), SQUARE, SPEC) > 0
    radius_m = np.hypot(0.3, 0.2)
    sector = 2 * (np.pi / 2) / 2 * radius_m**2  # both ends sweep a quarter of the circle, at least
    assert sector * 0.9 < covered.sum() * 0.0025 < np.pi * radius_m**2


def test_poses_that_are_far_apart_are_not_joined() -> None:
    track = track_of([(0, 0), (3.0, 0)], step_s=2.0)
    covered = driven_cells(track, np.ones(2, np.bool_), circle(0.3), SPEC) > 0
    assert covered.sum() * 0.0025 == pytest.approx(2 * np.pi * 0.09, rel=0.1)


def test_a_jump_there_and_back_leaves_the_longer_chain() -> None:
    way = [(0.2 * i, 2.0 if 10 <= i < 15 else 0.0) for i in range(30)]
    kept = steady(track_of(way))
    assert np.flatnonzero(~kept).tolist() == [10, 11, 12, 13, 14]
    assert steady(track_of([(0.2 * i, 0.0) for i in range(30)])).all()
    cut = steady(track_of([(0.2 * i, 0.0) for i in range(30)]), cuts=[10, 15])
    assert np.flatnonzero(~cut).tolist() == [10, 11, 12, 13, 14]


def test_time_spans_are_read_and_refused() -> None:
    seconds = np.array([0.0, 1.0, 2.0, 3.0])
    assert in_spans(seconds, (read_span("0.5-2"),)).tolist() == [False, True, True, False]
    for wrong in ("20-12", "3", "a-b", "-4", "nan-3"):
        with pytest.raises(ConfigError, match=r"such as 12\.5-20"):
            read_span(wrong)
