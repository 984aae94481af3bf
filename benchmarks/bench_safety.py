"""How safe the map is, by the figures a safety engineer reads: gardens in five lights, slopes, datum.

    python benchmarks/bench_safety.py out/ --gardens 5 --frames 4      # some minutes
    python benchmarks/bench_safety.py out/                             # the whole table: hours on two cores
    python benchmarks/bench_safety.py out/ --row "my rule" grid.min_grass_points=5 --only "my rule"

Gardens are filmed with the simulated stereo sensor, each in one of five lights; garden k of light l is
scene k of seed 8110 + l, which nothing was tuned on (tune on another: --seed 5000). Every
row is one evaluation against exact depth.
What is finished is kept: the same command goes on where it was, and more gardens or rows can be asked for
later.

The row "the truth as the map" judges each reference map as if it were the robot's: what the margin alone
costs, which no camera and no network can win back. "True masks, exact depth" is this system without any
error of its input.

Rows of slopes and datum are the same frames in a world that is turned about the start of the drive, or
lifted: what the camera sees stays the same, only the map's axes differ. Rows of steps are terraces of simple
solids, seen from the lawn before them.
"""

import argparse
import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.config import load_config
from swardmap.eval.dataset import DatasetSpec, open_dataset, read_frames
from swardmap.eval.frame import Plan, evaluate_frame, pose_of, segmenter_of
from swardmap.eval.frame_maps import FrameMaps
from swardmap.eval.maps import compare_frame, compare_maps, true_segmentation
from swardmap.eval.metrics import METRICS
from swardmap.eval.protocols import at_resolution
from swardmap.eval.results import metrics_of, safety_section
from swardmap.eval.run import evaluate, make_plan
from swardmap.eval.safety import judge
from swardmap.eval.things import find_things
from swardmap.geometry import Pose
from swardmap.io.files import write_bytes
from swardmap.io.images import encode_png
from swardmap.io.sources.eden_layout import LIGHTS
from swardmap.io.sources.folder import write_folder
from swardmap.io.sources.truth import (
    GROUND,
    GroundRaster,
    KnownThing,
    read_ground,
    write_ground,
    write_things,
)
from swardmap.labels import GRASS
from swardmap.synth import analytic
from swardmap.synth.analytic_noise import StereoNoise, with_sensor_noise
from swardmap.synth.analytic_render import LAWN, cast
from swardmap.synth.config import load_synth_config
from swardmap.synth.plan import SynthPlan
from swardmap.synth.produce import produce
from swardmap.synth.stage import garden_stage

SEED = 8110
COLUMNS = (
    "obstacle_called_free", "free_near", "free_beyond_margin_near", "lawn_marked", "lawn_kept_near",
    "things_missed", "things_missed_free", "things_dangerous", "corridor_missed", "false_stops",
    "unjudged_cells",
)  # fmt: skip
HEADS = ("FN %", "FN <= 5 m", "beyond the margin <= 5 m", "FP %, margin included", "lawn kept <= 5 m",
         "things missed", "missed and called free", "dangerous", "corridor misses", "false stops",
         "left out of the truth %"
)  # fmt: skip
COUNTED = ("things_missed", "things_missed_free", "things_dangerous", "corridor_missed", "false_stops")


@dataclass(frozen=True)
class Row:
    """One row of the table.

    Attributes:
        settings: changed from the defaults.
        margin_m: that marks are grown by; None = the configured one, or 0.10 m.
        slope_deg: of the world, positive uphill.
        datum_m: of the ground above the map's z = 0 where the drive begins.
        step_m: of a terrace of simple solids in place of the gardens: how far the lawn rises ahead.
        exact: the robot sees the exact depth, too.
        perfect: the reference map is judged in place of the robot's.
    """

    settings: tuple[str, ...] = ()
    margin_m: float | None = None
    slope_deg: float = 0.0
    datum_m: float = 0.0
    step_m: float = 0.0
    exact: bool = False
    perfect: bool = False


