"""`swardmap teach`: one drive over the lawn, and the network knows it."""

import json
import shlex
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swardmap.cli.options import ConfigFile, Json, Settings, settings
from swardmap.cli.progress import Progress
from swardmap.config import Config
from swardmap.errors import ConfigError

if TYPE_CHECKING:
    from swardmap.mapping.work_area import WorkArea
    from swardmap.teach.gate import Verdict
    from swardmap.teach.plan import TeachPlan
    from swardmap.teach.run import Labelled
    from swardmap.teach.task import Task

EXAMPLES = """\b
Examples:
  swardmap teach drive.mcap -o my-lawn.onnx              # labels, and a page to look at
  swardmap teach drive.mcap -o my-lawn.onnx --yes        # goes on from there: learns, and asks the gate
  swardmap teach drive.mcap -o my-lawn.onnx --leave-out 12.5-20 --leave-out-area path.yaml
  swardmap teach a.mcap b.mcap -o new.onnx --footprint '[[0.4, 0.2], [0.4, -0.2], [-0.2, -0.2], [-0.2, 0.2]]'
"""


def teach_command(
    drives: Annotated[
        list[Path],
        typer.Argument(
            help="Recordings with poses of drives over the lawn.", metavar="DRIVE...", readable=False
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="The network file, such as my-lawn.onnx.")],
    yes: Annotated[bool, typer.Option("--yes", help="Learn; without it labels and page are made.")] = False,
    footprint: Annotated[
        str | None,
        typer.Option(
            "--footprint",
            help="What touches the ground, from the robot's base, [[x, y], ...] in metres; "
            "none = a circle of costmap.inscribed_radius_m.",
        ),
    ] = None,
    leave_out: Annotated[
        list[str] | None,
        typer.Option("--leave-out", metavar="A-B", help="Seconds of the drive that teach nothing."),
    ] = None,
    leave_out_area: Annotated[
        list[Path] | None,
        typer.Option("--leave-out-area", help="Polygon (YAML, GeoJSON, KML) in which nothing is learnt."),
    ] = None,
    start: Annotated[
        Path | None, typer.Option("--start", help="Network to begin from, if not the package's.")
    ] = None,
    replay: Annotated[
        list[Path] | None,
        typer.Option(
            "--replay", help="Recording with true labels to replay, as of swardmap synth. Repeatable."
        ),
    ] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Steps of learning, if not the usual.")] = None,
    device: Annotated[str, typer.Option(help="As torch names it; auto = a GPU if there is one.")] = "auto",
    threads: Annotated[int, typer.Option(min=0, help="CPU threads; 0 = torch's choice.")] = 0,
    replace_: Annotated[
        bool, typer.Option("--replace", help="Write over a network that other drives or settings taught.")
    ] = False,
    config: ConfigFile = None,
    set_: Settings = None,
    as_json: Json = False,
) -> None:
    """Teach the network your lawn by a drive over it: labels, page, learning, gate (docs/tasks/teach.md)."""
    chosen = settings(config, list(set_ or []))
    from swardmap.io import is_live, open_source
    from swardmap.io.maps.area_files import read_area
    from swardmap.teach.run import label, learn
    from swardmap.teach.task import Task

    if out.suffix != ".onnx":
        raise typer.BadParameter(f"--out: expected a file such as my-lawn.onnx, got {out}")
    if any(map(is_live, drives)):
        raise typer.BadParameter("a drive is read twice: record the camera first, with swardmap record")
    task = Task(
        [open_source(drive, chosen) for drive in drives],
        drives,
        out,
        chosen,
        plan_of(footprint, leave_out or [], steps, chosen),
        start,
        read_area(chosen.area),
        tuple(_unwanted(leave_out_area or [], chosen)),
        tuple(replay or []),
        shlex.join(["swardmap", *_arguments(), "--yes"]),
        replace_,
    )
    began = time.monotonic()
    with Progress("labelling", "labelled", quiet=as_json) as bar:
        labelled = label(task, bar.show)
    if not yes:
        print(json.dumps(dict(labelled.facts), indent=2) if as_json else _labels_text(labelled, task))
        return
    verdict = learn(task, device, threads, _Report(task.plan.learn.total_steps, as_json))
    if as_json:
        print(json.dumps({"labels": dict(labelled.facts), **verdict.to_dict()}, indent=2))
    else:
        _print_verdict(verdict, task, time.monotonic() - began)
    if not verdict.passes:
        print(f"swardmap: refused, {task.out} is not written: {verdict.reasons[0]}", file=sys.stderr)
        raise typer.Exit(1)


