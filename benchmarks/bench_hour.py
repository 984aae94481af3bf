"""One hour of mowing in accelerated time: memory, places of the cells, and the map that was saved.

    python benchmarks/bench_hour.py               # 54,000 frames, some ten minutes
    python benchmarks/bench_hour.py --minutes 5

A mower drives lanes over a lawn of 40 x 28 m with 112 things on it, at 0.45 m/s and 15 frames a second, in
coordinates as large as UTM's. Beside the living map a second one is made at once in absolute coordinates: one
dense array for the whole lawn, float64 from the pixels to the cells, the NumPy twins of the kernels, no
tiles.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config, config_from_dict
from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.grid import GridSpec, OccupancyGrid, overlap
from swardmap.io.maps.log_odds_files import read_living_map, write_living
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.mapping.sensor_model import Cells, Viewpoint, cells_passed, parameters, update_cells
from swardmap.pipeline import ObstacleMapper
from swardmap.synth.analytic import Box, Cylinder, Scene, sphere, true_map
from swardmap.synth.analytic_render import cast
from swardmap.types import Frame, Segmentation

CAMERA = Intrinsics(80, 60, 57.5, 57.5, 39.5, 29.5)
EAST_M, NORTH_M = 364_912.37, 5_806_211.74
"""Where the lawn's corner lies: as large as UTM coordinates get."""

LENGTH_M, LANE_M, LANES = 40.0, 2.0, 15
SPEED_MPS, RATE_HZ, TURN_S = 0.45, 15.0, 3.0
RANGE_M = 6.0
CONFIG = config_from_dict(
    {
        "grid": {"mode": "evidence", "min_grass_points": 3, "clear_together": False},
        # the reference counts each cell alone, and has no filter of its own
        "cloud": {"max_range_m": RANGE_M, "consistent_neighbours": 0},
    }
)


class Truth:
    """True masks."""

    name, label_set = "truth", GRASS_OBSTACLE_PERSON

    def __call__(self, frame: Frame) -> Segmentation:
        assert frame.labels is not None
        return Segmentation(frame.labels, GRASS_OBSTACLE_PERSON)


def lawn(seed: int = 0) -> Scene:
    """Balls, boxes and poles between the lanes, in coordinates of the lawn's own corner."""
    rng = np.random.default_rng(seed)
    solids: list[Box | Cylinder | object] = []
    for lane in range(LANES - 1):
        for x in np.arange(2.5, LENGTH_M, 5.0):
            place = float(x + rng.uniform(-1.5, 1.5)), float(LANE_M * (lane + 0.5) + rng.uniform(-0.2, 0.2))
            size = float(rng.uniform(0.1, 0.3))
            kinds = (
                sphere((*place, size), size),
                Box(place, (size, 0.4, 0.5), float(rng.uniform(0, 90))),
                Cylinder(place, size / 3, 1.2),
            )
            solids.append(kinds[int(rng.integers(3))])
    return Scene(tuple(solids), name="lawn")  # type: ignore[arg-type]


def way() -> Iterator[tuple[float, float, float]]:
    """Place and heading (degrees) of each frame, for ever: lanes to and fro, turns on the spot, and back."""
    step, turn = SPEED_MPS / RATE_HZ, int(TURN_S * RATE_HZ)
    lanes = [*range(LANES), *range(LANES - 2, 0, -1)]
    x, forward = 0.0, True
    while True:
        for lane in lanes:
            y, heading = lane * LANE_M, 0.0 if forward else 180.0
            for _ in range(int(LENGTH_M / step)):
                x += step if forward else -step
                yield x, y, heading
            for i in range(turn):
                yield x, y, heading + 180.0 * (i + 1) / turn
            forward = not forward


def drive(scene: Scene, seed: int = 1, stride: int = 1) -> Iterator[Frame]:
    """Each `stride`-th frame of the mower: it sways, and its heading is never exact. Colour is not needed."""
    rng = np.random.default_rng(seed)
    black = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    middles = np.array([np.mean(solid.bounds(), axis=0)[:2] for solid in scene.solids])
    for i, (x, y, heading_deg) in enumerate(islice(way(), 0, None, stride)):
        sway = rng.normal(0, 0.02, 2)
        x, y, heading_deg = x + sway[0], y + sway[1], heading_deg + rng.normal(0, 1.0)
        near = np.hypot(*(middles - (x, y)).T) < RANGE_M + 3
        solids = tuple(solid for solid, close in zip(scene.solids, near, strict=True) if close)
        here = mount_pose(0.9, 25.0, 0.0, heading_deg, (x, y), parent="map")
        hits = cast(solids, (), CAMERA, here)
        depth = np.where(hits.depth_m < 20, hits.depth_m, 0).astype(np.float32)
        there = here.matrix.copy()
        there[:2, 3] += EAST_M, NORTH_M
        yield Frame(
            round(i * stride * 1e9 / RATE_HZ),
            CAMERA,
            black,
            depth,
            T_map_camera=Pose("map", "camera", there),
            labels=hits.labels,
            label_set=GRASS_OBSTACLE_PERSON,
        )


