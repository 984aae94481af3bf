"""Depth and mask to what a frame says of its cells: `observe` against other ways to do less, in one run.

    python benchmarks/bench_pipeline.py            # about two minutes
    python benchmarks/bench_pipeline.py --memory   # also 10,000 frames, for the peak memory

All cases take the same 12 VGA frames (analytic garden, stereo noise, 448 x 448 masks) in turn, round
robin, so that a slow moment of the machine hits all alike. Medians of processor time; ratios are what can
be trusted.
Open3D is measured when it is installed: pip install open3d.

Against another commit, turn by turn in two processes, processor time of the thread:

    git worktree add ../swardmap-old bbf8619
    python benchmarks/bench_pipeline.py --against ../swardmap-old
"""

import argparse
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads and Open3D's hinder each other

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.config import CloudConfig, Config
from swardmap.grid import GridSpec
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.mapping.last_seen_map import LastSeenMap
from swardmap.pipeline import ObstacleMapper, observe, view_spec
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.synth.analytic_noise import StereoNoise
from swardmap.types import Frame, Segmentation, nearest_indices

Case = Callable[[Frame, Segmentation], object]
CLOUD = CloudConfig()
UNFILTERED = CloudConfig(consistent_neighbours=0)
SETTINGS, SETTINGS_UNFILTERED = Config(cloud=CLOUD), Config(cloud=UNFILTERED)  # built once, as a run does
SETTINGS_PLAIN = Config(cloud=CLOUD, backend="plain")
RESOLUTION_M, MIN_POINTS = 0.05, 3
DEPTH_TO_3D: Any = getattr(cv2, "depthTo3d", None)  # in OpenCV 5; in 4 it was a contrib module


def frames_and_masks(count: int) -> list[tuple[Frame, Segmentation]]:
    """Frames with sensor noise, and their true masks at the size of the network."""
    rows, columns = nearest_indices(448, 480)[:, None], nearest_indices(448, 640)[None, :]
    source = AnalyticSource(
        garden_scene(0), tuple(lane_poses(count, step_m=0.3)), noise=StereoNoise(), seed=1
    )
    pairs = []
    for frame in source:
        assert frame.labels is not None
        labels = np.ascontiguousarray(frame.labels[rows, columns])
        pairs.append((frame, Segmentation(labels, GRASS_OBSTACLE_PERSON)))
    return pairs


def spec_of(frame: Frame) -> GridSpec:
    assert frame.T_map_camera is not None
    return view_spec(frame.intrinsics, frame.T_map_camera, CLOUD.max_range_m, RESOLUTION_M)


def fused(frame: Frame, mask: Segmentation) -> object:
    assert frame.T_map_camera is not None
    return observe(frame, mask, frame.T_map_camera, spec_of(frame), SETTINGS)


def fused_without_filter(frame: Frame, mask: Segmentation) -> object:
    assert frame.T_map_camera is not None
    return observe(frame, mask, frame.T_map_camera, spec_of(frame), SETTINGS_UNFILTERED)


def staged(frame: Frame, mask: Segmentation) -> object:
    assert frame.T_map_camera is not None
    return observe(frame, mask, frame.T_map_camera, spec_of(frame), SETTINGS_PLAIN)


def plain_numpy(frame: Frame, mask: Segmentation) -> NDArray[np.uint8]:
    """Float64 NumPy as one writes it from the paper, without any filter."""
    assert frame.T_map_camera is not None
    spec, K_inverse = spec_of(frame), np.linalg.inv(frame.intrinsics.matrix)
    height, width = frame.depth.shape
    depth_m = frame.depth.astype(np.float64) / 1000
    labels = mask.labels[nearest_indices(height, 448)[:, None], nearest_indices(width, 448)[None, :]]
    v, u = np.nonzero((depth_m >= CLOUD.min_range_m) & (depth_m <= CLOUD.max_range_m))
    points = (np.stack([u, v, np.ones_like(u)], axis=1) @ K_inverse.T) * depth_m[v, u][:, None]
    return _grid_of(frame.T_map_camera.apply(points), labels[v, u], spec)


