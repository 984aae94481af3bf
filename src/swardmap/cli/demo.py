"""`swardmap demo`: the main job on a drive that comes with the package, and how far its map can go wrong."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from swardmap.cli.evaluate import summary_text
from swardmap.cli.map import report
from swardmap.cli.options import ConfigFile, Json, Overwrite, Settings, settings
from swardmap.cli.progress import Progress
from swardmap.config import Config

RECORDING = Path(__file__).parent.parent / "data" / "demo"
"""A rendered drive in our folder layout, with true labels; `tools/demo_recording.py` films it."""


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
    """Map a drive through a rendered garden, and measure the map: no network, no weights, no data needed.

    Example: swardmap demo -o demo/
    """
    # few enough frames for a picture of each
    chosen = settings(config, ["output.pictures=1", f"source.stop={json.dumps(frames)}", *(set_ or [])])

    from swardmap.io import open_source
    from swardmap.runs.recording import map_recording

    source = open_source(RECORDING, chosen.source)
    with Progress("mapping", "mapped", source.frame_count, as_json) as bar:
        run = map_recording(source, out, chosen, overwrite=overwrite, on_step=bar.step)
    found = _evaluated(out / "evaluation", chosen) if evaluation else None
    if as_json:
        print(json.dumps(run.summary | {"evaluation": found}, indent=2, allow_nan=False))
        return
    print(report(run.summary, out))
    if found is not None:
        lines = summary_text(found, out / "evaluation").splitlines()
        print("\n".join(_few_frames(found) if line.startswith("no margin") else line for line in lines))


def _few_frames(found: dict[str, Any]) -> str:
    """That no margin can be measured here is no fault of the map."""
    return (
        f"margin: {found['frames']['evaluated']} frames are too few to measure one, "
        f"{found['margin_in_use_m']:g} m is taken; docs/evaluation.md tells how many it needs"
    )


def _evaluated(out: Path, config: Config) -> dict[str, Any]:
    """The same drive against its true labels; what `swardmap evaluate` writes, in this process."""
    from swardmap.eval.dataset import DatasetSpec
    from swardmap.eval.output import write_results
    from swardmap.eval.report import report_html
    from swardmap.eval.results import results
    from swardmap.eval.run import evaluate, make_plan

    plan = make_plan(DatasetSpec(str(RECORDING), config.source), config)
    records = evaluate(plan, out, workers=1)
    found = results(plan, records, command="swardmap demo")
    write_results(out, plan, records, found, report_html(plan, found))
    return found
