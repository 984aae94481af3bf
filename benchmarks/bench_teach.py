"""How well a drive teaches: gardens whose lawns the network knows badly, before and after.

    python benchmarks/bench_teach.py film out/ --gardens 2 --paint bleached --paint leaves
    python benchmarks/bench_teach.py teach out/
    python benchmarks/bench_teach.py table out/

Lawns are dry, shaded, in bluish light, long, mossy, in autumn: two gardens of each, seeds used nowhere else.
Of each a drive is filmed with the simulated stereo sensor, and frames of another way through the same garden,
which nothing is learnt from. `--paint` makes copies of a film whose lawn, by the true masks, or light has
another colour, in linear light: lawns that no garden has, and that the network knows badly.
`table` maps the other way with the network so far, the taught one and true masks.
What is finished is kept: the same command goes on where it was.
"""

import argparse
import json
import shutil
import time
from collections.abc import Collection, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from swardmap.cli.app import run
from swardmap.eval.things import NEAR_M
from swardmap.io import open_source
from swardmap.labels import GRASS, OTHER, PERSON, MapClass
from swardmap.models import bundled_network
from swardmap.models.onnx import OnnxSegmenter
from swardmap.synth.config import load_synth_config
from swardmap.synth.plan import SynthPlan, garden_seed
from swardmap.synth.produce import make_source
from swardmap.synth.scene.camera_path import mowing_run, random_rig
from swardmap.synth.scene.lawn_look import lawn_look
from swardmap.synth.sequence_files import discard, is_complete, write_sequence
from swardmap.synth.stage import garden_stage

FIRST_SEED = 8801
FRAMES = {"drive": 28, "other": 6}
SETTINGS = ("rig.width=448", "rig.height=336", "rig.samples=2", "rig.rate_hz=0.7", "camera.blur_share=0",
            "camera.raindrops=[0,0]", "camera.dirt=[0,0]", "map.enabled=false")  # fmt: skip
METRICS = ("lawn_kept_near", "free_near", "free_beyond_margin_near", "things_missed", "things_dangerous",
           "persons_dangerous", "corridor_missed", "false_stops")  # fmt: skip


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

Gains = tuple[float, float, float]


@dataclass(frozen=True)
class Paint:
    """How a lawn, and the light, are changed: factors of linear red, green and blue.

    Attributes:
        lawn: of the pixels of grass.
        faded: share of their colour that is lost first.
        light: of all pixels.
    """

    lawn: Gains = (1.0, 1.0, 1.0)
    faded: float = 0.0
    light: Gains = (1.0, 1.0, 1.0)


PAINTS = {
    "straw": Paint((1.7, 1.2, 0.6), 0.7),
    "bleached": Paint(faded=0.85),
    "frosted": Paint((1.9, 1.7, 1.8), 0.6),
    "leaves": Paint((1.5, 0.6, 0.4), 0.2),
    "moss": Paint((0.65, 0.5, 0.35), 0.5),
    "seeding": Paint((1.3, 0.85, 1.25), 0.6),
    "shade": Paint(light=(0.09, 0.13, 0.24)),
    "blue": Paint(light=(0.35, 0.8, 2.2)),
}


def film(out: Path, number: int, wanted: Collection[str]) -> None:
    """The drive and the other way of a garden."""
    kind = list(LAWNS)[number % len(LAWNS)]
    lawn, seed = LAWNS[kind], FIRST_SEED + number
    config = load_synth_config(None, (*SETTINGS, *lawn.settings))
    parts = {name: n for name, n in FRAMES.items() if name in wanted}
    if all(is_complete(folder_of(out, number) / part, "0000", lawn.light, n) for part, n in parts.items()):
        return
    stage = garden_stage(config)
    with patch("swardmap.synth.scene.garden.lawn_look", lambda rng: replace(lawn_look(rng), **lawn.look)):
        garden = stage.garden(garden_seed(seed, 0))
    rig = random_rig(garden.seed, config.rig.width, config.rig.height)
    for part, frames in parts.items():
        there = folder_of(out, number) / part
        discard(there, "0000", lawn.light)
        plan = SynthPlan(seed, 1, frames, (lawn.light,), config)
        source = make_source(plan, stage, 0, lawn.light, garden)
        if part == "other":
            way = mowing_run(garden, garden.seed + 1, frames, 0.4, rig)
            source = replace(source, run=way)
        write_sequence(source, there, "0000", None, config.map, lambda: {"lawn": kind}, lambda: None)
    print(f"filmed {folder_of(out, number)}", flush=True)


def folder_of(out: Path, number: int) -> Path:
    """Of a garden."""
    return out / f"{FIRST_SEED + number}-{list(LAWNS)[number % len(LAWNS)]}"


def recording(case: Path, part: str) -> Path:
    """The recording of a part of a garden or of a painted copy."""
    (found,) = (case / part / "folder" / "0000").iterdir()
    return found


