import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from sklearn import metrics as sk

from swardmap.errors import InvalidValueError
from swardmap.eval.confusion import (
    ConfusionMatrix,
    Share,
    aligned_masks,
    confusion_of_maps,
    confusion_of_masks,
)
from swardmap.labels import (
    GRASS_OBSTACLE,
    GRASS_OBSTACLE_PERSON,
    VOID_ID,
    LabelClass,
    LabelSet,
    MapClass,
    Role,
)
from swardmap.types import Segmentation

Mask = NDArray[np.uint8]

shapes = hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=40)
ids = st.sampled_from([0, 1, 2, VOID_ID])


@st.composite
def mask_pairs(draw: st.DrawFn) -> tuple[Mask, Mask]:
    shape = draw(shapes)
    r, p = (draw(hnp.arrays(np.uint8, shape, elements=ids, fill=ids)) for _ in range(2))
    return r, p


@st.composite
def map_pairs(draw: st.DrawFn) -> tuple[Mask, Mask]:
    shape = draw(shapes)
    cells = st.integers(0, 3)
    r, p = (draw(hnp.arrays(np.uint8, shape, elements=cells, fill=cells)) for _ in range(2))
    return r, p


def same(ours: float | None, theirs: float) -> bool:
    return math.isnan(theirs) if ours is None else math.isclose(ours, theirs, rel_tol=1e-12, abs_tol=0)


@given(map_pairs())
@settings(deadline=None)
def test_every_score_of_a_map_is_scikit_learns(pair: tuple[Mask, Mask]) -> None:
    truth, called = pair[0].ravel(), pair[1].ravel()
    matrix = confusion_of_maps(*pair)
    labels = [int(c) for c in MapClass]
    expected = sk.confusion_matrix(truth, called, labels=labels)
    assert np.array_equal(np.array(matrix.counts)[:, :4], expected)
    assert same(matrix.accuracy, sk.accuracy_score(truth, called))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        precision, recall, f1, support = sk.precision_recall_fscore_support(
            truth, called, labels=labels, zero_division=np.nan
        )
        iou = sk.jaccard_score(truth, called, labels=labels, average=None, zero_division=0)
    for c in labels:
        scores = matrix.all_scores()[c]
        assert scores.support == support[c]
        assert same(scores.precision, precision[c])
        assert same(scores.recall, recall[c])
        tn, fp, fn, tp = sk.confusion_matrix(truth == c, called == c, labels=[False, True]).ravel()
        assert same(scores.accuracy, (tp + tn) / truth.size)
        assert same(scores.specificity, tn / (tn + fp) if tn + fp else math.nan)
        if scores.support:
            assert same(scores.f1, f1[c])
            assert same(scores.iou, iou[c])
        else:
            assert scores.f1 is None
            assert scores.iou is None
            assert scores.predicted == fp + tp
            assert fn == 0


@given(mask_pairs())
@settings(deadline=None)
def test_void_in_the_reference_never_counts_and_void_in_the_prediction_is_no_hit(
    pair: tuple[Mask, Mask],
) -> None:
    truth, called = (a.ravel() for a in pair)
    matrix = confusion_of_masks(*pair, GRASS_OBSTACLE_PERSON)
    known = truth != VOID_ID
    assert matrix.total == known.sum()
    expected = sk.confusion_matrix(
        np.append(truth[known], [0, 1, 2, 255]), np.append(called[known], [0, 1, 2, 255])
    ) - np.eye(4, dtype=int)
    assert np.array_equal(np.array(matrix.counts), expected[:3])
    hazard = known & (truth != 1)
    assert matrix.obstacle_called_free == Share(int((hazard & (called == 1)).sum()), int(hazard.sum()))
    assert matrix.obstacle_not_seen.count == (hazard & (called == VOID_ID)).sum()
    persons = truth == 2
    assert matrix.person_called_free == Share(int((persons & (called == 1)).sum()), int(persons.sum()))