def plan_of(footprint: str | None, leave_out: list[str], steps: int | None, config: Config) -> "TeachPlan":
    """What the options say.

    Raises:
        ConfigError: for a span or a footprint that is none.
    """
    from swardmap.ros.footprint import footprint_from_text
    from swardmap.teach.plan import LearnConfig, TeachPlan, circle, read_span

    radius_m = config.costmap.inscribed_radius_m
    if footprint is None and radius_m <= 0:
        raise ConfigError(
            "expected --footprint or costmap.inscribed_radius_m above 0: what touched the ground?"
        )
    corners = circle(radius_m) if footprint is None else footprint_from_text(footprint).corners_m
    learning = LearnConfig() if steps is None else LearnConfig(steps=steps)
    return TeachPlan(corners, tuple(read_span(text) for text in leave_out), learn=learning)


def _unwanted(files: list[Path], config: Config) -> list["WorkArea"]:
    from swardmap.io.maps.area_files import read_area

    areas = [read_area(replace(config.area, file=str(file))) for file in files]
    return [area for area in areas if area is not None]


def _arguments() -> list[str]:
    """The command line, without --yes."""
    return [a for a in sys.argv[1:] if a != "--yes"]


def _labels_text(labelled: "Labelled", task: "Task") -> str:
    facts = labelled.facts
    before = facts["driven_called_before"]
    driven = max(1, sum(before.values()))
    lines = [
        f"{facts['driven_m2']} m2 driven, of which {facts['doubtful_m2']} m2 are doubtful",
        f"{facts['frames_learn']} frames to learn from, {facts['frames_held']} to measure on",
        f"the network so far calls {before['grass'] / driven:.0%} of the driven ground grass",
        *(f"look at this: {line}" for line in labelled.warnings),
        f"page: {task.folder / 'page.html'}",
        f"when it is right: {task.command}",
    ]
    return "\n".join(lines)


def _print_verdict(verdict: "Verdict", task: "Task", seconds: float) -> None:
    from swardmap.teach.gate import table

    print("\n".join(table(verdict.rows)))
    if verdict.warning:
        print(f"swardmap: warning: {verdict.warning}", file=sys.stderr)
    if verdict.passes:
        print(f"written: {task.out} ({seconds / 60:.0f} min); use it with --segmenter {task.out}")
        print("to undo it, name the old file again, or none")


class _Report:
    """Plain lines: every tenth step with the time left."""

    def __init__(self, steps: int, quiet: bool) -> None:
        self._steps, self._quiet = steps, quiet
        self._first: tuple[int, float] | None = None

    def __call__(self, figures: Mapping[str, Any]) -> None:
        if self._quiet:
            return
        if "why" in figures:
            print(
                f"not yet: {figures['why']}; trying nearer to the network so far", file=sys.stderr, flush=True
            )
            return
        step, now = int(figures["step"]), time.monotonic()
        first, since = self._first = self._first or (step, now)
        if step % 10 or len(figures) > 2:
            return
        left = (
            ""
            if step == first
            else f", about {(now - since) / (step - first) * (self._steps - step) / 60:.0f} min left"
        )
        print(f"step {step} of {self._steps}, loss {figures['loss']:.3f}{left}", file=sys.stderr, flush=True)