def paint(case: Path, name: str) -> None:
    """A copy of a film with a lawn, or a light, of another colour."""
    for part in FRAMES:
        source = recording(case, part)
        there = case.with_name(f"{case.name}-{name}") / part / "folder" / "0000" / source.name
        if (there / "complete.json").is_file():
            continue
        unpainted = shutil.ignore_patterns("rgb", "complete.json")
        shutil.copytree(source, there, dirs_exist_ok=True, ignore=unpainted)
        (there / "rgb").mkdir(exist_ok=True)
        for file in sorted((source / "rgb").iterdir()):
            labels = cv2.imread(str(source / "labels" / f"{file.stem}.png"), cv2.IMREAD_UNCHANGED)
            lawn = np.asarray(labels) == GRASS.id
            rgb = np.asarray(cv2.imread(str(file)), np.uint8)[..., ::-1]
            cv2.imwrite(str(there / "rgb" / f"{file.stem}.png"), painted(rgb, lawn, PAINTS[name])[..., ::-1])
        shutil.copy(source / "complete.json", there / "complete.json")


def painted(rgb: NDArray[np.uint8], lawn: NDArray[np.bool_], how: Paint) -> NDArray[np.uint8]:
    """An image with another lawn and light.

    Args:
        rgb: (H, W, 3) uint8 sRGB.
        lawn: (H, W) which pixels are grass.
        how: see there.
    """
    x = rgb.astype(np.float32) / 255
    x = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
    other = (x * (1 - how.faded) + x.mean(-1, keepdims=True) * how.faded) * np.array(how.lawn)
    share = cv2.GaussianBlur(lawn.astype(np.float32), (0, 0), 0.7)[..., None]  # as a lens mixes them
    x = np.clip((x * (1 - share) + other * share) * np.array(how.light), 0, 1)
    x = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.asarray(np.round(255 * x), np.uint8)


def cases(out: Path, only: str) -> list[Path]:
    """Folders of gardens and of painted copies with both ways."""
    return [c for c in sorted(out.glob(only)) if all((c / part).is_dir() for part in FRAMES)]


def teach(there: Path, start: Path | None, more: list[str]) -> None:
    """Teach from the drive of a garden."""
    if not (there / "verdict.json").is_file():
        drive = str(recording(there, "drive"))
        begin = [] if start is None else ["--start", str(start)]
        began, spent = time.monotonic(), time.process_time()
        code = run(["teach", drive, "-o", str(there / "taught.onnx"), "--yes", *begin, *more])
        most_mb = getrusage(RUSAGE_SELF).ru_maxrss // 1024
        took = {
            "wall_s": round(time.monotonic() - began),
            "cpu_s": round(time.process_time() - spent),
            "most_memory_mb": most_mb,
        }
        told_by_gate = there / "taught.teach" / "gate.json"
        gate = json.loads(told_by_gate.read_text()) if told_by_gate.is_file() else {}  # the drive was refused
        (there / "verdict.json").write_text(json.dumps({"code": code, **took, **gate}, indent=1))


Figures = dict[str, tuple[int, int]]
"""Hits and cases of each."""
NETWORKS = ("before", "after", "true masks")


def measure(there: Path, start: Path | None) -> dict[str, Figures]:
    """Figures of the other way: the network so far, the taught one, true masks."""
    found, taught = {}, there / "taught.onnx"
    other = recording(there, "other")
    for name, segmenter in (
        ("before", str(start or "auto")),
        ("after", str(taught)),
        ("true masks", "truth"),
    ):
        result = there / f"evaluated-{name.replace(' ', '-')}"
        if segmenter == str(taught) and not taught.is_file():
            continue
        if _older(result / "results.json", taught if segmenter == str(taught) else other):
            shutil.rmtree(result, ignore_errors=True)
            options = ["--segmenter", segmenter, "--resolution", "0.05", "--workers", "1"]
            with redirect_stdout(StringIO()):
                run(["evaluate", str(other), "-o", str(result), *options])
        overall = json.loads((result / "results.json").read_text())["metrics"]["overall"]
        found[name] = {metric: (overall[metric]["count"], overall[metric]["of"]) for metric in METRICS}
        if segmenter != "truth":
            network = bundled_network() if segmenter == "auto" else Path(segmenter)
            assert network is not None
            found[name] |= pixels(OnnxSegmenter(network, 1), other)
    return found


def _older(result: Path, than: Path) -> bool:
    """Whether a result is missing, or of an earlier network or film."""
    return not result.is_file() or result.stat().st_mtime < than.stat().st_mtime


