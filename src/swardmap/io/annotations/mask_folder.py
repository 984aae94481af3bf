"""A folder of masks: NAME.png with class ids, and classes.yaml that says what they mean."""

from pathlib import Path

import numpy as np

from swardmap.io.annotations.masks import Masks
from swardmap.io.files import inside, write_bytes, write_text
from swardmap.io.folders import new_output_folder
from swardmap.labels import LabelSet


def write_masks(masks: Masks, folder: str | Path, overwrite: bool = False) -> dict[str, int]:
    """Write masks as 8-bit PNG of class ids, one read at a time, and their classes.

    Args:
        masks: what to write.
        folder: must not exist, or be empty, or be one of ours with `overwrite`.
        overwrite: replace a folder that swardmap made.

    Returns:
        Number of pixels of each class, in all masks.

    Raises:
        InputError: if a mask cannot be read; OutputError: if the folder cannot be written.
    """
    import cv2

    counts = np.zeros(256, np.int64)
    with new_output_folder(folder, overwrite, "masks") as out:
        for name, mask in masks.items():
            encoded = cv2.imencode(".png", mask)[1].tobytes()
            write_bytes(inside(out, f"{name}.png"), encoded, durable=False)
            counts += np.bincount(mask.ravel(), minlength=256)
        write_text(out / "classes.yaml", classes_text(masks.label_set))
    return {c.name: int(counts[c.id]) for c in masks.label_set.classes}


def classes_text(label_set: LabelSet) -> str:
    """A label set as YAML: one class an entry, with id, name, role and colour."""
    import yaml

    entries = [
        {"id": c.id, "name": c.name, "role": c.role.value, "color": list(c.color)} for c in label_set.classes
    ]
    return yaml.safe_dump({"classes": entries}, sort_keys=False, default_flow_style=None)
