"""How many frames a second come out of a recording: what decoding, aligning and poses cost, in one thread.

    python benchmarks/bench_bags.py                    all kinds, of this version
    python benchmarks/bench_bags.py --against DIR      in turns with another checkout of swardmap

With --against, the other checkout runs in a process of its own on the same files, round by round, and the
median of the rounds' ratios is told. Frames are counted a second of the processor, which other programs do
not use up, and a second of the clock. For another commit: `git worktree add --detach DIR COMMIT`.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).parent.parent
FRAMES, MS, START_NS = 60, 1_000_000, 1_700_000_000_000_000_000
KINDS = ("rgb8, not packed", "rgb8", "rgb8, not aligned", "rgb8, tf 3 s late", "yuyv", "nv12", "bayer", "png")
LATE_NS = 3_000_000_000
"""Transforms that were written so long after their time: a reader of its own goes ahead for them."""


def made(kind: str, folder: Path) -> Path:
    """VGA at 30 Hz with tf at 50 Hz, aligned, in chunks of zstd as swardmap writes them; else as named."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    from swardmap.geometry import Intrinsics, mount_pose
    from swardmap.io.bags import ros_fields as rf
    from tests import bags

    camera, rng = Intrinsics(640, 480, 520.0, 520.0, 319.5, 239.5), np.random.default_rng(0)
    v = np.mgrid[:480, :640][0]
    depth = (800 + 8 * (480 - v) + rng.integers(0, 20, v.shape)).astype(np.uint16)
    rgb = np.clip(
        np.stack([60 + v // 8, 150 - v // 8, 50 + v // 9], -1) + rng.integers(-6, 6, (480, 640, 3)), 0, 255
    )
    rgb = rgb.astype(np.uint8)
    color_frame, depth_frame = "color", "depth" if kind == "rgb8, not aligned" else "color"
    mount = mount_pose(0.9, 25.0, parent="base", child="color")
    shift = np.eye(4)
    shift[0, 3] = -0.05
    static = [mount, *([type(mount)("color", "depth", shift)] if depth_frame == "depth" else [])]
    events: list[bags.Event] = [(START_NS - 1, "/tf_static", bags.TF, rf.tf_fields(static, START_NS))]
    late_ns = LATE_NS if kind.endswith("late") else 0
    for k in range(-5, 50 * FRAMES // 30 + 20):
        t = START_NS + k * 20 * MS
        here = np.eye(4)
        here[0, 3] = 0.01 * k
        events.append((t + late_ns, "/tf", bags.TF, rf.tf_fields([type(mount)("map", "base", here)], t)))
    for i in range(FRAMES):
        t = START_NS + i * 33 * MS
        topic, name, fields = color_message(kind, rgb, t, color_frame)
        place = "depth" if depth_frame == "depth" else "aligned_depth_to_color"
        events += [
            (t, topic, name, fields),
            (t, "/cam/color/camera_info", bags.INFO, rf.camera_info_fields(camera, t, color_frame)),
            (t, f"/cam/{place}/image_raw", bags.IMAGE, rf.image_fields(depth, t, depth_frame)),
            (t, f"/cam/{place}/camera_info", bags.INFO, rf.camera_info_fields(camera, t, depth_frame)),
        ]
    store, path = bags.typestore("mcap"), folder / kind.replace(", ", "_").replace(" ", "_")
    writer = Writer(path, version=8, storage_plugin=StoragePlugin.MCAP)
    if kind != "rgb8, not packed":
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    connections: dict[str, Any] = {}
    with writer:
        for t, topic, name, fields in sorted(events, key=lambda e: e[0]):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            assert isinstance(fields, dict)
            writer.write(connections[topic], t, bags.serialized(store, "mcap", name, fields))
    return path


def color_message(kind: str, rgb: Any, t: int, frame: str) -> tuple[str, str, Any]:
    """Topic, type and fields of a colour image."""
    from swardmap.io.bags import ros_fields as rf

    fields = rf.image_fields(rgb, t, frame)
    topic, image = "/cam/color/image_raw", "sensor_msgs/msg/Image"
    if kind.startswith("png"):
        fields = rf.compressed_image_fields(rgb, t, frame, "png")
        return f"{topic}/compressed", "sensor_msgs/msg/CompressedImage", fields
    if kind.startswith("yuyv"):
        data = np.repeat(rgb[..., :1], 2, axis=2)
        fields |= {"encoding": "yuv422_yuy2", "step": 1280, "data": np.ascontiguousarray(data).reshape(-1)}
    elif kind.startswith("nv12"):
        data = cv2.cvtColor(rgb, cv2.COLOR_RGB2YUV_I420)
        fields |= {"encoding": "nv12", "step": 640, "data": data.reshape(-1)}
    elif kind.startswith("bayer"):
        fields |= {
            "encoding": "bayer_rggb8",
            "step": 640,
            "data": np.ascontiguousarray(rgb[..., 1]).reshape(-1),
        }
    return topic, image, fields


def frames_per_second(path: Path) -> tuple[float, float]:
    """Of a second of the processor and of the clock, in one pass, opening included; 0 if it is refused."""
    from swardmap.config import SourceConfig
    from swardmap.errors import SwardmapError
    from swardmap.io import open_source

    busy, began = time.process_time(), time.perf_counter()
    try:
        count = sum(1 for _ in open_source(path, SourceConfig()))
    except SwardmapError:
        return 0.0, 0.0
    return count / (time.process_time() - busy), count / (time.perf_counter() - began)


class Reader:
    """A checkout of swardmap in a process of its own, which reads recordings when it is told to."""

    def __init__(self, checkout: Path) -> None:
        env = os.environ | {"PYTHONPATH": f"{checkout / 'src'}{os.pathsep}{checkout}"}
        command = [sys.executable, str(Path(__file__).resolve()), "--serve"]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, env=env, cwd=checkout, stdin=pipe, stdout=pipe, text=True)

    def read(self, path: Path) -> tuple[float, float]:
        """Frames a second of the processor and of the clock."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(path, file=self.process.stdin, flush=True)
        busy, clock = map(float, self.process.stdout.readline().split())
        return busy, clock


def row(kind: str, ours: Sequence[tuple[float, float]], theirs: Sequence[tuple[float, float]]) -> str:
    """A line of the table: medians, and the medians of the rounds' ratios."""
    cells = [kind, *(f"{median(column):.0f}" for column in zip(*ours, strict=True))]
    if theirs and theirs[0][0] == 0:
        cells += ["refused", "", "", ""]
    elif theirs:
        before = [f"{median(column):.0f}" for column in zip(*theirs, strict=True)]
        rounds = [(a[0] / b[0], a[1] / b[1]) for a, b in zip(ours, theirs, strict=True)]
        cells += [*before, *(f"{median(column):.2f}" for column in zip(*rounds, strict=True))]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Make the recordings, read them, print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--against", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.serve:
        for line in sys.stdin:
            print(*frames_per_second(Path(line.strip())), flush=True)
        return
    sys.path.insert(0, str(ROOT))
    heads = ["recording (VGA)", "frames/s, processor", "clock"]
    heads += ["before, processor", "clock", "ratio, processor", "clock"] if args.against else []
    print(f"| {' | '.join(heads)} |\n|---|{'---:|' * (len(heads) - 1)}", flush=True)
    ours, theirs = Reader(ROOT), Reader(args.against) if args.against else None
    with tempfile.TemporaryDirectory() as folder:
        for kind in args.kinds:
            path = made(kind, Path(folder))
            readers = [ours] if theirs is None else [ours, theirs]
            rounds = [[reader.read(path) for reader in readers] for _ in range(args.rounds + 1)]
            now, *before = zip(*rounds[1:], strict=True)  # the first pass warms up
            print(row(kind, now, before[0] if before else ()), flush=True)


if __name__ == "__main__":
    main()
