"""A subscription that follows what publishers offer: the rule, and over real DDS."""

import os
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from typing import Any
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.ros.subscription import Subscription, fitting
from swardmap.ros.topics import BEST_EFFORT, RELIABLE, image_qos
from tests.ros.node_process import environment

REQUESTS = {RELIABLE: {True}, BEST_EFFORT: {True, False}}
"""Whom each hears (ROS 2, QoS compatibilities): by whether a publisher offers to be reliable."""


@given(st.lists(st.booleans(), min_size=1), st.sampled_from(sorted(REQUESTS)))
def test_every_publisher_is_heard_as_reliably_as_all_of_them_allow(offered: list[bool], now: str) -> None:
    hearing_all = [name for name, heard in REQUESTS.items() if set(offered) <= heard]
    assert fitting(offered, now) == (RELIABLE if RELIABLE in hearing_all else BEST_EFFORT)


@pytest.mark.parametrize("now", sorted(REQUESTS))
def test_a_camera_that_went_away_changes_nothing(now: str) -> None:
    assert fitting([], now) == now


needs_ros = pytest.mark.skipif(
    find_spec("rclpy") is None, reason="rclpy is not installed (pip install 'swardmap[ros]')"
)


class Stage:
    """One node that listens and one that publishes, in one context of their own."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        with mock.patch.dict(os.environ, environment()):
            self.context = Context()
            rclpy.init(context=self.context)
            space = f"/t{os.getpid()}_{time.monotonic_ns()}"
            remapped = ["--ros-args", "-r", "image:=renamed"]
            self.hears = rclpy.create_node("hears", namespace=space, context=self.context, cli_args=remapped)
            self.says = rclpy.create_node("says", namespace=space, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.hears)
        self.heard: list[str] = []

    def listen(self, reliability: str) -> Subscription:
        from std_msgs.msg import String

        return Subscription(self.hears, String, "image", lambda m: self.heard.append(m.data), reliability, 5)

    def publisher(self, reliability: str) -> Any:
        from std_msgs.msg import String

        return self.says.create_publisher(String, "renamed", image_qos(reliability, 5))

    def say(self, publisher: Any, word: str) -> None:
        from std_msgs.msg import String

        publisher.publish(String(data=word))

    def until(self, done: Callable[[], bool], topic: Subscription, seconds: float = 30.0) -> bool:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)
            topic.follow()
            if done():
                return True
        return False

    def asks(self) -> list[str]:
        """What the subscriptions of the topic ask for, as others see it."""
        found = self.says.get_subscriptions_info_by_topic("renamed")
        return [info.qos_profile.reliability.name.lower() for info in found]


@pytest.fixture
def stage() -> Iterator[Stage]:
    made = Stage()
    yield made
    made.executor.shutdown()
    made.hears.destroy_node()
    made.says.destroy_node()
    made.context.try_shutdown()


def heard_by_one(stage: Stage, topic: Subscription, publisher: Any, reliability: str, word: str) -> None:
    """One subscription, as reliable as that, which hears each word once."""
    assert stage.until(
        lambda: stage.asks() == [reliability] and publisher.get_subscription_count() == 1, topic
    )
    stage.heard.clear()
    stage.say(publisher, word)
    assert stage.until(lambda: word in stage.heard, topic)
    assert stage.heard == [word]


@pytest.mark.slow
@needs_ros
def test_a_camera_that_comes_late_or_comes_back_otherwise_is_heard(stage: Stage) -> None:
    topic = stage.listen("auto")
    for reliability in (BEST_EFFORT, RELIABLE, BEST_EFFORT):
        camera = stage.publisher(reliability)
        heard_by_one(stage, topic, camera, reliability, reliability)
        stage.says.destroy_publisher(camera)
        assert stage.until(lambda: not stage.hears.get_publishers_info_by_topic("renamed"), topic)
        assert topic.reliability == reliability


@pytest.mark.slow
@needs_ros
def test_of_two_publishers_that_differ_both_are_heard(stage: Stage) -> None:
    topic = stage.listen("auto")
    reliable = stage.publisher(RELIABLE)
    heard_by_one(stage, topic, reliable, RELIABLE, "first")
    other = stage.publisher(BEST_EFFORT)
    heard_by_one(stage, topic, other, BEST_EFFORT, "second")
    heard_by_one(stage, topic, reliable, BEST_EFFORT, "third")
    stage.says.destroy_publisher(other)
    heard_by_one(stage, topic, reliable, RELIABLE, "fourth")


@pytest.mark.slow
@needs_ros
@pytest.mark.parametrize("reliability", sorted(REQUESTS))
def test_what_is_asked_for_by_name_stays(stage: Stage, reliability: str) -> None:
    topic = stage.listen(reliability)
    cameras = [stage.publisher(offered) for offered in (RELIABLE, BEST_EFFORT)]
    assert stage.until(lambda: stage.hears.count_publishers("renamed") == 2, topic)
    topic.follow()
    assert topic.reliability == reliability
    assert stage.until(lambda: stage.asks() == [reliability], topic)
    heard = [reliable in REQUESTS[reliability] for reliable in (True, False)]
    assert stage.until(lambda: [bool(c.get_subscription_count()) for c in cameras] == heard, topic)
