"""Transforms as they come to the node: one that is none takes no other with it, and no pose away."""

from types import SimpleNamespace
from typing import Any

import pytest

from swardmap.config import SourceConfig
from swardmap.geometry import Pose
from swardmap.ros.poses import LivePoses

MS = 1_000_000


def transform(parent: str, child: str, ms: int, x: float = 0.0, w: float = 1.0) -> Any:
    return SimpleNamespace(
        header=SimpleNamespace(
            frame_id=parent,
            stamp=SimpleNamespace(sec=ms // 1000, nanosec=ms % 1000 * MS),
        ),
        child_frame_id=child,
        transform=SimpleNamespace(
            translation=SimpleNamespace(x=x, y=0.0, z=0.0),
            rotation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=w),
        ),
    )


def message(*transforms: Any) -> Any:
    return SimpleNamespace(transforms=list(transforms))


@pytest.mark.parametrize(
    "bad",
    [transform("odom", "odom", 5), transform("", "", 5), transform("map", "base", 5, w=0.0)],
    ids=["of itself", "without names", "no rotation"],
)
def test_a_transform_that_is_none_hides_no_other(bad: Any) -> None:
    poses = LivePoses(SourceConfig())
    poses.add_tf_static(message(bad, transform("base", "camera", 0, x=0.2)))
    for ms in (1000, 1100):
        poses.add_tf(message(bad, transform("map", "base", ms, x=ms / 1000)))
    pose = poses.lookup("camera", 1050 * MS)
    assert pose is not None
    assert pose.position_m[0] == pytest.approx(1.25)
    assert sum(poses.refused.values()) == 3
    (said,) = poses.refused
    assert "does not name two frames" in said or "no rotation" in said


def test_a_second_parent_off_the_way_takes_no_pose() -> None:
    poses = LivePoses(SourceConfig())
    for ms in (1000, 1100):
        poses.add_tf(message(transform("left", "tag", ms), transform("right", "tag", ms)))
        poses.add_tf(message(transform("map", "camera", ms)))
    assert poses.lookup("camera", 1050 * MS) is not None


def moving(poses: LivePoses, *ms: int, child: str = "base") -> None:
    for at in ms:
        poses.add_tf(message(transform("map", child, at, x=at / 1000)))


OLD = transform("map", "other", 100)
NONE_OF_NOW = {
    "empty": message(),
    "all stamps 0": message(transform("map", "other", 0)),
    "older than the memory": message(OLD),
}


@pytest.mark.parametrize("name", NONE_OF_NOW)
def test_a_message_of_another_time_takes_no_other_edge_away(name: str) -> None:
    poses = LivePoses(SourceConfig())
    moving(poses, 50_000, 50_100)
    poses.add_tf(NONE_OF_NOW[name])
    pose = poses.lookup("base", 50_050 * MS)
    assert pose is not None
    assert pose.position_m[0] == pytest.approx(50.05)


def test_a_transform_much_older_than_others_of_its_edge_is_left_out_and_counted() -> None:
    poses = LivePoses(SourceConfig())
    moving(poses, 50_000, 50_100)
    moving(poses, 1000)
    assert poses.lookup("base", 50_050 * MS) is not None
    assert poses.lookup("base", 1000 * MS) is None
    assert poses.refused == {"transform map <- base is older than the newest by more than 10 s": 1}


def test_an_edge_whose_times_stay_back_begins_anew_and_no_other() -> None:
    """As after one stamp of the future, which must not silence the edge for good."""
    poses = LivePoses(SourceConfig())
    moving(poses, 50_000, 50_100)
    moving(poses, 50_000, 50_100, child="other")
    moving(poses, 90_000)  # one stamp ahead of its time
    moving(poses, *range(50_200, 51_200, 100))
    assert poses.lookup("base", 50_950 * MS) is not None
    assert poses.lookup("other", 50_050 * MS) is not None


def test_on_a_new_clock_what_moves_is_forgotten_and_what_stands_stays() -> None:
    poses = LivePoses(SourceConfig())
    poses.add_tf_static(message(transform("base", "camera", 0, x=0.2)))
    moving(poses, 50_000, 50_100)
    poses.forget_moving()
    assert poses.lookup("camera", 50_050 * MS) is None
    moving(poses, 45_000, 45_100)
    pose = poses.lookup("camera", 45_050 * MS)
    assert pose is not None
    assert pose.position_m[0] == pytest.approx(45.25)
    assert not poses.refused


def test_two_parents_on_the_way_are_refused_and_counted() -> None:
    poses = LivePoses(SourceConfig())
    poses.add_tf_static(message(transform("base", "camera", 0)))
    moving(poses, 1000, 1100)
    poses.add_tf(message(transform("odom", "base", 1100)))
    assert poses.newest_ns("camera") is None
    assert poses.between("map", "camera") is None
    assert poses.lookup("camera", 1050 * MS) is None
    (said,) = poses.refused
    assert "'base' has two parents" in said
    assert not poses.add_mount("map", "camera", Pose.identity("map", "camera"))


def test_a_parent_that_is_no_longer_heard_of_is_forgotten() -> None:
    poses = LivePoses(SourceConfig())
    poses.add_tf(message(transform("odom", "base", 1000)))
    moving(poses, 1100, 1200)
    assert poses.lookup("base", 1150 * MS) is None
    moving(poses, *range(1300, 11_400, 100))
    assert poses.lookup("base", 11_250 * MS) is not None
