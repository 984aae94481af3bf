"""Start the node, spin until it is stopped, and leave nothing behind."""

import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from swardmap.config import Config
from swardmap.errors import ConfigError, InputError, SwardmapError
from swardmap.ros.parameters import Parameters
from swardmap.ros.topics import rclpy_module
from swardmap.ros.warm_up import warm_up

WAITS_S = 0.2
"""A wait for messages takes at most so long: Python looks for signals between two of them."""


def run_node(
    defaults: Parameters | None = None,
    arguments: Sequence[str] = (),
    goes_on: Callable[[], bool] = lambda: True,
) -> None:
    """Run the node until Ctrl-C, SIGTERM or a shutdown of ROS; the last it says is stop, nothing free.

    Args:
        defaults: what parameters are unless ROS says otherwise.
        arguments: `--ros-args` and what follows.
        goes_on: asked a few times a second; it ends when this is false.

    Raises:
        MissingExtraError: if there is no rclpy.
        ConfigError: if parameters or ROS arguments are wrong.
        InputError: if the node cannot be configured; its log says why.
    """
    rclpy = rclpy_module()
    from rclpy.exceptions import ParameterException
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from swardmap.ros.node import RobotNode

    try:
        rclpy.init(args=[sys.argv[0], *arguments], signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # a parameter file that is none, a remapping that is misspelt
        raise ConfigError(f"ROS arguments: {' '.join(str(error).split())}") from error
    ended = _on_signals()
    robot = None
    try:
        _compile_kernels(rclpy)
        robot = RobotNode(defaults)
        if not robot.start():
            raise InputError("the node could not be configured: see its log")
        executor = SingleThreadedExecutor()
        executor.add_node(robot.node)
        while rclpy.ok() and not ended.is_set() and goes_on():
            executor.spin_once(timeout_sec=WAITS_S)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass  # how a node is stopped
    except ParameterException as error:
        raise ConfigError(str(error)) from error
    finally:
        if robot is not None:
            robot.close()
        rclpy.try_shutdown()


def _compile_kernels(rclpy: Any) -> None:
    """Have all kernels ready before the node is there: whoever is to configure it waits for it, and is told.

    A lifecycle manager that waits for an answer gives up in the middle of compiling.
    """
    from swardmap.models.colour import ColourSegmenter

    log, began = rclpy.logging.get_logger("swardmap"), time.monotonic()
    log.info("getting ready: the first start on a machine compiles for about a minute")
    config = Config()
    config = replace(config, geometry=replace(config.geometry, enabled=True))
    for mode in ("last_seen", "log_odds"):
        warm_up(replace(config, grid=replace(config.grid, mode=mode)), ColourSegmenter())
    log.info(f"kernels are ready after {time.monotonic() - began:.1f} s")


def _on_signals() -> threading.Event:
    """What is set at the first SIGINT or SIGTERM; the next one does what it always did."""
    ended = threading.Event()
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = {kind: signal.getsignal(kind) for kind in kinds}

    def end(_: int, __: object) -> None:
        ended.set()
        for kind in kinds:
            signal.signal(kind, before[kind])

    if threading.current_thread() is threading.main_thread():
        for kind in kinds:
            signal.signal(kind, end)
    return ended


def main() -> None:
    """Entry point of `ros2 run swardmap_ros swardmap`: ROS arguments as they come."""
    try:
        run_node(None, sys.argv[1:])
    except SwardmapError as error:
        raise SystemExit(f"swardmap: {error}") from error
