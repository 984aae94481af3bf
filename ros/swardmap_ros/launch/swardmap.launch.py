"""ros2 launch swardmap_ros swardmap.launch.py params:=/etc/swardmap/swardmap.yaml gate:=true."""

from typing import Any

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "namespace": ("", "namespace of the node, such as mower1"),
    "params": ("", "ROS 2 parameter file of the node; none = defaults"),
    "autostart": ("true", "configure and activate at once; false: a lifecycle manager does it"),
    "use_sim_time": ("false", "take the time from /clock"),
    "log_level": ("info", "of the node"),
    "gate": ("false", "start the gate as well: cmd_vel_in goes to cmd_vel while all is well (docs/robot.md)"),
    "gate_params": ("", "ROS 2 parameter file of the gate"),
}
TF = [("/tf", "tf"), ("/tf_static", "tf_static")]
"""As Nav2's own launch files: a robot in a namespace has a tf tree of its own."""


def nodes(context: Any) -> list[Node]:
    """The nodes, now that the values of the arguments are known."""

    def text(name: str) -> str:
        return str(LaunchConfiguration(name).perform(context))

    def files(name: str) -> list[Any]:
        return [text(name)] if text(name) else []

    def flag(name: str) -> ParameterValue:
        return ParameterValue(LaunchConfiguration(name), value_type=bool)

    shared: dict[str, Any] = {
        "package": "swardmap_ros",
        "namespace": LaunchConfiguration("namespace"),
        "output": "screen",
        "emulate_tty": True,
        "arguments": ["--ros-args", "--log-level", LaunchConfiguration("log_level")],
    }
    given = {name: flag(name) for name in ("autostart", "use_sim_time")}
    mapper = Node(
        executable="swardmap",
        name="swardmap",
        parameters=[*files("params"), given],
        remappings=TF,
        **shared,
    )
    gate = Node(
        executable="gate",
        name="swardmap_gate",
        parameters=[*files("gate_params"), {"use_sim_time": flag("use_sim_time")}],
        condition=IfCondition(LaunchConfiguration("gate")),
        **shared,
    )
    return [mapper, gate]


def generate_launch_description() -> LaunchDescription:
    """The node, and the gate if it is asked for."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=about)
        for name, (default, about) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])
