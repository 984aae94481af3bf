"""The queue before the mapper: no camera starves, the newest is never dropped."""

import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.ros.frame_queue import FrameQueue

cameras = st.sampled_from(["left", "right", "rear"])
steps = st.lists(st.one_of(cameras, st.none()), max_size=60)


@given(steps, st.integers(1, 3))
def test_the_newest_of_each_camera_waits_until_it_is_taken(events: list[str | None], capacity: int) -> None:
    queue = FrameQueue[tuple[str, int]](capacity)
    waiting: dict[str, list[int]] = {}
    put = dropped = 0
    for number, camera in enumerate(events):
        if camera is None:
            taken = queue.get(0)
            assert (taken is None) == (not any(waiting.values()))
            if taken is not None:
                assert waiting[taken[0]].pop(0) == taken[1]
            continue
        queue.put(camera, (camera, number))
        put += 1
        items = waiting.setdefault(camera, [])
        items.append(number)
        dropped += len(items) > capacity
        waiting[camera] = items[-capacity:]  # the oldest goes, never the newest
        assert queue.dropped.total() == dropped
    assert len(queue) == sum(map(len, waiting.values()))
    assert queue.longest == max(map(len, waiting.values()), default=0)


@pytest.mark.parametrize("capacity", [1, 2])
def test_of_cameras_that_give_frames_at_the_same_time_none_starves(capacity: int) -> None:
    """Two cameras at twice the rate that the mapper keeps up with: each gets its half."""
    queue = FrameQueue[str](capacity)
    served = {"left": 0, "right": 0}
    for _ in range(100):
        queue.put("left", "left")
        queue.put("right", "right")
        taken = queue.get(0)
        assert taken is not None
        served[taken] += 1
    assert served == {"left": 50, "right": 50}


def test_who_waits_is_woken_and_a_cleared_queue_is_empty() -> None:
    queue = FrameQueue[str](2)
    found: list[str | None] = []
    thread = threading.Thread(target=lambda: found.append(queue.get(60.0)))
    thread.start()
    queue.put("left", "frame")
    thread.join(timeout=60)
    assert found == ["frame"]
    queue.put("left", "old")
    queue.clear()
    assert queue.get(0) is None
    assert queue.dropped.total() == 0
