"""Frames a second of `map` on the drive in the package, ten times over: one thread after another, and ahead.

    python benchmarks/bench_offline.py                 # both in turn, five times
    python benchmarks/bench_offline.py --provider OpenVINOExecutionProvider

"One after another" is what `map` did before: decode, network (a thread a core, 4 at most), map. "Ahead" reads
and segments frames while earlier ones are mapped, a frame a core. Both are measured in turn in one run, so
that what else the machine does meets both; processor seconds are told beside.
"""

import argparse
import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from swardmap.config import Config
from swardmap.io import FrameSource, open_source
from swardmap.runs.recording import map_recording
from swardmap.runs.speed import RECORDING
from swardmap.types import Frame


@dataclass
class Repeated:
    """The drive over and over, decoded each time, as a recording is."""

    times: int
    source: FrameSource

    def __getattr__(self, name: str) -> Any:
        return getattr(self.source, name)

    def __iter__(self) -> Iterator[Frame]:
        for lap in range(self.times):
            for i, frame in enumerate(self.source):
                yield replace(frame, stamp_ns=lap * 1_000_000 + i)


def measured(times: int, config: Config, ahead: bool) -> tuple[float, float]:
    """Frames a second, and processor seconds a frame."""
    source = Repeated(times, open_source(RECORDING))
    wall, processor = time.perf_counter(), time.process_time()
    frames = map_recording(source, config=config, ahead=ahead).totals.frames
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    return frames / wall, processor / frames


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--times", type=int, default=10, help="how often the drive of 20 frames is repeated")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--provider", default=Config().segmenter.provider)
    given = parser.parse_args()
    config = Config()
    config = replace(config, segmenter=replace(config.segmenter, provider=given.provider))
    measured(1, config, True)  # kernels are loaded
    rows = [[measured(given.times, config, ahead) for ahead in (False, True)] for _ in range(given.rounds)]
    for name, column in zip(("one after another", "ahead"), zip(*rows, strict=True), strict=True):
        rate, processor = (statistics.median(values) for values in zip(*column, strict=True))
        print(f"{name:18} {rate:6.1f} frames/s  {1000 * processor:6.1f} ms of processor a frame")
    ratios = sorted(b[0] / a[0] for a, b in rows)
    print(f"ratio: median {statistics.median(ratios):.2f}, {ratios[0]:.2f} to {ratios[-1]:.2f}")


if __name__ == "__main__":
    main()
