"""All that a node listens to: images, calibrations and poses, handed to the intake of its pipeline."""

from collections.abc import Callable
from functools import partial
from typing import Any

from swardmap.errors import ConfigError
from swardmap.io.sources.pairing import COLOR, DEPTH
from swardmap.ros.inputs import is_compressed
from swardmap.ros.intake import Intake
from swardmap.ros.subscription import AUTO, FOLLOW_S, Subscription
from swardmap.ros.topics import BEST_EFFORT, Types, image_qos, latched_qos


class Subscriptions:
    """Subscribes to what a configured node needs.

    Args:
        node: of rclpy.
        types: which messages this ROS has.
        intake: what is told.
        is_active: images are taken only while it says so.

    Raises:
        ConfigError: if poses are to come by tf, which this ROS lacks.
    """

    def __init__(self, node: Any, types: Types, intake: Intake, is_active: Callable[[], bool]) -> None:
        from rclpy.clock import Clock, ClockType

        self._node, self._types, self._intake, self._is_active = node, types, intake, is_active
        self._followed: list[Subscription] = []
        self._held: list[Callable[[], object]] = []
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # a simulation may pause
        timer = node.create_timer(FOLLOW_S, self._follow_publishers, clock=steady)
        self._held.append(partial(node.destroy_timer, timer))
        try:
            self._subscribe_images()
            self._subscribe_poses()
        except BaseException:
            self.destroy()
            raise

    def destroy(self) -> None:
        """Listen no more."""
        for destroy in self._held:
            destroy()
        self._held.clear()
        self._followed.clear()

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _subscribe_images(self) -> None:
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image

        for name, camera in self._intake.inputs.items():
            topics = camera.topics
            for kind, topic, info in (
                (COLOR, topics.color, topics.color_info),
                (DEPTH, topics.depth, topics.depth_info),
            ):
                cls = CompressedImage if is_compressed(topic) else Image
                parameters = self._intake.parameters.node
                heard = partial(self._on_image, name, kind)
                self._follow(cls, topic, heard, parameters.image_reliability, parameters.image_depth)
                heard_info = partial(self._intake.on_info, name, kind)
                self._listen(CameraInfo, info, heard_info, image_qos(BEST_EFFORT, 2))

    def _subscribe_poses(self) -> None:
        from nav_msgs.msg import Odometry

        poses, tf = self._intake.poses, self._types["tf"]
        if not poses.posed:
            return
        if poses.from_odometry:
            topic = self._intake.parameters.config.source.odometry_topic
            assert topic is not None  # noqa: S101 - poses are from odometry only where a topic is set
            self._follow(Odometry, topic, self._on_odometry, AUTO, 50)
        elif tf is None:
            raise ConfigError(
                "poses by tf need tf2_msgs, which this ROS lacks: set source.odometry_topic, or install "
                "ros-<distribution>-tf2-msgs"
            )
        else:
            self._listen(tf, "/tf", partial(self._on_tf, False), 100)
        if tf is not None:
            self._listen(tf, "/tf_static", partial(self._on_tf, True), latched_qos(100))

    def _follow(
        self, cls: Any, topic: str, heard: Callable[[Any], None], reliability: str, depth: int
    ) -> None:
        subscription = Subscription(self._node, cls, topic, heard, reliability, depth)
        self._followed.append(subscription)
        self._held.append(subscription.destroy)

    def _listen(self, cls: Any, topic: str, callback: Callable[[Any], None], qos: Any) -> None:
        subscription = self._node.create_subscription(cls, topic, callback, qos)
        self._held.append(partial(self._node.destroy_subscription, subscription))

    def _follow_publishers(self) -> None:
        for subscription in self._followed:
            subscription.follow()

    def _on_image(self, camera: str, kind: str, message: Any) -> None:
        if self._is_active():
            self._intake.on_image(camera, kind, message, self._now_ns())

    def _on_odometry(self, message: Any) -> None:
        self._intake.on_odometry(message, self._now_ns())

    def _on_tf(self, static: bool, message: Any) -> None:
        self._intake.on_tf(message, static, self._now_ns())
