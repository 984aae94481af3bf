"""The living map against last-frame-wins, with the settings as shipped; both get the same frames and masks.

    python benchmarks/bench_living.py                      # analytic gardens, a person, ghosts, time: minutes
    python benchmarks/bench_living.py --quick              # one short garden
    python benchmarks/bench_living.py --gardens gardens/   # rendered gardens, see below

Every fifth frame both maps are compared with the truth of that moment, over the cells that any frame so far
has seen. A person who has walked out of view is not judged: nobody can know where he is.

Rendered gardens are made by

    swardmap synth gardens/ --scenes 5 --frames 50 --samples 1 --illumination cloudy --seed 100

and mapped with the network of the package and with true masks that err, with geometry on and off. Scene 0000
is left out: the settings were chosen on it.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from map_score import Drive, Noisy, Score, analytic_drive, rendered_drives, show
from numpy.typing import NDArray

from swardmap.config import Config, SegmenterConfig, config_from_dict
from swardmap.geometry import Intrinsics
from swardmap.grid import GridSpec, overlap
from swardmap.labels import MapClass
from swardmap.models import build_segmenter
from swardmap.pipeline import ObstacleMapper
from swardmap.segmenter import Segmenter
from swardmap.synth.analytic import (
    VGA,
    AnalyticSource,
    Scene,
    StereoNoise,
    Walker,
    garden_scene,
    lane_poses,
    true_map,
)

CROSSING = Intrinsics(320, 240, 230.0, 230.0, 159.5, 119.5)
MODES = {"last frame wins": "paper", "evidence": "evidence"}
BOTH_KNOW = ", where both know"
"""Columns over the cells that neither map calls unknown: nobody gains there by knowing less."""

MakeSegmenter = Callable[[], Segmenter]


def config_of(mode: str, spec: GridSpec | None = None, geometry: bool = False) -> Config:
    """The settings as shipped, but for the mode, the extent, and geometry."""
    grid: dict[str, object] = {"mode": mode}
    if spec is not None:
        size = [spec.width * spec.resolution_m, spec.height * spec.resolution_m]
        grid |= {"origin_m": list(spec.origin_m), "size_m": size}
    return config_from_dict({"grid": grid, "geometry": {"enabled": geometry}})


def score_modes(drive: Drive, make_segmenter: MakeSegmenter, geometry: bool = False) -> dict[str, Score]:
    """Map the frames in both modes and judge them at each moment."""
    mappers = {
        name: ObstacleMapper(make_segmenter(), config_of(mode, drive.spec, geometry))
        for name, mode in MODES.items()
    }
    scores = {name + where: Score() for where in ("", BOTH_KNOW) for name in MODES}
    observed = np.zeros(drive.spec.shape, np.bool_)
    for i, frame in enumerate(drive.frames):
        for mapper in mappers.values():
            step = mapper.step(frame)
        here, there = overlap(step.seen.spec, drive.spec)
        observed[there] |= step.seen.classes[here] != MapClass.UNKNOWN
        if i in drive.truths:
            grids = {name: mapper.map for name, mapper in mappers.items()}
            known = np.logical_and.reduce([g.classes > 0 for g in grids.values() if g is not None])
            for name, grid in grids.items():
                assert grid is not None
                scores[name].add(drive.truths[i], grid, observed)
                scores[name + BOTH_KNOW].add(drive.truths[i], grid, known)
    return scores


def gardens(
    drives: list[Drive], title: str, make: Callable[[int], MakeSegmenter], geometry: bool = False
) -> None:
    """FN, FP, d_min-obst and ghosts of both modes over all drives."""
    totals = {name + where: Score() for where in ("", BOTH_KNOW) for name in MODES}
    for number, drive in enumerate(drives):
        for name, score in score_modes(drive, make(number), geometry).items():
            totals[name] += score
    show(title, {name: total.row() for name, total in totals.items()})


def rendered(folder: Path) -> None:
    """Rendered gardens: the network of the package, and true masks that err."""
    drives = list(rendered_drives(folder, leave_out=("0000",)))
    frames = sum(len(drive.frames) for drive in drives)
    about = f"{len(drives)} rendered gardens, {frames} frames"
    network: Segmenter = build_segmenter(SegmenterConfig(), None)
    for geometry in (False, True):
        with_it = ", geometry on" if geometry else ""
        gardens(drives, f"{about}, {network.name}{with_it}", lambda _: lambda: network, geometry)
        title = f"{about}, true masks with a wrong blob a frame{with_it}"
        gardens(drives, title, lambda number: lambda: Noisy(1.0, number), geometry)


def walking_person(speed_mps: float = 0.8, frames_after: int = 30) -> dict[str, dict[str, float]]:
    """A person crosses in front of a standing camera: is he followed, and what is left behind for how long.

    Left behind are hazard cells within 5 m of the camera in which the lawn has been seen again.
    """
    scene = Scene(persons=(Walker((4.0, -4.5), (0.0, speed_mps)),), name="crossing")
    crossing = int(9.0 / speed_mps * 5)
    poses = tuple(lane_poses(crossing + frames_after, step_m=0.0))
    frames = list(AnalyticSource(scene, poses, CROSSING, noise=StereoNoise(), seed=3))
    spec = GridSpec(0.05, 320, 320, (-2.0, -8.0))
    iy, ix = np.indices(spec.shape)
    near = np.hypot(*np.moveaxis(spec.center_of(np.stack((ix, iy), -1)), -1, 0)) < 5.0
    truths = [true_map(scene, spec, frame.stamp_ns).is_obstacle for frame in frames]
    rows = {}
    for name, mode in MODES.items():
        mapper = ObstacleMapper(Noisy(), config_of(mode, spec))
        followed, seen_cells, wrong, longest = 0, 0, [], 0
        grass_frames: NDArray[np.int64] = np.zeros(spec.shape, np.int64)
        for frame, truth in zip(frames, truths, strict=True):
            step = mapper.step(frame)
            grid = mapper.map
            assert grid is not None
            here, there = overlap(step.seen.spec, spec)
            now = np.zeros(spec.shape, np.uint8)
            now[there] = step.seen.classes[here]
            on_him = (now >= MapClass.OBSTACLE) & truth
            followed += int((on_him & grid.is_obstacle).sum())
            seen_cells += int(on_him.sum())
            grass_frames = np.where(now >= MapClass.OBSTACLE, 0, grass_frames + (now == MapClass.GRASS))
            behind = grid.is_obstacle & near & ~truth & (grass_frames > 0)
            wrong.append(int(behind.sum()))
            longest = max(longest, int(grass_frames[behind].max(initial=0)) + 1)
        rows[name] = {
            "cells of the person seen and marked %": 100 * followed / seen_cells,
            "cells still marked where the lawn was seen again, mean": float(np.mean(wrong)),
            "frames of grass until a cell he left is clear, at most": float(longest),
            "such cells after the last frame": float(wrong[-1]),
        }
    return rows


def blob_ghosts(masks: int = 200) -> dict[str, dict[str, float]]:
    """A standing camera on an empty lawn with wrong blobs in half the frames: hazards that are not there."""
    rows = {}
    frame = next(iter(AnalyticSource(Scene(name="lawn"), tuple(lane_poses(1)), VGA)))
    for name, mode in MODES.items():
        mapper, counts = ObstacleMapper(Noisy(0.5), config_of(mode)), []
        for i in range(masks):
            mapper.step(replace(frame, stamp_ns=i * 200_000_000))
            grid = mapper.map
            assert grid is not None
            counts.append(int(grid.is_obstacle.sum()))
        rows[name] = {
            "wrong hazard cells, mean": float(np.mean(counts[20:])),
            "frames with any %": 100 * float(np.mean(np.array(counts[20:]) > 0)),
        }
    return rows


def time_a_frame() -> dict[str, dict[str, float]]:
    """Milliseconds of the map's update alone, VGA frames in both modes."""
    frames = list(AnalyticSource(garden_scene(0), tuple(lane_poses(12, step_m=0.3)), VGA))
    rows: dict[str, dict[str, float]] = {}
    for name, mode in MODES.items():
        mapper = ObstacleMapper(Noisy(), config_of(mode))
        steps = [mapper.step(replace(frames[i % 12], stamp_ns=i)) for i in range(60)]
        rows[name] = {
            f"{stage}, median ms": float(np.median([s.timings_ms[stage] for s in steps[10:]]))
            for stage in ("grid", "update")
        }
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--gardens", type=Path, help="folder that `swardmap synth` made")
    arguments = parser.parse_args()
    if arguments.gardens is not None:
        rendered(arguments.gardens)
        return
    seeds, count = ([0], 20) if arguments.quick else ([2, 3, 4], 60)  # the settings were chosen on 0 and 1
    drives = [analytic_drive(seed, count, VGA) for seed in seeds]
    for blobs in (0.0, 1.0, 3.0):
        title = f"{len(seeds)} gardens x {count} frames, sensor noise, {blobs:g} wrong blobs a frame"

        def make(number: int, blobs: float = blobs) -> MakeSegmenter:
            return lambda: Noisy(blobs, seeds[number])

        gardens(drives, title, make)
    show("A person walks across 4 m ahead of a standing camera, 0.8 m/s, 5 frames a second", walking_person())
    show("An empty lawn, half a wrong blob a frame", blob_ghosts())
    show("640 x 480, 0.05 m cells", time_a_frame())


if __name__ == "__main__":
    main()