def opencv(frame: Frame, mask: Segmentation) -> NDArray[np.uint8]:
    """OpenCV's depthTo3d and transform, then NumPy; without any filter."""
    assert frame.T_map_camera is not None
    spec = spec_of(frame)
    height, width = frame.depth.shape
    labels = cv2.resize(mask.labels, (width, height), interpolation=cv2.INTER_NEAREST)
    cloud = DEPTH_TO_3D(frame.depth, frame.intrinsics.matrix)
    matrix = frame.T_map_camera.matrix[:3]
    moved = cv2.transform(
        np.ascontiguousarray(cloud.reshape(-1, 1, cloud.shape[-1])[..., :3]), matrix
    ).reshape(-1, 3)
    keep = (frame.depth.ravel() >= 300) & (frame.depth.ravel() <= 8000)
    return _grid_of(moved[keep], labels.ravel()[keep], spec)


def open3d_chain(o3d: Any) -> Case:
    """Open3D's usual chain: RGB-D to cloud, voxel grid, statistical outliers; then NumPy."""

    def run(frame: Frame, mask: Segmentation) -> NDArray[np.uint8]:
        assert frame.T_map_camera is not None
        k = frame.intrinsics
        camera = o3d.camera.PinholeCameraIntrinsic(k.width, k.height, k.fx, k.fy, k.cx, k.cy)
        rows, columns = nearest_indices(k.height, 448)[:, None], nearest_indices(k.width, 448)[None, :]
        labels = mask.labels[rows, columns]
        color = o3d.geometry.Image(np.repeat(labels[..., None], 3, axis=2).copy())
        rgbd = o3d.geometry.RGBDImage.create_from_color_and_depth(
            color, o3d.geometry.Image(frame.depth), 1000.0, CLOUD.max_range_m, False
        )  # fmt: skip
        cloud = o3d.geometry.PointCloud.create_from_rgbd_image(rgbd, camera)
        cloud = cloud.transform(frame.T_map_camera.matrix).voxel_down_sample(0.05)
        cloud, _ = cloud.remove_statistical_outlier(20, 2.0)
        ids = np.rint(np.asarray(cloud.colors)[:, 0] * 255).astype(np.uint8)
        return _grid_of(np.asarray(cloud.points), ids, spec_of(frame))

    return run


def _grid_of(points: NDArray[np.floating], labels: NDArray[np.uint8], spec: GridSpec) -> NDArray[np.uint8]:
    """Clear grass, then mark obstacles: Sec. 3.5 with index sets."""
    in_height = (points[:, 2] >= CLOUD.min_height_m) & (points[:, 2] <= CLOUD.max_height_m)
    cells, labels = spec.cell_of(points[in_height, :2]), labels[in_height]
    inside = spec.contains(cells)
    (ix, iy), labels = cells[inside].T, labels[inside]
    grid = np.zeros(spec.shape, np.uint8)
    grass = labels == 1
    grid[iy[grass], ix[grass]] = 1
    grid[iy[~grass], ix[~grass]] = 2
    return grid


def measure(cases: dict[str, Case], pairs: list[tuple[Frame, Segmentation]], rounds: int) -> dict[str, float]:
    """Median milliseconds of processor time (all threads) a frame of each case, round robin."""
    for case in cases.values():
        case(*pairs[0])
    times: dict[str, list[float]] = {name: [] for name in cases}
    for i in range(rounds):
        for name, case in cases.items():
            started = time.process_time()
            case(*pairs[i % len(pairs)])
            times[name].append(1e3 * (time.process_time() - started))
    return {name: float(np.median(values)) for name, values in times.items()}


WORKER = """
import sys, time
from bench_pipeline import frames_and_masks, fused

pairs = frames_and_masks(12)
fused(*pairs[0])
print("ready", flush=True)
for _ in sys.stdin:
    took = []
    for pair in pairs:
        started = time.thread_time()
        fused(*pair)
        took.append(time.thread_time() - started)
    print(*took, flush=True)
"""


