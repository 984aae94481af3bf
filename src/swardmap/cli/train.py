"""`swardmap train`: a recipe to a checkpoint."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from swardmap.errors import ConfigError, require

EXAMPLES = """\b
Examples:
  swardmap train recipes/lawn.yaml --data ~/photos -o run1
  swardmap train recipes/lawn.yaml --data ~/photos -o try --set schedule.steps=50
  torchrun --nproc-per-node 4 -m swardmap train ...       # many GPUs
"""


def train(
    recipe: Annotated[Path, typer.Argument(help="YAML recipe, such as recipes/lawn.yaml.")],
    data: Annotated[Path, typer.Option("--data", help="Folder that the recipe's data folders are in.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for checkpoints and curves.")],
    device: Annotated[str, typer.Option(help="As torch names it; auto = a GPU if there is one.")] = "auto",
    threads: Annotated[int, typer.Option(min=0, help="CPU threads; 0 = torch's choice.")] = 0,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="One setting, such as schedule.steps=200. Repeatable."
        ),
    ] = None,
    distil: Annotated[
        bool, typer.Option("--distil", help="First write the teachers' masks that the recipe names.")
    ] = False,
) -> None:
    """Train a network; run again with the same OUT, it goes on where it was."""
    torch = require("torch", "train")
    from swardmap.train.loop import train as run_training
    from swardmap.train.processes import join_processes
    from swardmap.train.recipe import load_recipe

    chosen = load_recipe(recipe, set_ or ())
    if threads:
        torch.set_num_threads(threads)
    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    rank, world = join_processes(device)  # torchrun starts several
    if distil and rank == 0:
        _distil(chosen, data)
    if world > 1:
        torch.distributed.barrier()
    run = run_training(chosen, data, out, _Report(chosen.schedule.steps), device)
    if world > 1:
        torch.distributed.destroy_process_group()
    if rank == 0:
        print(f"trained {run.step} steps; best checkpoint: {out / 'best.pt'}")


class _Report:
    """Plain lines: every tenth step its loss and the time left, every validation its figures."""

    def __init__(self, steps: int) -> None:
        self._steps = steps
        self._first: tuple[int, float] | None = None

    def __call__(self, figures: Mapping[str, Any]) -> None:
        step, now = int(figures["step"]), time.monotonic()
        first_step, since = self._first = self._first or (step, now)
        validated = len(figures) > 2
        if step % 10 and not validated:
            return
        words = [f"{k} {v:.4g}" if v is not None else f"{k} -" for k, v in figures.items()]
        if step > first_step and not validated:
            minutes = (now - since) / (step - first_step) * (self._steps - step) / 60
            words.append(f"of {self._steps}, about {minutes:.0f} min left")
        print("  ".join(words), flush=True)


def _distil(recipe: Any, root: Path) -> None:
    from swardmap.train.distil import Teacher, write_masks
    from swardmap.train.photos import image_paths

    if not recipe.teachers:
        raise ConfigError(f"recipe {recipe.name}: --distil needs 'teachers', got none")
    teachers = [Teacher(t, root) for t in recipe.teachers]
    for config in recipe.data:
        if config.pseudo is not None and not config.validation:
            count = write_masks(image_paths(config, root), teachers, root / config.pseudo, lambda _: None)
            print(f"{config.name}: {count} masks written to {root / config.pseudo}", flush=True)
