"""Views that an encoder looks at once: each is learnt from once a turn, and a killed run goes on the same."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from swardmap.errors import ConfigError
from swardmap.train.checkpoint import read_checkpoint
from swardmap.train.data import load_photos, make_codes
from swardmap.train.kept_views import KeptViews
from swardmap.train.loop import start_run, train, train_step
from swardmap.train.recipe import Recipe, recipe_from_dict

MakeRecipe = Callable[..., dict[str, Any]]
ALL_BLOCKS = 99


class KilledError(Exception):
    pass


def killed(figures: Mapping[str, Any]) -> None:
    if figures["step"] == 5 and "accuracy" not in figures:
        raise KilledError


def kept_recipe(make: MakeRecipe, **changes: Any) -> Recipe:
    recipe = recipe_from_dict(make(steps=6, dropout=0.3, auxiliary_classes=0))
    settings: dict[str, Any] = {"kept_batches": 2, "frozen_norms": True, "encoder_rate": 0.0}
    network = replace(recipe.network, imagenet=True, frozen_blocks=ALL_BLOCKS)
    return replace(recipe, network=network, schedule=replace(recipe.schedule, **settings | changes))


def test_every_view_comes_once_a_turn_in_another_order() -> None:
    made: list[int] = []

    def make(number: int) -> tuple[torch.Tensor, ...]:
        made.append(number)
        return (torch.arange(4) + 4 * number,)

    kept = KeptViews(3, 4, seed=0)
    steps = [kept.at(step, make)[0].tolist() for step in range(9)]
    turns = [[v for step in steps[t : t + 3] for v in step] for t in range(0, 9, 3)]
    assert turns[0] == list(range(12))
    assert all(sorted(turn) == turns[0] for turn in turns)
    assert turns[1] != turns[0]
    assert turns[2] != turns[1]
    assert made == [0, 1, 2]


def test_a_killed_run_ends_with_the_same_weights(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.set_num_threads(1)
    monkeypatch.setattr("swardmap.train.build.load_imagenet", lambda *_: None)
    recipe = kept_recipe(tiny_recipe)
    train(recipe, data_root, tmp_path / "whole", lambda _: None)
    with pytest.raises(KilledError):
        train(recipe, data_root, tmp_path / "cut", killed)
    assert read_checkpoint(tmp_path / "cut/last.pt")["step"] == 4
    train(recipe, data_root, tmp_path / "cut", lambda _: None)
    whole, cut = (read_checkpoint(tmp_path / name / "last.pt") for name in ("whole", "cut"))
    for part in ("network", "average"):
        for key, value in whole[part].items():
            assert torch.equal(value, cut[part][key]), key


@pytest.mark.parametrize(("frozen_blocks", "frozen_norms"), [(ALL_BLOCKS, False), (0, True)])
def test_an_encoder_that_changes_is_refused(
    data_root: Path,
    tiny_recipe: MakeRecipe,
    monkeypatch: pytest.MonkeyPatch,
    frozen_blocks: int,
    frozen_norms: bool,
) -> None:
    monkeypatch.setattr("swardmap.train.build.load_imagenet", lambda *_: None)
    recipe = kept_recipe(tiny_recipe, frozen_norms=frozen_norms)
    recipe = replace(recipe, network=replace(recipe.network, frozen_blocks=frozen_blocks))
    run = start_run(recipe, torch.device("cpu"))
    with pytest.raises(ConfigError, match="does not learn"):
        train_step(run, load_photos(recipe, data_root, validation=False), make_codes(recipe))
