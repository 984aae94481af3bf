"""Speed of the evaluation's inner loops against SciPy, scikit-learn and torchmetrics on the same work.

    python benchmarks/bench_evaluation.py            # about two minutes
    python benchmarks/bench_evaluation.py --quick    # a few seconds, for a smoke test

Maps of 400 x 400 cells and VGA masks come from a small set of different ones, taken in turn; times are
medians over many calls, and the column for 50,000 is that median times 50,000 on one core. All methods
are checked to give the same numbers first. torchmetrics takes part where it is installed.
"""

import argparse
import json
import platform
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from sklearn.metrics import confusion_matrix

from swardmap.config import config_from_dict
from swardmap.eval.confusion import confusion_of_maps, confusion_of_masks
from swardmap.eval.dataset import DatasetSpec, read_frames
from swardmap.eval.dmin import d_min_obst, find_misses
from swardmap.eval.frame import Plan, evaluate_frame, segmenter_of
from swardmap.labels import GRASS_OBSTACLE_PERSON

Array = NDArray[np.uint8]
Pair = tuple[Array, Array]


def maps(count: int) -> list[Pair]:
    """A fan of grass with obstacles of 1-15 cells; the prediction is shifted, frayed and misses some."""
    rng = np.random.default_rng(0)
    pairs = []
    iy, ix = np.indices((400, 400))
    fan = (ix > 20) & (ix < 180) & (np.abs(iy - 200) < 0.7 * ix)
    for _ in range(count):
        reference = np.where(fan, 1, 0).astype(np.uint8)
        for _ in range(12):
            y, x, h, w = *rng.integers((90, 40), (300, 170)), *rng.integers(1, 15, 2)
            reference[y : y + h, x : x + w] = rng.choice([2, 2, 2, 3])
        predicted = np.roll(reference, rng.integers(-2, 3), axis=int(rng.integers(0, 2)))
        predicted[(rng.random(predicted.shape) < 0.1) & (predicted >= 2)] = 1
        predicted[rng.random(predicted.shape) < 0.02] = 0
        pairs.append((reference, predicted))
    return pairs


def masks(count: int) -> list[Pair]:
    """VGA masks of areas with an unsteady border, some void."""
    rng = np.random.default_rng(1)
    pairs = []
    for _ in range(count):
        field = nd.gaussian_filter(rng.standard_normal((480, 640)), 20)
        truth = (field > 0).astype(np.uint8)
        truth[nd.gaussian_filter(rng.standard_normal((480, 640)), 12) > 0.06] = 2
        truth[:20] = 255
        moved = nd.map_coordinates(truth, np.indices((480, 640)) + rng.normal(0, 1.5, (2, 1, 1)), order=0)
        pairs.append((truth, moved.astype(np.uint8)))
    return pairs


def kd_tree(reference: Array, predicted: Array) -> NDArray[np.float64]:
    hit, miss = _hits_and_misses(reference, predicted)
    return np.asarray(cKDTree(np.argwhere(hit)).query(np.argwhere(miss))[0] * 0.05)


def all_pairs(reference: Array, predicted: Array) -> NDArray[np.float64]:
    hit, miss = _hits_and_misses(reference, predicted)
    return np.asarray(cdist(np.argwhere(miss), np.argwhere(hit)).min(axis=1) * 0.05)


def transform(reference: Array, predicted: Array) -> NDArray[np.float64]:
    hit, miss = _hits_and_misses(reference, predicted)
    return np.asarray(nd.distance_transform_edt(~hit)[miss] * 0.05)


