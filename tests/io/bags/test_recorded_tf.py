"""Recordings whose tf is as users report it: the box is found where it is, or the question is asked."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import R_BODY_OPTICAL
from swardmap.io.bags import ros_fields as rf
from swardmap.io.bags.rosbag import REASON_POSE, REASON_TRANSFORM, open_source
from tests import bags
from tests.bags import ODOMETRY, TF, Event
from tests.lawn_bags import COLOR, DEPTH, MS, OPTICAL, START_NS, Lawn, T_map_base, down, mapped, mount, pose


def write(folder: Path, lawn: Lawn, *more: Event, kind: bags.Kind = "mcap") -> Path:
    events = sorted([*lawn.events(), *more], key=lambda event: event[0])
    return bags.write_bag(folder, kind, events)


def check_box(path: Path, frames: int = 6, **settings: Any) -> Any:
    """The map has the box, to the cell, and nothing else."""
    found = mapped(path, source=settings)
    assert (found.frames, found.on_box, found.elsewhere) == (frames, 72, 0), found.source.facts
    return found


def tf_at(ms: int, *transforms: Any, topic: str = "/tf", stamp_ms: int | None = None) -> Event:
    stamp = START_NS + (ms if stamp_ms is None else stamp_ms) * MS
    return START_NS + ms * MS + 7, topic, TF, rf.tf_fields(transforms, stamp)


def raw(parent: str, child: str, turn: tuple[float, ...] = (0, 0, 0, 1)) -> dict[str, Any]:
    """A transform that no Pose could be."""
    place = dict(zip("xyz", (0.0, 0.0, 0.0), strict=True))
    rotation = dict(zip("xyzw", map(float, turn), strict=True))
    header = rf.header_fields(START_NS, parent)
    return {
        "header": header,
        "child_frame_id": child,
        "transform": {"translation": place, "rotation": rotation},
    }


@pytest.mark.parametrize("kind", bags.KINDS)
def test_control(tmp_path: Path, kind: bags.Kind) -> None:
    found = check_box(write(tmp_path, Lawn(), kind=kind))
    facts = found.source.facts
    assert facts["poses"]["frames"] == f"map <- odom <- base_link <- {OPTICAL}"
    assert facts["poses"]["largest_gap_ms"] == {"map <- odom": 20.0, "odom <- base_link": 20.0}
    assert facts["pairing"] == {"pairs": 6, "median_ms": 0.0, "worst_ms": 0.0}
    assert facts["left_out"] == {}
    assert facts["notes"] == []


ROBOT_1 = Lawn(
    tf_topic="/robot1/tf",
    color_topic=f"/robot1{COLOR}",
    depth_topic=f"/robot1{DEPTH}",
)


def robot_2() -> list[Event]:
    """Another robot, 3 m to the side and turned, with the same names of frames."""
    away = pose("odom", "base_link", (0, 3, 0), np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]))
    return [
        tf_at(ms, pose("map", "odom", (0, 0, 0)), away, topic="/robot2/tf") for ms in range(-200, 800, 20)
    ]


def test_two_robots(tmp_path: Path) -> None:
    found = check_box(write(tmp_path, ROBOT_1, *robot_2()))
    assert "tf of /robot2/tf is left out; the camera's is /robot1/tf" in " ".join(found.source.notes)


def test_two_robots_and_a_camera_of_neither(tmp_path: Path) -> None:
    path = write(tmp_path, ROBOT_1.with_(color_topic=COLOR, depth_topic=DEPTH), *robot_2())
    with pytest.raises(InputError, match=r"which tf is .*/robot1/tf or /robot2/tf.*source\.tf_topic"):
        open_source(path, SourceConfig())
    check_box(path, tf_topic="/robot1/tf")
    with pytest.raises(InputError, match="no tf in topic '/tf'"):
        open_source(path, SourceConfig(tf_topic="/tf"))


def test_one_tf_may_be_in_any_namespace(tmp_path: Path) -> None:
    check_box(write(tmp_path, Lawn(tf_topic="/mower/tf")))


def placeholder() -> Event:
    return START_NS - 400 * MS, "/tf_static", TF, rf.tf_fields([pose("map", "odom", (5, 0, 0))], START_NS)


def test_a_static_placeholder_does_not_hide_the_localisation(tmp_path: Path) -> None:
    found = check_box(write(tmp_path, Lawn(), placeholder()))
    assert found.source.notes == ["tf gives map <- odom as static and as moving: the moving one is used"]


def test_a_placeholder_that_poses_were_given_by_is_refused(tmp_path: Path) -> None:
    lawn = Lawn(chain=("odom", "odom"), frames=140)
    moved = [tf_at(ms, pose("map", "odom", (0, 0, 0))) for ms in range(11_000, 14_000, 100)]
    path = write(tmp_path, lawn, placeholder(), *moved)
    source = open_source(path, SourceConfig())
    with pytest.raises(InputError, match=r"map <- odom as static, .* first \d+ frames.*source\.start"):
        list(source)


def test_a_placeholder_that_is_right_changes_nothing(tmp_path: Path) -> None:
    same = rf.tf_fields([pose("map", "odom", (0, 0, 0))], START_NS)
    found = check_box(write(tmp_path, Lawn(), (START_NS - 400 * MS, "/tf_static", TF, same)))
    assert found.source.notes == []


@pytest.mark.parametrize("names", [("odom", "odom"), ("", ""), ("map", "")])
def test_transforms_that_name_no_two_frames_are_skipped_one_by_one(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    events = []
    for t, topic, kind, fields in Lawn().events():
        if topic == "/tf" and isinstance(fields, dict):
            fields = {"transforms": [raw(*names), *fields["transforms"]]}  # in front of the good ones
        events.append((t, topic, kind, fields))
    found = check_box(bags.write_bag(tmp_path, "mcap", events))
    assert found.source.skipped[REASON_TRANSFORM] > 20
    assert "does not name two frames" in found.source.facts["left_out"][REASON_TRANSFORM]["first"]


def test_a_marker_of_two_cameras_is_none_of_the_maps_business(tmp_path: Path) -> None:
    tags = [tf_at(20 * k, pose(("left", "right")[k % 2], "tag_0", (1, 0, 1))) for k in range(30)]
    check_box(write(tmp_path, Lawn(), *tags))


def test_two_parents_on_the_way_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path, Lawn(), tf_at(40, pose("dock", "base_link", (1, 0, 0))))
    with pytest.raises(InputError, match="'base_link' has two parents in tf: 'odom' and 'dock'"):
        mapped(path)


def test_a_zero_quaternion_off_the_way(tmp_path: Path) -> None:
    antenna = {"transforms": [raw("base_link", "antenna", (0, 0, 0, 0))]}
    check_box(write(tmp_path, Lawn(), (START_NS - 450 * MS, "/tf_static", TF, antenna)))


def test_a_zero_quaternion_on_the_way_is_named(tmp_path: Path) -> None:
    camera = {"transforms": [raw("base_link", OPTICAL, (0, 0, 0, 0))]}
    path = write(tmp_path, Lawn(static=()), (START_NS - 450 * MS, "/tf_static", TF, camera))
    with pytest.raises(InputError, match=rf"Left out: transform base_link <- {OPTICAL} is no rotation"):
        open_source(path, SourceConfig())


@pytest.mark.parametrize("period_ms", [100, 200])
def test_localisation_at_the_commonest_rates(tmp_path: Path, period_ms: int) -> None:
    # images lie between the transforms, and a period is sometimes a little longer
    lawn = Lawn(tf_ms=period_ms + 7)
    check_box(write(tmp_path, lawn))


def test_a_gap_names_edge_length_and_setting(tmp_path: Path) -> None:
    path = write(tmp_path, Lawn(tf_ms=400))
    source = open_source(path, SourceConfig())
    assert len(list(source)) < 6
    first = source.facts["left_out"][REASON_POSE]["first"]
    assert (
        "map <- odom has a gap of 400 ms at" in first or "odom <- base_link has a gap of 400 ms at" in first
    )
    assert "source.pose_tolerance_ms=250" in first
    assert len(list(open_source(path, SourceConfig(pose_tolerance_ms=500.0)))) == 6


@pytest.mark.parametrize("late_ms", [300, 3000])
def test_tf_that_is_written_late_is_read_ahead(tmp_path: Path, late_ms: int) -> None:
    check_box(write(tmp_path, Lawn(tf_late_ms=late_ms)))


@pytest.mark.parametrize("name", ["world", "utm", "robot1/map"])
def test_a_fixed_frame_of_another_name_is_asked_for(tmp_path: Path, name: str) -> None:
    path = write(tmp_path, Lawn(chain=(name, "local")))
    with pytest.raises(InputError, match=rf"frames: base_link, .*{name}.*source\.map_frame={name}") as caught:
        open_source(path, SourceConfig())
    assert "source.poses=none" in str(caught.value)
    check_box(path, map_frame=name)
    frames = list(open_source(path, SourceConfig(poses="none")))
    assert len(frames) == 6
    assert all(f.T_map_camera is None for f in frames)


def test_two_trees_are_told_apart(tmp_path: Path) -> None:
    apart = Lawn(static=(pose("lens_mount", OPTICAL, (0, 0, 0)),))
    with pytest.raises(InputError, match=r"no way from 'map' to .*hangs on 'lens_mount'.*source\.map_frame"):
        open_source(write(tmp_path, apart), SourceConfig())


def test_no_poses_is_said_with_the_reason(tmp_path: Path) -> None:
    source = open_source(write(tmp_path, Lawn(with_tf=False)), SourceConfig())
    assert len(list(source)) == 6
    assert source.notes == ["no poses, each frame is mapped on its own: neither tf nor odometry is recorded"]


def test_several_odometries_are_named(tmp_path: Path) -> None:
    odometries: list[Event] = [
        (START_NS + ms * MS, topic, ODOMETRY, rf.odometry_fields(T_map_base(0), START_NS))
        for ms in range(0, 600, 50) for topic in ("/odom/wheels", "/odom/filtered")
    ]  # fmt: skip
    source = open_source(write(tmp_path, Lawn(with_tf=False), *odometries), SourceConfig())
    list(source)
    assert "/odom/filtered, /odom/wheels with source.odometry_topic" in source.notes[0]


@pytest.mark.parametrize("shift_s", [-3, 3, -1_699_999_995])
def test_clocks_that_differ_are_told_by_both_spans(tmp_path: Path, shift_s: int) -> None:
    path = write(tmp_path, Lawn(tf_shift_ns=shift_s * 10**9))
    source = open_source(path, SourceConfig())
    assert list(source) == []
    assert source.skipped == {REASON_POSE: 6}
    first = source.facts["left_out"][REASON_POSE]["first"]
    begins = START_NS / 1e9 + shift_s - 0.2
    assert f"is known from {begins:.3f} to" in first
    assert "the image is of 1700000000.000 s" in first


BODY = Lawn(
    color_frame="camera_link",
    depth_frame="camera_link",
    static=(pose("base_link", "camera_link", (0.2, 0, 0.9), down()),),
)


def test_images_in_the_frame_of_the_body_are_noticed(tmp_path: Path) -> None:
    path = write(tmp_path, BODY)
    source = open_source(path, SourceConfig())
    with pytest.raises(InputError, match=r"'camera_link' looks up.*camera_frame=.*source\.camera_axes=body"):
        list(source)
    check_box(path, camera_axes="body")


def test_the_optical_frame_beside_a_body_frame_may_be_named(tmp_path: Path) -> None:
    lawn = BODY.with_(static=(*BODY.static, mount("camera_link_optical")))  # type: ignore[misc]
    check_box(write(tmp_path, lawn), camera_frame="camera_link_optical")


def test_a_camera_that_does_look_up_is_believed_when_told(tmp_path: Path) -> None:
    up = Lawn(static=(pose("base_link", OPTICAL, (0.2, 0, 0.9), down(-60) @ R_BODY_OPTICAL),))
    path = write(tmp_path, up)
    with pytest.raises(InputError, match="looks up"):
        list(open_source(path, SourceConfig()))
    assert len(list(open_source(path, SourceConfig(camera_axes="optical")))) == 6


def test_stamps_of_zero_in_tf_are_replaced_and_said(tmp_path: Path) -> None:
    found = check_box(write(tmp_path, Lawn(tf_shift_ns=0, with_tf=False), *unstamped_tf()))
    assert "transforms of 'base_link' have no times: those of their recording are taken" in found.source.notes


def unstamped_tf() -> list[Event]:
    static = (START_NS - 500 * MS, "/tf_static", TF, rf.tf_fields([mount()], 0))
    moving = [
        (START_NS + ms * MS, "/tf", TF,
         rf.tf_fields([pose("map", "base_link", T_map_base(ms / 100).position_m)], 0))
        for ms in range(-200, 900, 20)
    ]  # fmt: skip
    return [static, *moving]


@pytest.mark.parametrize("stamp_ms", [-1_700_000_000_000, 3_600_000, 60_000])
def test_one_transform_of_another_time_does_no_harm(tmp_path: Path, stamp_ms: int) -> None:
    odd = tf_at(210, pose("odom", "base_link", (9, 9, 0)), stamp_ms=stamp_ms)
    check_box(write(tmp_path, Lawn(), odd))
