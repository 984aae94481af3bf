"""What a network file says about itself: preprocessing, classes, activation, origin.

It travels inside the .onnx file as one JSON text under the metadata key `swardmap`.
"""

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from swardmap.errors import InvalidValueError, ModelError
from swardmap.io.door import parse_json, reading
from swardmap.labels import LabelClass, LabelSet

METADATA_KEY = "swardmap"
METADATA_VERSION = 1
ACTIVATIONS = ("softmax", "sigmoid")
COLOUR_ORDERS = ("rgb", "bgr")
SHAPE = {
    "version": int, "name": str, "width": int, "height": int, "channel_ids": [int],
    "mean": [float], "std": [float], "label_set": [{"id": int, "name": str, "color": [int]}],
    "temperature?": float, "licence?": str, "training?": {}, "metrics?": {},
}  # fmt: skip
"""Of the JSON; see `door.parse_json`."""

UNFAMILIAR = "unfamiliar"
"""Output of a network, one float32 of 0 or more: how unlike the images that it knows the image is."""


@dataclass(frozen=True)
class NetworkSpec:
    """All that is needed to run a network and to say where it comes from.

    Attributes:
        name: of the network, such as `deeplabv3plus-efficientnet-lite0`.
        width, height: of the input in pixels; frames are stretched to it.
        mean, std: of each channel, in the scale 0..1, in the order of `colour_order`.
        colour_order: `rgb` or `bgr`.
        label_set: classes of the mask.
        channel_ids: class id of each output channel. With a sigmoid the network has one channel, the
            probability of the second id against the first.
        activation: `softmax` or `sigmoid`.
        temperature: logits are divided by it, so that the probability is the share that is right.
        unfamiliar_limit: largest value of the output `unfamiliar` that images it knows have; None = the
            network has no such output.
        licence: of the file and of what it was made from.
        training: what it was trained on and how (free form, JSON).
        metrics: figures measured for it (free form, JSON).
    """

    name: str
    width: int
    height: int
    label_set: LabelSet
    channel_ids: tuple[int, ...]
    mean: tuple[float, float, float] = (0.485, 0.456, 0.406)
    std: tuple[float, float, float] = (0.229, 0.224, 0.225)
    colour_order: str = "rgb"
    activation: str = "softmax"
    temperature: float = 1.0
    unfamiliar_limit: float | None = None
    licence: str = ""
    training: Mapping[str, Any] = field(default_factory=dict)
    metrics: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        who = f"network {self.name}"
        declared = {c.id for c in self.label_set.classes}
        checks = {
            f"a size of 8..4096 pixels, got {self.width} x {self.height}": all(
                8 <= n <= 4096 for n in (self.width, self.height)
            ),
            f"channel ids of the label set, each once, got {self.channel_ids}": (
                len(set(self.channel_ids)) == len(self.channel_ids) >= 2 and set(self.channel_ids) <= declared
            ),
            f"three finite means, got {self.mean}": len(self.mean) == 3
            and all(map(math.isfinite, self.mean)),
            f"three positive deviations, got {self.std}": (
                len(self.std) == 3 and all(s > 0 and math.isfinite(s) for s in self.std)
            ),
            f"colour order rgb or bgr, got '{self.colour_order}'": self.colour_order in COLOUR_ORDERS,
            f"activation softmax or sigmoid, got '{self.activation}'": self.activation in ACTIVATIONS,
            f"two classes with a sigmoid, got {len(self.channel_ids)}": (
                self.activation != "sigmoid" or len(self.channel_ids) == 2
            ),
            f"a positive temperature, got {self.temperature}": 0 < self.temperature < math.inf,
            f"a positive unfamiliar_limit or none, got {self.unfamiliar_limit}": (
                self.unfamiliar_limit is None or 0 < self.unfamiliar_limit < math.inf
            ),
        }
        for expected, holds in checks.items():
            if not holds:
                raise InvalidValueError(f"{who}: expected {expected}")

    @property
    def channels(self) -> int:
        """Number of output channels."""
        return 1 if self.activation == "sigmoid" else len(self.channel_ids)

    def to_json(self) -> str:
        """The metadata text."""
        tree = dataclasses.asdict(self)
        tree["label_set"] = [dataclasses.asdict(c) for c in self.label_set.classes]
        if self.unfamiliar_limit is None:
            del tree["unfamiliar_limit"]  # such a file can be read by every release
        return json.dumps({"version": METADATA_VERSION, **tree}, sort_keys=True, allow_nan=False)

    @classmethod
    def from_json(cls, text: str, where: str) -> "NetworkSpec":
        """Read the metadata text.

        Args:
            text: as `to_json` gives it.
            where: file named in errors.

        Raises:
            ModelError: for text that is not such metadata, or of a version this swardmap does not know.
        """
        with reading(where, "swardmap metadata that hold together", ModelError):
            tree = parse_json(text, "metadata", {"version": int})
            version = tree.pop("version")
            if version != METADATA_VERSION:
                raise ModelError(
                    f"{where}: expected metadata version {METADATA_VERSION}, got {version!r}; "
                    "export it again with this swardmap"
                )
            parse_json(text, "metadata", SHAPE)
            tree["label_set"] = LabelSet(tuple(_label_class(c) for c in tree["label_set"]))
            tree["channel_ids"] = tuple(int(i) for i in tree["channel_ids"])
            for key in ("mean", "std"):
                tree[key] = tuple(float(v) for v in tree[key])
            return cls(**tree)


def _label_class(tree: Mapping[str, Any]) -> LabelClass:
    return LabelClass(**{**tree, "color": tuple(tree["color"])})
