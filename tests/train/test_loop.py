import pickle
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from swardmap.errors import ConfigError, InputError, ModelError, OutputError
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.train import loop
from swardmap.train.checkpoint import blended, load_network, read_checkpoint
from swardmap.train.data import draw_batch, load_photos, make_codes
from swardmap.train.loop import start_run, train, train_step
from swardmap.train.recipe import recipe_from_dict

MakeRecipe = Callable[..., dict[str, Any]]


class KilledError(Exception):
    pass


def silent(_: Mapping[str, Any]) -> None:
    pass


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


def killed_at(step: int) -> Callable[[Mapping[str, Any]], None]:
    def report(figures: Mapping[str, Any]) -> None:
        if figures["step"] == step and "accuracy" not in figures:
            raise KilledError

    return report


def test_a_killed_run_ends_with_the_same_weights(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path
) -> None:
    recipe = recipe_from_dict(tiny_recipe(steps=6, dropout=0.3, auxiliary_classes=0))
    train(recipe, data_root, tmp_path / "whole", silent)
    with pytest.raises(KilledError):
        train(recipe, data_root, tmp_path / "cut", killed_at(5))
    assert read_checkpoint(tmp_path / "cut/last.pt")["step"] == 4
    train(recipe, data_root, tmp_path / "cut", silent)
    whole, cut = (read_checkpoint(tmp_path / name / "last.pt") for name in ("whole", "cut"))
    assert whole["history"] == cut["history"]
    for part in ("network", "average"):
        for key, value in whole[part].items():
            assert torch.equal(value, cut[part][key]), key


def test_with_nothing_to_check_it_on_the_best_is_the_newest(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path
) -> None:
    """It was the first checkpoint for good, and that was exported."""
    tree = tiny_recipe(steps=6, auxiliary_classes=0)
    tree["data"] = [entry for entry in tree["data"] if not entry.get("validation")]
    train(recipe_from_dict(tree), data_root, tmp_path / "out", silent)
    assert read_checkpoint(tmp_path / "out/best.pt")["step"] == 6


def test_a_run_leaves_what_a_person_looks_at(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path
) -> None:
    run = train(recipe_from_dict(tiny_recipe(steps=2)), data_root, tmp_path, silent)
    names = {p.name for p in tmp_path.iterdir()}
    assert names == {"last.pt", "best.pt", "curve.json", "curve.png", "examples.png"}
    assert run.history[0]["step"] == 2
    network, recipe, _ = load_network(tmp_path / "best.pt")
    assert recipe.name == "tiny"
    assert not network.training


def test_another_recipe_does_not_go_on(data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path) -> None:
    train(recipe_from_dict(tiny_recipe(steps=2)), data_root, tmp_path, silent)
    with pytest.raises(ConfigError, match="another recipe"):
        train(recipe_from_dict(tiny_recipe(steps=4)), data_root, tmp_path, silent)


def test_nothing_in_a_checkpoint_is_executed(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "ran",))

    (tmp_path / "evil.pt").write_bytes(pickle.dumps({"version": 1, "average": Evil()}))
    torch.save({"version": 1, "average": Evil()}, tmp_path / "evil_zip.pt")
    (tmp_path / "cut.pt").write_bytes((tmp_path / "evil_zip.pt").read_bytes()[:100])
    torch.save({"version": 99}, tmp_path / "newer.pt")
    for name in ("evil", "evil_zip", "cut", "newer"):
        with pytest.raises(ModelError, match=f"{name}.pt"):
            read_checkpoint(tmp_path / f"{name}.pt")
    assert not (tmp_path / "ran").exists()
    torch.save({"version": 1, "average": [1], "recipe": {"name": 3}}, tmp_path / "hollow.pt")
    with pytest.raises(ModelError, match=r"hollow\.pt"):
        load_network(tmp_path / "hollow.pt")
    with pytest.raises(InputError, match="no such checkpoint"):
        read_checkpoint(tmp_path / "none.pt")


def test_two_processes_take_the_batch_in_turn(
    data_root: Path, tiny_recipe: MakeRecipe, monkeypatch: pytest.MonkeyPatch
) -> None:
    recipe = recipe_from_dict(tiny_recipe())
    drawn: list[list[int]] = []

    def spy(sets: Any, recipe: Any, indices: Any, step: int) -> Any:
        drawn.append(list(indices))
        return draw_batch(sets, recipe, indices, step)

    monkeypatch.setattr(loop, "draw_batch", spy)
    monkeypatch.setattr(torch.distributed, "all_reduce", lambda gradient: gradient.mul_(2))
    sets = load_photos(recipe, data_root, validation=False)
    for rank in range(2):
        run = start_run(recipe, torch.device("cpu"))
        train_step(run, sets, make_codes(recipe), rank, 2)
    assert drawn == [[0, 2], [1, 3]]


def test_a_run_may_begin_from_anothers_weights(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path
) -> None:
    train(recipe_from_dict(tiny_recipe(steps=2)), data_root, tmp_path / "first", silent)
    start = str(tmp_path / "first/best.pt")
    again = recipe_from_dict(tiny_recipe(steps=2) | {"start": start})
    still = {"steps": 1, "encoder_rate": 0.0, "decoder_rate": 0.0}
    tree = tiny_recipe(steps=1) | {"start": start}
    tree["schedule"] = tree["schedule"] | still
    run = train(recipe_from_dict(tree), data_root, tmp_path / "still", silent)
    begun = read_checkpoint(tmp_path / "first/best.pt")["average"]
    for key, value in run.network.named_parameters():  # learnt nothing, so it is where it began
        torch.testing.assert_close(value, begun[key])
    assert train(again, data_root, tmp_path / "second", silent).step == 2
    kept = read_checkpoint(tmp_path / "second/start.pt")["average"]
    assert all(torch.equal(kept[key], value) for key, value in begun.items())
    other = tiny_recipe(steps=2, encoder="resnet18", imagenet=False) | {"start": start}
    binary = tiny_recipe(steps=1, classes="grass-obstacle", activation="sigmoid") | {"start": start}
    binary["schedule"] = binary["schedule"] | still  # other classes: all but the head is taken
    run = train(recipe_from_dict(binary), data_root, tmp_path / "binary", silent)
    for key, value in run.network.named_parameters():
        if key.startswith("segmentation_head"):
            assert value.shape[0] == 1
        else:
            torch.testing.assert_close(value, begun[key])
    with pytest.raises(ModelError, match="expected a checkpoint of the same network"):
        train(recipe_from_dict(other), data_root, tmp_path / "third", silent)


