"""A program of its own, with plain rclpy: asks the node for services and parameters, prints answers as JSON.

python -m tests.ros.ask NAMESPACE '[["call", "clear"], ["set", "cloud.max_range_m", 6.0], ["state"]]'
"""

import json
import sys
import time
from typing import Any

import rclpy
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import SetBool, Trigger


def ask(node: Any, kind: Any, name: str, request: Any) -> Any:
    client = node.create_client(kind, f"swardmap/{name}")
    if not client.wait_for_service(timeout_sec=150):
        raise SystemExit(f"no service {name}")
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=30)
    return future.result()


def nodes(node: Any, *names: str) -> list[str]:
    """All that are known, once those in the namespace are: their names come after their services."""
    wanted, found = {(name, sys.argv[1]) for name in names}, list[tuple[str, str]]()
    end = time.monotonic() + 30
    while time.monotonic() < end:
        found = node.get_node_names_and_namespaces()
        if wanted <= set(found):
            break
        rclpy.spin_once(node, timeout_sec=0.1)
    return [f"{namespace}/{name}" for name, namespace in found]


def answer(node: Any, words: list[Any]) -> Any:
    what, *rest = words
    if what == "call":
        kind = SetBool if len(rest) > 1 else Trigger
        request = kind.Request(data=rest[1]) if len(rest) > 1 else kind.Request()
        said = ask(node, kind, rest[0], request)
        return [said.success, said.message]
    if what == "set":
        request = SetParameters.Request(parameters=[Parameter(rest[0], value=rest[1]).to_parameter_msg()])
        said = ask(node, SetParameters, "set_parameters", request).results[0]
        return [said.successful, said.reason]
    if what == "get":
        said = ask(node, GetParameters, "get_parameters", GetParameters.Request(names=[rest[0]]))
        return parameter_value_to_python(said.values[0])
    if what == "nodes":
        return nodes(node, *rest)
    if what == "topics":
        nodes(node, "swardmap")
        return dict(node.get_publisher_names_and_types_by_node("swardmap", sys.argv[1]))
    if what == "change":
        request = ChangeState.Request()
        request.transition.id = rest[0]
        return ask(node, ChangeState, "change_state", request).success
    return ask(node, GetState, "get_state", GetState.Request()).current_state.label


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("asker", namespace=sys.argv[1])
    sys.stdout.write(json.dumps([answer(node, words) for words in json.loads(sys.argv[2])]))
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
