"""The second round: the network's word counts on open ground alone, near and far alike."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from swardmap.labels import GRASS, GRASS_OBSTACLE_PERSON, OTHER, PERSON, VOID_ID
from swardmap.teach.again import AGAIN, SAID_AGAIN, labels_again, second_recipe
from swardmap.teach.labels import BESIDE, SETTLED, UNSEEN
from swardmap.teach.learn import teach_recipe
from swardmap.teach.plan import LabelConfig, LearnConfig
from swardmap.types import Segmentation

SHAPE = (40, 200)


def says(class_id: int, confidence: float = 0.95) -> Segmentation:
    return Segmentation(
        np.full(SHAPE, class_id, np.uint8), GRASS_OBSTACLE_PERSON, np.full(SHAPE, confidence, np.float32)
    )


def nothing_known() -> np.ndarray:
    return np.full(SHAPE, VOID_ID, np.uint8)


def test_each_cell_of_open_ground_gets_as_many_pixels_near_and_far() -> None:
    open_ground = np.full(SHAPE, 200, np.uint8)
    open_ground[:20] = 4  # far cells hold few
    limits = LabelConfig(cell_pixels=2)
    sure, said = labels_again(nothing_known(), open_ground, nothing_known(), says(GRASS.id), limits, 0)
    assert (sure[:20] == GRASS.id).mean() == pytest.approx(2 / 4, abs=0.03)
    assert (sure[20:] == GRASS.id).mean() == pytest.approx(2 / 200, abs=0.005)
    assert (said == VOID_ID).all()
    again, _ = labels_again(nothing_known(), open_ground, nothing_known(), says(GRASS.id), limits, 0)
    assert np.array_equal(sure, again)


@pytest.mark.parametrize("where", [SETTLED, BESIDE, UNSEEN])
def test_elsewhere_no_ground_becomes_grass(where: int) -> None:
    open_ground = np.full(SHAPE, where, np.uint8)
    sure, said = labels_again(nothing_known(), open_ground, nothing_known(), says(GRASS.id), LabelConfig(), 0)
    assert (sure == VOID_ID).all()
    assert (said == VOID_ID).all()


def test_what_the_drive_says_stays_and_doubt_teaches_nothing() -> None:
    sure = nothing_known()
    sure[:, :50] = OTHER.id
    open_ground = np.where(sure == VOID_ID, np.uint8(1), np.uint8(SETTLED))
    learnt, _ = labels_again(sure, open_ground, nothing_known(), says(GRASS.id), LabelConfig(), 0)
    assert (learnt[:, :50] == OTHER.id).all()
    assert (learnt[:, 50:] == GRASS.id).all()
    learnt, said = labels_again(sure, open_ground, nothing_known(), says(GRASS.id, 0.8), LabelConfig(), 0)
    assert np.array_equal(learnt, sure)
    assert (said == VOID_ID).all()


def test_its_no_grass_counts_and_a_person_on_flat_ground_does_not() -> None:
    open_ground = np.full(SHAPE, 9, np.uint8)
    open_ground[:20] = UNSEEN
    sure, said = labels_again(nothing_known(), open_ground, nothing_known(), says(OTHER.id), LabelConfig(), 0)
    assert (sure == VOID_ID).all()
    assert (said == OTHER.id).all()
    sure, said = labels_again(
        nothing_known(), open_ground, nothing_known(), says(PERSON.id), LabelConfig(), 0
    )
    assert (sure == VOID_ID).all()
    assert (said[:20] == PERSON.id).all()
    assert (said[20:] == VOID_ID).all()


def test_what_was_surely_no_grass_before_does_not_become_grass() -> None:
    """A first round had taken the paths of a campus for lawn; the second would have learnt them as such."""
    open_ground, before = np.full(SHAPE, 3, np.uint8), nothing_known()
    before[:, :80] = OTHER.id
    sure, said = labels_again(nothing_known(), open_ground, before, says(GRASS.id), LabelConfig(), 0)
    assert (sure[:, :80] == VOID_ID).all()
    assert (said == VOID_ID).all()
    assert (sure[:, 80:] == GRASS.id).any()


def test_the_second_round_goes_on_from_the_first_by_its_own_labels() -> None:
    learn = LearnConfig(steps=100, again=0.3)
    first = teach_recipe("my-lawn", Path("lawn.onnx"), "MIT", learn, (), "fp32", 20.0)
    second = second_recipe(first, learn, Path("run/last.pt"), 7.0)
    assert second.schedule.steps == 30
    assert second.start.endswith("run/last.pt")
    assert (second.data[0].labels, second.data[0].pseudo) == (AGAIN, SAID_AGAIN)
    assert second.data[0].free_weight == 7.0
    assert second.data[1:] == first.data[1:]
    assert second.digest != first.digest
