"""The true labels of a recording, in place of a segmenter: what a perfect network would give."""

from dataclasses import dataclass

from swardmap.config import SegmenterConfig
from swardmap.errors import ConfigError, InputError
from swardmap.labels import LabelSet
from swardmap.types import Frame, Segmentation


@dataclass(frozen=True, slots=True)
class TruthSegmenter:
    """Returns the labels that came with the frame.

    Attributes:
        label_set: classes of the recording.
        name: `truth`.
    """

    label_set: LabelSet
    name: str = "truth"

    def __call__(self, frame: Frame) -> Segmentation:
        """Labels of the frame, at its own size.

        Raises:
            InputError: for a frame without labels.
        """
        if frame.labels is None or frame.label_set is None:
            raise InputError(
                f"frame {frame.name or frame.stamp_ns}: expected true labels for the segmenter 'truth', "
                "got none; choose another segmenter or a recording with labels"
            )
        return Segmentation(frame.labels, frame.label_set)


def open_segmenter(config: SegmenterConfig, source_label_set: LabelSet | None) -> TruthSegmenter:
    """Serve the recording's own labels.

    Raises:
        ConfigError: if the recording has none.
    """
    if source_label_set is None:
        raise ConfigError(
            f"segmenter '{config.name}': expected a recording with true labels, got one without; "
            "choose --segmenter auto or colour"
        )
    return TruthSegmenter(source_label_set)