ROWS: dict[str, Row] = {
    "as shipped": Row(),
    "no margin": Row(margin_m=0.0),
    "margin .40": Row(margin_m=0.4),
    "true masks": Row(("segmenter.name=truth",)),
    "true masks, exact depth": Row(("segmenter.name=truth",), exact=True),
    "the truth as the map": Row(("segmenter.name=truth",), perfect=True),
    "clearing by points alone": Row(("grid.clear_below=1",)),
    "geometry off": Row(("geometry.enabled=false",)),
    "geometry, 1 point": Row(("geometry.min_points=1",)),
    "without the joint rule": Row(("geometry.doubt_above=1",)),
    "none of these, no margin": Row(("grid.clear_below=1", "geometry.enabled=false"), margin_m=0.0),
    "min_confidence .7": Row(("segmenter.min_confidence=0.7",)),
    "min_grass_points 5": Row(("grid.min_grass_points=5",)),
    **{f"slope {deg:+d} deg": Row(slope_deg=deg) for deg in (-15, -10, -5, 5, 10, 15)},
    **{f"datum {m:+d} m": Row(datum_m=m) for m in (-3, -1, 1, 3)},
    **{
        f"slope {deg:+d} deg, datum {m:+d} m": Row(slope_deg=deg, datum_m=m)
        for deg, m in ((10, 3), (-10, -3))
    },
    **{
        f"step {m:+.1f} m, true masks": Row(("segmenter.name=truth",), step_m=m)
        for m in (-0.3, -0.1, 0.1, 0.3)
    },
}


def film(out: Path, light: str, gardens: int, frames: int, width: int, jobs: int, seed: int = SEED) -> Path:
    """The gardens of one light."""
    sets = [f"rig.width={width}", f"rig.height={width * 3 // 4}", "rig.rate_hz=1.0", "rig.samples=2"]
    config = load_synth_config(None, sets)
    plan = SynthPlan(seed + LIGHTS.index(light), gardens, frames, (light,), config)
    produce(plan, out / "gardens" / light, garden_stage, jobs=jobs)
    return out / "gardens" / light


def moved(gardens: Path, out: Path, row: Row) -> Path:
    """The same gardens in a world that is turned and lifted; what is finished is kept."""
    if not row.slope_deg and not row.datum_m and not row.exact:
        return gardens
    world = f"{row.slope_deg:+g}deg{row.datum_m:+g}m" + ("-exact" if row.exact else "")
    target = out / "moved" / world / gardens.name
    for done in sorted(gardens.glob("folder/*/*/complete.json")):
        sequence, here = done.parent, target / done.parent.relative_to(gardens)
        if (here / done.name).is_file():
            continue
        shutil.rmtree(here, ignore_errors=True)
        here.mkdir(parents=True)
        depth = "exact/depth" if row.exact else "depth"
        for part in ("rgb", "depth", "labels", "instances", "instances.json", "camera.yaml", "exact"):
            (here / part).symlink_to((sequence / (depth if part == "depth" else part)).resolve())
        T_new_map = _move(sequence, here, row)
        write_ground(here / GROUND, moved_ground(read_ground(sequence / GROUND), T_new_map))
        shutil.copy(done, here / done.name)
    shutil.copy(gardens / "plan.json", target / "plan.json")
    return target


