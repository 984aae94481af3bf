"""A drive that the running node records: what `swardmap teach` can learn from, and no more than that."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from swardmap.config import Config, MountConfig
from swardmap.io import open_source
from swardmap.ros import services
from swardmap.ros.drive_recorder import DriveRecorder
from swardmap.ros.parameters import NodeConfig
from swardmap.teach.drive import read_drive
from swardmap.types import Frame
from tests.teach.scenes import CONFIG, PLAN, Says, lane


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return list(lane(n=14))


Offered = Iterator[tuple[str, Frame]]


def recorded(folder: Path, offered: Offered, most: int = 100) -> tuple[DriveRecorder, list[str]]:
    told = list[str]()
    recorder = DriveRecorder(folder, told.append, most)
    for camera, frame in offered:
        recorder.offer(camera, frame)
        while not recorder._waiting.empty() and recorder.writing:  # a disk that keeps up
            recorder.wait(0.001)
    recorder.stop()
    recorder.wait()
    return recorder, told


def test_what_was_recorded_teaches(frames: list[Frame], tmp_path: Path) -> None:
    live = [replace(f, labels=None, label_set=None, name=f"camera:{f.stamp_ns}") for f in frames]
    recorder, told = recorded(tmp_path / "drive", (("camera", f) for f in live))
    again = list(open_source(tmp_path / "drive"))
    assert [f.stamp_ns for f in again] == [f.stamp_ns for f in frames]
    for one, two in zip(live, again, strict=True):
        assert one.T_map_camera is not None
        assert two.T_map_camera is not None
        np.testing.assert_allclose(two.T_map_camera.matrix, one.T_map_camera.matrix, atol=1e-6)
        np.testing.assert_array_equal(two.rgb, one.rgb)
        np.testing.assert_allclose(two.depth_m, one.depth_m)
    assert told == [recorder.told]
    assert "14 frames" in recorder.told
    assert f"swardmap teach {tmp_path / 'drive'} -o" in recorder.told
    both = zip(again, frames, strict=True)
    labelled = [replace(a, labels=f.labels, label_set=f.label_set) for a, f in both]
    drive = read_drive("drive", labelled, Says(), CONFIG, PLAN, lambda: None)
    assert drive.driven_m2 > 0.6 * 13 * 0.25


def test_a_robot_that_stands_or_has_no_pose_fills_no_disk(frames: list[Frame], tmp_path: Path) -> None:
    lost = replace(frames[3], T_map_camera=None)
    other = ("rear", frames[4])
    offered = [("front", frames[0])] * 20 + [("front", lost), other, ("front", frames[5])]
    recorder, _ = recorded(tmp_path / "drive", iter(offered))
    assert "2 frames" in recorder.told
    stamps = [f.stamp_ns for f in open_source(tmp_path / "drive")]
    assert stamps == [frames[0].stamp_ns, frames[5].stamp_ns]


def test_a_long_drive_ends_by_itself_and_says_so(frames: list[Frame], tmp_path: Path) -> None:
    _, told = recorded(tmp_path / "drive", (("camera", f) for f in frames), most=5)
    (line,) = told
    assert "5 frames" in line


def answer(asked: Any) -> Any:
    while True:
        try:
            asked.send(None)
        except StopIteration as ended:
            return ended.value


def test_the_service_begins_ends_and_says_what_came_of_it(frames: list[Frame], tmp_path: Path) -> None:
    pipeline: Any = SimpleNamespace(
        parameters=SimpleNamespace(node=NodeConfig(save_folder=str(tmp_path)), config=Config()),
        intake=SimpleNamespace(poses=SimpleNamespace(posed=True)),
        recorder=None,
        events=[],
    )

    def ask(on: bool) -> Any:
        return answer(services._teach_record(pipeline, SimpleNamespace(data=on), SimpleNamespace()))

    assert not ask(False).success
    begun = ask(True)
    assert begun.success
    assert not ask(True).success
    pipeline.recorder.offer("camera", frames[0])
    folder = pipeline.recorder.folder
    ended = ask(False)
    assert ended.success
    assert "1 frames" in ended.message
    assert [line for _, line in pipeline.events] == [ended.message]
    assert len(list(open_source(folder))) == 1
    assert ask(True).success
    nothing = ask(False)
    assert not nothing.success
    assert "no frame" in nothing.message
    pipeline.intake.poses.posed = False
    assert "poses" in ask(True).message


def test_a_drive_that_must_end_keeps_what_was_seen_and_says_so(frames: list[Frame], tmp_path: Path) -> None:
    """Another camera or a clock that went back lost the whole drive; the longest ended silently."""
    half = replace(frames[6], depth_unit_m=0.0005)
    back = replace(frames[6], stamp_ns=frames[2].stamp_ns)
    for name, bad, told in (
        ("camera", half, "the camera is another"),
        ("clock", back, "the clock went back"),
    ):
        offered = [*frames[:6], bad, *frames[7:]]
        recorder, _ = recorded(tmp_path / name, (("front", f) for f in offered))
        assert f"6 frames of the drive in {tmp_path / name}, which ended early since {told}" in recorder.told
        assert [f.stamp_ns for f in open_source(tmp_path / name)] == [f.stamp_ns for f in frames[:6]]
    recorder, _ = recorded(tmp_path / "most", (("front", f) for f in frames), most=4)
    assert "ended early since 4 frames are the most" in recorder.told
    recorder, _ = recorded(tmp_path / "just", (("front", f) for f in frames[:4]), most=4)
    assert "early" not in recorder.told


def test_the_command_that_is_told_knows_where_the_camera_sits() -> None:
    assert services._mount_options(MountConfig()) == ""
    mount = MountConfig(x_m=0.4, yaw_deg=-3)
    assert services._mount_options(mount) == " --set mount.x_m=0.4 --set mount.yaw_deg=-3"
