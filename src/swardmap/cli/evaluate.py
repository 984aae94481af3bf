"""`swardmap evaluate`: how far the maps of a data set can be trusted, and the margin that follows."""

import json
import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from swardmap.cli.evaluation_text import summary_text
from swardmap.cli.options import (
    Classes,
    ConfigFile,
    Depth,
    Json,
    Kind,
    Overwrite,
    Poses,
    Provider,
    Rgb,
    SegmenterName,
    Settings,
    image_flags,
    meanings,
    provider_name,
    settings,
    tell_guesses,
    with_flags,
)
from swardmap.cli.progress import Progress
from swardmap.errors import InputError

EXAMPLES = """\b
Examples:
  swardmap evaluate EDEN/ -o out/ --segmenter lawn.onnx
  swardmap evaluate recording/ -o out/ --segmenter truth --unit sequence
  swardmap evaluate analytic:scenes=4,frames=90 -o out/ --segmenter colour
  swardmap evaluate another_recording/ -o out/ --more

An interrupted run goes on where it was: give the same command again.
--more adds a recording to a finished run, with that run's settings.
"""


OF_THE_RUN = (
    "segmenter",
    "provider",
    "resolution",
    "protocol",
    "judged_margin",
    "pose_noise",
    "budget",
    "config",
)
"""Options that a recording that is added takes from the run."""


