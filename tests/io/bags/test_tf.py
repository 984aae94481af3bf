"""Lookups in the frame tree against SciPy's rotations and spherical interpolation."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from swardmap.errors import InputError
from swardmap.geometry import Float64Array
from swardmap.io.bags.tf import TransformBuffer
from swardmap.io.bags.tf_edge import ALWAYS_NS

UNIT = (0.0, 0.0, 0.0, 1.0)
MS = 1_000_000


def matrix(rotation: Rotation, translation: Float64Array) -> Float64Array:
    out = np.eye(4)
    out[:3, :3] = rotation.as_matrix()
    out[:3, 3] = translation
    return out


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), fractions=st.lists(st.floats(0, 1), min_size=3, max_size=3))
def test_lookup_between_two_branches_equals_scipy(seed: int, fractions: list[float]) -> None:
    # map -> odom -> base -> camera (static), and map -> dock: the way goes up one branch and down another
    rng = np.random.default_rng(seed)
    edges = {"odom": "map", "base": "odom", "dock": "map"}
    buffer, truth = TransformBuffer(), {}
    stamp_ns = 500 * MS
    for (child, parent), fraction in zip(edges.items(), fractions, strict=True):
        before = stamp_ns - round(fraction * 40 * MS) - 1
        after = before + 41 * MS
        turns = Rotation.random(2, rng=rng)
        places = rng.normal(0, 5, (2, 3))
        for stamp, turn, place in zip((before, after), turns, places, strict=True):
            buffer.add(parent, child, stamp, place, turn.as_quat())
        share = (stamp_ns - before) / (after - before)
        truth[child] = matrix(Slerp([0, 1], turns)([share])[0], (1 - share) * places[0] + share * places[1])
    mount, arm = Rotation.random(rng=rng), rng.normal(0, 1, 3)
    buffer.add_static("/base", "camera", arm.tolist(), mount.as_quat())
    expected = np.linalg.inv(truth["dock"]) @ truth["odom"] @ truth["base"] @ matrix(mount, arm)
    pose = buffer.lookup("dock", "/camera", stamp_ns, 50 * MS)
    assert pose is not None
    assert (pose.parent, pose.child) == ("dock", "camera")
    np.testing.assert_allclose(pose.matrix, expected, atol=1e-9)
    back = buffer.lookup("camera", "dock", stamp_ns, 50 * MS)
    assert back is not None
    np.testing.assert_allclose(back.matrix @ pose.matrix, np.eye(4), atol=1e-9)


def moving(stamps_ms: list[int]) -> TransformBuffer:
    buffer = TransformBuffer()
    for t in stamps_ms:
        buffer.add("map", "base", t * MS, (t / 1000, 0, 0), UNIT)
    return buffer


def test_never_the_latest_in_place_of_the_right_time() -> None:
    buffer = moving([100, 150, 400])
    assert buffer.lookup("map", "base", 99 * MS, 10**12) is None  # before the first
    assert buffer.lookup("map", "base", 401 * MS, 10**12) is None  # after the last
    assert buffer.lookup("map", "base", 200 * MS, 100 * MS) is None  # inside too large a gap
    inside = buffer.lookup("map", "base", 125 * MS, 50 * MS)
    assert inside is not None
    assert inside.position_m[0] == pytest.approx(0.125)
    for t in (100, 150, 400):  # exact hits need no neighbour
        assert buffer.lookup("map", "base", t * MS, 0) is not None


def test_unconnected_frames_have_no_pose() -> None:
    buffer = moving([0, 100])
    buffer.add_static("world", "camera", (0, 0, 0), UNIT)
    assert buffer.lookup("map", "camera", 0, 10**9) is None
    assert buffer.lookup("map", "nowhere", 0, 10**9) is None
    assert not buffer.connected("map", "camera")
    assert buffer.newest_ns("map", "camera") is None
    assert buffer.frames == {"map", "base", "world", "camera"}


def test_a_frame_seen_from_itself_is_identity() -> None:
    pose = moving([0, 100]).lookup("base", "base", 5, 0)
    assert pose is not None
    np.testing.assert_array_equal(pose.matrix, np.eye(4))


@pytest.mark.parametrize("quaternion", [(0, 0, 0, 0), (0, 0, 0, np.nan), (1, 1, 1, 1), (0, 0, np.inf, 1)])
def test_refuses_what_is_no_rotation(quaternion: tuple[float, ...]) -> None:
    buffer = moving([0])
    buffer.add("map", "base", 50 * MS, (0, 0, 0), quaternion)
    buffer.add("map", "base", 60 * MS, (np.nan, 0, 0), UNIT)
    assert buffer.refused == 2
    assert buffer.lookup("map", "base", 25 * MS, 10**9) is None
    assert not buffer.add_static("base", "camera", (0, 0, 0), quaternion)
    assert buffer.refused == 3
    assert "transform base <- camera is no rotation" in " ".join(buffer.faults)


IN_ORDER_MS = list(range(0, 200, 20))


@cache
def tidy_matrix(t_ms: int) -> "np.ndarray[Any, np.dtype[np.float64]]":
    pose = moving(IN_ORDER_MS).lookup("map", "base", t_ms * MS, 20 * MS)
    assert pose is not None
    return pose.matrix


@given(order=st.permutations(IN_ORDER_MS))
def test_the_order_of_arrival_does_not_matter(order: list[int]) -> None:
    buffer = moving(order)
    for t in range(0, 181, 7):
        pose = buffer.lookup("map", "base", t * MS, 20 * MS)
        assert pose is not None
        assert np.array_equal(pose.matrix, tidy_matrix(t))
    assert (buffer.late == 0) == (order == sorted(order))


def test_the_first_of_two_at_the_same_time_stays() -> None:
    buffer = moving([0, 100])
    buffer.add("map", "base", 100 * MS, (9, 9, 9), UNIT)
    pose = buffer.lookup("map", "base", 100 * MS, 0)
    assert pose is not None
    assert pose.position_m[0] == pytest.approx(0.1)


def test_forgetting_keeps_what_is_needed() -> None:
    buffer = moving(list(range(0, 1000, 10)))
    buffer.forget_before(503 * MS)
    assert buffer.lookup("map", "base", 503 * MS, 10 * MS) is not None
    assert buffer.lookup("map", "base", 490 * MS, 10 * MS) is None
    buffer.forget_before(10**15)
    assert buffer.newest_ns("map", "base") == 990 * MS


def test_newest_is_the_slowest_of_the_way() -> None:
    buffer = moving([0, 100])
    buffer.add("odom", "map", 30 * MS, (0, 0, 0), UNIT)
    buffer.add_static("base", "camera", (0, 0, 0), UNIT)
    assert buffer.newest_ns("odom", "camera") == 30 * MS
    assert buffer.newest_ns("base", "camera") == ALWAYS_NS


def test_what_contradicts_itself_on_the_way_is_refused() -> None:
    buffer = moving([0])
    buffer.add_static("base", "camera", (0, 0, 0), UNIT)
    assert buffer.add("odom", "base", 5, (0, 0, 0), UNIT)
    with pytest.raises(InputError, match="two parents in tf: 'map' and 'odom'"):
        buffer.lookup("map", "camera", 0, 0)
    assert buffer.lookup("base", "camera", 0, 0) is not None
    round_ = moving([0])
    round_.add("base", "map", 0, (0, 0, 0), UNIT)
    with pytest.raises(InputError, match="circle"):
        round_.lookup("map", "base", 0, 0)


def test_off_the_way_nothing_is_judged() -> None:
    buffer = moving([0, 100])
    buffer.add("left", "tag", 5, (0, 0, 0), UNIT)
    buffer.add("right", "tag", 6, (1, 0, 0), UNIT)
    buffer.add("north", "map", 6, (1, 0, 0), UNIT)  # above where the two ends meet
    buffer.add("south", "map", 6, (1, 0, 0), UNIT)
    buffer.add_static("base", "antenna", (0, 0, 0), (0, 0, 0, 0))
    assert buffer.lookup("map", "base", 50 * MS, 10**9) is not None
    assert buffer.refused == 1


@pytest.mark.parametrize(("parent", "child"), [("base", "base"), ("", "base"), ("map", ""), ("/", "base")])
def test_what_does_not_name_two_frames_is_counted_as_tf2_does(parent: str, child: str) -> None:
    buffer = moving([0, 100])
    assert not buffer.add(parent, child, 5, (0, 0, 0), UNIT)
    assert not buffer.add_static(parent, child, (0, 0, 0), UNIT)
    assert buffer.refused == 2
    assert buffer.lookup("map", "base", 50 * MS, 10**9) is not None


def test_what_is_static_and_moves_elsewhere_moves() -> None:
    buffer = moving([0, 100])
    buffer.add_static("map", "base", (5, 0, 0), UNIT)
    buffer.add_static("base", "camera", (0, 0, 1), UNIT)
    buffer.add("base", "camera", 50 * MS, (0, 0, 1), (0, 0, 0, -1.0))  # the same, sent again and turned round
    pose = buffer.lookup("map", "camera", 50 * MS, 10**9)
    assert pose is not None
    np.testing.assert_allclose(pose.position_m, [0.05, 0, 1])
    assert buffer.conflicts("map", "camera") == [("map", "base")]
    assert buffer.way("map", "camera") == [("base", "camera", False), ("map", "base", True)]
    assert buffer.newest_ns("map", "camera") == 100 * MS


def test_why_there_is_no_pose_is_told() -> None:
    buffer = moving([1000, 1900])
    buffer.add_static("base", "camera", (0, 0, 1), UNIT)

    def why(ms: int) -> str:
        return buffer.why_not("map", "camera", ms * MS, 250 * MS, {"base": (500 * MS, 1900 * MS)})

    assert why(1400) == "map <- base has a gap of 900 ms at 1.400 s"
    assert why(2500) == "map <- base is known from 0.500 to 1.900 s, the image is of 2.500 s"
    assert "no way" in buffer.why_not("earth", "camera", 0, 0, {})
