"""Transforms as they come to the node: one that is none takes no other with it, and no pose away."""

from types import SimpleNamespace
from typing import Any

import pytest

from swardmap.config import SourceConfig
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
