import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.labels import GRASS_OBSTACLE_PERSON, VOID_ID
from swardmap.train.distil import Opinion, agree
from swardmap.train.score import Score


def opinion(grass: list[float] | None, person: list[float] | None, doubtful: list[bool]) -> Opinion:
    def row(values: list[float] | None) -> NDArray[np.float32] | None:
        return None if values is None else np.array([values], np.float32)

    return Opinion(row(grass), row(person), np.array([doubtful]))


def test_only_agreement_gives_a_class() -> None:
    no = [False] * 5
    a = opinion([0.9, 0.9, 0.0, 0.0, 0.0], [0.0, 0.0, 0.9, 0.0, 0.0], no)
    b = opinion([0.8, 0.3, 0.0, 0.0, 0.0], [0.0, 0.0, 0.8, 0.0, 0.0], [*no[:4], True])
    assert agree([a, b]).tolist() == [[1, VOID_ID, 2, 0, VOID_ID]]


def test_a_person_teacher_speaks_of_persons_alone() -> None:
    both = opinion([0.9, 0.0], [0.9, 0.0], [False, False])
    person = opinion(None, [0.1, 0.0], [False, False])
    assert agree([both, person]).tolist() == [[1, 0]]
    assert agree([person]).tolist() == [[VOID_ID, VOID_ID]]


def test_scores_are_scikit_learns() -> None:
    from sklearn.metrics import accuracy_score, jaccard_score

    rng = np.random.default_rng(0)
    truth, predicted = rng.integers(0, 3, (2, 40, 50)).astype(np.uint8)
    score = Score.empty((0, 1, 2), GRASS_OBSTACLE_PERSON)
    for i in range(0, 40, 10):
        score = score.plus(truth[i : i + 10], predicted[i : i + 10])
    figures = score.figures()
    assert figures["accuracy"] == accuracy_score(truth.ravel(), predicted.ravel())
    for i, name in enumerate(("other", "grass", "person")):
        expected = jaccard_score(truth.ravel(), predicted.ravel(), labels=[i], average="macro")
        assert figures[f"{name}_iou"] == pytest.approx(expected)
    obstacle = truth != 1
    assert figures["obstacle_called_grass"] == pytest.approx(np.mean(predicted[obstacle] == 1))


def test_void_truth_does_not_count_and_void_predictions_do() -> None:
    score = Score.empty((0, 1, 2), GRASS_OBSTACLE_PERSON)
    truth = np.array([[0, 1, VOID_ID, 1]], np.uint8)
    score = score.plus(truth, np.array([[0, VOID_ID, 1, 1]], np.uint8))
    figures = score.figures()
    assert figures["accuracy"] == 2 / 3
    assert figures["grass_iou"] == 1 / 2
    assert figures["person_iou"] is None
    assert Score.empty((0, 1), GRASS_OBSTACLE_PERSON).figures()["accuracy"] is None
