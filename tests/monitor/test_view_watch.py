"""What view, pose and mount say against each other: wrong ones are named, good drives are not blamed."""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from swardmap.config import WatchdogConfig
from swardmap.geometry import Intrinsics, Pose
from swardmap.io import open_source
from swardmap.monitor.align_watch import AlignWatch
from swardmap.monitor.diagnostics import Fault, frame_stats
from swardmap.monitor.motion_watch import PairOff, is_off
from swardmap.monitor.seen_motion import seen_motion, view_of
from swardmap.monitor.tilt_watch import TiltWatch
from swardmap.monitor.watchdog import Watchdog
from swardmap.runs.frame_check import FrameCheck, doubt_warnings
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.types import Frame, depth_in_metres

DEMO = Path(__file__).parents[2] / "src/swardmap/data/demo"
LENS = Intrinsics(320, 240, 230.0, 230.0, 159.5, 119.5)
DATA = Path(os.environ.get("SWARDMAP_DATA", "none"))
NEVER_FROZEN = WatchdogConfig(frozen_s=None)

Frames = Sequence[Frame]


@cache
def drive(name: str = "lane") -> tuple[Frame, ...]:
    if name == "demo":
        return tuple(open_source(DEMO))
    frames = AnalyticSource(garden_scene(0), tuple(lane_poses(10, step_m=0.2)), LENS)
    return tuple(replace(f, stamp_ns=(i + 1) * 100_000_000) for i, f in enumerate(frames))


def doubts(frames: Frames) -> FrameCheck:
    check = FrameCheck(NEVER_FROZEN)
    assert all(check.is_fit(frame) for frame in frames)
    return check


def posed(frames: Frames, change: Callable[[int, np.ndarray], np.ndarray]) -> list[Frame]:
    matrices = [(f, f.T_map_camera.matrix.copy()) for f in frames if f.T_map_camera is not None]
    return [replace(f, T_map_camera=Pose("map", "camera", change(i, m))) for i, (f, m) in enumerate(matrices)]


def shifted(i: int, m: np.ndarray, x: float = 0, y: float = 0) -> np.ndarray:
    m[:2, 3] += i * x, i * y
    return m


def scaled(frames: Frames, by: float) -> list[Frame]:
    metres = [depth_in_metres(f.depth, f.depth_unit_m) * np.float32(by) for f in frames]
    return [replace(f, depth=z, depth_unit_m=1.0) for f, z in zip(frames, metres, strict=True)]


def yawed(frames: Frames, degrees: float) -> list[Frame]:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])

    def change(_: int, m: np.ndarray) -> np.ndarray:
        m[:3, :3] = turn @ m[:3, :3]
        return m

    return posed(frames, change)


@pytest.mark.parametrize("name", ["lane", "demo"])
def test_the_motion_seen_is_that_of_the_renderer_whatever_the_pose_says(name: str) -> None:
    frames = drive(name)[2:8]
    still = posed(frames, lambda _, m: m)
    for one, two in pairwise(still):
        a, b = view_of(one), view_of(two)
        assert a is not None
        assert b is not None
        seen = seen_motion(a, b)
        misled = seen_motion(a, replace(b, T_map_camera=a.T_map_camera))
        assert seen == pytest.approx(b.T_map_camera.matrix, abs=0.02)
        assert misled is None or misled == pytest.approx(b.T_map_camera.matrix, abs=0.02)


@pytest.mark.parametrize("name", ["lane", "demo"])
@pytest.mark.parametrize("order", ["forward", "every second", "standing"])
def test_good_drives_are_not_blamed(name: str, order: str) -> None:
    frames = list(drive(name))
    kinds = {"forward": frames, "every second": frames[::2], "standing": frames[3:4] * 12}
    chosen = [replace(f, stamp_ns=(i + 1) * 400_000_000) for i, f in enumerate(kinds[order])]
    assert not doubts(chosen).faults


@pytest.mark.parametrize("name", ["rgbd_3dmatch", "rgbd_lawn", "orfd"])
def test_real_recordings_are_not_blamed(name: str) -> None:
    if not (DATA / name).is_dir():
        pytest.skip("SWARDMAP_DATA names no folder with this recording")
    check = FrameCheck(NEVER_FROZEN)
    for frame in list(open_source(DATA / name))[:20]:
        check.is_fit(frame)
    assert not check.doubts


WRONG = {
    "depth too long by a tenth": lambda frames: scaled(frames, 1.1),
    "depth too short by a tenth": lambda frames: scaled(frames, 0.9),
    "camera three degrees to the left": lambda frames: yawed(frames, 3),
    "camera three degrees to the right": lambda frames: yawed(frames, -3),
    "drift to the side": lambda frames: posed(frames, lambda i, m: shifted(i, m, y=0.02)),
    "wheels that slip": lambda frames: posed(frames, lambda i, m: shifted(i, m, x=0.03)),
    "pose stands still": lambda frames: posed(frames, lambda i, m: shifted(i, m, x=-0.2)),
    "pose runs backwards": lambda frames: posed(frames, lambda i, m: shifted(i, m, x=-0.4)),
}


@pytest.mark.parametrize("kind", WRONG)
def test_pose_and_view_that_differ_are_named_and_mapped(kind: str) -> None:
    frames = WRONG[kind](drive())
    check = doubts(frames)
    assert set(check.faults) == {Fault.MOTION}
    assert check.refused == 0
    (warning,) = doubt_warnings({"faults": check.faults, "first": check.first, "doubts": check.doubts})
    assert warning.startswith("motion mismatch (from frame ")
    dog = Watchdog(["camera"], NEVER_FROZEN)
    for frame in frames:
        assert dog.observe_frame("camera", frame_stats(frame, frame.stamp_ns))
    assert Fault.MOTION in dog.check(frames[-1].stamp_ns).faults("camera"), "as offline"


