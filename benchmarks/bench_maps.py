"""Maps over time and masks of another size by the figures of safety, on gardens that bench_safety.py filmed.

    python benchmarks/bench_safety.py out/ --seed 5000 --gardens 10 --frames 5 --only "true masks"
    python benchmarks/bench_maps.py out/gardens/*

Every frame is mapped with the network's mask and with the true one. "One frame" is its standalone map,
"last seen" and "log odds" are the accumulated maps of both modes after it; of each the cells are judged that
exact depth shows in this frame, for what nobody sees there is no truth of the moment. "Up-sampled" has the
network's logits brought to the size of the depth image before the decision, "true, small" the true mask at
the network's size.
"""

import argparse
import time
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from swardmap.config import SegmenterConfig, load_config
from swardmap.config.outputs import DEFAULT_MARGIN_M
from swardmap.eval.dataset import DatasetSpec, read_frames
from swardmap.eval.frame import pose_of
from swardmap.eval.frame_maps import FrameMaps
from swardmap.eval.maps import spec_of, true_segmentation
from swardmap.eval.run import make_plan
from swardmap.eval.safety import SafetyTally, judge, total_safety
from swardmap.eval.things import find_things
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.models.network_io import segmentation_of
from swardmap.models.onnx import open_segmenter
from swardmap.pipeline import new_map, observe

SETTINGS = load_config(overrides=["grid.resolution_m=0.05"])
MODES = {
    "last seen": load_config(overrides=["grid.resolution_m=0.05", "grid.mode=last_seen"]),
    "log odds": load_config(overrides=["grid.resolution_m=0.05", "grid.mode=log_odds"]),
}


def part_of(grid: OccupancyGrid | None, spec: GridSpec, known: np.ndarray[Any, Any]) -> OccupancyGrid:
    """The cells of `spec` in a larger map, unknown where `known` is False."""
    classes = np.zeros(spec.shape, np.uint8)
    if grid is not None:
        r = spec.resolution_m
        ox, oy = (round((grid.spec.origin_m[i] - spec.origin_m[i]) / r) for i in (0, 1))
        x0, x1 = max(ox, 0), min(ox + grid.spec.width, spec.width)
        y0, y1 = max(oy, 0), min(oy + grid.spec.height, spec.height)
        if x1 > x0 and y1 > y0:
            classes[y0:y1, x0:x1] = grid.classes[y0 - oy : y1 - oy, x0 - ox : x1 - ox]
    return OccupancyGrid(spec, np.where(known, classes, np.uint8(0)))


def tallies(folder: Path, network: Any, spent: dict[str, list[float]]) -> dict[str, list[SafetyTally]]:
    """What is counted of every frame of a folder, by name of the map."""
    dataset = DatasetSpec(str(folder.resolve()), SETTINGS.source)
    plan = make_plan(dataset, SETTINGS, resolutions_m=(0.05,), protocols=("dense",), with_budget=False)
    found: dict[str, list[SafetyTally]] = defaultdict(list)
    maps: dict[tuple[str, str], Any] = {}
    scene = None
    for numbered in read_frames(plan.dataset, 0, 10**6):
        frame = numbered.frame
        if frame is None:
            break
        if (frame.tags.get("scene"), frame.tags.get("sequence")) != scene:
            scene, maps = (frame.tags.get("scene"), frame.tags.get("sequence")), {}
        pose, made, exact = pose_of(plan, frame), FrameMaps(numbered.truth), numbered.clean or frame
        spec, true = spec_of(frame, pose, SETTINGS), true_segmentation(exact)
        reference = made.dense(exact, true, pose, SETTINGS, spec)
        pixels = made.pixels(exact, pose, SETTINGS)
        things = find_things(exact, pixels, made.cells(pixels, spec), spec, SETTINGS, numbered.truth)
        logits = network.logits(frame.rgb)
        started = time.process_time()
        mask = segmentation_of(logits, network.spec)
        decided = time.process_time()
        size = frame.depth.shape[::-1]
        larger = np.stack([cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR) for plane in logits[0]])
        fine = segmentation_of(larger[None], network.spec)
        spent["at its own size"].append(1e3 * (decided - started))
        spent["up-sampled"].append(1e3 * (time.process_time() - decided))
        known = reference.classes > 0
        for who, one in (("network", mask), ("true", true)):
            seen = observe(frame, one, pose, spec, SETTINGS)
            told = {"one frame": part_of(seen.grid, spec, known)}
            for mode, config in MODES.items():
                over_time = maps.setdefault((who, mode), new_map(config, pose.parent))
                over_time.integrate(seen)
                told[mode] = part_of(over_time.grid, spec, known)
            for name, grid in told.items():
                found[f"{who}, {name}"].append(judge(reference, grid, things, pose, DEFAULT_MARGIN_M))
        for name, one in (
            ("network, up-sampled", fine),
            ("true, small", true.resized_to(*mask.labels.shape)),
        ):
            grid = part_of(observe(frame, one, pose, spec, SETTINGS).grid, spec, known)
            found[name].append(judge(reference, grid, things, pose, DEFAULT_MARGIN_M))
    return found


def line(name: str, tally: SafetyTally) -> str:
    """A row of the table."""
    n = Counter(tally.counts)
    things, missed, dangerous = tally.of_things()
    shares = (
        ("obstacle_free", "obstacle"), ("obstacle_free_near", "obstacle_near"),
        ("obstacle_free_beyond_near", "obstacle_near"), ("lawn_kept_near", "lawn_near"),
    )  # fmt: skip
    cells = [f"{100 * n[a] / max(1, n[b]):.2f}" for a, b in shares]
    cells += [f"{missed} ({dangerous}) of {things}", f"{n['corridor_missed']} of {n['corridor_thing']}",
              f"{n['corridor_stopped']} of {n['corridor_clear']}"]  # fmt: skip
    return f"| {name} | " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="+", help="such as out/gardens/* of bench_safety.py")
    options = parser.parse_args()
    network = open_segmenter(SegmenterConfig(threads=1))
    found: dict[str, list[SafetyTally]] = defaultdict(list)
    spent: dict[str, list[float]] = defaultdict(list)
    for folder in options.folders:
        for name, some in tallies(folder, network, spent).items():
            found[name] += some
    print("| | FN % | FN <= 5 m | beyond the margin <= 5 m | lawn kept <= 5 m | things missed (dangerous) "
          "| corridor misses | false stops |\n|---|--:|--:|--:|--:|--:|--:|--:|")  # fmt: skip
    for name, some in found.items():
        print(line(name, total_safety(some, DEFAULT_MARGIN_M)))
    for name, times in spent.items():
        print(f"decision {name}: {np.median(times):.2f} ms of processor time")


if __name__ == "__main__":
    main()
