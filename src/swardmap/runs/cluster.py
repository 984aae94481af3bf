"""Parts on a Ray cluster; every node must see the data and the folder under the same path."""

import os
import socket
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from swardmap.errors import InputError, require

Part = TypeVar("Part")
Result = TypeVar("Result")


def on_ray(
    work: Callable[[Part, Callable[[], None]], Result], parts: Sequence[Part], address: str
) -> Iterator[tuple[Part, Result]]:
    """Parts in the order in which they are finished; a part on a node that dies is done again elsewhere.

    Args:
        work: called with a part and a tick that nobody hears.
        parts: what to work on.
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
        remote, shared = ray.remote(num_cpus=1, max_retries=-1)(_on_node), ray.put(work)
        running = {remote.remote(shared, part): part for part in parts}
        while running:
            (finished, *_), _ = ray.wait(list(running), num_returns=1)
            yield running.pop(finished), ray.get(finished)
    finally:
        if ours:
            ray.shutdown()


def _on_node(work: Callable[[Part, Callable[[], None]], Result], part: Part) -> Result:
    return work(part, _no_tick)


def _no_tick() -> None:
    """Nobody hears it."""


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
