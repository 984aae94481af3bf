"""A network's own classes: read from a recipe's text, and what masks and partial labels then mean."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.errors import ConfigError
from swardmap.labels import VOID_ID
from swardmap.train.classes import PAPER_SETS, classes_text, read_classes
from swardmap.train.data import load_photos, make_codes
from swardmap.train.photos import PARTIAL_CODE, Photo
from swardmap.train.recipe import recipe_from_dict

MakeRecipe = Callable[..., dict[str, Any]]


def one_photo(root: Path, recipe: dict[str, Any]) -> Photo:
    return load_photos(recipe_from_dict(recipe), root, validation=False)[0].photos[0]


OWN = "other=obstacle,grass=free,person=person,mole_hill=obstacle,path=free"


def test_own_classes_are_those_of_the_masks(data_root: Path, tiny_recipe: MakeRecipe) -> None:
    plain, own = tiny_recipe(), tiny_recipe(classes=OWN)
    network = recipe_from_dict(own).network
    assert network.trained_ids == (0, 1, 2, 3, 4)
    assert [c.name for c in network.label_set.classes] == [
        "other", "grass", "person", "mole_hill", "path", "void",
    ]  # fmt: skip
    colors = network.label_set.color_table[:5]
    assert len(np.unique(colors, axis=0)) == 5
    assert (network.label_set.map_class_table[:5] == [2, 1, 3, 2, 1]).all()
    codes = one_photo(data_root, plain).codes
    np.testing.assert_array_equal(one_photo(data_root, own).codes, codes)
    own["data"][0]["ids"] = "0=mole_hill,1=path"  # others void
    expected = np.choose(np.minimum(codes, 2), [3, 4, VOID_ID])
    np.testing.assert_array_equal(one_photo(data_root, own).codes, expected)
    meant = make_codes(recipe_from_dict(own | {"data": [own["data"][0] | {"void_means": "path,mole_hill"}]}))
    np.testing.assert_array_equal(meant.sets[PARTIAL_CODE], [0, 0, 0, 1, 1])


@given(st.lists(st.tuples(st.sampled_from("abcdefgh"), st.sampled_from(["free", "obstacle", "person"]))))
def test_classes_come_back_from_their_text_or_are_refused(pairs: list[tuple[str, str]]) -> None:
    text = ",".join(f"{name}={role}" for name, role in pairs)
    roles = [role for _, role in pairs]
    if len(dict(pairs)) == len(pairs) and {"free", "obstacle"} <= set(roles):
        classes = read_classes(text)
        assert classes_text(classes) == text
        assert [(c.name, str(c.role)) for c in classes.classes[:-1]] == pairs
    else:
        with pytest.raises(ConfigError, match="other=obstacle,grass=free"):
            read_classes(text)


@pytest.mark.parametrize(
    "text",
    ["", "grass", "grass=lawn,other=obstacle", "void=free,other=obstacle", "Grass=free,other=obstacle"],
)
def test_what_are_no_classes_is_said(text: str, tiny_recipe: MakeRecipe) -> None:
    with pytest.raises(ConfigError, match="other=obstacle,grass=free"):
        recipe_from_dict(tiny_recipe(classes=text))


def test_the_papers_sets_have_names() -> None:
    for name, known in PAPER_SETS.items():
        assert read_classes(name) == known
        assert classes_text(known) == name
