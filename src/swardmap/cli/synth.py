"""`swardmap synth`: gardens with exact truth, as many as one likes."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from swardmap.cli.options import Json, Overwrite, with_flags
from swardmap.cli.progress import Progress
from swardmap.errors import InputError

EXAMPLES = """\b
Examples:
  swardmap synth gardens/ --scenes 20 --frames 100 --illumination all --seed 0
  swardmap synth gardens/ --illumination sunset --set camera.faults=false
  swardmap synth gardens/ --census
  swardmap evaluate gardens/eden -o out/ --segmenter truth

An interrupted run goes on where it was: give the same command again.
"""


def synth(
    out: Annotated[Path, typer.Argument(help="Folder for the gardens; a run there is resumed.")],
    scenes: Annotated[int, typer.Option(min=1, help="Gardens.")] = 20,
    frames: Annotated[int, typer.Option(min=1, help="Frames of each garden in each light.")] = 100,
    illumination: Annotated[
        list[str] | None,
        typer.Option(help="clear, cloudy, overcast, sunset, twilight, or all; repeatable."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of everything; seeds share no garden.")] = 0,
    width: Annotated[int | None, typer.Option(help="Of the image; 640.")] = None,
    height: Annotated[int | None, typer.Option(help="Of the image; 480.")] = None,
    samples: Annotated[int | None, typer.Option(help="Anti-aliasing: samples a pixel; 4.")] = None,
    sensor: Annotated[
        bool | None, typer.Option("--sensor/--no-sensor", help="Depth through a D435i-like sensor, or exact.")
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; none = one a core.")] = None,
    census: Annotated[
        bool, typer.Option("--census", help="Make nothing; count what is to be seen in OUT.")
    ] = False,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="YAML file with any part of the garden's settings.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="One setting, such as stereo.dropout=[0,0.1]. Repeatable."
        ),
    ] = None,
    settings: Annotated[
        bool, typer.Option("--settings", help="Print the settings, and make nothing.")
    ] = False,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Film procedural gardens: colour, depth, labels, poses and true maps, in EDEN's layout and in ours."""
    from swardmap.config.loader import to_yaml
    from swardmap.synth.config import load_synth_config
    from swardmap.synth.plan import SynthPlan

    flags = {"rig.width": width, "rig.height": height, "rig.samples": samples, "stereo.enabled": sensor}
    chosen = load_synth_config(config, with_flags(set_, flags))
    if settings:
        print(to_yaml(chosen), end="")
        return
    if census:
        _census(out, as_json)
        return
    plan = SynthPlan(seed, scenes, frames, lights_of(illumination or ["all"]), chosen)

    from swardmap.synth.produce import produce
    from swardmap.synth.stage import garden_stage

    with Progress("filming", "made", quiet=as_json) as bar:
        made = produce(plan, out, garden_stage, jobs=jobs, overwrite=overwrite, on_done=bar.show)
    print(json.dumps(made, indent=2) if as_json else _report(made))


def lights_of(words: list[str]) -> tuple[str, ...]:
    """The lights that `--illumination` names, in EDEN's order; commas part several."""
    from swardmap.io.sources.eden_layout import LIGHTS

    named = [part.strip() for word in words for part in word.split(",")]
    unknown = sorted(set(named) - {*LIGHTS, "all"})
    if unknown:
        raise typer.BadParameter(f"--illumination: expected {', '.join(LIGHTS)} or all, got '{unknown[0]}'")
    return tuple(light for light in LIGHTS if light in named or "all" in named)


def _census(out: Path, as_json: bool) -> None:
    from swardmap.synth.census import census_of, census_text

    if not out.is_dir():
        raise InputError(f"no such folder: {out}")
    found = census_of(out)
    print(json.dumps(found, indent=2) if as_json else census_text(found))


def _report(made: dict[str, Any]) -> str:
    out = made["out"]
    return (
        f"{made['sequences']} sequences, {made['frames']} frames in {out} ({made['made']} made now)\n"
        f"EDEN's layout: {out}/eden; with poses, sensor depth and maps: {out}/folder"
    )
