"""A day of mowing in accelerated time: memory, file sizes, places of the cells, and restarts with resume.

    python benchmarks/bench_day.py                 # 8 hours, a frame every 3 s: 9,600 frames
    python benchmarks/bench_day.py --hours 1 --every-s 1

The lawn, the mower and its sway are those of `bench_hour.py`, and so are coordinates as large as UTM's. Three
maps are made of the same frames: of the whole lawn, of a window of 12 m around the mower, and one that
is saved and loaded after each hour, as that of a node that is started anew.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from bench_hour import CONFIG, EAST_M, NORTH_M, RANGE_M, RATE_HZ, Truth, drive, lawn, rss_mb, same

from swardmap.config import config_from_dict
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.maps.log_odds_files import read_living_map, write_living
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.pipeline import ObstacleMapper
from swardmap.synth.analytic import Scene, true_map
from swardmap.types import Frame

WINDOW = config_from_dict(
    {"grid": {"mode": "evidence"}, "evidence": {"window_m": 12.0},
     "cloud": {"max_range_m": RANGE_M, "consistent_neighbours": 0}}
)  # fmt: skip
SHIFTS = [(dx, dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]


def evidence_of(mapper: ObstacleMapper) -> LogOddsMap:
    assert mapper.log_odds is not None
    return mapper.log_odds


def marked_by_shift(grid: OccupancyGrid | None, scene: Scene) -> dict[tuple[int, int], float]:
    """Share of the true obstacle cells that are marked, if the map is moved by (dx, dy) cells."""
    assert grid is not None
    (x, y), spec = grid.spec.origin_m, grid.spec
    local = GridSpec(spec.resolution_m, spec.width, spec.height, (x - EAST_M, y - NORTH_M))
    true = true_map(scene, local).is_obstacle & (grid.classes > 0)
    return {
        (dx, dy): float(np.roll(grid.is_obstacle, (dy, dx), axis=(0, 1))[true].mean()) for dx, dy in SHIFTS
    }


def restarted(mapper: ObstacleMapper, path: Path) -> ObstacleMapper:
    """Saved, thrown away, and gone on with from the file."""
    write_living(evidence_of(mapper), path, CONFIG)
    return ObstacleMapper(Truth(), CONFIG, log_odds=read_living_map(path, CONFIG))


def row(hour: int, whole: ObstacleMapper, window: ObstacleMapper, file_mb: float, scene: Scene) -> str:
    shifts = marked_by_shift(whole.map, scene)
    best = max(shifts, key=lambda shift: shifts[shift])
    tiles_mb = [evidence_of(mapper).nbytes / 1e6 for mapper in (whole, window)]
    assert whole.map is not None
    known = int(np.count_nonzero(whole.map.classes))
    return (
        f"| {hour} | {rss_mb():.0f} | {tiles_mb[0]:.2f} | {tiles_mb[1]:.2f} | {file_mb:.3f} | {known} | "
        f"{100 * shifts[0, 0]:.1f} | {best} |"
    )


def mow(hours: int, every_s: float, folder: Path) -> bool:
    """Drive, print a row each hour; whether the map that was restarted is the same at the end."""
    scene, file = lawn(), folder / "living.npz"
    frames: Iterator[Frame] = drive(scene, stride=round(every_s * RATE_HZ))
    whole, again = ObstacleMapper(Truth(), CONFIG), ObstacleMapper(Truth(), CONFIG)
    window = ObstacleMapper(Truth(), WINDOW)
    heads = ("hours", "process MB", "tiles MB", "window's tiles MB", "file MB", "cells known",
             "true obstacle cells marked %", "shift (cells) that marks most")  # fmt: skip
    print(f"| {' | '.join(heads)} |\n|{'---:|' * len(heads)}")
    for hour in range(1, hours + 1):
        for frame in islice(frames, round(3600 / every_s)):
            for mapper in (whole, again, window):
                mapper.step(frame)
        again = restarted(again, file)
        print(row(hour, whole, window, file.stat().st_size / 1e6, scene), flush=True)
    return bool(same(evidence_of(whole), evidence_of(again)))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=int, default=8)
    parser.add_argument("--every-s", type=float, default=3.0, help="seconds from frame to frame")
    args = parser.parse_args()
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        equal = mow(args.hours, args.every_s, Path(folder))
    print(f"\nthe map that was saved and loaded {args.hours} times equals the one that never was: {equal}")
    print(f"{time.process_time() - began:.0f} s of a core")


if __name__ == "__main__":
    main()
