"""Confusion matrices of masks and maps, and every score that follows from them (Tables 2-6, 8, 9)."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.labels import LabelSet, MapClass, Role
from swardmap.types import Segmentation

HAZARDS = (Role.OBSTACLE, Role.PERSON)


@dataclass(frozen=True, slots=True)
class Share:
    """A share with its count, which stays undefined where there is nothing to have a share of."""

    count: int
    of: int

    @property
    def value(self) -> float | None:
        """Count over `of`, or None if `of` is 0."""
        return self.count / self.of if self.of else None


@dataclass(frozen=True, slots=True)
class ClassScores:
    """Scores of one class against all others (one-vs-rest), as in Tables 2-6, 8 and 9.

    A score that cannot be formed is None: recall, F1 and IoU of a class the reference never shows,
    precision of a class that was never predicted, specificity where there is no other class.

    Attributes:
        name: of the class.
        support: pixels or cells of it in the reference.
        predicted: pixels or cells called so.
        accuracy, f1, precision, recall, specificity, iou: 0..1.
    """

    name: str
    support: int
    predicted: int
    accuracy: float | None
    f1: float | None
    precision: float | None
    recall: float | None
    specificity: float | None
    iou: float | None


@dataclass(frozen=True, slots=True)
class ConfusionMatrix:
    """Counts of (reference class, predicted class). Matrices add up in any order, without rounding.

    Void never counts: a pixel whose reference is void is in no row. A pixel predicted void, where the
    reference knows better, is in the last column: missed by its class, and called nothing.

    Attributes:
        names: of the classes, in the order of rows and columns.
        roles: of the classes.
        counts: rows = reference, columns = predicted, the last column = predicted void.

    >>> from swardmap.labels import GRASS_OBSTACLE
    >>> mask = np.array([0, 0, 1, 1, 255], np.uint8)
    >>> matrix = confusion_of_masks(mask, np.array([0, 1, 1, 1, 1], np.uint8), GRASS_OBSTACLE)
    >>> matrix.counts
    ((1, 1, 0), (0, 2, 0))
    >>> matrix.scores("other").recall, matrix.obstacle_called_free
    (0.5, Share(count=1, of=2))
    """

    names: tuple[str, ...]
    roles: tuple[Role, ...]
    counts: tuple[tuple[int, ...], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "counts", tuple(tuple(int(n) for n in row) for row in self.counts))
        k = len(self.names)
        if len(self.roles) != k or len(self.counts) != k or any(len(row) != k + 1 for row in self.counts):
            shape = (len(self.counts), {len(row) for row in self.counts})
            raise InvalidValueError(
                f"confusion matrix: expected {k} x {k + 1} counts for {self.names}, got {shape}"
            )

    @classmethod
    def empty(cls, names: tuple[str, ...], roles: tuple[Role, ...]) -> "ConfusionMatrix":
        """A matrix that has counted nothing."""
        return cls(names, roles, ((0,) * (len(names) + 1),) * len(names))

    def __add__(self, other: "ConfusionMatrix") -> "ConfusionMatrix":
        if (self.names, self.roles) != (other.names, other.roles):
            raise InvalidValueError(f"cannot add confusion matrices of {self.names} and {other.names}")
        rows = zip(self.counts, other.counts, strict=True)
        return ConfusionMatrix(
            self.names, self.roles, tuple(tuple(a + b for a, b in zip(r, s, strict=True)) for r, s in rows)
        )

    @property
    def total(self) -> int:
        """Pixels or cells counted."""
        return sum(map(sum, self.counts))

    @property
    def accuracy(self) -> float | None:
        """Overall accuracy: share of all pixels or cells called what they are."""
        right = sum(self.counts[i][i] for i in range(len(self.names)))
        return Share(right, self.total).value

    def scores(self, name: str) -> ClassScores:
        """Scores of one class against the rest."""
        i = self._index(name)
        tp = self.counts[i][i]
        support, predicted = sum(self.counts[i]), sum(row[i] for row in self.counts)
        fn, fp = support - tp, predicted - tp
        tn = self.total - tp - fn - fp
        return ClassScores(
            name=name,
            support=support,
            predicted=predicted,
            accuracy=Share(tp + tn, self.total).value,
            f1=Share(2 * tp, 2 * tp + fp + fn).value if support else None,
            precision=Share(tp, predicted).value,
            recall=Share(tp, support).value,
            specificity=Share(tn, tn + fp).value,
            iou=Share(tp, tp + fp + fn).value if support else None,
        )

    def all_scores(self) -> tuple[ClassScores, ...]:
        """Scores of every class, in order."""
        return tuple(self.scores(name) for name in self.names)

    def share(self, reference: Iterable[Role], predicted: Iterable[Role]) -> Share:
        """How much of what is `reference` was called `predicted`; predicted void is Role.VOID."""
        wanted, called = frozenset(reference), frozenset(predicted)
        columns = [j for j, role in enumerate((*self.roles, Role.VOID)) if role in called]
        rows = [row for row, role in zip(self.counts, self.roles, strict=True) if role in wanted]
        return Share(sum(row[j] for row in rows for j in columns), sum(map(sum, rows)))

    @property
    def obstacle_called_free(self) -> Share:
        """The unsafe error: obstacle, person included, called free."""
        return self.share(HAZARDS, (Role.FREE,))

    @property
    def person_called_free(self) -> Share:
        """The worst error: person called free."""
        return self.share((Role.PERSON,), (Role.FREE,))

    @property
    def free_called_obstacle(self) -> Share:
        """The costly error: free ground that will not be mown."""
        return self.share((Role.FREE,), HAZARDS)

    @property
    def obstacle_not_seen(self) -> Share:
        """Obstacle, person included, of which nothing is said: unknown cells, void pixels."""
        return self.share(HAZARDS, (Role.VOID,))

    def merged(self, groups: Mapping[str, Iterable[str]]) -> "ConfusionMatrix":
        """The same counts with classes joined, such as obstacle and person in Tables 6, 8 and 9.

        Args:
            groups: new name -> names here; the role is that of the first. Every class goes somewhere.
        """
        index = [[self._index(name) for name in members] for members in groups.values()]
        if sorted(i for members in index for i in members) != list(range(len(self.names))):
            raise InvalidValueError(f"expected every class of {self.names} once, got {dict(groups)}")
        columns = [*index, [len(self.names)]]
        counts = tuple(
            tuple(sum(self.counts[i][j] for i in rows for j in column) for column in columns)
            for rows in index
        )
        return ConfusionMatrix(tuple(groups), tuple(self.roles[members[0]] for members in index), counts)

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and strings."""
        return {"names": list(self.names), "roles": list(self.roles), "counts": [*map(list, self.counts)]}

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any]) -> "ConfusionMatrix":
        """What `to_dict` gave."""
        roles = tuple(Role(role) for role in plain["roles"])
        return cls(tuple(plain["names"]), roles, tuple(map(tuple, plain["counts"])))

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise InvalidValueError(f"no class '{name}' in the matrix; it has: {', '.join(self.names)}")
        return self.names.index(name)


