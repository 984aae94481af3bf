"""Depth that is a frame late or early is noticed in motion, and nothing else is taken for it."""

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from swardmap.config import SourceConfig, WatchdogConfig
from swardmap.geometry import Intrinsics
from swardmap.io import open_source
from swardmap.monitor.diagnostics import Fault, frame_stats
from swardmap.monitor.step_watch import (
    DECIDED,
    WINDOW,
    EdgeLook,
    StepCounts,
    StepWatch,
    edge_look,
    step_counts,
)
from swardmap.monitor.watchdog import Watchdog
from swardmap.runs.frame_check import FrameCheck
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.types import Frame

DEMO = Path(__file__).parents[2] / "src/swardmap/data/demo"
LENS = Intrinsics(480, 360, 345.0, 345.0, 239.5, 179.5)
DATA = Path(os.environ.get("SWARDMAP_DATA", "none"))
RECORDINGS = ("rgbd_3dmatch", "rgbd_lawn", "orfd")


@cache
def drive(name: str) -> tuple[Frame, ...]:
    if name == "rendered":
        return tuple(AnalyticSource(garden_scene(0), tuple(lane_poses(14, step_m=0.15)), LENS))
    return tuple(open_source(DEMO))


def shifted(frames: Sequence[Frame], by: int) -> list[Frame]:
    """Depth of the frame `by` places before, with the colour, pose and time of each."""
    last = len(frames) - 1
    return [replace(f, depth=frames[min(last, max(0, i - by))].depth) for i, f in enumerate(frames)]


def found(frames: Sequence[Frame]) -> int:
    check = FrameCheck(WatchdogConfig(frozen_s=None))
    return len(frames) - sum(check.is_fit(frame) for frame in frames)


@pytest.mark.parametrize("name", ["demo", "rendered"])
@pytest.mark.parametrize("by", [1, -1], ids=["late", "early"])
def test_depth_of_another_frame_is_noticed_within_seven(name: str, by: int) -> None:
    frames = shifted(drive(name), by)
    assert found(frames[: DECIDED + 2]) >= 1
    check, dog = (
        FrameCheck(WatchdogConfig(frozen_s=None)),
        Watchdog(["camera"], WatchdogConfig(frozen_s=None)),
    )
    fit = [check.is_fit(frame) for frame in frames]
    assert fit == [dog.observe_frame("camera", frame_stats(f, f.stamp_ns)) for f in frames], (
        "as the node says"
    )
    assert set(check.faults) == {Fault.OUT_OF_STEP}
    assert fit.count(False) > len(frames) // 3


@pytest.mark.parametrize("name", ["demo", "rendered"])
@pytest.mark.parametrize("order", ["forward", "backward", "every second", "standing", "shuffled"])
def test_good_drives_are_not_blamed(name: str, order: str) -> None:
    frames = list(drive(name))
    kinds = {
        "forward": frames, "backward": frames[::-1], "every second": frames[::2], "standing": frames[:1] * 16,
        "shuffled": [frames[i] for i in np.random.default_rng(1).permutation(len(frames))],
    }  # fmt: skip
    assert found(kinds[order]) == 0


@pytest.mark.parametrize("name", RECORDINGS)
def test_real_recordings_are_not_blamed(name: str) -> None:
    if not (DATA / name).is_dir():
        pytest.skip("SWARDMAP_DATA names no folder with this recording")
    assert found(list(open_source(DATA / name, SourceConfig()))[:60]) == 0


def test_a_real_drive_with_its_depth_a_frame_late_is_noticed() -> None:
    if not (DATA / "rgbd_lawn").is_dir():
        pytest.skip("SWARDMAP_DATA names no folder with this recording")
    frames = list(open_source(DATA / "rgbd_lawn", SourceConfig()))
    assert found(shifted(frames, 1)) >= 5
    assert found(shifted(frames, -1)) >= 5


def test_who_stands_still_is_not_blamed_for_ever() -> None:
    watch, bad, nothing = StepWatch(1.6), StepCounts(100, 10, 0, 0), StepCounts(1, 1, 1, 1)
    assert [watch.add(bad) for _ in range(DECIDED)] == [False] * (DECIDED - 1) + [True]
    assert [watch.add(nothing) for _ in range(WINDOW)][-1] is False


def test_a_fault_that_was_found_ends_only_well_below_what_begins_it() -> None:
    watch, weak, good = StepWatch(1.6), StepCounts(70, 50, 0, 0), StepCounts(10, 100, 0, 0)
    assert not any(watch.add(weak) for _ in range(20))
    assert [watch.add(StepCounts(100, 10, 0, 0)) for _ in range(WINDOW)][-1]
    assert all(watch.add(weak) for _ in range(20))
    assert not [watch.add(good) for _ in range(4)][-1]
    assert not any(StepWatch(None).add(StepCounts(1000, 0, 0, 0)) for _ in range(20))


def test_images_of_another_size_or_none_tell_nothing() -> None:
    rgb = np.zeros((12, 16, 3), np.uint8)
    small = edge_look(rgb, np.full((12, 16), np.nan, np.float32))
    assert not small.depth.any()
    other = EdgeLook(np.zeros((6, 8), np.bool_), np.zeros((6, 8), np.bool_))
    assert step_counts(small, other) is None
    assert step_counts(None, small) is None
    assert step_counts(small, small) == StepCounts(0, 0, 0, 0)