def against(old: Path, rounds: int) -> dict[str, list[float]]:
    """Milliseconds of processor time a frame, of this checkout and another, 12 frames in turn."""
    folders = {"here": Path(__file__).parents[1], str(old): old}
    workers = {
        name: subprocess.Popen(
            [sys.executable, "-c", WORKER],
            env={**os.environ, "PYTHONPATH": f"{folder / 'src'}:{folder / 'benchmarks'}"},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        for name, folder in folders.items()
    }  # fmt: skip
    times: dict[str, list[float]] = {name: [] for name in workers}
    for i in range(-1, rounds):
        for name, worker in workers.items():
            assert worker.stdin is not None
            assert worker.stdout is not None
            if i >= 0:
                worker.stdin.write("\n")
                worker.stdin.flush()
            told = worker.stdout.readline().split()
            if i > 0:  # the first round warms up
                times[name] += [1e3 * float(seconds) for seconds in told]
    for worker in workers.values():
        worker.communicate()
    return times


def print_against(old: Path, rounds: int) -> None:
    """Median and minimum of both, and their ratios."""
    times = against(old, rounds)
    for name, values in times.items():
        print(f"{name:<42}{np.median(values):>12.2f} ms median{min(values):>8.2f} ms minimum")
    new, base = times.values()
    medians, minima = np.median(new) / np.median(base), min(new) / min(base)
    print(f"ratio of medians {medians:.2f}, of minima {minima:.2f}")


def files_to_map(pairs: list[tuple[Frame, Segmentation]]) -> float:
    """Frames a second of processor time from PNG depth and JPEG colour to the map, without segmentation."""
    encoded = [
        (cv2.imencode(".png", f.depth)[1], cv2.imencode(".jpg", f.rgb[..., ::-1])[1], f, m) for f, m in pairs
    ]
    mapper = LastSeenMap(Config().grid)
    started = time.process_time()
    for depth, color, frame, mask in encoded:
        images: list[Any] = [cv2.imdecode(depth, cv2.IMREAD_UNCHANGED), cv2.imdecode(color, cv2.IMREAD_COLOR)]
        read = replace(frame, depth=images[0], rgb=cv2.cvtColor(images[1], cv2.COLOR_BGR2RGB))
        assert read.T_map_camera is not None
        mapper.integrate(observe(read, mask, read.T_map_camera, spec_of(read), SETTINGS))
    return len(encoded) / (time.process_time() - started)


def memory_over(pairs: list[tuple[Frame, Segmentation]], count: int) -> list[tuple[int, float]]:
    """Peak memory in MB after each tenth of a long sequence driven to and fro."""
    mapper = ObstacleMapper(_GivenMask(pairs), Config())
    marks = []
    for i in range(count):
        frame = pairs[i % len(pairs)][0]
        mapper.step(replace(frame, stamp_ns=i))
        if (i + 1) % (count // 10) == 0:
            marks.append((i + 1, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))
    return marks


class _GivenMask:
    """A segmenter that looks up the mask made before."""

    name = "given"
    label_set = GRASS_OBSTACLE_PERSON

    def __init__(self, pairs: list[tuple[Frame, Segmentation]]) -> None:
        self._mask_of = {frame.name: mask for frame, mask in pairs}

    def __call__(self, frame: Frame) -> Segmentation:
        return self._mask_of[frame.name]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--memory", action="store_true")
    parser.add_argument("--against", type=Path, help="checkout of another commit")
    arguments = parser.parse_args()
    if arguments.against is not None:
        print_against(arguments.against.resolve(), arguments.rounds)
        return
    pairs = frames_and_masks(12)
    cases: dict[str, Case] = {
        "observe, compiled (the default)": fused,
        "observe, compiled, no 3x3 filter": fused_without_filter,
        "observe, plain NumPy (the twin)": staged,
        "plain float64 NumPy, no filter": plain_numpy,
    }
    if DEPTH_TO_3D is not None:
        cases["OpenCV depthTo3d + NumPy, no filter"] = opencv
    try:
        import open3d
    except ImportError:
        print("Open3D is not installed: left out")
    else:
        cases["Open3D + voxel grid + outliers + NumPy"] = open3d_chain(open3d)
    medians = measure(cases, pairs, arguments.rounds)
    print(f"{'640 x 480, 0.05 m cells':<42}{'ms a frame':>12}{'x default':>10}")
    for name, milliseconds in medians.items():
        ratio = milliseconds / medians["observe, compiled (the default)"]
        print(f"{name:<42}{milliseconds:>12.2f}{ratio:>10.1f}")
    print(f"PNG + JPEG files to map, {files_to_map(pairs * 4):.0f} frames a second of processor time")
    if arguments.memory:
        for count, megabytes in memory_over(pairs, 10_000):
            print(f"peak memory after {count:>6} frames: {megabytes:.0f} MB")


if __name__ == "__main__":
    main()