def pixels(segmenter: OnnxSegmenter, recording: Path) -> Figures:
    """True pixels of lawn, things and persons within NEAR_M: those called grass, and all."""
    hits, of = np.zeros(3, np.int64), np.zeros(3, np.int64)
    for frame in open_source(recording):
        grass = segmenter(frame).resized_to(*frame.depth.shape).map_classes == MapClass.GRASS
        near = frame.depth_m <= NEAR_M
        for i, one in enumerate((GRASS, OTHER, PERSON)):
            there = near & (frame.labels == one.id)
            hits[i] += np.count_nonzero(grass & there)
            of[i] += np.count_nonzero(there)
    names = ("grass_recall", "other_called_grass", "person_called_grass")
    return {n: (h, c) for n, h, c in zip(names, hits.tolist(), of.tolist(), strict=True)}


def told(figures: Figures) -> str:
    """One line."""
    return "  ".join(f"{n} {h}/{of}" + (f" = {h / of:.3f}" if of else "") for n, (h, of) in figures.items())


def print_table(found: Mapping[str, Mapping[str, Figures]]) -> None:
    """Each garden, all of them together, and how much of the lawn of true masks the taught network keeps."""
    for case, by_network in found.items():
        for name, figures in by_network.items():
            print(f"{case:<22} {name:<10} {told(figures)}")
    for name in NETWORKS:
        of_all = [by_network[name] for by_network in found.values() if name in by_network]
        total = {
            metric: (sum(f[metric][0] for f in of_all), sum(f[metric][1] for f in of_all))
            for metric in (of_all[0] if of_all else ())
        }
        print(f"{f'all {len(of_all)}':<22} {name:<10} {told(total)}")
    kept = [
        by_network.get("after", by_network["before"])["lawn_kept_near"][0]  # refused: as it was
        / by_network["true masks"]["lawn_kept_near"][0]
        for by_network in found.values()
    ]
    print("lawn kept after teaching, of what true masks keep: " + " ".join(f"{k:.3f}" for k in kept))
    if len(kept) > 1:
        half = float(t.ppf(0.975, len(kept) - 1)) * float(np.std(kept, ddof=1)) / len(kept) ** 0.5
        print(f"mean {np.mean(kept):.3f}, 95 % interval +- {half:.3f}, least {min(kept):.3f}")


COLUMNS = {
    "lawn kept free within 5 m": ("lawn_kept_near", True),
    "obstacle cells called free": ("free_near", True),
    "of them beyond the margin": ("free_beyond_margin_near", True),
    "things missed": ("things_missed", False),
    "things dangerous": ("things_dangerous", False),
    "persons dangerous": ("persons_dangerous", False),
    "corridor missed": ("corridor_missed", False),
    "false stops": ("false_stops", False),
}
"""Of the table for a page: what it is called, the metric, whether in percent."""


def print_page_table(found: Mapping[str, Mapping[str, Figures]]) -> None:
    """The same as Markdown: before / after / true masks."""
    print("| garden | after, of true masks | " + " | ".join(COLUMNS) + " |")
    print("|---" * (len(COLUMNS) + 2) + "|")
    for case, networks in found.items():
        taught = networks.get("after", networks["before"])  # refused: as it was
        kept = taught["lawn_kept_near"][0] / networks["true masks"]["lawn_kept_near"][0]
        cells = []
        for metric, percent in COLUMNS.values():
            counts = [networks.get(n, networks["before"])[metric] for n in NETWORKS]
            if percent:
                cells.append(" / ".join(f"{100 * hits / max(1, of):.1f}" for hits, of in counts) + " %")
            else:
                cells.append(" / ".join(str(hits) for hits, _ in counts) + f" of {counts[-1][1]}")
        refused = "" if "after" in networks else " (refused)"
        print(f"| {case} | {kept:.0%}{refused} | " + " | ".join(cells) + " |")


def main() -> None:
    """Film, teach, or print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("film", "teach", "table"))
    parser.add_argument("out", type=Path)
    parser.add_argument("--gardens", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--part", action="append", choices=tuple(FRAMES), help="of a film; none = all")
    parser.add_argument("--paint", action="append", choices=tuple(PAINTS), help="make such copies, too")
    parser.add_argument("--only", action="append", help="names of the gardens to teach or to measure")
    parser.add_argument("--markdown", action="store_true", help="print the table for a page")
    parser.add_argument("--start", type=Path, help="network to begin from, if not the package's")
    chosen, more = parser.parse_known_args()
    if chosen.what == "film":
        for number in range(chosen.first, chosen.first + chosen.gardens):
            film(chosen.out, number, chosen.part or FRAMES)
            for name in chosen.paint or ():
                paint(folder_of(chosen.out, number), name)
        return
    chosen_cases = [c for only in chosen.only or ["*"] for c in cases(chosen.out, only)]
    if chosen.what == "table":
        found = {case.name: measure(case, chosen.start) for case in chosen_cases}
        (print_page_table if chosen.markdown else print_table)(found)
        return
    for case in chosen_cases:
        teach(case, chosen.start, more)


if __name__ == "__main__":
    main()