@given(st.lists(mask_pairs(), min_size=1, max_size=5), st.randoms())
@settings(deadline=None)
def test_matrices_merge_in_any_order_to_the_matrix_of_all(
    pairs: list[tuple[Mask, Mask]], random: object
) -> None:
    parts = [confusion_of_masks(r, p, GRASS_OBSTACLE_PERSON) for r, p in pairs]
    whole = confusion_of_masks(
        np.concatenate([r.ravel() for r, _ in pairs])[None],
        np.concatenate([p.ravel() for _, p in pairs])[None],
        GRASS_OBSTACLE_PERSON,
    )
    random.shuffle(parts)  # type: ignore[attr-defined]
    empty = ConfusionMatrix.empty(whole.names, whole.roles)
    assert sum(parts, empty) == whole
    assert sum(parts[1:], parts[0]) == whole


def test_ids_above_seven_are_counted_too() -> None:
    many = LabelSet(tuple(LabelClass(i, f"c{i}", Role.OBSTACLE, (0, 0, 0)) for i in (3, 7, 9, 200)))
    rng = np.random.default_rng(1)
    truth, called = rng.choice([3, 7, 8, 9, 200, 255], (2, 50, 60)).astype(np.uint8)
    matrix = confusion_of_masks(truth, called, many)
    for i, a in enumerate((3, 7, 9, 200)):
        for j, b in enumerate((3, 7, 9, 200)):
            assert matrix.counts[i][j] == ((truth == a) & (called == b)).sum()
        assert matrix.counts[i][4] == ((truth == a) & np.isin(called, [8, 255])).sum()


def test_undefined_is_none_with_a_count() -> None:
    nothing = np.full((3, 3), MapClass.UNKNOWN, np.uint8)
    matrix = confusion_of_maps(nothing, nothing)
    person = matrix.scores("person")
    assert (person.recall, person.precision, person.f1, person.iou) == (None, None, None, None)
    assert (person.support, person.predicted) == (0, 0)
    assert person.specificity == 1
    assert matrix.scores("unknown").specificity is None
    assert matrix.person_called_free.value is None
    assert ConfusionMatrix.empty(matrix.names, matrix.roles).accuracy is None


def test_joined_classes_are_those_of_joined_arrays() -> None:
    rng = np.random.default_rng(2)
    truth, called = rng.integers(0, 4, (2, 40, 40)).astype(np.uint8)
    joined = confusion_of_maps(truth, called).merged(
        {"unknown": ["unknown"], "obstacle": ["obstacle", "person"], "grass": ["grass"]}
    )
    again = confusion_of_maps(np.minimum(truth, 2), np.minimum(called, 2))
    for name in joined.names:
        assert joined.scores(name) == again.scores(name)
    with pytest.raises(InvalidValueError, match="every class"):
        joined.merged({"all": ["unknown", "grass"]})


def test_a_truth_of_three_classes_meets_a_model_of_two() -> None:
    truth = np.array([[0, 1, 2, 255]], np.uint8)
    mask = Segmentation(np.array([[0, 1]], np.uint8), GRASS_OBSTACLE)
    reference, predicted = aligned_masks(truth, GRASS_OBSTACLE_PERSON, mask)
    assert reference.tolist() == [[0, 1, 0, 255]]
    assert predicted.tolist() == [[0, 0, 1, 1]]


def test_plain_form_round_trips_and_wrong_input_is_refused() -> None:
    matrix = confusion_of_maps(np.zeros((2, 2), np.uint8), np.ones((2, 2), np.uint8))
    assert ConfusionMatrix.from_dict(matrix.to_dict()) == matrix
    with pytest.raises(InvalidValueError, match="one shape"):
        confusion_of_maps(np.zeros((2, 2), np.uint8), np.ones((2, 3), np.uint8))
    with pytest.raises(InvalidValueError, match="below 4"):
        confusion_of_maps(np.zeros((2, 2), np.uint8), np.full((2, 2), 4, np.uint8))
    with pytest.raises(InvalidValueError, match="expected 2 x 3 counts"):
        ConfusionMatrix(("a", "b"), (Role.FREE, Role.OBSTACLE), ((1, 2),))
    other = ConfusionMatrix.empty(("a",), (Role.FREE,))
    with pytest.raises(InvalidValueError, match="cannot add"):
        _ = matrix + other