def evaluate_command(
    context: typer.Context,
    dataset: Annotated[
        str, typer.Argument(help="Recording with true labels, or analytic:scenes=4,frames=25.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the results; a run there is resumed.")],
    kind: Kind = None,
    rgb: Rgb = None,
    depth: Depth = None,
    poses: Poses = None,
    segmenter: SegmenterName = None,
    provider: Provider = None,
    clean: Annotated[
        Path | None, typer.Option(help="The same recording with clean depth, for the error budget.")
    ] = None,
    masks: Annotated[
        Path | None,
        typer.Option(help="True masks: CVAT, COCO, Label Studio, Roboflow, by the frames' names."),
    ] = None,
    classes: Classes = None,
    resolution: Annotated[
        list[float] | None, typer.Option(help="Edge of a map cell in metres; repeatable, the first counts.")
    ] = None,
    protocol: Annotated[
        list[str] | None, typer.Option(help="dense, paper, paper-own; repeatable, the first counts.")
    ] = None,
    judged_margin: Annotated[
        float | None,
        typer.Option(
            help="Margin in metres that safety is judged with; none = costmap.margin_m, or 0.10.", min=0
        ),
    ] = None,
    share: Annotated[float, typer.Option(help="Share of the missed cells the margin covers.")] = 0.99,
    confidence: Annotated[float, typer.Option(help="Confidence of that.")] = 0.95,
    unit: Annotated[
        str, typer.Option(help="What is independent: frame, or a tag such as sequence.")
    ] = "frame",
    population: Annotated[
        str, typer.Option(help="Missed cells to cover: found (of obstacles found in part), all.")
    ] = "found",
    pose_noise: Annotated[
        tuple[float, float, float], typer.Option(help="Of the budget: metres, degrees yaw, degrees tilt.")
    ] = (0.02, 0.5, 0.5),
    budget: Annotated[bool, typer.Option("--budget/--no-budget", help="Run the error budget.")] = True,
    map_file: Annotated[
        Path | None, typer.Option("--map", help="Map (YAML) to show the cost of the margin on.")
    ] = None,
    work_area: Annotated[
        Path | None, typer.Option(help="Polygon (YAML) of the work area on that map.")
    ] = None,
    mower_width: Annotated[float, typer.Option(help="Of the mower in metres, for the cost.")] = 0.5,
    workers: Annotated[int | None, typer.Option(help="Processes; none = one a core.", min=1)] = None,
    ray: Annotated[str | None, typer.Option(help="Address of a Ray cluster to use, or local.")] = None,
    more: Annotated[
        bool, typer.Option("--more", help="Add the recording to the finished run in OUT, with its settings.")
    ] = False,
    strict: Annotated[bool, typer.Option(help="Stop at a frame that cannot be evaluated.")] = False,
    config: ConfigFile = None,
    set_: Settings = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Compare maps with their truth: the paper's tables, d_min-obst, an error budget, a proven margin."""
    if more:
        _refuse_own_settings(context, set_ or [], overwrite)
    flags = {
        "source.format": kind, **image_flags(rgb, depth, poses),
        "segmenter.name": segmenter, "segmenter.provider": provider_name(provider),
    }  # fmt: skip
    chosen = settings(config, with_flags(set_, flags))

    from swardmap.eval.budget import PoseNoise
    from swardmap.eval.dataset import DatasetSpec, true_masks
    from swardmap.eval.gathered import place_for_more
    from swardmap.eval.run import evaluate, make_plan

    said = tuple(f"{theirs}={ours}" for theirs, ours in meanings(classes or []).items())
    if masks is not None:
        tell_guesses(true_masks(str(masks), said))
    spec = DatasetSpec(
        dataset, chosen.source, str(clean) if clean else None, str(masks) if masks else None, said
    )
    options: dict[str, Any] = {"pose_noise": PoseNoise(*pose_noise), "with_budget": budget}
    if resolution:
        options["resolutions_m"] = tuple(resolution)
    if protocol:
        options["protocols"] = tuple(protocol)
    if judged_margin is not None:
        options["margin_m"] = judged_margin
    plan, folder = place_for_more(out, spec) if more else (make_plan(spec, chosen, **options), out)
    with Progress("evaluating", "evaluated", quiet=as_json) as bar:
        evaluate(
            plan, folder, workers=workers, ray_address=ray, strict=strict, overwrite=overwrite,
            on_done=bar.show,
        )  # fmt: skip
    wanted = {"share": share, "confidence": confidence, "unit": unit, "population": population}
    given = {name: value for name, value in wanted.items() if not more or _is_given(context, name)}
    found = _written(out, given, (map_file, work_area, mower_width))
    print(json.dumps(found, allow_nan=False) if as_json else summary_text(found, out))
    if not found["frames"]["evaluated"]:
        raise InputError(f"{dataset}: not one frame could be evaluated, so nothing was measured")


def _written(
    out: Path, margin_options: dict[str, Any], cost: tuple[Path | None, Path | None, float]
) -> dict[str, Any]:
    """Everything that follows from the records of a run, into its files."""
    from swardmap.config import config_to_dict
    from swardmap.eval.cost import margin_cost
    from swardmap.eval.gathered import gather, recordings_section
    from swardmap.eval.look_again import worst_things
    from swardmap.eval.margin_section import MarginOptions
    from swardmap.eval.output import write_results, written_margin_options
    from swardmap.eval.report import report_html
    from swardmap.eval.results import results
    from swardmap.eval.worst import worst_frames
    from swardmap.io.door import reading
    from swardmap.runs.frame_check import doubt_warnings
    from swardmap.runs.record_looks import watchdog_of
    from swardmap.runs.warnings import flat_warnings

    run = gather(out)
    margin = MarginOptions(**(written_margin_options(out) | margin_options))
    with reading(out, "whole records of an evaluation"):
        found = results(run.plan, run.records, margin, command="swardmap " + shlex.join(sys.argv[1:]))
        watchdog = watchdog_of(run.records, run.plan.config.watchdog)
    found["recordings"], found["unfinished"] = recordings_section(run), list(run.unfinished)
    flat = flat_warnings(config_to_dict(run.plan.config))
    found["faults"], found["warnings"] = watchdog["faults"], [*flat, *doubt_warnings(watchdog)]
    found["cost"] = margin_cost(found, *cost)
    again = worst_frames(run, found)
    found["worst_things"] = worst_things(again, run.plan.margin_m)
    write_results(out, run.plan, run.records, found, report_html(run.plan, found, again))
    return found


def _is_given(context: typer.Context, name: str) -> bool:
    """Whether an option stands on the command line."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _refuse_own_settings(context: typer.Context, set_: list[str], overwrite: bool) -> None:
    """Hold that a recording that is added is judged as those before it."""
    names = [name for name in OF_THE_RUN if _is_given(context, name)]
    own = [f"--{name.replace('_', '-')}" for name in names]
    own += [f"--set {word}" for word in set_ if not word.startswith("source.")]
    if own or overwrite:
        raise typer.BadParameter(
            f"--more takes these from the run in OUT: leave out {', '.join(own) or '--overwrite'}"
        )
