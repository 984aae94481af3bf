"""Where a Rerun stream goes: into an .rrd file, to a viewer that runs, or to one that is started for it.

Rerun sends in threads of its own, which only log what goes wrong; `arrive` waits for them and raises.
"""

import os
import shutil
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from swardmap.errors import OutputError, require
from swardmap.io.staging import name_beside, sweep

ARRIVE_S = 10.0
"""The longest time one frame may take to arrive; a viewer that needs longer is taken for gone."""

CONNECT_S = 3.0
QUIET = "error,re_sdk=off,re_grpc_client=off,re_log_encoding=off"
"""What Rerun may print; the rest is said by our own errors."""


def load_rerun() -> Any:
    """The module rerun, which prints no more than it must.

    Raises:
        MissingExtraError: without rerun-sdk.
    """
    os.environ.setdefault("RUST_LOG", QUIET)  # read when it is imported
    return require("rerun", "view")


@dataclass(frozen=True, slots=True)
class RerunSink:
    """An open stream.

    Attributes:
        stream: the rerun.RecordingStream.
        what: begins an error, such as "cannot write FILE".
        folder: whose disk may be full; None = not a file.
    """

    stream: Any
    what: str
    folder: Path | None = None

    def arrive(self, timeout_s: float = ARRIVE_S) -> None:
        """Wait until all that was logged has arrived, so that memory stays flat.

        Raises:
            OutputError: if it does not.
        """
        try:
            self.stream.flush(timeout_sec=timeout_s)
        except RuntimeError as error:
            full = self.folder is not None and shutil.disk_usage(self.folder).free < 2**20
            raise OutputError(f"{self.what}: {'the disk is full' if full else _line(error)}") from error


@contextmanager
def rerun_sink(
    save: Path | None = None, connect: str | None = None, overwrite: bool = False, layout: Any = None
) -> Iterator[RerunSink]:
    """Open a stream into a file, to a viewer that runs, or to one that is started for it.

    Args:
        save: .rrd file; it appears under its name when it is whole.
        connect: such as rerun+http://127.0.0.1:9876/proxy.
        overwrite: replace the file of that name.
        layout: a rerun Blueprint.

    Raises:
        MissingExtraError: without rerun-sdk.
        OutputError: if the file cannot be written, or no viewer answers or starts.
    """
    stream = load_rerun().RecordingStream("swardmap")
    if save is not None:
        with _whole_file(save, overwrite) as temporary:
            stream.save(temporary, default_blueprint=layout)
            sink = RerunSink(stream, f"cannot write {save}", save.parent)
            try:
                yield sink
                sink.arrive()
            finally:
                stream.disconnect()
        return
    sink = _viewer(stream, connect, layout)
    try:
        yield sink
        sink.arrive()
    finally:
        stream.disconnect()


def _viewer(stream: Any, connect: str | None, layout: Any) -> RerunSink:
    """Refuse a viewer that does not answer, before any work is done for it."""
    if connect is None and not has_screen():
        raise OutputError(
            "the Rerun viewer needs a screen, and neither DISPLAY nor WAYLAND_DISPLAY is set: write a file "
            "with --save FILE.rrd, or name a viewer on another machine with --connect URL"
        )
    sink = RerunSink(stream, "the Rerun viewer is gone" if connect is None else f"{connect} is gone")
    if connect is not None:
        _knock(connect)
    try:
        if connect is None:
            stream.spawn(default_blueprint=layout)
        else:
            stream.connect_grpc(connect, default_blueprint=layout)
        stream.flush(timeout_sec=CONNECT_S)
    except (RuntimeError, ValueError, OSError) as error:
        stream.disconnect()
        if connect is None:
            raise OutputError(f"the Rerun viewer does not start: {_line(error)}") from error
        raise _nobody(connect, _line(error)) from error
    return sink


def _knock(url: str) -> None:
    """Is anybody there: Rerun itself would wait long, and print much."""
    try:
        parts = urlsplit(url)
        if not (parts.scheme.startswith("rerun") and parts.hostname and parts.port):
            raise ValueError("no such address")
        socket.create_connection((parts.hostname, parts.port), CONNECT_S).close()
    except (OSError, ValueError) as error:
        raise _nobody(url, _line(error)) from error


def _nobody(url: str, why: str) -> OutputError:
    return OutputError(
        f"no Rerun viewer answers at {url}: {why}. Start one with `rerun`, and name it as "
        "rerun+http://HOST:9876/proxy"
    )


def has_screen() -> bool:
    """Whether a window can be opened, as far as the environment says."""
    return sys.platform != "linux" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


@contextmanager
def _whole_file(path: Path, overwrite: bool) -> Iterator[Path]:
    """A temporary file beside `path` that takes its name at the end."""
    if path.suffix != ".rrd" or path.is_dir():
        raise OutputError(f"expected a file whose name ends in .rrd, got {path}")
    sweep(path)
    if path.exists() and not overwrite:
        raise OutputError(f"{path} exists: choose another name, or pass --overwrite")
    temporary = name_beside(path)
    try:
        with _one_error(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary.touch(exist_ok=False)  # Rerun writes in a thread of its own, and would only log it
        yield temporary
        with _one_error(path):
            temporary.replace(path)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def _one_error(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200].rstrip(".")
