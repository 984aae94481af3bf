"""How well real photos teach: RGB-D frames without poses, each with a lane ahead as if it had been driven.

    python benchmarks/bench_teach_photos.py rgbd_lawn out/ --steps 60

The recording has depth and true masks, no poses. In each frame the robot drives one straight lane over the
lawn, as a person would steer it: away from what the mask says is no lawn. The masks say no more than that;
what is learnt comes from the lane, from what rises by the depth and from the network, as in `swardmap teach`.
Of the frames, in the order of how much lawn they show, every second one is learnt from and the others are
scored by their masks, then the other way round.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config, MountConfig
from swardmap.geometry import Pose
from swardmap.io import open_source
from swardmap.labels import GRASS, OTHER, PERSON, VOID_ID, MapClass
from swardmap.models import bundled_network
from swardmap.models.onnx import OnnxSegmenter
from swardmap.pipeline import configured_mount
from swardmap.teach.labels import DrivenGround, label_frame
from swardmap.teach.learn import read_network
from swardmap.teach.plan import LabelConfig, LearnConfig, TeachPlan, circle
from swardmap.teach.run import learn
from swardmap.teach.task import Task
from swardmap.teach.views import Heights, heights_of
from swardmap.teach.write import Written, _count, _write, write_facts
from swardmap.types import Frame, Segmentation

HALF_WIDTH_M, KEPT_AWAY_M = 0.3, 0.3
"""Of the lane, and how far it stays away from what is no lawn."""
FOLDS = 2
CLASSES = (GRASS, OTHER, PERSON)


def lane_of(heights: Heights, frame: Frame, camera: Pose) -> NDArray[np.bool_]:
    """(height, width) bool: cells of the grid around the view that the robot would have driven over."""
    spec, labels = heights.spec, np.asarray(frame.labels)
    rows, columns = np.indices(spec.shape)
    x = spec.origin_m[0] + (columns + 0.5) * spec.resolution_m - camera.position_m[0]
    y = spec.origin_m[1] + (rows + 0.5) * spec.resolution_m - camera.position_m[1]
    known = heights.cells >= 0
    barred, grass = np.zeros(spec.shape, np.bool_), np.zeros(spec.shape, np.bool_)
    barred.ravel()[heights.cells[known & (labels != GRASS.id) & (labels != VOID_ID)]] = True
    grass.ravel()[heights.cells[known & (labels == GRASS.id)]] = True
    away_m = cv2.distanceTransform((~barred).astype(np.uint8), cv2.DIST_L2, 3) * spec.resolution_m
    may = grass & (away_m >= KEPT_AWAY_M) & (x > 0)
    lanes = [may & (np.abs(y - aside) <= HALF_WIDTH_M) for aside in np.arange(-2.0, 2.01, 0.2)]
    return max(lanes, key=lambda lane: int(lane.sum()))


def write_fold(
    frames: Sequence[Frame], folder: Path, segmenter: OnnxSegmenter, config: Config, pose: Pose
) -> float:
    """Labels of photos as `swardmap teach` keeps them, the last held out for its gate; area driven."""
    written, limits, area_m2 = Written(), LabelConfig(), 0.0
    for number, frame in enumerate(frames):
        heights = heights_of(frame, pose, config)
        if heights is None:
            continue
        found: Segmentation = segmenter(frame).resized_to(*frame.depth.shape)
        lane, nothing = lane_of(heights, frame, pose), np.zeros(heights.spec.shape, np.bool_)
        ground = DrivenGround(heights.spec, lane, nothing, nothing, nothing, least_other=float("inf"))
        labels = label_frame(heights, found, ground, limits)
        _count(written, labels, found)
        _write(folder, f"{number:04d}", frame, labels, held=number == len(frames) - 1)
        area_m2 += float(lane.sum()) * heights.spec.resolution_m**2
    facts = {
        **written.facts(),
        "digest": "photos",
        "drives": ["photos"],
        "driven_m2": round(area_m2, 2),
        "frames_learn": len(frames) - 1,
    }
    write_facts(folder / "labels.json", facts)
    print(json.dumps({k: facts[k] for k in ("driven_m2", "pixels", "driven_called_before")}), flush=True)
    return area_m2


def score(network: Path, frames: Sequence[Frame]) -> NDArray[np.int64]:
    """(3, 2) pixels of lawn, of other things and of persons: those called grass, and all."""
    segmenter, counts = OnnxSegmenter(network, 1), np.zeros((3, 2), np.int64)
    for frame in frames:
        grass = segmenter(frame).resized_to(*frame.depth.shape).map_classes == MapClass.GRASS
        for i, one in enumerate(CLASSES):
            there = np.asarray(frame.labels) == one.id
            counts[i] += np.count_nonzero(grass & there), np.count_nonzero(there)
    return counts


def told(counts: NDArray[np.int64]) -> str:
    """Shares called grass."""
    return "  ".join(
        f"{one.name} called grass {h / c if c else float('nan'):.4f} of {c}"
        for one, (h, c) in zip(CLASSES, counts.tolist(), strict=True)
    )


def main() -> None:
    """Learn each fold, and score the other."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recording", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--steps", type=int, default=LearnConfig().steps)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--height-m", type=float, default=0.774)
    parser.add_argument("--pitch-deg", type=float, default=16.0)
    chosen = parser.parse_args()
    config = Config(mount=MountConfig(height_m=chosen.height_m, pitch_deg=chosen.pitch_deg))
    mount = configured_mount(config.mount)
    assert mount is not None
    pose = Pose("map", mount.child, mount.matrix)
    start = bundled_network()
    assert start is not None
    frames, segmenter = list(open_source(chosen.recording)), OnnxSegmenter(start, 1)
    frames.sort(key=lambda f: -np.count_nonzero(f.labels == GRASS.id))
    plan = TeachPlan(circle(HALF_WIDTH_M), learn=LearnConfig(steps=chosen.steps))
    total = {"before": np.zeros((3, 2), np.int64), "after": np.zeros((3, 2), np.int64)}
    print(read_network(start).name)
    for fold in range(FOLDS):
        task = Task((), (), chosen.out / f"fold-{fold}.onnx", config, plan)
        if not task.out.is_file():
            write_fold(frames[fold::FOLDS], task.folder, segmenter, config, pose)
            verdict = learn(task, "cpu", chosen.threads, lambda _: None)
            print(f"fold {fold}: {'; '.join(verdict.reasons) or 'the gate lets it pass'}", flush=True)
        rest = [f for i, f in enumerate(frames) if i % FOLDS != fold]
        for name, network in (("before", start), ("after", task.out)):
            counts = score(network if network.is_file() else start, rest)
            total[name] += counts
            print(f"fold {fold} {name:<7} {told(counts)}", flush=True)
    for name, counts in total.items():
        print(f"all    {name:<7} {told(counts)}", flush=True)


if __name__ == "__main__":
    main()
