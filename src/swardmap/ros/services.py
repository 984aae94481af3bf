"""The node's services: clear, save, pause, grant_start_area."""

import threading
from collections.abc import Callable, Generator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from swardmap.errors import SwardmapError
from swardmap.ros.live_pipeline import LivePipeline
from swardmap.ros.run_facts import run_facts

TURN_S = 0.01
"""A callback that waits for a thread waits so long at once."""


def serve(node: Any, pipeline: LivePipeline) -> list[Callable[[], object]]:
    """Create the services of a configured node, below its name.

    Args:
        node: of rclpy.
        pipeline: what they act on.

    Returns:
        What takes each of them back.
    """
    from std_srvs.srv import SetBool, Trigger

    services = (
        node.create_service(Trigger, "~/clear", partial(_clear, pipeline)),
        node.create_service(Trigger, "~/save", partial(_save, pipeline)),
        node.create_service(SetBool, "~/pause", partial(_pause, pipeline)),
        node.create_service(Trigger, "~/grant_start_area", partial(_grant, node, pipeline)),
    )
    return [partial(node.destroy_service, service) for service in services]


def _clear(pipeline: LivePipeline, _: Any, response: Any) -> Any:
    pipeline.clear()
    response.success, response.message = True, "the map is empty: all is unknown"
    return response


def _grant(node: Any, pipeline: LivePipeline, _: Any, response: Any) -> Any:
    now_ns = int(node.get_clock().now().nanoseconds)
    try:
        response.success, response.message = True, pipeline.grant_start_area(now_ns)
    except SwardmapError as error:
        response.success, response.message = False, str(error)
    return response


async def _save(pipeline: LivePipeline, _: Any, response: Any) -> Any:
    folder = Path(pipeline.parameters.node.save_folder) / datetime.now(UTC).strftime("%Y%m%dT%H%M%S.%f")
    writer = _Writer(pipeline, folder)
    writer.start()
    while writer.is_alive():  # the stop flag is published meanwhile, or the robot would stand
        writer.join(TURN_S)
        await _OthersTurn()
    response.success, response.message = not writer.error, writer.error or str(folder.absolute())
    return response


class _Writer(threading.Thread):
    """Saves the map; `error` says afterwards what went wrong."""

    def __init__(self, pipeline: LivePipeline, folder: Path) -> None:
        super().__init__(daemon=True)
        self.error = "the map could not be saved"
        self._save = partial(pipeline.mapper.save, folder, run_facts(pipeline))

    def run(self) -> None:
        try:
            self._save()
            self.error = ""
        except SwardmapError as error:
            self.error = str(error)


class _OthersTurn:
    """Awaited in a callback, it lets the executor call all others that are ready before it goes on."""

    def __await__(self) -> Generator[None, None, None]:
        yield


def _pause(pipeline: LivePipeline, request: Any, response: Any) -> Any:
    pipeline.intake.paused = bool(request.data)
    response.success = True
    response.message = "paused: the stop flag is set" if request.data else "mapping"
    return response
