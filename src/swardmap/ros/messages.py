"""What the node publishes, as nested dicts of fields, and messages of rclpy made of them.

The fields are those of the ROS 2 messages; ROS itself is not needed but for `ros_message`. Images and
grids are built as arrays: nothing here loops over pixels or cells.
"""

import importlib
import json
from array import array
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec
from swardmap.io.bags.ros_fields import Fields, header_fields, image_fields
from swardmap.labels import VOID_ID, LabelSet
from swardmap.types import Segmentation

Rectangle = tuple[int, int, int, int]
"""x, y, width, height in cells, as map_msgs/OccupancyGridUpdate counts them."""

OK, WARN, ERROR, STALE = (bytes([level]) for level in range(4))
"""Levels of diagnostic_msgs/DiagnosticStatus."""

FULL_CONFIDENCE = 255


def ros_message(cls: Any, fields: Mapping[str, Any]) -> Any:
    """A message of rclpy from nested dicts; arrays are handed over whole, without a check of each element.

    Args:
        cls: generated message class, such as sensor_msgs.msg.Image.
        fields: all or some of its fields.
    """
    message = cls()
    slots = dict(zip(cls.get_fields_and_field_types(), cls.SLOT_TYPES, strict=True))
    for name, value in fields.items():
        setattr(message, name, _slot_value(slots[name], value))
    return message


def _slot_value(slot: Any, value: Any) -> Any:
    if isinstance(value, Mapping):
        return ros_message(_message_class(slot), value)
    element = getattr(slot, "value_type", None)
    if isinstance(value, np.ndarray) and not hasattr(slot, "size"):
        whole = array(value.dtype.char)
        whole.frombytes(np.ascontiguousarray(value).reshape(-1).view(np.uint8).data)
        return whole
    if isinstance(value, (list, tuple)) and hasattr(element, "namespaces"):
        return [ros_message(_message_class(element), item) for item in value]
    return value


def _message_class(slot: Any) -> Any:
    return getattr(importlib.import_module(".".join(slot.namespaces)), slot.name)


def mask_fields(
    segmentation: Segmentation, size: tuple[int, int], stamp_ns: int, frame_id: str
) -> tuple[Fields, Fields]:
    """Mask and confidence as sensor_msgs/Image mono8 of the size of the colour image.

    Args:
        segmentation: at any size.
        size: (height, width) of the colour image.
        stamp_ns: of the colour image.
        frame_id: its optical frame.

    Returns:
        Class ids, void 255; and 255 x confidence, rounded down, 255 where the segmenter gives none.
        Where the mask is void the confidence is 0.
    """
    resized = segmentation.resized_to(*size)
    sure = np.full(size, FULL_CONFIDENCE, np.uint8)
    if resized.confidence is not None:
        scaled = np.clip(np.nan_to_num(resized.confidence), 0, 1) * np.float32(FULL_CONFIDENCE)
        sure = scaled.astype(np.uint8)
    sure = np.where(resized.labels == VOID_ID, np.uint8(0), sure)
    mask = np.ascontiguousarray(resized.labels)
    return image_fields(mask, stamp_ns, frame_id), image_fields(sure, stamp_ns, frame_id)


def label_info_fields(label_set: LabelSet, stamp_ns: int, frame_id: str) -> Fields:
    """vision_msgs/LabelInfo: the classes of the mask by id and name; 255 is what has no label there."""
    classes = [{"class_id": c.id, "class_name": c.name} for c in label_set.classes if c.id != VOID_ID]
    return {"header": header_fields(stamp_ns, frame_id), "class_map": classes, "threshold": 0.0}


def label_info_json(label_set: LabelSet) -> str:
    """The same as JSON, for a ROS without vision_msgs: id, name and role of each class, void too."""
    return json.dumps([{"class_id": c.id, "class_name": c.name, "role": c.role} for c in label_set.classes])


def changed_rectangle(before: NDArray[Any], after: NDArray[Any]) -> Rectangle | None:
    """Smallest rectangle around all cells that differ; None if none does. Arrays are of one shape."""
    changed = before != after
    columns, rows = np.flatnonzero(changed.any(axis=0)), np.flatnonzero(changed.any(axis=1))
    if len(columns) == 0:
        return None
    x, y = int(columns[0]), int(rows[0])
    return x, y, int(columns[-1]) - x + 1, int(rows[-1]) - y + 1


def joined(first: Rectangle | None, second: Rectangle | None) -> Rectangle | None:
    """Smallest rectangle around two; None is empty."""
    if first is None or second is None:
        return first or second
    x, y = min(first[0], second[0]), min(first[1], second[1])
    right = max(first[0] + first[2], second[0] + second[2])
    top = max(first[1] + first[3], second[1] + second[3])
    return x, y, right - x, top - y


def update_fields(values: NDArray[np.int8], rectangle: Rectangle, spec: GridSpec, stamp_ns: int) -> Fields:
    """map_msgs/OccupancyGridUpdate: a rectangle of a grid (rows, columns) that was published before."""
    x, y, width, height = rectangle
    part = np.ascontiguousarray(values[y : y + height, x : x + width], np.int8)
    return {
        "header": header_fields(stamp_ns, spec.frame_id),
        "x": x, "y": y, "width": width, "height": height, "data": part.reshape(-1),
    }  # fmt: skip


def diagnostic_fields(
    stamp_ns: int, statuses: Sequence[tuple[str, bytes, str, Mapping[str, object]]], hardware_id: str = ""
) -> Fields:
    """diagnostic_msgs/DiagnosticArray of (name, level, message, values)."""
    return {
        "header": header_fields(stamp_ns, ""),
        "status": [
            {
                "level": level, "name": name, "message": text, "hardware_id": hardware_id,
                "values": [{"key": key, "value": str(value)} for key, value in values.items()],
            }
            for name, level, text, values in statuses
        ],
    }  # fmt: skip
