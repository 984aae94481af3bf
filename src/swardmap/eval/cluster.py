"""Parts of an evaluation on a Ray cluster; every node must see the data set under the same path."""

import os
import socket
from collections.abc import Iterator
from typing import Any

from swardmap.errors import InputError, require
from swardmap.eval.frame import Plan, evaluate_part


def on_ray(plan: Plan, todo: list[tuple[int, int]], address: str) -> Iterator[tuple[tuple[int, int], str]]:
    """Parts in the order in which they are finished; a part on a node that dies is done again elsewhere.

    Args:
        plan: what to evaluate.
        todo: parts (start, stop).
        address: of the cluster, such as `auto`, `HOST:6379` or `ray://HOST:10001`; `local` starts one here.

    Raises:
        MissingExtraError: without Ray.
        InputError: if the cluster cannot be reached.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    ray: Any = require("ray", "ray")
    ours = not ray.is_initialized()
    if ours:
        _knock(address)
        try:
            ray.init(
                address=None if address == "local" else address, log_to_driver=False, logging_level="error"
            )
        except (ray.exceptions.RayError, ValueError, RuntimeError, OSError) as error:
            raise InputError(f"no Ray cluster at '{address}': {error}") from error
    try:
        remote = ray.remote(num_cpus=1, max_retries=-1)(evaluate_part)
        running = {remote.remote(plan, start, stop): (start, stop) for start, stop in todo}
        while running:
            (finished, *_), _ = ray.wait(list(running), num_returns=1)
            yield running.pop(finished), ray.get(finished)
    finally:
        if ours:
            ray.shutdown()


def _knock(address: str) -> None:
    """Ray itself would try for minutes where nobody answers."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        return
    try:
        with socket.create_connection((host, int(port)), timeout=10):
            pass
    except OSError as error:
        raise InputError(f"no Ray cluster at '{address}': {error}") from error
