"""The node's services: clear, save, pause, grant_start_area, teach_record."""

import threading
from collections.abc import Callable, Generator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from swardmap.config import MountConfig
from swardmap.errors import SwardmapError
from swardmap.monitor.diagnostics import Severity
from swardmap.ros.drive_recorder import DriveRecorder
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
        node.create_service(SetBool, "~/teach_record", partial(_teach_record, pipeline)),
    )
    return [*(partial(node.destroy_service, service) for service in services), partial(_end_drive, pipeline)]


def _clear(pipeline: LivePipeline, _: Any, response: Any) -> Any:
    try:
        pipeline.clear()
        response.success, response.message = True, "the map is empty: all is unknown"
    except SwardmapError as error:
        response.success, response.message = False, str(error)
    return response


def _grant(node: Any, pipeline: LivePipeline, _: Any, response: Any) -> Any:
    now_ns = int(node.get_clock().now().nanoseconds)
    try:
        response.success, response.message = True, pipeline.grant_start_area(now_ns)
    except SwardmapError as error:
        response.success, response.message = False, str(error)
    return response


async def _save(pipeline: LivePipeline, _: Any, response: Any) -> Any:
    folder = _new_folder(pipeline)
    writer = _Writer(pipeline, folder)
    writer.start()
    while writer.is_alive():  # the stop flag is published meanwhile, or the robot would stand
        writer.join(TURN_S)
        await _OthersTurn()
    response.success, response.message = not writer.error, writer.error or str(folder.absolute())
    return response


def _new_folder(pipeline: LivePipeline, name: str = "") -> Path:
    name += datetime.now(UTC).strftime("%Y%m%dT%H%M%S.%f")
    return Path(pipeline.parameters.node.save_folder) / name


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


async def _teach_record(pipeline: LivePipeline, request: Any, response: Any) -> Any:
    recorder = pipeline.recorder
    if not request.data and recorder is not None:
        recorder.stop()
        while recorder.writing:
            recorder.wait(TURN_S)
            await _OthersTurn()
        pipeline.recorder = None
        response.success, response.message = not recorder.error, recorder.told
    elif not request.data:
        response.success, response.message = False, "no drive is being recorded"
    elif not pipeline.intake.poses.posed:
        response.success, response.message = False, "a drive needs poses, and pose_source is none"
    elif recorder is not None and recorder.writing:
        response.success, response.message = False, f"already recording into {recorder.folder}"
    else:
        folder = _new_folder(pipeline, "drive_").absolute()
        options = _mount_options(pipeline.parameters.config.mount)
        pipeline.recorder = DriveRecorder(folder, partial(_log, pipeline), options=options)
        response.success, response.message = True, f"recording into {pipeline.recorder.folder}"
    return response


def _mount_options(mount: MountConfig) -> str:
    """Where the camera sits, as `swardmap teach` is told it; empty where nobody said."""
    told = {"x_m": mount.x_m, "y_m": mount.y_m, "yaw_deg": mount.yaw_deg}
    return "".join(f" --set mount.{name}={value:g}" for name, value in told.items() if value)


def _log(pipeline: LivePipeline, line: str) -> None:
    pipeline.events.append((Severity.OK, line))


def _end_drive(pipeline: LivePipeline) -> None:
    """What was recorded until the node stops is kept."""
    if pipeline.recorder is not None:
        pipeline.recorder.stop()
        pipeline.recorder.wait()
