"""How well a drive teaches: gardens whose lawns the network knows badly, before and after.

    python benchmarks/bench_teach.py film out/ --gardens 2      # each a drive and another way to measure on
    python benchmarks/bench_teach.py teach out/ --gardens 2
    python benchmarks/bench_teach.py table out/ --gardens 2

Lawns are dry, shaded, in bluish light, long, mossy, in autumn: two gardens of each, seeds used nowhere else.
Of each a drive is filmed with the simulated stereo sensor, and frames of another way through the same garden,
which nothing is learnt from. These are mapped with the network so far, the taught one and true masks.
What is finished is kept: the same command goes on where it was.
"""

import argparse
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

from swardmap.cli.app import run
from swardmap.synth.config import load_synth_config
from swardmap.synth.plan import SynthPlan, garden_seed
from swardmap.synth.produce import make_source
from swardmap.synth.scene.camera_path import mowing_run, random_rig
from swardmap.synth.scene.lawn_look import lawn_look
from swardmap.synth.sequence_files import discard, is_complete, write_sequence
from swardmap.synth.stage import garden_stage

FIRST_SEED = 8801
DRIVE_FRAMES, OTHER_FRAMES = 44, 8
SETTINGS = ("rig.width=480", "rig.height=360", "rig.samples=2", "rig.rate_hz=2", "camera.blur_share=0",
            "camera.raindrops=[0,0]", "camera.dirt=[0,0]", "map.enabled=false")  # fmt: skip
METRICS = ("obstacle_called_free", "free_beyond_margin_near", "lawn_kept_near", "things_missed",
           "things_dangerous", "corridor_missed", "false_stops")  # fmt: skip


@dataclass(frozen=True)
class Lawn:
    """A kind of lawn: what its look is set to, the light, and more settings of the camera."""

    look: Mapping[str, Any] = field(default_factory=dict)
    light: str = "cloudy"
    settings: tuple[str, ...] = ()


LAWNS = {
    "dry": Lawn({"dry": 0.97, "hue_deg": 60.0, "saturation": 0.32}, "clear"),
    "shaded": Lawn({}, "overcast", ("camera.exposure_ev=[-2.6,-2.2]",)),
    "bluish": Lawn({}, "twilight", ("camera.white_balance=[-0.6,-0.5]",)),
    "long": Lawn({"height_m": 0.14, "density": 1.0, "stripe": 0.0}, "cloudy"),
    "mossy": Lawn({"moss": 1.0, "hue_deg": 93.0, "saturation": 0.3, "value": 0.3}, "overcast"),
    "autumn": Lawn({"hue_deg": 48.0, "dry": 0.7, "bare": 1.0, "worn": 1.0}, "sunset"),
}


def film(out: Path, number: int) -> None:
    """The drive and the other way of a garden."""
    kind = list(LAWNS)[number % len(LAWNS)]
    lawn, seed = LAWNS[kind], FIRST_SEED + number
    config = load_synth_config(None, (*SETTINGS, *lawn.settings))
    parts = {"drive": DRIVE_FRAMES, "other": OTHER_FRAMES}
    if all(is_complete(folder_of(out, number) / part, "0000", lawn.light, n) for part, n in parts.items()):
        return
    stage = garden_stage(config)
    with patch("swardmap.synth.scene.garden.lawn_look", lambda rng: replace(lawn_look(rng), **lawn.look)):
        garden = stage.garden(garden_seed(seed, 0))
    rig = random_rig(garden.seed, config.rig.width, config.rig.height)
    for k, (part, frames) in enumerate(parts.items()):
        there = folder_of(out, number) / part
        discard(there, "0000", lawn.light)
        plan = SynthPlan(seed, 1, frames, (lawn.light,), config)
        source = make_source(plan, stage, 0, lawn.light, garden)
        if k:
            way = mowing_run(garden, garden.seed + 1, frames, 0.4, rig)
            source = replace(source, run=way)
        write_sequence(source, there, "0000", None, config.map, lambda: {"lawn": kind}, lambda: None)
    print(f"filmed {folder_of(out, number)}", flush=True)


def folder_of(out: Path, number: int) -> Path:
    """Of a garden."""
    return out / f"{FIRST_SEED + number}-{list(LAWNS)[number % len(LAWNS)]}"


def recording(out: Path, number: int, part: str) -> Path:
    """The recording of a part."""
    (found,) = (folder_of(out, number) / part / "folder" / "0000").iterdir()
    return found


def teach(out: Path, number: int, start: Path | None, more: list[str]) -> None:
    """Teach from the drive of a garden."""
    there = folder_of(out, number)
    if not (there / "verdict.json").is_file():
        drive = str(recording(out, number, "drive"))
        begin = [] if start is None else ["--start", str(start)]
        code = run(["teach", drive, "-o", str(there / "taught.onnx"), "--yes", *begin, *more])
        gate = json.loads((there / "taught.teach" / "gate.json").read_text())
        (there / "verdict.json").write_text(json.dumps({"code": code, **gate}, indent=1))


def measure(out: Path, number: int, start: Path | None) -> dict[str, dict[str, float | None]]:
    """Figures of the other way: the network so far, the taught one, true masks."""
    there, found = folder_of(out, number), {}
    taught = there / "taught.onnx"
    for name, segmenter in (
        ("before", str(start or "auto")),
        ("after", str(taught)),
        ("true masks", "truth"),
    ):
        result = there / f"evaluated-{name.replace(' ', '-')}"
        if segmenter == str(taught) and not taught.is_file():
            continue
        if not (result / "results.json").is_file():
            other = str(recording(out, number, "other"))
            options = ["--segmenter", segmenter, "--resolution", "0.05", "--workers", "1"]
            run(["evaluate", other, "-o", str(result), *options])
        metrics = json.loads((result / "results.json").read_text())
        found[name] = figures(metrics)
    return found


def figures(results: Mapping[str, Any]) -> dict[str, float | None]:
    """The figures of METRICS, of the dense protocol."""
    rows = results["metrics"]
    row = rows[0] if isinstance(rows, list) else next(iter(rows.values()))
    values = row.get("values", row)
    return {name: values.get(name) for name in METRICS}


def main() -> None:
    """Film, teach, or print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("film", "teach", "table"))
    parser.add_argument("out", type=Path)
    parser.add_argument("--gardens", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--start", type=Path, help="network to begin from, if not the package's")
    chosen, more = parser.parse_known_args()
    for number in range(chosen.first, chosen.first + chosen.gardens):
        if chosen.what == "film":
            film(chosen.out, number)
        elif chosen.what == "teach":
            teach(chosen.out, number, chosen.start, more)
        else:
            for name, values in measure(chosen.out, number, chosen.start).items():
                told = "  ".join(f"{k} {'-' if v is None else f'{v:.3f}'}" for k, v in values.items())
                print(f"{folder_of(chosen.out, number).name:<14} {name:<10} {told}", flush=True)


if __name__ == "__main__":
    main()
