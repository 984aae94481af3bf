"""Checkpoints: tensors and plain values, written whole, loaded without unpickling anything else."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from swardmap.errors import ConfigError, InputError, ModelError, OutputError, one_line
from swardmap.io.door import reading
from swardmap.io.files import atomic_write
from swardmap.train.build import build_network, fitted_head, network_spec
from swardmap.train.kept_views import KeptViews
from swardmap.train.networks import DeepLabV3Plus
from swardmap.train.recipe import Recipe, recipe_from_dict, recipe_to_dict

CHECKPOINT_VERSION = 1
WHOLE = "a whole checkpoint of this network"


@dataclass(eq=False)
class Run:
    """Everything that changes while a network is trained."""

    recipe: Recipe
    device: torch.device
    network: DeepLabV3Plus
    auxiliary: nn.Module
    average: dict[str, Tensor]
    optimizer: torch.optim.Optimizer
    step: int = 0
    best: float = -1.0
    kept: KeptViews | None = None
    history: list[dict[str, Any]] = field(default_factory=list)


def save_progress(run: Run, out: Path, value: float) -> None:
    """Write `best.pt` if this is the best so far, then `last.pt`.

    What a run leaves between the two steps is done again from `last.pt` on, so that comes last of all.
    """
    better = value >= run.best  # with nothing to check it on, the newest
    run.best = max(run.best, value)
    state = {
        "version": CHECKPOINT_VERSION,
        "recipe": recipe_to_dict(run.recipe),
        "digest": run.recipe.digest,
        "step": run.step,
        "best": run.best,
        "history": run.history,
        "network": run.network.state_dict(),
        "auxiliary": run.auxiliary.state_dict(),
        "average": run.average,
        "optimizer": run.optimizer.state_dict(),
    }
    if better:
        _save(
            {k: state[k] for k in ("version", "recipe", "digest", "step", "best", "history", "average")},
            out / "best.pt",
        )
    _save(state, out / "last.pt")


def save_start(run: Run, path: Path) -> None:
    """Write the weights that a run began with as a checkpoint, for `blended`."""
    head = {"version": CHECKPOINT_VERSION, "recipe": recipe_to_dict(run.recipe), "digest": run.recipe.digest}
    _save(head | {"step": 0, "best": -1.0, "history": [], "average": run.average}, path)


def restore(run: Run, path: Path) -> None:
    """Go on from a checkpoint of the same recipe.

    Raises:
        ConfigError: if it is of another recipe.
        ModelError: for a file that is no checkpoint.
    """
    state = read_checkpoint(path)
    if state.get("digest") != run.recipe.digest or "optimizer" not in state:
        raise ConfigError(
            f"{path} was made by another recipe; choose another output folder, or remove it to start again"
        )
    with reading(path, WHOLE, ModelError):
        run.network.load_state_dict(state["network"])
        run.auxiliary.load_state_dict(state["auxiliary"])
        run.optimizer.load_state_dict(state["optimizer"])
        run.average = {k: v.to(run.device) for k, v in state["average"].items()}
        run.step, run.best, run.history = int(state["step"]), float(state["best"]), list(state["history"])


def begin_from(run: Run, path: Path) -> None:
    """Take the weights of another run's checkpoint; steps, learning rates and history start anew.

    A network of other classes takes what it can of the head, its last layer; see `fitted_head`.

    Raises:
        ModelError: for a file that is no checkpoint, or one of another network.
    """
    state, own = read_checkpoint(path), run.network.state_dict()
    with reading(path, WHOLE, ModelError):
        specs = network_spec(run.recipe), network_spec(recipe_from_dict(state["recipe"], str(path)))
    try:
        run.network.load_state_dict(state["average"] | fitted_head(state["average"], own, *specs))
    except (RuntimeError, LookupError) as error:  # torch lists every tensor that does not fit
        raise ModelError(
            f"{path}: expected a checkpoint of the same network as the recipe's "
            f"({run.recipe.network.encoder}), got another"
        ) from error
    run.average = {k: v.detach().clone() for k, v in run.network.state_dict().items()}


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Load a checkpoint; nothing in it is executed.

    Raises:
        InputError: if it is not there.
        ModelError: if it is damaged or no checkpoint of swardmap's.
    """
    if not path.is_file():
        raise InputError(f"no such checkpoint: {path}")
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many kinds for a damaged file
        raise ModelError(
            f"{path}: expected a checkpoint, got a damaged or foreign file ({one_line(repr(error), 120)})"
        ) from error
    if not isinstance(state, dict) or state.get("version") != CHECKPOINT_VERSION or "average" not in state:
        raise ModelError(f"{path}: expected a checkpoint of swardmap version {CHECKPOINT_VERSION}")
    return state


def load_network(path: Path) -> tuple[DeepLabV3Plus, Recipe, dict[str, Any]]:
    """The trained network of a checkpoint, its recipe, and the checkpoint's other contents."""
    state = read_checkpoint(path)
    with reading(path, WHOLE, ModelError):
        recipe = recipe_from_dict(state["recipe"], str(path))
        network = build_network(recipe, pretrained=False)
        network.load_state_dict(state["average"])
    return network.eval(), recipe, state


def blended(network: DeepLabV3Plus, path: Path, share: float) -> None:
    """Move a network's weights towards those of a checkpoint, such as the one its training began from.

    Between the start and the end of a fine-tuning there are often weights that are better on what the
    start knew and almost as good on what was learnt (Wortsman et al., Robust fine-tuning, CVPR 2022).

    Args:
        network: changed in place.
        path: the checkpoint.
        share: of the checkpoint, 0 (nothing changes) to 1.

    Raises:
        ModelError: for a file that is no checkpoint, or one of another network.
    """
    own, other = network.state_dict(), read_checkpoint(path)["average"]
    with reading(path, WHOLE, ModelError):
        shapes = {k: v.shape for k, v in other.items()}
    if {k: v.shape for k, v in own.items()} != shapes:
        raise ModelError(f"{path}: expected a checkpoint of the same network, got another")
    mixed = {k: v.lerp(other[k].to(v), share) if v.is_floating_point() else v for k, v in own.items()}
    network.load_state_dict(mixed)


def make_folder(path: Path) -> None:
    """Make the folder of a run, if it is not there.

    Raises:
        OutputError: if that cannot be.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder {path}: {error.strerror}") from error


def _save(state: Mapping[str, Any], path: Path) -> None:
    try:
        with atomic_write(path) as file:
            torch.save(dict(state), file)
    except (OSError, RuntimeError, OutputError) as error:  # torch's writer raises the second on a full disk
        raise OutputError(f"{one_line(error)}; the checkpoint before it stays") from error
