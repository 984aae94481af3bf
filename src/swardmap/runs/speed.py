"""How fast this machine maps: frames of the drive in the package, for a few seconds, at VGA size."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from time import perf_counter

import numpy as np

from swardmap.config import Config
from swardmap.geometry import Intrinsics
from swardmap.io import open_source
from swardmap.models import build_segmenter
from swardmap.pipeline import ObstacleMapper
from swardmap.types import Frame, nearest_indices

RECORDING = Path(__file__).parent.parent / "data" / "demo"
WIDTH, HEIGHT = 640, 480
CPU = "CPUExecutionProvider"


@dataclass(frozen=True, slots=True)
class Speed:
    """What was measured.

    Attributes:
        threads: of the network.
        provider: ONNX Runtime's execution provider.
        frames_per_s: one after another, network and map.
        network_ms, map_ms: medians of a frame.
    """

    threads: int
    provider: str
    frames_per_s: float
    network_ms: float
    map_ms: float


def measure_speeds(seconds: float = 10.0) -> list[Speed]:
    """The default settings first, then the other numbers of threads and providers that could be faster.

    Args:
        seconds: for all of them together; compiling and loading come on top.
    """
    from onnxruntime import get_available_providers

    cores = os.cpu_count() or 1
    default = Config().segmenter
    first = (default.threads or max(1, cores - 1), default.provider)
    others = [(threads, CPU) for threads in thread_choices(cores)]
    others += [(first[0], p) for p in get_available_providers() if p.startswith(("CUDA", "OpenVINO"))]
    tried = list(dict.fromkeys([first, *others]))
    frames = vga_frames()
    return [measure_speed(frames, *each, seconds=seconds / len(tried)) for each in tried]


def thread_choices(cores: int) -> list[int]:
    """Numbers of threads worth trying: one, half of the cores, all but one, all.

    >>> [thread_choices(n) for n in (1, 2, 4, 8)]
    [[1], [1, 2], [1, 2, 3, 4], [1, 4, 7, 8]]
    """
    return sorted({max(1, n) for n in (1, cores // 2, cores - 1, cores)})


def measure_speed(frames: Sequence[Frame], threads: int, provider: str, seconds: float) -> Speed:
    """Map frames over and over for some seconds, and at least once.

    Raises:
        SwardmapError: if the network cannot run so.
    """
    config = Config()
    config = replace(config, segmenter=replace(config.segmenter, threads=threads, provider=provider))
    mapper = ObstacleMapper(build_segmenter(config.segmenter), config)
    steps = mapper.run(endless(frames))
    for _ in range(3):  # kernels are loaded, and the network is laid out in memory
        next(steps)
    times: list[dict[str, float]] = []
    started = perf_counter()
    while not times or perf_counter() - started < seconds:
        times.append(next(steps).timings_ms)
    wall_s = perf_counter() - started
    network = [t["segment"] for t in times]
    rest = [sum(t.values()) - t["segment"] for t in times]
    return Speed(threads, provider, len(times) / wall_s, float(np.median(network)), float(np.median(rest)))


def vga_frames() -> list[Frame]:
    """The drive in the package, enlarged by repeating pixels: its content is real, its size the usual one."""
    return [_enlarged(frame) for frame in open_source(RECORDING)]


def endless(frames: Sequence[Frame]) -> Iterator[Frame]:
    """The frames over and over, in order of time."""
    for i in count():
        yield replace(frames[i % len(frames)], stamp_ns=i)


def _enlarged(frame: Frame) -> Frame:
    old = frame.intrinsics
    rows, columns = nearest_indices(HEIGHT, old.height)[:, None], nearest_indices(WIDTH, old.width)
    sx, sy = WIDTH / old.width, HEIGHT / old.height
    camera = Intrinsics(
        WIDTH, HEIGHT, old.fx * sx, old.fy * sy, (old.cx + 0.5) * sx - 0.5, (old.cy + 0.5) * sy - 0.5
    )
    rgb, depth = frame.rgb[rows, columns], frame.depth[rows, columns]
    return replace(frame, intrinsics=camera, rgb=rgb, depth=depth, labels=None)
