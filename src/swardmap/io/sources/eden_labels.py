"""What the ids of EDEN's segmentation mean: a table that can be replaced by a YAML file.

    1: {name: grass, role: free, color: [104, 180, 84]}
    7: {name: obstacle, role: obstacle}
    camera: {width: 640, height: 480, fx: 640, fy: 640, cx: 320, cy: 240}

`camera` is optional: it stands in for camera matrices that are missing. A file with nothing but
`camera` keeps the default classes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swardmap.errors import InputError
from swardmap.geometry import Intrinsics
from swardmap.io.door import parse_yaml, reading, through_door
from swardmap.io.files import read_bytes
from swardmap.labels import LabelClass, LabelSet, Role

TRIMBOT = LabelSet(
    (
        LabelClass(0, "unknown", Role.VOID, (60, 60, 60)),
        LabelClass(1, "grass", Role.FREE, (104, 180, 84)),
        LabelClass(2, "ground", Role.OBSTACLE, (150, 116, 82)),
        LabelClass(3, "pavement", Role.OBSTACLE, (168, 164, 158)),
        LabelClass(4, "hedge", Role.OBSTACLE, (38, 96, 70)),
        LabelClass(5, "topiary", Role.OBSTACLE, (72, 140, 120)),
        LabelClass(6, "rose", Role.OBSTACLE, (206, 84, 118)),
        LabelClass(7, "obstacle", Role.OBSTACLE, (66, 103, 178)),
        LabelClass(8, "tree", Role.OBSTACLE, (112, 82, 150)),
        LabelClass(9, "background", Role.VOID, (190, 206, 220)),
    )
)
"""Ids of the TrimBot gardens, by the same authors. EDEN's own table is not published with the data."""

COLORS = tuple(c.color for c in TRIMBOT.classes[1:9])
CAMERA_KEYS = ("width", "height", "fx", "fy", "cx", "cy")
MAX_FILE_BYTES = 2**20


@dataclass(frozen=True, slots=True)
class LabelTable:
    """What a label table says.

    Attributes:
        label_set: classes of the ids; an id that is not declared is void.
        camera: intrinsics of frames without a camera matrix; None = there must be one.
    """

    label_set: LabelSet = TRIMBOT
    camera: Intrinsics | None = None


@through_door("a table of labels")
def read_label_table(file: Path) -> LabelTable:
    """Read a label table.

    Raises:
        InputError: if it cannot be read, or declares a class or camera that cannot be.
    """
    tree = parse_yaml(read_bytes(file, MAX_FILE_BYTES), file)
    if not isinstance(tree, dict) or not tree:
        raise InputError(
            f"{file}: expected lines like '1: {{name: grass, role: free}}', got {type(tree).__name__}"
        )
    camera = tree.pop("camera", None)
    with reading(file, "a table of labels"):
        classes = tuple(_class(key, value) for key, value in tree.items())
        return LabelTable(LabelSet(classes) if classes else TRIMBOT, _camera(camera))


def label_table_yaml(label_set: LabelSet) -> str:
    """A label table as text, as `read_label_table` takes it."""
    import yaml

    tree = {c.id: {"name": c.name, "role": str(c.role), "color": list(c.color)} for c in label_set.classes}
    return yaml.safe_dump(tree, sort_keys=False, default_flow_style=None)


def _class(key: object, value: Any) -> LabelClass:
    if not isinstance(key, int) or isinstance(key, bool):
        raise ValueError(f"expected an id (a whole number) or 'camera' as key, got {key!r}")
    known = {"name", "role", "color"}
    if not isinstance(value, Mapping) or not {"name", "role"} <= set(value) or set(value) - known:
        raise ValueError(f"id {key}: expected name, role and perhaps color, got {value!r}")
    roles = [str(role) for role in Role]
    if value["role"] not in roles:
        raise ValueError(f"id {key}: expected a role of {', '.join(roles)}, got {value['role']!r}")
    red, green, blue = (int(c) for c in value.get("color", COLORS[key % len(COLORS)]))
    return LabelClass(key, str(value["name"]), Role(value["role"]), (red, green, blue))


def _camera(tree: Any) -> Intrinsics | None:
    if tree is None:
        return None
    if not isinstance(tree, Mapping) or set(tree) != set(CAMERA_KEYS):
        raise ValueError(f"camera: expected {', '.join(CAMERA_KEYS)}, got {tree!r}")
    size = [int(tree[key]) for key in CAMERA_KEYS[:2]]
    return Intrinsics(*size, *(float(tree[key]) for key in CAMERA_KEYS[2:])).centered()
