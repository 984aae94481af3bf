"""The parameters of a running node: declared, checked when they are set; the measured margin is of them."""

from collections.abc import Callable
from typing import Any

from swardmap.config import config_to_dict
from swardmap.errors import ConfigError, SwardmapError
from swardmap.models.onnx import usable_cores
from swardmap.rig.rig import Rig
from swardmap.ros.network_choice import network_of_rig
from swardmap.ros.parameters import Declaration, Parameters, changed, declarations, parameters_from


class NodeParameters:
    """Declares all parameters on a node, and keeps what they are now.

    Args:
        node: of rclpy.
        defaults: what they are unless ROS says otherwise.
        take: is given them when they have changed; raises SwardmapError to refuse them.
        configured: whether the node is configured, so that some must stay as they are.

    Attributes:
        now: what they are.

    Raises:
        ConfigError: if one is out of range.
    """

    def __init__(
        self,
        node: Any,
        defaults: Parameters,
        take: Callable[[Parameters], None],
        configured: Callable[[], bool],
    ) -> None:
        self._node, self._take, self._configured = node, take, configured
        self._known = {d.name: self._declared(d) for d in declarations(defaults)}
        self.now = parameters_from(self._known)
        node.add_on_set_parameters_callback(self._on_set)

    def take_network(self, rig: Rig | None) -> None:
        """Set the smaller network in place of `auto` for a rig that asks too much of the cores.

        The parameter `segmenter.name` tells it from then on.

        Raises:
            ConfigError: if the other parameters do not allow it.
        """
        from rclpy.parameter import Parameter

        name, why = network_of_rig(self.now.config.segmenter, rig, usable_cores())
        if why:
            result = self._node.set_parameters_atomically([Parameter("segmenter.name", value=name)])
            if not result.successful:
                raise ConfigError(f"segmenter.name: {result.reason}")
            self._node.get_logger().info(why)

    def take_margin(self) -> None:
        """Set the measured margin in place of what the parameters say; they tell it from then on.

        Raises:
            InputError: if its file cannot be read.
            ConfigError: if its margin is out of range.
        """
        from rclpy.parameter import Parameter

        from swardmap.io.maps.margin_file import margin_notes, read_margin
        from swardmap.runs.versions import segmenter_title

        log, file = self._node.get_logger(), self.now.node.margin_file
        if file is None:
            if self.now.config.costmap.margin_m is None:
                margin_m = self.now.config.costmap.obstacle_margin_m
                log.info(f"margin {margin_m:g} m, the default: none was measured (swardmap evaluate)")
            return
        margin = read_margin(file)
        person_m = margin.margin_m if margin.person_margin_m is None else margin.person_margin_m
        found = {"costmap.margin_m": margin.margin_m, "costmap.person_margin_m": person_m}
        result = self._node.set_parameters_atomically(
            [Parameter(n, value=float(v)) for n, v in found.items()]
        )
        if not result.successful:
            raise ConfigError(f"{file}: {result.reason}")
        log.info(f"margin {margin.margin_m:g} m, around persons {person_m:g} m, of {file}")
        config = self.now.config
        for note in margin_notes(file, config_to_dict(config), segmenter_title(config)):
            log.warning(note)

    def _declared(self, declaration: Declaration) -> Any:
        """Declare one parameter; its value may come from the command line or a file."""
        from rcl_interfaces.msg import ParameterDescriptor

        descriptor = ParameterDescriptor(
            description=declaration.about,
            additional_constraints=declaration.limits,
            dynamic_typing=declaration.optional or declaration.value is None,
        )
        return self._node.declare_parameter(declaration.name, declaration.value, descriptor).value

    def _on_set(self, wanted: list[Any]) -> Any:
        from rcl_interfaces.msg import SetParametersResult

        values = {p.name: p.value for p in wanted if p.name in self._known}
        try:
            parameters = changed(self.now, values, self._configured())
            self._take(parameters)
        except SwardmapError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.now = parameters
        return SetParametersResult(successful=True)