def _move(sequence: Path, here: Path, row: Row) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Write the poses anew; T_new_map as a 4 x 4 matrix."""
    lines = (sequence / "poses.txt").read_text().splitlines()
    names = [line.split() for line in lines if not line.startswith("#")]
    poses = [Pose.from_quaternion("map", "camera", *np.split(np.array(w[2:], float), [3])) for w in names]
    start, forward = poses[0].position_m, poses[0].matrix[:2, 2]
    axis = np.array([-forward[1], forward[0], 0.0]) / np.hypot(*forward)  # to the left: nose up is negative
    turn = Pose.from_quaternion("map", "camera", [0, 0, 0], [*(axis * np.sin(_half(-row.slope_deg))),
                                                          np.cos(_half(-row.slope_deg))]).matrix  # fmt: skip
    foot = np.array([start[0], start[1], float(read_ground(sequence / GROUND).at(start[0], start[1]))])
    T = np.eye(4)
    T[:3, :3] = turn[:3, :3]
    T[:3, 3] = foot - turn[:3, :3] @ foot + (0, 0, row.datum_m)
    from scipy.spatial.transform import Rotation

    text = "# name stamp_ns tx ty tz qx qy qz qw (T_map_camera; metres; none = no pose)\n"
    for words, pose in zip(names, poses, strict=True):
        matrix = T @ pose.matrix
        numbers = (*matrix[:3, 3], *Rotation.from_matrix(matrix[:3, :3]).as_quat())
        text += " ".join([*words[:2], *(repr(float(v)) for v in numbers)]) + "\n"
    (here / "poses.txt").write_text(text)
    return T


def _half(degrees: float) -> float:
    return float(np.deg2rad(degrees)) / 2


def moved_ground(ground: GroundRaster, T_new_map: np.ndarray[Any, Any]) -> GroundRaster:
    """A ground in a turned and lifted world, on a raster of the same texels."""
    ny, nx = ground.height_m.shape
    x, y = (o + (np.arange(n) + 0.5) * ground.texel_m for o, n in zip(ground.origin_m, (nx, ny), strict=True))
    corners = np.array([(a, b, 0, 1) for a in (x[0], x[-1]) for b in (y[0], y[-1])]) @ T_new_map.T
    low = np.floor(corners[:, :2].min(axis=0)) - 1
    size = np.ceil((corners[:, :2].max(axis=0) + 1 - low) / ground.texel_m).astype(int)
    wanted = np.stack(
        np.meshgrid(*(o + (np.arange(n) + 0.5) * ground.texel_m for o, n in zip(low, size, strict=True))), -1
    )
    at = wanted.copy()
    for _ in range(8):  # the point below which the wanted one lies, step by step
        z = ground.at(at[..., 0], at[..., 1])
        now = np.stack((at[..., 0], at[..., 1], z, np.ones_like(z)), -1) @ T_new_map.T
        at += wanted - now[..., :2]
    z = ground.at(at[..., 0], at[..., 1])
    now = np.stack((at[..., 0], at[..., 1], z, np.ones_like(z)), -1) @ T_new_map.T
    return GroundRaster((float(low[0]), float(low[1])), ground.texel_m, now[..., 2].astype(np.float32))


def terrace(step_m: float) -> tuple[analytic.Scene, GroundRaster, float]:
    """A lawn that rises or falls 2 m ahead, boxes on both levels; its ground, and that of the camera."""
    rise, low = max(step_m, 0.0), max(-step_m, 0.0)
    x0, x1 = (2.0, 12.0) if step_m > 0 else (-10.0, 2.0)
    step = analytic.Box(((x0 + x1) / 2, 0.0), (x1 - x0, 16.0, abs(step_m)), label=GRASS, material=LAWN)
    places = ((1.5, -0.6, low), (1.6, 0.9, low), (2.8, 0.3, rise), (3.6, -0.9, rise), (4.6, 0.6, rise))
    boxes = tuple(
        analytic.Box((x, y), (0.2, 0.2, 0.15 + 0.1 * k), base_m=base) for k, (x, y, base) in enumerate(places)
    )
    columns = (np.arange(400) + 0.5) * 0.05 - 8.0
    height = np.where((columns >= x0) & (columns < x1), abs(step_m), 0.0).astype(np.float32)
    ground = GroundRaster((-8.0, -8.0), 0.05, np.tile(height, (320, 1)))
    return analytic.Scene((step, *boxes), name=f"step{step_m:+g}"), ground, low


def film_steps(out: Path, step_m: float, frames: int) -> Path:
    """A drive towards a terrace, with stereo noise, exact depth and ids."""
    here = out / "steps" / f"{step_m:+g}"
    if (here / GROUND).is_file():
        return here
    shutil.rmtree(here, ignore_errors=True)
    scene, ground, low = terrace(step_m)
    poses = [Pose(p.parent, p.child, p.matrix + _lift(low)) for p in analytic.lane_poses(frames, step_m=0.1)]
    exact = [analytic.render(scene, analytic.VGA, p, i * 10**9, f"{i:05d}") for i, p in enumerate(poses)]
    tagged = [replace(f, tags={"scene": scene.name, "sequence": scene.name}) for f in exact]
    noisy = (with_sensor_noise(f, np.random.default_rng(i), StereoNoise()) for i, f in enumerate(tagged))
    write_folder(noisy, here)
    for frame, pose in zip(exact, poses, strict=True):
        surface = cast(scene.solids, (), analytic.VGA, pose).surface.astype(np.int64)
        ids = np.where(surface > 0, surface + 1, 0).astype(np.uint16)  # the terrace itself is lawn
        write_bytes(here / "instances" / f"{frame.name}.png", encode_png(ids))
        write_bytes(here / "exact" / "depth" / f"{frame.name}.png", encode_png(frame.depth))
    shutil.copy(here / "camera.yaml", here / "exact" / "camera.yaml")
    boxes = [s for s in scene.solids if isinstance(s, analytic.Box)]
    write_things(
        here / "instances.json", {k + 1: KnownThing("box", b.size_m[2]) for k, b in enumerate(boxes)}
    )
    write_ground(here / GROUND, ground)
    return here


def _lift(height_m: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    lift = np.zeros((4, 4))
    lift[2, 3] = height_m
    return lift


def records_of(
    name: str, row: Row, gardens: Mapping[str, Path], out: Path, workers: int
) -> tuple[Any, list[Any]]:
    """The records of all lights; a garden is a scene of its own."""
    records: list[Any] = []
    config = load_config(overrides=list(row.settings))
    options = {} if row.margin_m is None else {"margin_m": row.margin_m}
    folder = "".join(c if c.isalnum() or c in "+-." else "_" for c in name)
    if row.step_m:
        gardens = {"steps": film_steps(out, row.step_m, 12)}
    for light, place in gardens.items():
        spec = DatasetSpec(str(moved(place, out, row).resolve()), config.source)
        plan = make_plan(
            spec, config, resolutions_m=(0.05,), protocols=("dense",), with_budget=False, **options
        )
        if row.perfect:
            records += [with_garden(record, light) for record in perfect_records(plan)]
            continue
        found = evaluate(
            plan,
            out / "rows" / folder / light,
            workers=workers,
            overwrite=_other(out / "rows" / folder / light, plan),
        )
        for record in found:
            if "error" in record:
                print(f"{name}, {light}: {record['error']}")
                continue
            records.append(with_garden(record, light))
    return plan, records


def with_garden(record: Mapping[str, Any], light: str) -> dict[str, Any]:
    """The record of a frame whose garden has a name of its own over all lights."""
    tags = record["tags"] | {"scene": f"{light}-{record['tags']['scene']}"}
    return {**record, "tags": tags}


def perfect_records(plan: Plan) -> Iterator[dict[str, Any]]:
    """The frames of a plan, each reference map judged as if the robot had made it."""
    config = at_resolution(plan.config, plan.resolutions_m[0])
    count = open_dataset(plan.dataset).frame_count or 0
    for numbered in read_frames(plan.dataset, 0, count):
        assert numbered.frame is not None, numbered.error
        frame = numbered.frame
        record = evaluate_frame(plan, numbered, segmenter_of(plan, frame.label_set))
        made, pose, truth = FrameMaps(numbered.truth), pose_of(plan, frame), numbered.clean or frame
        found = compare_frame(frame, true_segmentation(truth), pose, config, "dense", numbered.clean, made)
        reference, pixels = found.reference, made.pixels(truth, pose, config)
        things = find_things(
            truth, pixels, made.cells(pixels, reference.spec), reference.spec, config, made.truth
        )
        safety = judge(reference, reference, things, pose, plan.margin_m)
        maps = {plan.main: compare_maps(reference, reference).tally.to_dict()}
        yield record | {"safety": safety.to_dict(), "maps": maps}


def _other(folder: Path, plan: Any) -> bool:
    """Whether a folder holds an older plan: more gardens, or another version of the rules."""
    try:
        return bool(json.loads((folder / "plan.json").read_text())["fingerprint"] != plan.fingerprint)
    except (OSError, ValueError, KeyError):
        return False


def line(name: str, metrics: Mapping[str, Any]) -> str:
    """One row in Markdown."""
    cells = []
    for key in COLUMNS:
        found = metrics[key]
        text = "–" if found["value"] is None else f"{100 * found['value']:.2f}"  # noqa: RUF001
        if key in COUNTED:
            text = f"{found['count']:g} of {found['of']:g}"
        if found.get("high") is not None:
            text += f" ({100 * found['low']:.1f}-{100 * found['high']:.1f} %)"
        cells.append(text)
    return f"| {name} | " + " | ".join(cells) + " |"


def details(name: str, section: Mapping[str, Any]) -> None:
    """Things by height, kind and range of one row."""
    print(f"\n{name}: things, missed, dangerous")
    for by, field in (
        ("by_height", "height"),
        ("by_kind", "kind"),
        ("by_range", "band"),
        ("test_body_by_range", "band"),
    ):
        print(
            f"  {by}: "
            + ", ".join(
                f"{r[field]} {r['things']}/{r['missed']}/{r['dangerous']}" for r in section[by] if r["things"]
            )
        )
    print("  counts: " + ", ".join(f"{k} {v}" for k, v in section["counts"].items()))


def main() -> None:
    """Film what is missing, evaluate what is missing, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--gardens", type=int, default=20, help="a multiple of five")
    parser.add_argument("--frames", type=int, default=11, help="of each garden")
    parser.add_argument("--seed", type=int, default=SEED, help="of the gardens of the first light")
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--only", nargs="*", help="names of rows")
    parser.add_argument("--row", nargs="+", action="append", default=[], metavar=("NAME", "KEY=VALUE"))
    parser.add_argument("--json", type=Path, help="write all metrics of all rows here")
    options = parser.parse_args()
    rows = ROWS | {name: Row(tuple(settings)) for name, *settings in options.row}
    chosen: Sequence[str] = options.only or list(rows)
    each = max(1, options.gardens // len(LIGHTS))
    lights = LIGHTS[: min(options.gardens, len(LIGHTS))]
    gardens = {
        light: film(options.out, light, each, options.frames, options.width, options.workers, options.seed)
        for light in lights
    }
    print(f"{each * len(lights)} gardens, {each * len(lights) * options.frames} frames\n")
    print("| | " + " | ".join(HEADS) + " |\n|---|" + "--:|" * len(HEADS))
    told, told_safety = {}, {}
    for name in chosen:
        plan, records = records_of(name, rows[name], gardens, options.out, options.workers)
        told[name] = metrics_of(records, plan.main)
        told_safety[name] = safety_section(plan, records)
        print(line(name, told[name]), flush=True)
    for name in chosen[:1]:
        details(name, told_safety[name])
    if options.json:
        options.json.write_text(json.dumps({"metrics": told, "safety": told_safety}, indent=1))
    assert set(COLUMNS) <= {m.key for m in METRICS}


if __name__ == "__main__":
    main()