class AtOnce:
    """The same map as one dense array over the whole lawn, in float64 and absolute coordinates."""

    def __init__(self, config: Config) -> None:
        self._config = config
        r, air = config.grid.resolution_m, RANGE_M + 2
        low, high = (EAST_M - air, NORTH_M - air), (EAST_M + LENGTH_M + air, NORTH_M + LANES * LANE_M + air)
        self.spec = GridSpec.covering(r, low, high)
        self.cells = Cells.unknown(*self.spec.shape)
        self._model = parameters(config.evidence, config.grid.min_points, config.grid.min_grass_points)

    def add(self, frame: Frame) -> None:
        """Let one frame speak."""
        cloud, r, pose = self._config.cloud, self.spec.resolution_m, frame.T_map_camera
        assert pose is not None
        assert frame.labels is not None
        v, u = np.indices(frame.depth.shape)
        z = frame.depth.astype(np.float64)
        rays = np.stack(((u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(z.shape)), axis=-1)
        points = pose.apply((rays * z[..., None]).reshape(-1, 3))
        use = (z.ravel() >= cloud.min_range_m) & (z.ravel() <= cloud.max_range_m)
        use &= (points[:, 2] >= cloud.min_height_m) & (points[:, 2] <= cloud.max_height_m)
        cells = np.floor((points[use, :2] - self.spec.origin_m) / r).astype(np.int64)
        low, high = cells.min(axis=0) - 1, cells.max(axis=0) + 2
        classes = GRASS_OBSTACLE_PERSON.map_class_table[frame.labels.ravel()[use]]
        counts = np.zeros((*(high - low)[::-1], 4), np.uint32)
        np.add.at(counts, (cells[:, 1] - low[1], cells[:, 0] - low[0], classes), 1)
        corner = np.asarray(self.spec.origin_m) + low * r
        window = GridSpec(r, counts.shape[1], counts.shape[0], (float(corner[0]), float(corner[1])))
        x, y, height = pose.position_m.tolist()
        view = Viewpoint.of((x, y, height), height, window, self._config.evidence, cloud.min_height_m)
        grid = self._config.grid
        passed = cells_passed(counts, view, grid.min_points, grid.min_grass_points)
        block = self.cells[slice(low[1], high[1]), slice(low[0], high[0])]
        update_cells(counts, passed, view, (0, 0), self._model, block)


@dataclass
class Sample:
    """What is looked at now and then."""

    minutes: float
    rss_mb: float
    tiles_mb: float
    window_mb: float


@dataclass
class Hour:
    """What a drive gave.

    Attributes:
        samples: memory.
        known: cells the living map knows.
        differ: cells whose class is another in the map made at once.
        shifts: share of true obstacle cells that are marked, if the map is moved by (dx, dy) cells.
        beside: hazard cells of the window that are none in the map of the whole lawn, at most.
        saved_equal: whether every tile came back from the file.
        goes_on_equal: and whether a minute more made the same map of it as of the live one.
        file_mb: of the saved map.
    """

    samples: list[Sample] = field(default_factory=list)
    known: int = 0
    differ: int = 0
    shifts: dict[tuple[int, int], float] = field(default_factory=dict)
    beside: int = 0
    saved_equal: bool = False
    goes_on_equal: bool = False
    file_mb: float = 0.0


def mow(minutes: float, every_min: float, folder: Path) -> Hour:
    """Drive, look at everything, save, load, and drive on."""
    scene, hour, at_once = lawn(), Hour(), AtOnce(CONFIG)
    window_config = config_from_dict(
        {"grid": {"mode": "evidence", "min_grass_points": 3, "clear_together": False},
         "evidence": {"window_m": 12.0},
         "cloud": {"max_range_m": RANGE_M, "consistent_neighbours": 0}}
    )  # fmt: skip
    whole, window = ObstacleMapper(Truth(), CONFIG), ObstacleMapper(Truth(), window_config)
    frames, count = drive(scene), round(minutes * 60 * RATE_HZ)
    every = max(1, round(every_min * 60 * RATE_HZ))
    for i, frame in enumerate(islice(frames, count), start=1):
        whole.step(frame)
        window.step(frame)
        at_once.add(frame)
        if i % every == 0 or i == count:
            assert whole.log_odds is not None
            assert window.log_odds is not None
            sizes = whole.log_odds.nbytes / 1e6, window.log_odds.nbytes / 1e6
            hour.samples.append(Sample(i / 60 / RATE_HZ, rss_mb(), *sizes))
            hour.beside = max(hour.beside, _beside(window.map, whole.map))
    _compare(hour, whole.map, at_once, scene)
    assert whole.log_odds is not None
    _save(hour, whole, folder / "living.npz", frames)
    return hour


def _beside(window: OccupancyGrid | None, whole: OccupancyGrid | None) -> int:
    assert window is not None
    assert whole is not None
    here, there = overlap(window.spec, whole.spec)
    return int((window.is_obstacle[here] & ~whole.is_obstacle[there]).sum())


def _compare(hour: Hour, grid: OccupancyGrid | None, at_once: AtOnce, scene: Scene) -> None:
    assert grid is not None
    here, there = overlap(grid.spec, at_once.spec)
    live, dense = grid.classes[here], at_once.cells.classes[there]
    hour.known = int(np.count_nonzero(grid.classes))
    hour.differ = int((live != dense).sum()) + hour.known - int(np.count_nonzero(live))
    (x, y), r = grid.spec.origin_m, grid.spec.resolution_m
    local = GridSpec(r, grid.spec.width, grid.spec.height, (x - EAST_M, y - NORTH_M))
    true = true_map(scene, local).is_obstacle & (grid.classes > 0)
    marked = grid.is_obstacle
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            hour.shifts[dx, dy] = float(np.roll(marked, (dy, dx), axis=(0, 1))[true].mean())


def _save(hour: Hour, mapper: ObstacleMapper, path: Path, frames: Iterator[Frame]) -> None:
    living = mapper.log_odds
    assert living is not None
    write_living(living, path, CONFIG)
    hour.file_mb = path.stat().st_size / 1e6
    loaded = read_living_map(path, CONFIG)
    hour.saved_equal = same(living, loaded)
    goes_on = ObstacleMapper(Truth(), CONFIG, log_odds=loaded)
    for frame in islice(frames, round(60 * RATE_HZ)):
        mapper.step(frame)
        goes_on.step(frame)
    hour.goes_on_equal = same(living, loaded)


def same(one: LogOddsMap, two: LogOddsMap) -> bool:
    """Whether two maps hold the same evidence in the same cells."""
    if set(one.tiles) != set(two.tiles) or one.corner_cell != two.corner_cell:
        return False
    return all(
        np.array_equal(getattr(tile, name), getattr(two.tiles[key], name))
        for key, tile in one.tiles.items()
        for name in ("evidence", "person", "classes")
    )


def rss_mb() -> float:
    """Memory of this process that is in use now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def marked_share(shifts: dict[tuple[int, int], float]) -> NDArray[np.float64]:
    """(5, 5) share of true obstacle cells that are marked, by shift in cells; the middle is no shift."""
    return np.array([[shifts[dx, dy] for dx in range(-2, 3)] for dy in range(-2, 3)])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=60.0)
    minutes = parser.parse_args().minutes
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        hour = mow(minutes, minutes / 12, Path(folder))
    frames = round(minutes * 60 * RATE_HZ)
    print(f"{minutes:g} minutes, {frames} frames, {frames / RATE_HZ * SPEED_MPS:.0f} m; took "
          f"{time.perf_counter() - started:.0f} s\n")  # fmt: skip
    print("| minutes | process MB | tiles MB | window's tiles MB |\n|---:|---:|---:|---:|")
    for s in hour.samples:
        print(f"| {s.minutes:.0f} | {s.rss_mb:.1f} | {s.tiles_mb:.2f} | {s.window_mb:.2f} |")
    print(f"\ncells known: {hour.known}; of another class in the map made at once: {hour.differ}")
    print(f"hazard cells of the window that are none in the whole map, at most: {hour.beside}")
    print("true obstacle cells marked %, by shift of the map in cells:")
    for row in 100 * marked_share(hour.shifts)[::-1]:
        print("  " + " ".join(f"{value:5.1f}" for value in row))
    print(f"saved map ({hour.file_mb:.2f} MB) equal to the live one: {hour.saved_equal}; "
          f"after a minute more: {hour.goes_on_equal}")  # fmt: skip


if __name__ == "__main__":
    main()
