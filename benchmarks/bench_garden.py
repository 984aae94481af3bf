"""What a picture of a garden costs, whether memory stays flat, and whether drivers agree.

    python benchmarks/bench_garden.py              # seconds of processor time a frame at 640 x 480, by pass
    python benchmarks/bench_garden.py --memory     # 1,000 frames of four gardens in five lights
    python benchmarks/bench_garden.py --drivers    # depth and labels of Mesa's llvmpipe against its softpipe

Processor time of all threads is counted, since the clock depends on what else the machine does.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.errors import MissingExtraError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.sources.eden_layout import LIGHTS
from swardmap.synth.assets import Assets, open_assets
from swardmap.synth.light import sample_light
from swardmap.synth.model import Float32Array, Garden, Light, View
from swardmap.synth.render import GardenRenderer
from swardmap.synth.scene.camera_path import mowing_run, random_rig
from swardmap.synth.scene.garden import build_garden

GARDENS = (0, 1, 2, 3)
WARM, TIMED = 2, 6


class Timed(GardenRenderer):
    """Waits for the driver after each pass, and counts what it took."""

    seconds: dict[str, list[float]] = defaultdict(list)  # noqa: RUF012

    def _clock(self, name: str, started: float) -> None:
        self._context.finish()
        self.seconds[name].append(time.process_time() - started)

    def _begin(self, *args: Any, **kwargs: Any) -> Any:
        started = time.process_time()
        found = super()._begin(*args, **kwargs)
        self._clock("shadow maps", started)
        return found

    def _draw(self, scene: Any, camera: Any, seen: Any, *outputs: str) -> None:
        started = time.process_time()
        super()._draw(scene, camera, seen, *outputs)
        self._clock("truth" if outputs[0] == "TRUTH" else "radiance", started)

    def _finished(self, picture: Any) -> None:
        started = time.process_time()
        super()._finished(picture)
        self._clock("occlusion, mean of samples", started)


def assets_or_none() -> Assets | None:
    try:
        return open_assets()
    except MissingExtraError as error:
        print(f"without assets: {error}")
        return None


def drives(
    assets: Assets | None, seeds: range | tuple[int, ...], frames: int, width: int, height: int
) -> Iterator[tuple[Garden, Intrinsics, tuple[tuple[int, Pose], ...]]]:
    for seed in seeds:
        garden, rig = build_garden(seed, assets), random_rig(seed, width, height)
        yield garden, rig.intrinsics, mowing_run(garden, seed, frames, 5.0, rig)


def cost() -> None:
    assets = assets_or_none()
    gardens = list(drives(assets, GARDENS, WARM + TIMED, 640, 480))
    for samples in (1, 4):
        plain, timed = (kind(640, 480, samples, assets) for kind in (GardenRenderer, Timed))
        Timed.seconds.clear()
        whole, alone = [], []
        for garden, lens, run in gardens:
            light = sample_light("clear", np.random.default_rng(garden.seed))
            for k, (stamp_ns, pose) in enumerate(run):
                if k == WARM:  # the first frames of a garden upload it
                    Timed.seconds.clear()
                started = time.process_time()
                plain.render(garden, light, lens, pose, stamp_ns)
                between = time.process_time()
                plain.radiance(garden, light, lens, pose, stamp_ns)
                after = time.process_time()
                timed.render(garden, light, lens, pose, stamp_ns)
                if k >= WARM:
                    whole.append(between - started)
                    alone.append(after - between)
        print(f"{samples} samples a pixel, {plain.driver}: {np.mean(whole):.2f} s a frame; "
              f"colours alone with 1 sample: {np.mean(alone):.2f} s")  # fmt: skip
        for name, seconds in Timed.seconds.items():
            print(f"    {name}: {np.median(seconds):.3f} s")
        plain.close()
        timed.close()


def used_mib() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def memory(count: int) -> None:
    """Gardens in turn, built before: what grows from the second round on is the renderer's."""
    assets = assets_or_none()
    gardens = list(drives(assets, GARDENS, 10, 160, 120))
    renderer, done = GardenRenderer(160, 120, 1, assets), 0
    while done < count:
        for garden, lens, run in gardens:
            for name in LIGHTS:
                light = sample_light(name, np.random.default_rng(done))
                for stamp_ns, pose in run:
                    renderer.render(garden, light, lens, pose, stamp_ns)
                    done += 1
        print(f"{done} frames: {used_mib():.0f} MiB", flush=True)


def drawn(folder: Path) -> None:
    """Exact truth of a few views, into a file."""
    renderer = GardenRenderer(160, 120, 1, None)
    found: dict[str, Float32Array] = {}
    for garden, lens, run in drives(None, (0, 1, 2), 8, 160, 120):
        light: Light = sample_light("clear", np.random.default_rng(garden.seed))
        view: View = renderer.render(garden, light, lens, run[-1][1], run[-1][0])
        found[f"{garden.seed}.depth"], found[f"{garden.seed}.color"] = view.depth_m, view.radiance
        found[f"{garden.seed}.labels"] = view.labels.astype(np.float32)
    np.savez(folder / "views.npz", **found)  # type: ignore[arg-type]
    print(renderer.driver)


def drivers() -> None:
    with tempfile.TemporaryDirectory() as name:
        loaded = []
        for driver in ("llvmpipe", "softpipe"):
            folder = Path(name) / driver
            folder.mkdir()
            command = [sys.executable, __file__, "--into", str(folder)]
            subprocess.run(command, env={**os.environ, "GALLIUM_DRIVER": driver}, check=True)
            loaded.append(dict(np.load(folder / "views.npz")))
        a, b = loaded
        for seed in (0, 1, 2):
            depth = np.abs(a[f"{seed}.depth"] - b[f"{seed}.depth"])
            same = a[f"{seed}.labels"] == b[f"{seed}.labels"]
            color = a[f"{seed}.color"].mean() / b[f"{seed}.color"].mean()
            print(f"garden {seed}: labels differ in {100 * (~same).mean():.2f} % of the pixels; "
                  f"depth by more than 1 mm in {100 * (depth > 1e-3).mean():.2f} %, "
                  f"median {1e6 * np.median(depth):.1f} um; "
                  f"mean radiance {color:.4f} to 1")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--memory", type=int, nargs="?", const=1000, help="frames")
    parser.add_argument("--drivers", action="store_true")
    parser.add_argument("--into", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.into:
        drawn(options.into)
    elif options.drivers:
        drivers()
    elif options.memory:
        memory(options.memory)
    else:
        cost()


if __name__ == "__main__":
    main()
