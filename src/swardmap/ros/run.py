"""Start the node, spin until it is stopped, and leave nothing behind."""

import sys
from collections.abc import Sequence

from swardmap.errors import ConfigError, InputError
from swardmap.ros.parameters import Parameters
from swardmap.ros.topics import rclpy_module


def run_node(defaults: Parameters | None = None, arguments: Sequence[str] = ()) -> None:
    """Run the node until Ctrl-C, SIGTERM or a shutdown of ROS.

    Args:
        defaults: what parameters are unless ROS says otherwise.
        arguments: `--ros-args` and what follows.

    Raises:
        MissingExtraError: if there is no rclpy.
        ConfigError: if parameters are wrong.
        InputError: if the node cannot be configured; its log says why.
    """
    rclpy = rclpy_module()
    from rclpy.exceptions import ParameterException
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from swardmap.ros.node import RobotNode

    rclpy.init(args=[sys.argv[0], *arguments], signal_handler_options=SignalHandlerOptions.NO)
    robot = None
    try:
        robot = RobotNode(defaults)
        if not robot.start():
            raise InputError("the node could not be configured: see its log")
        executor = SingleThreadedExecutor()
        executor.add_node(robot.node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass  # how a node is stopped
    except ParameterException as error:
        raise ConfigError(str(error)) from error
    finally:
        if robot is not None:
            robot.close()
        rclpy.try_shutdown()


def main() -> None:
    """Entry point of `ros2 run swardmap_ros swardmap`: ROS arguments as they come."""
    run_node(None, sys.argv[1:])
