"""Label sets, and the tables between them."""

import pytest

from swardmap.errors import InvalidValueError
from swardmap.labels import (
    GRASS,
    GRASS_OBSTACLE,
    GRASS_OBSTACLE_PERSON,
    OTHER,
    PERSON,
    VOID,
    VOID_ID,
    LabelClass,
    LabelSet,
    MapClass,
    Role,
)


def test_the_papers_ids() -> None:
    ids = {c.name: c.id for c in GRASS_OBSTACLE_PERSON.classes}
    assert ids == {"other": 0, "grass": 1, "person": 2, "void": 255}


def test_only_declared_free_ids_are_grass() -> None:
    table = GRASS_OBSTACLE_PERSON.map_class_table
    assert table[[0, 1, 2, 255]].tolist() == [
        MapClass.OBSTACLE,
        MapClass.GRASS,
        MapClass.PERSON,
        MapClass.UNKNOWN,
    ]
    assert (table[3:255] == MapClass.UNKNOWN).all()
    with pytest.raises(ValueError, match="read-only"):
        table[9] = MapClass.GRASS


def test_remapping_by_name_and_by_role() -> None:
    garden = LabelSet(
        (LabelClass(1, "grass", Role.FREE, (0, 255, 0)), LabelClass(4, "hedge", Role.OBSTACLE, (0, 90, 0)),
         LabelClass(9, "sky", Role.VOID, (0, 0, 255)), LabelClass(3, "human", Role.PERSON, (255, 0, 0)))
    )  # fmt: skip
    table = garden.remap_table(GRASS_OBSTACLE_PERSON)
    assert table[[1, 4, 9, 3, 200]].tolist() == [1, 0, 255, 2, VOID_ID]
    assert (
        garden.remap_table(GRASS_OBSTACLE)[3] == OTHER.id
    )  # a person is an obstacle where no word is better
    assert garden.remap_table(GRASS_OBSTACLE_PERSON, {"hedge": "void"})[4] == VOID_ID
    with pytest.raises(InvalidValueError, match="no class 'bush'"):
        garden.remap_table(GRASS_OBSTACLE_PERSON, {"bush": "other"})
    with pytest.raises(InvalidValueError, match="no class 'obstacle'"):
        garden.remap_table(GRASS_OBSTACLE_PERSON, {"hedge": "obstacle"})


def test_label_sets_are_checked() -> None:
    with pytest.raises(InvalidValueError, match="each id once, got twice: 1"):
        LabelSet((GRASS, LabelClass(1, "lawn", Role.FREE, (0, 0, 0))))
    with pytest.raises(InvalidValueError, match="each name once"):
        LabelSet((GRASS, LabelClass(7, "grass", Role.FREE, (0, 0, 0))))
    with pytest.raises(InvalidValueError, match=r"id in 0\.\.255"):
        LabelClass(256, "x", Role.FREE, (0, 0, 0))
    with pytest.raises(InvalidValueError, match="colour"):
        LabelClass(1, "x", Role.FREE, (0, 0, 300))


def test_look_up_by_name() -> None:
    assert GRASS_OBSTACLE_PERSON["person"] is PERSON
    assert GRASS_OBSTACLE_PERSON.names[-1] == VOID.name
    assert GRASS_OBSTACLE_PERSON.color_table[1].tolist() == list(GRASS.color)