MAP_NAMES = tuple(c.name.lower() for c in MapClass)
MAP_ROLES = (Role.VOID, Role.FREE, Role.OBSTACLE, Role.PERSON)


def confusion_of_maps(reference: NDArray[np.uint8], predicted: NDArray[np.uint8]) -> ConfusionMatrix:
    """Compare two maps cell by cell; unknown is a class like any other, as in Table 6.

    Args:
        reference: (height, width) uint8 MapClass, the truth.
        predicted: the same, what is to be judged.
    """
    counts = _pair_counts(reference, predicted, max(MapClass))
    if counts[len(MapClass) :].any() or counts[:, len(MapClass) :].any():
        raise InvalidValueError(f"maps: expected classes below {len(MapClass)}, got others")
    n = len(MapClass)
    return ConfusionMatrix(MAP_NAMES, MAP_ROLES, tuple((*row[:n], 0) for row in counts[:n].tolist()))


def confusion_of_masks(
    reference: NDArray[np.uint8], predicted: NDArray[np.uint8], label_set: LabelSet
) -> ConfusionMatrix:
    """Compare two masks pixel by pixel.

    Args:
        reference: (H, W) uint8 ids of `label_set`; ids it does not declare count as void.
        predicted: the same, what is to be judged.
        label_set: classes of both; see `aligned_masks` where they differ.
    """
    classes = [c for c in label_set.classes if c.role is not Role.VOID]
    ids = [c.id for c in classes]
    counts = _pair_counts(reference, predicted, max(ids, default=0))
    rows = [counts[i] for i in ids]
    table = tuple((*(int(row[j]) for j in ids), int(row.sum() - row[ids].sum())) for row in rows)
    return ConfusionMatrix(tuple(c.name for c in classes), tuple(c.role for c in classes), table)


def aligned_masks(
    reference: NDArray[np.uint8], reference_set: LabelSet, segmentation: Segmentation
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A true mask and a predicted one, both in the classes of the segmenter and at the size of the truth.

    Args:
        reference: (H, W) uint8 ids of `reference_set`.
        reference_set: classes of the truth, joined by role where the segmenter knows fewer.
        segmentation: of the same image, at any size.
    """
    target = segmentation.label_set
    truth = reference if reference_set == target else reference_set.remap_table(target)[reference]
    return truth, segmentation.resized_to(*reference.shape).labels


def _pair_counts(
    reference: NDArray[np.uint8], predicted: NDArray[np.uint8], highest_id: int
) -> NDArray[np.int64]:
    """(n, n) int64 counts of pairs of ids; the last row and column hold every id above `highest_id`."""
    if reference.shape != predicted.shape or {reference.dtype, predicted.dtype} != {np.dtype(np.uint8)}:
        raise InvalidValueError(
            f"expected two uint8 arrays of one shape, got {reference.dtype} {reference.shape} "
            f"and {predicted.dtype} {predicted.shape}"
        )
    from swardmap.kernels import metrics as kernel

    r, p = np.ascontiguousarray(reference).ravel(), np.ascontiguousarray(predicted).ravel()
    if highest_id >= kernel.CODES - 1:
        return np.bincount(r.astype(np.int64) * 256 + p, minlength=256 * 256).reshape(256, 256)
    counts = np.empty((kernel.CODES, kernel.CODES), np.int64)
    kernel.count_pairs(r, p, counts)
    return counts