def test_each_validation_set_has_its_say_in_the_choice(data_root: Path, tiny_recipe: MakeRecipe) -> None:
    tree = tiny_recipe()
    held = {"folder": "made", "validation": True, "hold_out": 5}
    tree["data"] = [
        {"name": "made", "folder": "made", "hold_out": 5},
        held | {"name": "a", "weight": 3.0},
        held | {"name": "b", "weight": 1.0},
    ]
    sets = load_photos(recipe_from_dict(tree), data_root, validation=True)
    figures = {"a.grass_iou": 0.8, "a.obstacle_called_grass": 0.2, "b.grass_iou": 0.4, "b.person_iou": 0.8}
    assert loop.selection_score(figures, sets, GRASS_OBSTACLE_PERSON) == pytest.approx((3 * 0.6 + 0.6) / 4)
    recipe = recipe_from_dict(tree)
    measured = loop.validate(
        loop.averaged_network(start_run(recipe, torch.device("cpu"), pretrained=False)),
        recipe,
        sets,
        torch.device("cpu"),
    )
    assert measured["a.accuracy"] == measured["b.accuracy"] == measured["accuracy"]


@pytest.mark.parametrize(("supported", "as_if"), [(True, "bf16"), (False, "fp32")])
def test_bf16_is_taken_where_the_device_computes_with_it(
    data_root: Path, tiny_recipe: MakeRecipe, monkeypatch: pytest.MonkeyPatch, supported: bool, as_if: str
) -> None:
    """A processor without it imitates it: a step of lawn-robots.yaml took it 52 s in place of 3.5."""
    monkeypatch.setattr(torch.ops.mkldnn, "_is_mkldnn_bf16_supported", lambda: supported)
    losses = []
    for precision in ("auto", as_if):
        tree = tiny_recipe(steps=40)
        tree["schedule"]["precision"] = precision
        recipe = recipe_from_dict(tree)
        run, sets = start_run(recipe, torch.device("cpu")), load_photos(recipe, data_root, validation=False)
        losses.append(train_step(run, sets, make_codes(recipe)))
    assert losses[0] == losses[1]


def test_half_precision_learns_as_full_precision(data_root: Path, tiny_recipe: MakeRecipe) -> None:
    losses = {}
    for precision in ("fp32", "bf16"):
        tree = tiny_recipe(steps=40)
        tree["schedule"] |= {"precision": precision, "batch": 3}  # not every processor is quick in bf16
        recipe = recipe_from_dict(tree)
        run, sets = start_run(recipe, torch.device("cpu")), load_photos(recipe, data_root, validation=False)
        losses[precision] = [train_step(run, sets, make_codes(recipe)) for _ in range(12)]
        assert all(
            p.dtype == torch.float32 for p in run.network.parameters()
        )  # only the arithmetic is halved
    assert losses["bf16"] != losses["fp32"]
    assert losses["bf16"][0] == pytest.approx(losses["fp32"][0], rel=0.05)
    for course in losses.values():
        assert np.mean(course[-3:]) < 0.85 * np.mean(course[:3])


def test_a_device_or_folder_that_cannot_be_is_said(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path
) -> None:
    recipe = recipe_from_dict(tiny_recipe(steps=2))
    with pytest.raises(ConfigError, match=r"device 'banana': torch .* cannot use it"):
        train(recipe, data_root, tmp_path, silent, "banana")
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot make the folder"):
        train(recipe, data_root, tmp_path / "file", silent)


def test_a_full_disk_leaves_the_checkpoint_before(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recipe = recipe_from_dict(tiny_recipe(steps=2))

    def full(*_: object) -> None:
        raise RuntimeError("unexpected pos 64 vs 0")  # as torch says it

    monkeypatch.setattr(torch, "save", full)
    with pytest.raises(OutputError, match="the checkpoint before it stays"):
        train(recipe, data_root, tmp_path / "run", silent)


def test_blended_weights_lie_between_those_of_two_checkpoints(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path
) -> None:
    for seed, name in enumerate(("a", "b")):
        tree = tiny_recipe(steps=2)
        tree["schedule"] |= {"seed": seed}
        train(recipe_from_dict(tree), data_root, tmp_path / name, silent)
    b = read_checkpoint(tmp_path / "b/best.pt")["average"]
    for share in (0.0, 0.25, 1.0):
        network, _, state = load_network(tmp_path / "a/best.pt")
        blended(network, tmp_path / "b/best.pt", share)
        for key, value in network.state_dict().items():
            if value.is_floating_point():
                torch.testing.assert_close(value, (1 - share) * state["average"][key] + share * b[key])
    other = tiny_recipe(steps=1, decoder_channels=24)
    train(recipe_from_dict(other), data_root, tmp_path / "other", silent)
    with pytest.raises(ModelError, match="expected a checkpoint of the same network"):
        blended(network, tmp_path / "other/best.pt", 0.5)
