"""A recording of any kind to a folder: in our layout, or its images alone, to annotate them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swardmap.config import Config
from swardmap.errors import InputError
from swardmap.types import Frame


@dataclass(frozen=True, slots=True)
class Span:
    """Frames by their time, in seconds after the first.

    Attributes:
        from_s: the first to take.
        to_s: none from here on; None = to the end.
    """

    from_s: float = 0.0
    to_s: float | None = None

    def of(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        """The frames inside; reading ends with the span."""
        first_ns: int | None = None
        for frame in frames:
            first_ns = frame.stamp_ns if first_ns is None else first_ns
            after_s = (frame.stamp_ns - first_ns) / 1e9
            if self.to_s is not None and after_s >= self.to_s:
                return
            if after_s >= self.from_s:
                yield frame


def convert_recording(
    location: str, target: Path, config: Config, span: Span, images_only: bool, overwrite: bool, quiet: bool
) -> dict[str, Any]:
    """Write the frames of a recording into a folder; see `swardmap convert`.

    Raises:
        InputError: if it is no recording, or no frame is left; OutputError: if the folder cannot be written.
    """
    from swardmap.cli.progress import Progress
    from swardmap.io import open_source
    from swardmap.io.files import refuse_to_replace
    from swardmap.io.sources.folder import write_folder

    source = open_source(location, config)
    refuse_to_replace(location, target)
    with Progress("reading", "read", source.frame_count, quiet) as bar:
        frames = _told(span.of(iter(source)), bar.step)
        first = next(frames, None)
        if first is None:
            why = ", ".join(f"{n} x {reason}" for reason, n in source.skipped.items() if n)
            raise InputError(f"{location}: no frame is left to write (left out: {why or 'by the time'})")
        whole = _chain(first, frames)
        write = _write_images if images_only else write_folder
        count = write(whole, target, overwrite)
    left_out = {reason: n for reason, n in source.skipped.items() if n}
    kind = "images" if images_only else "recording"
    return {"kind": kind, "written": str(target), "frames": count, **left_out}


def _told(frames: Iterator[Frame], on_frame: Any) -> Iterator[Frame]:
    for frame in frames:
        yield frame
        on_frame(frame)


def _chain(first: Frame, rest: Iterator[Frame]) -> Iterator[Frame]:
    yield first
    yield from rest


def _write_images(frames: Iterable[Frame], target: str | Path, overwrite: bool = False) -> int:
    """NAME.png of every frame: `--masks` finds the mask of a frame by this name."""
    from swardmap.io.files import inside, write_bytes
    from swardmap.io.folders import new_output_folder
    from swardmap.io.images import encode_png

    count = 0
    with new_output_folder(target, overwrite, "images") as folder:
        for count, frame in enumerate(frames, 1):
            file = inside(folder, f"{frame.name or f'{count - 1:06d}'}.png")
            write_bytes(file, encode_png(frame.rgb), durable=False)
    return count
