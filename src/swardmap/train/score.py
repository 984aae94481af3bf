"""Figures of a mask against the truth, from one confusion matrix."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.eval.confusion import confusion_of_masks
from swardmap.labels import LabelSet, Role


@dataclass(frozen=True)
class Score:
    """Counts of pixels, true class by row, predicted class by column (last column: void).

    Attributes:
        counts: (C, C + 1) int64.
        ids: class id of each row.
        label_set: what the ids mean.
    """

    counts: NDArray[np.int64]
    ids: tuple[int, ...]
    label_set: LabelSet

    @classmethod
    def empty(cls, ids: Sequence[int], label_set: LabelSet) -> "Score":
        """Nothing counted yet."""
        return cls(np.zeros((len(ids), len(ids) + 1), np.int64), tuple(ids), label_set)

    def plus(self, truth: NDArray[np.uint8], predicted: NDArray[np.uint8]) -> "Score":
        """With one more image; pixels whose true id is none of `ids` do not count."""
        by_id = {c.id: c for c in self.label_set.classes}
        counted = confusion_of_masks(truth, predicted, LabelSet(tuple(by_id[i] for i in self.ids)))
        return Score(self.counts + np.array(counted.counts, np.int64), self.ids, self.label_set)

    def figures(self) -> Mapping[str, float | None]:
        """Accuracy, IoU and F1 of each class, share of obstacle pixels called grass; None where undefined."""
        square = self.counts[:, :-1]
        right = np.diag(square)
        union = self.counts.sum(1) + square.sum(0) - right
        names = {c.id: c.name for c in self.label_set.classes}
        roles = {c.id: c.role for c in self.label_set.classes}
        figures = {"accuracy": _share(right.sum(), self.counts.sum())}
        for row, class_id in enumerate(self.ids):
            figures[f"{names[class_id]}_iou"] = _share(right[row], union[row])
            figures[f"{names[class_id]}_f1"] = _share(2 * right[row], union[row] + right[row])
        free = np.array([roles[i] is Role.FREE for i in self.ids])
        figures["obstacle_called_grass"] = _share(square[~free][:, free].sum(), self.counts[~free].sum())
        return figures


def _share(part: np.integer, whole: np.integer) -> float | None:
    return float(part) / float(whole) if whole else None
