"""Transitions that a node cannot make are refused, not fatal, as with nodes of rclcpp."""

from typing import Any


def refuse_wrong_transitions(node: Any) -> None:
    """Let a lifecycle node of rclpy answer success=false to a transition that its state does not allow.

    rclpy's service raises RCLError there, which ends whoever spins the node; rclcpp_lifecycle answers
    success=false (lifecycle_node_interface_impl.cpp, on_change_state). Nav2's lifecycle manager asks for such
    a transition where a node has started by itself.

    Args:
        node: of rclpy.
    """
    service = getattr(node, "_service_change_state", None)
    if service is None:  # a later rclpy, which may do it by itself
        return
    answer = service.callback

    def answered(request: Any, response: Any) -> Any:
        try:
            return answer(request, response)
        except RuntimeError as error:  # RCLError is one
            wanted = request.transition.label or request.transition.id
            reason = " ".join(str(error).split())
            node.get_logger().warning(
                f"transition {wanted} refused: {reason}. Under a lifecycle manager set autostart: false"
            )
            response.success = False
            return response

    service.callback = answered
