"""`swardmap train`: a recipe to a checkpoint."""

import shlex
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from swardmap.cli.progress import Progress
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
    if rank == 0:
        print(counts_line(chosen, data), flush=True)
    steps, watched = chosen.schedule.steps, rank == 0 and sys.stderr is not None and sys.stderr.isatty()
    with Progress("training", "trained", steps, quiet=not watched, things="steps") as bar:
        run = run_training(chosen, data, out, _Report(steps, bar.show if watched else None), device)
    if world > 1:
        torch.distributed.destroy_process_group()
    if rank == 0:
        page = _write_page(out, chosen.name, run.history, chosen.schedule.steps)
        print(f"trained {run.step} steps; best checkpoint: {out / 'best.pt'}; page: {page}")


def counts_line(recipe: Any, root: Path) -> str:
    """What is learned from and checked on, before the first step."""
    from swardmap.train.photos import image_paths

    def told(validation: bool) -> str:
        sets = [config for config in recipe.data if config.validation is validation]
        images = sum(len(image_paths(c, root)) for c in sets if c.kind == "images")
        recordings = sum(c.kind == "recording" for c in sets)
        of_recordings = f"{recordings} recording{'s' * (recordings > 1)}"
        parts = [f"{images} images"] * (images > 0) + [of_recordings] * (recordings > 0)
        return " and ".join(parts) or "nothing"

    schedule = recipe.schedule
    return (
        f"{schedule.steps} steps on {told(False)}, checked on {told(True)} every {schedule.check_every} steps"
    )


def _write_page(out: Path, name: str, history: list[dict[str, Any]], steps: int) -> Path:
    from swardmap.io.files import write_text
    from swardmap.train.page import training_page

    examples = out / "examples.png"
    picture = examples.read_bytes() if examples.is_file() else None
    command = "swardmap " + shlex.join(sys.argv[1:])
    write_text(out / "report.html", training_page(name, history, steps, picture, command))
    return out / "report.html"


class _Report:
    """Lines: soon, and every tenth step, loss and time left, or a bar; every validation its figures."""

    def __init__(self, steps: int, show: Callable[[int, int], None] | None = None) -> None:
        self._steps, self._show = steps, show
        self._first: tuple[int, float] | None = None

    def __call__(self, figures: Mapping[str, Any]) -> None:
        step, now = int(figures["step"]), time.monotonic()
        first_step, since = self._first = self._first or (step, now)
        validated = len(figures) > 2
        if self._show is not None:
            self._show(step, self._steps)
        if not validated and (self._show is not None or (step % 10 and step != first_step + 1)):
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