def turning(degrees: float) -> list[Pose]:
    """Poses of a drive that turns by so many degrees a frame."""
    poses, at, heading = [], np.zeros(2), 0.0
    for _ in range(10):
        c, s = np.cos(heading), np.sin(heading)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        matrix = lane_poses(1)[0].matrix.copy()
        matrix[:3, :3] = turn @ matrix[:3, :3]
        matrix[:2, 3] += at
        poses.append(Pose("map", "camera", matrix))
        at, heading = at + 0.2 * np.array([c, s]), heading + np.deg2rad(degrees)
    return poses


def test_mirrored_images_are_named_in_a_turn() -> None:
    source = AnalyticSource(garden_scene(0), tuple(turning(5)), LENS)
    frames = [replace(f, stamp_ns=(i + 1) * 100_000_000) for i, f in enumerate(source)]
    assert not doubts(frames).faults
    mirrored = []
    for f in frames:
        assert f.labels is not None
        rgb, depth, labels = f.rgb[:, ::-1].copy(), f.depth[:, ::-1].copy(), f.labels[:, ::-1].copy()
        mirrored.append(replace(f, rgb=rgb, depth=depth, labels=labels))
    assert set(doubts(mirrored).faults) == {Fault.MOTION}


def test_images_too_small_to_tell_motion_by_tell_nothing() -> None:
    small = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
    (frame,) = AnalyticSource(garden_scene(0), tuple(lane_poses(1)), small)
    assert view_of(frame) is None
    assert view_of(replace(drive()[0], T_map_camera=None)) is None


def test_wheels_that_spin_on_the_spot_are_named() -> None:
    spinning = [replace(f, rgb=drive()[0].rgb, depth=drive()[0].depth) for f in drive()]
    assert doubts(spinning).doubts[Fault.MOTION].startswith("in ")


def test_one_pair_or_a_few_prove_nothing_and_neither_does_scatter() -> None:
    off, good = PairOff(0.1, 0.0, False), PairOff(0.0, 0.0, False)
    assert not is_off([off] * 5)
    assert is_off([off] * 6)
    assert not is_off([off] * 5 + [good] * 6)
    assert not is_off([PairOff(v, 0.0, False) for v in (0.4, -0.3, 0.5, -0.2, 0.3, 0.2)])
    assert not is_off([PairOff(None, None, True)] * 3)
    assert is_off([PairOff(None, None, True)] * 4)
    assert not is_off([PairOff(None, None, True)] * 4 + [PairOff(None, None, False)] * 4)
    assert not is_off([off] * 12, limit=2)


def moved_aside(frame: Frame, pixels: int) -> Frame:
    depth = np.roll(frame.depth, pixels, axis=1)
    return replace(frame, depth=depth)


@pytest.mark.parametrize("recording", ["lane", "rgbd_3dmatch", "rgbd_lawn"])
@pytest.mark.parametrize("share", [0.05, -0.05])
def test_depth_beside_colour_is_named_with_its_side(recording: str, share: float) -> None:
    if recording.startswith("rgbd") and not (DATA / recording).is_dir():
        pytest.skip("SWARDMAP_DATA names no folder with this recording")
    frames = list(drive()) if recording == "lane" else list(open_source(DATA / recording)) * 2
    good, bad = AlignWatch(1.0), AlignWatch(1.0)
    for frame in frames:
        good.add(frame_stats(frame, 0).edges)
        bad.add(frame_stats(moved_aside(frame, round(share * frame.depth.shape[1])), 0).edges)
    assert good.shift == 0
    assert bad.shift == pytest.approx(share, abs=0.012)


def camera(x_m: float, tilt_deg: float = 20.0) -> Pose:
    t = np.deg2rad(tilt_deg)
    matrix = np.eye(4)
    matrix[:3, :3] = [[0, -np.sin(t), np.cos(t)], [-1, 0, 0], [0, -np.cos(t), -np.sin(t)]]
    matrix[0, 3] = x_m
    return Pose("map", "camera", matrix)


def test_ground_that_is_tilted_all_along_is_named_with_its_angles() -> None:
    watch, slope = TiltWatch(1.0), (0.01, np.tan(np.deg2rad(3)))
    said = [watch.add(camera(0.2 * i), slope) for i in range(12)]
    assert said == [False] * 9 + [True] * 3
    assert watch.tilt_deg == pytest.approx(
        (-0.573, 3.0), abs=0.01
    )  # it rises to the left: falls to the right


def test_slopes_that_come_and_go_or_are_in_the_pose_are_no_fault_of_the_mount() -> None:
    banks = [np.tan(np.deg2rad(d)) for d in (0, 0, 1, 2, 4, 6, 8, 10, 10, 10, 6, 3, 0, 0)]
    bank, tilting, parked, level = (TiltWatch(1.0) for _ in range(4))
    for i, rise in enumerate(banks):
        assert not bank.add(camera(0.2 * i), (rise, 0.0))
        assert not tilting.add(camera(0.2 * i, 20 + i % 3), (0.1, 0.0)), "the pose has the robot's own tilt"
        assert not parked.add(camera(0.01 * i), (0.1, 0.0))
        assert not level.add(camera(0.2 * i), (0.03, -0.03))
    assert not any(TiltWatch(None).add(camera(0.2 * i), (0.3, 0.0)) for i in range(20))
