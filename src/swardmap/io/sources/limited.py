"""A part of a source: some frames, some seconds, or until someone says stop."""

from collections.abc import Iterator, Mapping
from typing import Any

from swardmap.io import FrameSource
from swardmap.types import Frame


class LimitedSource:
    """The first frames of a source; see `swardmap.io.FrameSource`.

    Args:
        source: a recording, or a camera that has a `stop` of its own.
        frames: at most so many; None = all.
        duration_s: only frames less than this after the first, by their stamps; None = all.

    Attributes:
        name, label_set: of the source.
        given: frames that the last iteration gave so far.
    """

    def __init__(
        self, source: FrameSource, frames: int | None = None, duration_s: float | None = None
    ) -> None:
        self._source, self._frames, self._duration_s = source, frames, duration_s
        self._stopped = False
        self.name, self.label_set = source.name, source.label_set
        self.given = 0

    @property
    def frame_count(self) -> int | None:
        """At most; None if the source has no end and no number was given."""
        counts = [n for n in (self._source.frame_count, self._frames) if n is not None]
        return min(counts, default=None)

    @property
    def skipped(self) -> Mapping[str, int]:
        """Of the source."""
        return self._source.skipped

    @property
    def notes(self) -> list[str]:
        """Of the source."""
        return list(getattr(self._source, "notes", []))

    @property
    def facts(self) -> dict[str, Any]:
        """Of the source."""
        return dict(getattr(self._source, "facts", {}))

    @property
    def stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._stopped

    @property
    def lost(self) -> str:
        """Why a camera stopped giving images; empty if it did not."""
        return str(getattr(self._source, "lost", ""))

    def stop(self) -> None:
        """End after the frame in progress; may be called from a signal handler."""
        self._stopped = True
        if (stop := getattr(self._source, "stop", None)) is not None:
            stop()

    def __iter__(self) -> Iterator[Frame]:
        """Yield frames up to the limit."""
        first_ns: int | None = None
        self.given = 0
        if self._frames == 0:
            return
        for index, frame in enumerate(self._source, start=1):
            first_ns = frame.stamp_ns if first_ns is None else first_ns
            elapsed_s = (frame.stamp_ns - first_ns) / 1e9
            if self._stopped or (self._duration_s is not None and elapsed_s >= self._duration_s):
                return
            self.given = index
            yield frame
            if index == self._frames or self._stopped:
                return
