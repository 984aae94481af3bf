"""True labels that `swardmap record` wrote beside the images, back at the frames they belong to."""

import json
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.bags.reader import Bag
from swardmap.io.bags.ros_messages import image_array
from swardmap.io.door import reading
from swardmap.labels import LabelClass, LabelSet

IMAGES, CLASSES = "/labels/image_raw", "/labels/classes"
WAITING = 300
"""Labels that are kept for frames that are yet to come."""


@dataclass(frozen=True, slots=True)
class LabelTopic:
    """A topic with masks of ids, and what they mean."""

    name: str
    label_set: LabelSet


def find_labels(bag: Bag) -> LabelTopic | None:
    """The labels of a recording, if it has some.

    Raises:
        InputError: if their classes cannot be read.
    """
    for name, topic in bag.topics.items():
        classes = name.removesuffix(IMAGES) + CLASSES
        if name.endswith(IMAGES) and topic.type == "sensor_msgs/msg/Image" and classes in bag.topics:
            text = next((message.data for message in bag.beginning(classes, 1)), "")
            return LabelTopic(name, _label_set(text, f"{bag.path}: {classes}"))
    return None


def _label_set(text: str, who: str) -> LabelSet:
    with reading(who, "classes in JSON, with id, name, role and color"):
        found = [LabelClass(**{**c, "color": tuple(c["color"])}) for c in json.loads(text)]
        return LabelSet(tuple(found))


@dataclass(slots=True)
class LabelStore:
    """Masks by the time of their images; the oldest is dropped where too many wait."""

    _waiting: dict[int, bytes] = field(default_factory=dict)

    def add(self, stamp_ns: int, data: bytes) -> None:
        """Keep a message."""
        self._waiting[stamp_ns] = data
        if len(self._waiting) > WAITING:
            del self._waiting[next(iter(self._waiting))]

    def take(self, bag: Bag, topic: LabelTopic, stamp_ns: int) -> NDArray[np.uint8] | None:
        """(H, W) uint8 ids of the image of a time; None if it has none.

        Raises:
            InputError: if they cannot be decoded.
        """
        data = self._waiting.pop(stamp_ns, None)
        if data is None:
            return None
        mask = image_array(bag.decode(topic.name, data))
        if mask.dtype != np.uint8 or mask.ndim != 2:
            raise InputError(f"{topic.name}: expected one number of 8 bits a pixel, got {mask.dtype}")
        return np.asarray(mask, np.uint8)
