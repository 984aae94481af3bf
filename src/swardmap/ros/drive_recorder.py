"""Record what a running node sees, with poses, as a folder for `swardmap teach`; ROS is not needed."""

import queue
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from swardmap.errors import SwardmapError
from swardmap.io.sources.folder import same_camera, write_folder
from swardmap.types import Frame

APART_M, APART_RAD = 0.1, 0.1
"""A frame is recorded when the camera moved so far since the last one, or turned so far."""
MOST_FRAMES = 600
"""Then the recording ends by itself: 60 m of way at least, about 0.5 GB in 640 x 480."""
WAITING = 8
"""Frames that wait for the disk; one more is left out."""
TURN_S = 0.01


class DriveRecorder:
    """Writes the frames of one camera in a thread of its own; the folder appears when it is stopped.

    Args:
        folder: the new recording.
        tell: is given one line when the recording has ended, however it did (in that thread).
        most_frames: of it.
        options: of `swardmap teach` that belong to this robot.

    Attributes:
        folder: of the recording.
        error: why nothing was written; empty once the folder is there.
    """

    def __init__(
        self,
        folder: Path,
        tell: Callable[[str], None],
        most_frames: int = MOST_FRAMES,
        options: str = "",
    ) -> None:
        self.folder, self.error = folder, "the drive could not be written"
        self._tell, self._most, self._options, self._cut = tell, most_frames, options, ""
        self._taken = self._written = self._left_out = 0
        self._camera, self._last = "", np.eye(4)
        self._like: Frame | None = None
        self._waiting: queue.Queue[Frame] = queue.Queue(WAITING)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    @property
    def writing(self) -> bool:
        """Whether the folder is not there yet."""
        return self._thread.is_alive()

    @property
    def told(self) -> str:
        """What came of it, for a person."""
        if self.error:
            return f"nothing was recorded: {self.error}"
        slow = f", {self._left_out} left out since the disk was too slow" if self._left_out else ""
        cut = f", which ended early since {self._cut}: the rest is not in it" if self._cut else ""
        return (
            f"{self._written} frames of the drive in {self.folder}{slow}{cut}; "
            f"next: swardmap teach {self.folder} -o my-lawn.onnx{self._options}"
        )

    def offer(self, camera: str, frame: Frame) -> None:
        """Take a frame if it has a pose, is of the first camera and shows another place than the last."""
        if self._ended.is_set() or frame.T_map_camera is None or self._camera not in ("", camera):
            return
        pose = frame.T_map_camera.matrix
        way_m = float(np.linalg.norm(pose[:3, 3] - self._last[:3, 3]))
        turn = float(np.arccos(np.clip((np.trace(self._last[:3, :3].T @ pose[:3, :3]) - 1) / 2, -1, 1)))
        if self._taken and way_m < APART_M and turn < APART_RAD:
            return
        self._cut = self._no_more(frame)
        if self._cut:
            self._ended.set()
            return
        try:
            self._waiting.put_nowait(replace(frame, name=""))
        except queue.Full:
            self._left_out += 1
            return
        self._camera, self._last, self._taken = camera, pose, self._taken + 1
        self._like = frame

    def _no_more(self, frame: Frame) -> str:
        """Why this frame cannot follow the others; empty where it can."""
        if self._taken >= self._most:
            return f"{self._most} frames are the most"
        if self._like is None:
            return ""
        if frame.stamp_ns < self._like.stamp_ns:
            return "the clock went back"
        return "" if same_camera(self._like, frame) else "the camera is another now"

    def stop(self) -> None:
        """Take no more frames; `writing` says until when the folder is not there."""
        self._ended.set()

    def wait(self, seconds: float | None = None) -> None:
        """Wait until the folder is there, or so long."""
        self._thread.join(seconds)

    def _frames(self) -> Iterator[Frame]:
        while True:
            try:
                frame = self._waiting.get(timeout=TURN_S)
            except queue.Empty:
                if self._ended.is_set() and self._waiting.empty():
                    return
                continue
            yield frame

    def _write(self) -> None:
        try:
            self._written = write_folder(self._frames(), self.folder)
            self.error = ""
        except SwardmapError as error:
            self.error = str(error)
        finally:
            self._ended.set()
            self._tell(self.told)
