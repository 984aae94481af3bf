"""What a frame costs in each form that `swardmap record` can store it in: time and size.

    python benchmarks/bench_record.py        # half a minute

VGA frames of the analytic garden with the noise of a colour and of a stereo camera.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from swardmap.io.bags.mcap_writer import mcap_writer
from swardmap.io.bags.record_messages import RecordOptions
from swardmap.synth.analytic import VGA, AnalyticSource, StereoNoise, garden_scene, lane_poses
from swardmap.types import Frame

FORMS = (("raw", "raw"), ("jpeg", "raw"), ("jpeg", "png"), ("png", "raw"), ("png", "png"))


def garden(count: int) -> Iterator[Frame]:
    """Frames whose colour has the grain of a camera, which is what a codec has to carry."""
    rng = np.random.default_rng(0)
    for frame in AnalyticSource(garden_scene(0), tuple(lane_poses(count)), VGA, noise=StereoNoise()):
        grain = rng.normal(0, 3, frame.rgb.shape)
        yield replace(frame, rgb=np.clip(frame.rgb + grain, 0, 255).astype(np.uint8), labels=None)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=30)
    frames = list(garden(parser.parse_args().frames))
    print("| colour | depth | median ms a frame | slowest | kB a frame |\n|---|---|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as folder:
        for color, depth in FORMS:
            path, times = Path(folder, f"{color}_{depth}.mcap"), []
            with mcap_writer(path, RecordOptions(color, depth)) as writer:
                for frame in frames:
                    started = time.perf_counter()
                    writer.write(frame)
                    times.append(1e3 * (time.perf_counter() - started))
            size_kb = path.stat().st_size / len(frames) / 1e3
            print(f"| {color} | {depth} | {np.median(times):.1f} | {max(times[1:]):.1f} | {size_kb:.0f} |")


if __name__ == "__main__":
    main()
