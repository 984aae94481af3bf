"""Latency of the segmenters on a VGA frame: the shipped network and the paper's, every way to run them.

    python benchmarks/bench_segmenter.py [--rounds 5] [--runs 20]

Batch 1, 1 and 2 threads. Rows are run in turn, round after round in one process, so that a busy machine
hits them alike; the table gives the median over all runs and the fastest round's median. The times of
ONNX files include everything from the uint8 frame to the mask with its confidence. Without torch only the
file in the package and the colour baseline are timed; the other networks have random weights, which
changes no latency.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.models import bundled_network
from swardmap.models.colour import grass_threshold, green_chromaticity
from swardmap.models.onnx import OnnxSegmenter

NETWORKS = {
    "R34 448x448 (paper)": {"encoder": "resnet34", "decoder_channels": 256, "rates": [12, 24, 36]},
    "lite2 512x384": {"encoder": "efficientnet-lite2", "decoder_channels": 128, "width": 512, "height": 384},
}
Step = Callable[[], object]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--runs", type=int, default=20)
    arguments = parser.parse_args()
    frame = np.random.default_rng(0).integers(0, 256, (480, 640, 3), np.uint8)
    with tempfile.TemporaryDirectory() as folder:
        rows = [(name, threads, step) for name, threads, step in candidates(frame, Path(folder))]
        medians = measure([step for _, _, step in rows], arguments.rounds, arguments.runs)
    print(f"{'segmenter':44} threads  median ms  best round ms")
    for (name, threads, _), times in zip(rows, medians, strict=True):
        print(f"{name:44} {threads:7d} {np.median(times):10.1f} {min(times):14.1f}")


def candidates(frame: NDArray[np.uint8], folder: Path) -> Iterator[tuple[str, int, Step]]:
    yield "colour (excess green)", 1, lambda: grass_threshold(green_chromaticity(frame)[0])
    shipped = bundled_network()
    if shipped is not None:
        for threads in (1, 2):
            yield "in the package, ONNX Runtime INT8", threads, _onnx_step(shipped, frame, threads)
    try:
        import torch  # noqa: F401
    except ImportError:
        print("torch is not installed: only what is in the package is timed")
        return
    for name, network in NETWORKS.items():
        yield from _of_network(name, dict(network), frame, folder)


def _of_network(
    name: str, network: dict[str, Any], frame: NDArray[np.uint8], folder: Path
) -> Iterator[tuple[str, int, Step]]:
    import torch

    from swardmap.train.build import build_network, network_spec
    from swardmap.train.export import export_onnx, quantise
    from swardmap.train.recipe import recipe_from_dict

    network = {"width": 448, "height": 448, "imagenet": False, **network}
    recipe = recipe_from_dict({"name": name, "network": network, "data": [{"name": "none", "folder": "."}]})
    model = build_network(recipe).eval().to(memory_format=torch.channels_last)
    image = torch.zeros(1, 3, recipe.network.height, recipe.network.width)
    image = image.to(memory_format=torch.channels_last)
    plain, small = (folder / f"{recipe.network.encoder}{kind}.onnx" for kind in ("", "-int8"))
    export_onnx(build_network(recipe), network_spec(recipe), plain)
    quantise(plain, small, [frame] * 2)
    for threads in (1, 2):

        def torch_step(threads: int = threads) -> None:
            torch.set_num_threads(threads)
            with torch.inference_mode():
                model(image)

        yield f"{name}, torch float32 (network alone)", threads, torch_step
        yield f"{name}, ONNX Runtime float32", threads, _onnx_step(plain, frame, threads)
        yield f"{name}, ONNX Runtime INT8", threads, _onnx_step(small, frame, threads)


def _onnx_step(path: Path, frame: NDArray[np.uint8], threads: int) -> Step:
    segmenter = OnnxSegmenter(path, threads)
    return lambda: segmenter.segment(frame)


def measure(steps: list[Step], rounds: int, runs: int) -> list[list[float]]:
    """Median milliseconds of each step in each round."""
    medians: list[list[float]] = [[] for _ in steps]
    for _ in range(rounds):
        for times, step in zip(medians, steps, strict=True):
            step()
            taken = []
            for _ in range(runs):
                start = time.perf_counter()
                step()
                taken.append(1e3 * (time.perf_counter() - start))
            times.append(float(np.median(taken)))
    return medians


if __name__ == "__main__":
    main()
