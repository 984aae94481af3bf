from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn import functional as F  # noqa: N812 - torch's own name for it

from swardmap.train.data import make_codes
from swardmap.train.loss import set_loss
from swardmap.train.photos import FREE_CODE, OBSTACLE_CODE, PARTIAL_CODE, PSEUDO_CODE, SMALL_CODE
from swardmap.train.recipe import recipe_from_dict

MakeRecipe = Callable[..., dict[str, Any]]


def codes_of(tiny_recipe: MakeRecipe, **network: object) -> Any:
    tree = tiny_recipe(**network)
    tree["data"][0]["void_means"] = "other,grass"
    tree["schedule"]["person_weight"] = 1.0
    return make_codes(recipe_from_dict(tree))


def test_known_pixels_cost_their_cross_entropy(tiny_recipe: MakeRecipe) -> None:
    logits, target = torch.randn(2, 3, 5, 7), torch.randint(0, 3, (2, 5, 7))
    ours = set_loss(logits, target.to(torch.uint8), codes_of(tiny_recipe))
    torch.testing.assert_close(ours, F.cross_entropy(logits, target))


def test_a_teachers_word_counts_as_a_class(tiny_recipe: MakeRecipe) -> None:
    logits, target = torch.randn(1, 3, 4, 4), torch.randint(0, 3, (1, 4, 4))
    ours = set_loss(logits, (target + PSEUDO_CODE).to(torch.uint8), codes_of(tiny_recipe))
    torch.testing.assert_close(ours, F.cross_entropy(logits, target))


def test_void_costs_nothing_and_pulls_nowhere(tiny_recipe: MakeRecipe) -> None:
    logits = torch.randn(1, 3, 4, 4, requires_grad=True)
    loss = set_loss(logits, torch.full((1, 4, 4), 255, dtype=torch.uint8), codes_of(tiny_recipe))
    loss.backward()
    assert float(loss.detach()) == 0
    assert logits.grad is not None
    assert not logits.grad.any()


def test_a_partial_label_speaks_of_the_set_alone(tiny_recipe: MakeRecipe) -> None:
    logits = torch.randn(1, 3, 4, 4)
    loss = set_loss(logits, torch.full((1, 4, 4), PARTIAL_CODE, dtype=torch.uint8), codes_of(tiny_recipe))
    probability = logits.softmax(1)
    torch.testing.assert_close(loss, -(probability[:, 0] + probability[:, 1]).log().mean())


@pytest.mark.parametrize(
    ("setting", "class_id", "code"), [("obstacle_weight", 0, OBSTACLE_CODE), ("free_weight", 1, FREE_CODE)]
)
def test_a_class_of_a_set_weighs_what_the_recipe_says(
    setting: str, class_id: int, code: int, tiny_recipe: MakeRecipe
) -> None:
    tree = tiny_recipe()
    tree["data"][0][setting] = 3.0
    tree["schedule"]["person_weight"] = 1.0
    logits, target = torch.randn(2, 3, 5, 7), torch.randint(0, 3, (2, 5, 7))
    own = torch.where(target == class_id, code, target).to(torch.uint8)
    ours = set_loss(logits, own, make_codes(recipe_from_dict(tree)))
    weights = torch.ones(3)
    weights[class_id] = 3.0
    torch.testing.assert_close(ours, F.cross_entropy(logits, target, weights))


def test_small_things_weigh_what_the_schedule_says(tiny_recipe: MakeRecipe) -> None:
    tree = tiny_recipe()
    tree["data"][0]["obstacle_weight"] = 3.0
    tree["schedule"]["small_weight"] = 12.0
    codes = make_codes(recipe_from_dict(tree))
    assert codes.weights[[0, OBSTACLE_CODE, SMALL_CODE]].tolist() == [1, 3, 12]
    assert codes.sets[SMALL_CODE].tolist() == [True, False, False]


def test_a_sigmoid_costs_binary_cross_entropy(tiny_recipe: MakeRecipe) -> None:
    codes = codes_of(tiny_recipe, activation="sigmoid", classes="grass-obstacle")
    logits, target = torch.randn(1, 1, 4, 4), torch.randint(0, 2, (1, 4, 4))
    ours = set_loss(logits, target.to(torch.uint8), codes)
    torch.testing.assert_close(ours, F.binary_cross_entropy_with_logits(logits[:, 0], target.float()))
    assert codes.sets.shape == (256, 2)
    assert np.isfinite(codes.weights).all()
