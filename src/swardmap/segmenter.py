"""What tells grass from obstacles: the protocol that every network and every stand-in follows."""

from typing import Protocol, runtime_checkable

from swardmap.labels import LabelSet
from swardmap.types import Frame, Segmentation


@runtime_checkable
class Segmenter(Protocol):
    """Gives each pixel of a frame a class. One instance serves one thread: it keeps its buffers.

    One that several threads may call at once says so by `concurrent = True`; frames of a recording are then
    segmented side by side.
    """

    @property
    def name(self) -> str:
        """What a person would call it; goes into reports."""

    @property
    def label_set(self) -> LabelSet:
        """Classes that its masks may hold."""

    def __call__(self, frame: Frame) -> Segmentation:
        """Classes of the frame, at the segmenter's own size."""