def _hits_and_misses(reference: Array, predicted: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    obstacle = reference >= 2
    return obstacle & (predicted >= 2), obstacle & (predicted == 1)


def scipy_map(reference: Array, predicted: Array) -> tuple[Any, Any, int]:
    """What `find_misses` and `confusion_of_maps` give, from the fastest parts of SciPy and NumPy."""
    matrix = np.bincount((reference << np.uint8(2) | predicted).ravel(), minlength=16)
    labels, _ = nd.label(reference >= 2, np.ones((3, 3)))
    hit, _ = _hits_and_misses(reference, predicted)
    missed = np.setdiff1d(np.unique(labels), np.unique(labels[hit]))
    return matrix, all_pairs(reference, predicted), len(missed) - 1


def our_map(reference: Array, predicted: Array) -> tuple[Any, Any, int]:
    matrix = confusion_of_maps(reference, predicted)
    misses = find_misses(reference, predicted)
    return matrix, misses.d_min_m(0.05), len(misses.missed)


def median_ms(work: Callable[[Array, Array], Any], pairs: list[Pair], rounds: int) -> float:
    for pair in pairs[:3]:
        work(*pair)
    times = []
    for i in range(rounds):
        pair = pairs[i % len(pairs)]
        started = time.perf_counter()
        work(*pair)
        times.append(time.perf_counter() - started)
    return float(np.median(times) * 1e3)


def table(
    title: str, methods: dict[str, Callable[[Array, Array], Any]], pairs: list[Pair], rounds: int
) -> Any:
    print(f"\n{title}\n{'':44}{'ms':>9}{'50,000 [s]':>12}{'times ours':>12}")
    found = {name: median_ms(work, pairs, rounds) for name, work in methods.items()}
    ours = next(iter(found.values()))
    for name, ms in found.items():
        print(f"{name:44}{ms:9.4f}{ms * 50:12.1f}{ms / ours:12.1f}")
    return found


def whole_frames(rounds: int) -> Any:
    """Frames a second of everything there is to a frame, with true masks in memory."""
    spec, config = (
        DatasetSpec("analytic:scenes=1,frames=4"),
        config_from_dict({"segmenter": {"name": "truth"}}),
    )
    numbered = list(read_frames(spec, 0, 4))
    frame = numbered[0].frame
    if frame is None:
        raise RuntimeError(numbered[0].error)
    segmenter = segmenter_of(Plan(spec, config), frame.label_set)
    plans = {
        "one kind of map, no budget": Plan(spec, config, (0.05,), ("dense",), with_budget=False),
        "4 kinds of map (the default), no budget": Plan(spec, config, with_budget=False),
        "4 kinds of map and the budget (the default)": Plan(spec, config),
    }
    print("\nwhole evaluation of a VGA frame, true masks, decoded images, processor time")
    print(f"{'':44}{'ms':>9}{'frames/s':>12}")
    result = {}
    for name, plan in plans.items():
        times = []
        for i in range(rounds + 2):
            started = time.process_time()  # a busy machine must not count
            evaluate_frame(plan, numbered[i % 4], segmenter)
            times.append(time.process_time() - started)
        result[name] = float(np.median(times[2:]) * 1e3)
        print(f"{name:44}{result[name]:9.2f}{1000 / result[name]:12.0f}")
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description="Speed of the evaluation against its peers.")
    parser.add_argument("--quick", action="store_true", help="few rounds")
    parser.add_argument("--json", help="write the numbers here")
    options = parser.parse_args()
    rounds = 20 if options.quick else 400
    map_pairs, mask_pairs = maps(4 if options.quick else 16), masks(2 if options.quick else 8)
    cells = [_hits_and_misses(*pair) for pair in map_pairs]
    print(f"{platform.machine()}, Python {platform.python_version()}, NumPy {np.__version__}; one core")
    print(f"maps: on average {np.mean([m.sum() for _, m in cells]):.0f} FN and "
          f"{np.mean([h.sum() for h, _ in cells]):.0f} TP cells")  # fmt: skip
    for pair in map_pairs:
        expected = d_min_obst(*pair, 0.05)
        for other in (kd_tree, all_pairs, transform):
            np.testing.assert_allclose(other(*pair), expected, rtol=1e-12)
        matrix, distances, missed = our_map(*pair)
        theirs = scipy_map(*pair)
        assert np.array_equal(np.array(matrix.counts)[:, :4].ravel(), theirs[0])
        assert (len(distances), missed) == (len(theirs[1]), theirs[2])

    by_mask: dict[str, Callable[[Array, Array], Any]] = {
        "swardmap": lambda r, p: confusion_of_masks(r, p, GRASS_OBSTACLE_PERSON),
        "scikit-learn confusion_matrix": lambda r, p: confusion_matrix(
            np.minimum(r, 3).ravel(), np.minimum(p, 3).ravel(), labels=[0, 1, 2, 3]
        ),
        "NumPy bincount on int64": lambda r, p: np.bincount(
            (np.minimum(r, 3).astype(np.int64) * 4 + np.minimum(p, 3)).ravel(), minlength=16
        ),
    }
    try:
        import torch
        from torchmetrics.functional.classification import multiclass_confusion_matrix
    except ImportError:
        print("torchmetrics is not installed: left out")
    else:
        torch.set_num_threads(1)
        by_mask["torchmetrics, validate_args=False"] = lambda r, p: multiclass_confusion_matrix(
            torch.from_numpy(np.minimum(p, 3)), torch.from_numpy(np.minimum(r, 3)), 4, validate_args=False
        )
    numbers = {
        "d_min": table(
            "d_min-obst of a 400 x 400 map",
            {"swardmap": lambda r, p: d_min_obst(r, p, 0.05), "SciPy cKDTree": kd_tree,
             "SciPy cdist": all_pairs, "SciPy distance_transform_edt": transform}, map_pairs, rounds),
        "map": table(
            "all metrics of a map: matrix, d_min-obst, missed obstacles",
            {"swardmap": our_map, "SciPy label + cdist, NumPy bincount": scipy_map}, map_pairs, rounds),
        "mask": table("confusion matrix of VGA masks", by_mask, mask_pairs, rounds // 2),
        "frame": whole_frames(rounds // 5),
    }  # fmt: skip
    if options.json:
        from pathlib import Path

        Path(options.json).write_text(json.dumps(numbers, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
