"""`swardmap demo`: a map of a drive that comes with the package, a margin for it, and what that costs."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from swardmap.cli.demo_text import told
from swardmap.cli.map import report
from swardmap.cli.options import ConfigFile, Json, Overwrite, Settings, settings
from swardmap.cli.progress import Progress
from swardmap.config import Config

RECORDING = Path(__file__).parent.parent / "data" / "demo"
"""A rendered drive in our folder layout, with true labels; `tools/demo_recording.py` films it."""

MOWER_WIDTH_M = 0.5


def demo(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.")] = Path("demo"),
    frames: Annotated[int | None, typer.Option(min=1, help="Only the first so many frames.")] = None,
    evaluation: Annotated[
        bool, typer.Option("--evaluate/--no-evaluate", help="Compare the maps with the truth too.")
    ] = True,
    config: ConfigFile = None,
    set_: Settings = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Map a drive through a rendered garden, measure a margin for it, and tell what it costs: no data needed.

    Example: swardmap demo -o demo/
    """
    # few enough frames for a picture of each
    chosen = settings(config, ["output.pictures=1", f"source.stop={json.dumps(frames)}", *(set_ or [])])

    from swardmap.io import open_source
    from swardmap.runs.recording import map_recording

    source = open_source(RECORDING, chosen.source)
    with Progress("mapping", "mapped", source.frame_count, as_json) as bar:
        run = map_recording(source, out, chosen, overwrite=overwrite, on_step=bar.step)
    found = None
    if evaluation:
        with Progress("comparing with the truth", "compared", source.frame_count, as_json) as bar:
            found = _evaluated(out, chosen, bar)
    if as_json:
        print(json.dumps(run.summary | {"evaluation": found}, indent=2, allow_nan=False))
        return
    print(report(run.summary, out))
    if found is not None:
        print(told(found, out))


def _evaluated(out: Path, config: Config, bar: Progress) -> dict[str, Any]:
    """The same drive against its true labels; what `swardmap evaluate` writes, in this process."""
    from swardmap.eval.cost import margin_cost
    from swardmap.eval.dataset import DatasetSpec
    from swardmap.eval.gathered import alone
    from swardmap.eval.look_again import worst_things
    from swardmap.eval.margin_section import MarginOptions
    from swardmap.eval.output import write_results
    from swardmap.eval.report import report_html
    from swardmap.eval.results import margin_for, results
    from swardmap.eval.run import evaluate, make_plan
    from swardmap.eval.shares import plain_share
    from swardmap.eval.worst import worst_frames

    folder = out / "evaluation"
    plan = make_plan(DatasetSpec(str(RECORDING), config.source), config)
    records = evaluate(plan, folder, workers=1, on_done=bar.show)
    found = results(plan, records, command="swardmap demo")
    share = plain_share(found["margin"]["carried_share"])
    if found["margin"]["margin_m"] is None and share is not None:
        found["margin"] = margin_for(plan, records, MarginOptions(share))
    map_file = out / "map.yaml"
    found["cost"] = margin_cost(found, map_file if map_file.is_file() else None, None, MOWER_WIDTH_M)
    again = worst_frames(alone(plan, records), found, most=len(records))
    found["worst_things"] = worst_things(again, plan.margin_m)
    write_results(folder, plan, records, found, report_html(plan, found, again))
    return found
