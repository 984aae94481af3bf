"""`swardmap evaluate`: how far the maps of a data set can be trusted, and the margin that follows."""

import json
import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from swardmap.cli.options import (
    Classes,
    ConfigFile,
    Json,
    Overwrite,
    Settings,
    meanings,
    settings,
    tell_guesses,
)
from swardmap.cli.progress import Progress
from swardmap.errors import InputError

EXAMPLES = """\b
Examples:
  swardmap evaluate EDEN/ -o out/ --segmenter lawn.onnx
  swardmap evaluate recording/ -o out/ --segmenter truth --unit sequence
  swardmap evaluate analytic:scenes=4,frames=90 -o out/ --segmenter colour

An interrupted run goes on where it was: give the same command again.
"""


def evaluate_command(
    dataset: Annotated[
        str, typer.Argument(help="Recording with true labels, or analytic:scenes=4,frames=25.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the results; a run there is resumed.")],
    kind: Annotated[
        str | None, typer.Option("--format", help="Kind of recording, if it is not recognised.")
    ] = None,
    segmenter: Annotated[str | None, typer.Option(help="auto, colour, truth, or an .onnx file.")] = None,
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
    strict: Annotated[bool, typer.Option(help="Stop at a frame that cannot be evaluated.")] = False,
    config: ConfigFile = None,
    set_: Settings = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Compare maps with their truth: the paper's tables, d_min-obst, an error budget, a proven margin."""
    flags = {"source.format": kind, "segmenter.name": segmenter}
    named = [f"{key}={json.dumps(value)}" for key, value in flags.items() if value is not None]
    chosen = settings(config, [*(set_ or []), *named])

    from swardmap.eval.budget import PoseNoise
    from swardmap.eval.cost import margin_cost
    from swardmap.eval.dataset import DatasetSpec, true_masks
    from swardmap.eval.margin_section import MarginOptions
    from swardmap.eval.output import write_results
    from swardmap.eval.report import report_html
    from swardmap.eval.results import results
    from swardmap.eval.run import evaluate, make_plan
    from swardmap.io.door import reading
    from swardmap.runs.frame_check import faults_of_records

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
    margin = MarginOptions(share, confidence, unit, population)
    plan = make_plan(spec, chosen, **options)
    with Progress("evaluating", "evaluated", quiet=as_json) as bar:
        records = evaluate(
            plan, out, workers=workers, ray_address=ray, strict=strict, overwrite=overwrite, on_done=bar.show
        )
    with reading(out, "whole records of an evaluation"):
        found = results(plan, records, margin, command="swardmap " + shlex.join(sys.argv[1:]))
    found["faults"] = faults_of_records([record.get("looks") for record in records], chosen.watchdog)
    found["cost"] = margin_cost(found, map_file, work_area, mower_width)
    write_results(out, plan, records, found, report_html(plan, found))
    print(json.dumps(found, allow_nan=False) if as_json else summary_text(found, out))
    if not found["frames"]["evaluated"]:
        raise InputError(f"{dataset}: not one frame could be evaluated, so nothing was measured")


def summary_text(found: dict[str, Any], out: Path) -> str:
    """What a person wants to know after an evaluation, in a few lines."""
    from swardmap.eval.pages import percent

    frames, margin = found["frames"], found["margin"]
    lines = [f"{frames['evaluated']} of {frames['total']} frames evaluated with '{found['segmenter']}'"]
    lines += [f"  not evaluated: frame {bad['index']}: {bad['error']}" for bad in frames["unreadable"][:5]]
    if len(frames["unreadable"]) > 5:
        lines.append(f"  ... and {len(frames['unreadable']) - 5} more, see frames.csv")
    if frames["evaluated"]:
        section = found["maps"][found["main"]]["overall"]
        cells, d_min = section["cells"], section["d_min"]["all"]
        called = cells["obstacle_called_free"]
        rate = f"{percent(called['share'])} % ({called['count']} of {called['of']})"
        lines += [
            f"masks: accuracy {percent(found['masks']['overall']['accuracy'])} %",
            f"maps ({found['main']}): obstacle cells called free: {rate}",
            *safety_lines(found),
        ]
        if d_min["count"]:
            lines.append(
                f"d_min-obst: mean {d_min['mean_m']:.3f} m, 99 % {d_min['quantiles_m']['0.99']:.3f} m"
            )
    if found.get("faults"):
        counts = ", ".join(f"{n} x {fault}" for fault, n in found["faults"].items())
        lines.append(f"frames that the watchdog of the node would refuse: {counts}")
    if margin["margin_m"] is None:
        lines.append(f"no margin: {margin['reason']}")
        if margin["carried_share"] and found["command"].startswith("swardmap evaluate"):
            lines.append(f"  for that share: {with_share(found['command'], margin['carried_share'])}")
    else:
        lines.append(f"margin: {margin['margin_m']:.3f} m, see {out / 'margin.yaml'}")
    return "\n".join([*lines, f"report: {out / 'report.html'}"])


def with_share(command: str, share: float) -> str:
    """The same command for another share of the missed cells; what is evaluated already is not done again."""
    words = shlex.split(command)
    if "--share" in words[:-1]:
        at = words.index("--share")
        del words[at : at + 2]
    words = [word for word in words if not word.startswith("--share=") and word != "--overwrite"]
    return shlex.join([*words, "--share", f"{share:g}"])


def safety_lines(found: dict[str, Any]) -> list[str]:
    """What a safety engineer reads first."""
    from swardmap.eval.metrics import interval_text, metric

    section = found["metrics"]["overall"]

    def told(key: str, name: str) -> str:
        one = section[key]
        interval = interval_text(one)
        more = f", 95 % by {found['unit']}: {interval}" if interval else ""
        return f"{one['count']} of {one['of']} {name} ({metric(key).text(one['value'])}{more})"

    near = metric("free_beyond_margin_near").text(section["free_beyond_margin_near"]["value"])
    kept = metric("lawn_kept_near").text(section["lawn_kept_near"]["value"])
    margin = f"beyond the margin of {found['margin_in_use_m']:g} m"
    return [
        f"things within 5 m: {told('things_missed', 'missed')}; {told('things_dangerous', 'dangerous')}",
        f"corridors of 3 m: {told('corridor_missed', 'missed')}; {told('false_stops', 'false stops')}",
        f"obstacle cells within 5 m called free {margin}: {near}; lawn kept there: {kept}",
    ]
