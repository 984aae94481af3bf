"""Which tf of a recording the camera is in: two robots that are recorded together call their frames alike."""

from dataclasses import dataclass
from typing import Any

from swardmap.errors import InputError
from swardmap.io.bags.reader import TF_TYPES, Bag

STATIC = "tf_static"


@dataclass(frozen=True, slots=True)
class TfTopics:
    """One tree of frames.

    Attributes:
        moving: topics with transforms that move.
        static: messages of those that do not.
    """

    moving: frozenset[str]
    static: tuple[Any, ...]


def choose_tf(bag: Bag, wanted: str | None, color_topic: str) -> tuple[frozenset[str], list[str], list[str]]:
    """Topics of the tf in the namespace of a camera.

    Args:
        bag: the recording.
        wanted: the tf topic, if it is named.
        color_topic: of the camera.

    Returns:
        Topics that move, static topics, and the tf topics that are left out.

    Raises:
        InputError: if the topic named is none, or several could be meant.
    """
    names = [t.name for t in bag.topics.values() if t.type in TF_TYPES and t.count]
    moving, static = ([n for n in names if n.endswith(STATIC) is flag] for flag in (False, True))
    if wanted is not None and wanted not in moving:
        raise InputError(
            f"{bag.path}: no tf in topic '{wanted}'; topics with tf: {', '.join(moving) or 'none'}"
        )
    chosen = [wanted] if wanted is not None else _nearest(moving, color_topic)
    if len(chosen) > 1:
        raise InputError(
            f"{bag.path}: which tf is the camera's, that of {' or '.join(chosen)}? Their frames could be "
            "those of two robots. Name one with --set source.tf_topic=..."
        )
    beside = chosen[0] if chosen else color_topic
    still = [n for n in static if _namespace(n) == _namespace(beside)] or _nearest(static, beside)
    if len(still) > 1:
        raise InputError(
            f"{bag.path}: which static tf is the camera's, that of {' or '.join(still)}? Filter the "
            "recording so that one is left."
        )
    return frozenset(chosen), still, sorted(set(names) - set(chosen) - set(still))


def _nearest(topics: list[str], other: str) -> list[str]:
    """Of topics, that in the nearest namespace around another topic; all of them if none is around it."""
    around = [t for t in topics if other.startswith(_namespace(t) + "/")]
    longest = max((len(_namespace(t)) for t in around), default=0)
    return [t for t in around if len(_namespace(t)) == longest] or topics


def _namespace(topic: str) -> str:
    return topic.rpartition("/")[0]
