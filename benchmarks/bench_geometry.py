"""Geometry beside semantics: what each finds, what both find, and what it costs a frame.

    python benchmarks/bench_geometry.py                      # some minutes
    python benchmarks/bench_geometry.py --gardens gardens/   # of `swardmap synth`, with the package's network

Analytic scenes with exact truth, depth with stereo noise (sigma 2 mm at 1 m, growing with the square of
the depth, holes, flying pixels), and a network that errs: a share of every solid's surface and some
whole solids are called grass, and some of the lawn an obstacle. The reference of each frame is made of
exact depth and true labels; a hole counts as an obstacle. All settings are those shipped, but for geometry,
which is on.
"""

import argparse
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config, GeometryConfig, SegmenterConfig
from swardmap.eval.dmin import find_misses
from swardmap.eval.maps import frame_map, spec_of, true_segmentation
from swardmap.eval.truth import dense_map, true_pixels
from swardmap.geometry import Pose
from swardmap.grid import OccupancyGrid
from swardmap.io import open_source
from swardmap.labels import GRASS, GRASS_OBSTACLE_PERSON, OTHER, PERSON, MapClass
from swardmap.models import build_segmenter
from swardmap.pipeline import observe
from swardmap.synth.analytic import (
    VGA,
    Box,
    Cylinder,
    Ellipsoid,
    Patch,
    Scene,
    garden_scene,
    lane_poses,
    render,
    with_sensor_noise,
)
from swardmap.synth.analytic_render import cast
from swardmap.types import Frame, Segmentation

CONFIG = Config(geometry=GeometryConfig(enabled=True))
SHARE_OF_SURFACE, SHARE_OF_SOLIDS, SHARE_OF_LAWN = 0.2, 0.2, 0.004


@dataclass(frozen=True)
class Case:
    """A scene on a lawn that may slope, and what becomes of its frames."""

    name: str
    scene: Scene
    slope_deg: float = 0.0
    roll_deg: float = 0.0
    grass_m: float = 0.0  # height of the longest blades
    pit: tuple[float, float, float, float, float] | None = None  # x, y, length, width, depth
    bend_deg: float = 0.0  # the lawn turns by it at x = 3 m


def tilt(slope_deg: float, roll_deg: float) -> NDArray[np.float64]:
    """(4, 4) turn of the world: uphill along x, and along y."""
    (cs, ss), (cr, sr) = ((np.cos(a), np.sin(a)) for a in np.deg2rad([slope_deg, roll_deg]))
    turned = np.eye(4)
    turned[:3, :3] = np.array([[cs, 0, -ss], [0, 1, 0], [ss, 0, cs]]) @ np.array(
        [[1, 0, 0], [0, cr, -sr], [0, sr, cr]]
    )
    return turned


def with_pit(frame: Frame, case: Case) -> Frame:
    """The frame as if a box was dug out of the lawn: its floor or its far wall, in closed form."""
    if case.pit is None or frame.T_map_camera is None or frame.labels is None:
        return frame
    x, y, length, width, deep = case.pit
    rays, origin = _rays(frame), frame.T_map_camera.position_m
    with np.errstate(divide="ignore", invalid="ignore"):
        at_lawn = origin[:2] + rays[..., :2] * (-origin[2] / rays[..., 2])[..., None]
        inside = (np.abs(at_lawn - (x, y)) < (length / 2, width / 2)).all(axis=-1)
        inside &= (frame.labels == GRASS.id) & (rays[..., 2] < 0)
        limits = [(-origin[2] - deep) / rays[..., 2], (x + length / 2 - origin[0]) / rays[..., 0]]
        limits += [(y + side * width / 2 - origin[1]) / rays[..., 1] for side in (-1, 1)]
        inner = np.minimum.reduce([np.where(t > 0, t, np.inf) for t in limits])
    depth = np.where(inside, inner, frame.depth_m).astype(np.float32)
    labels = np.where(inside, OTHER.id, frame.labels).astype(np.uint8)
    return replace(frame, depth=np.nan_to_num(depth), labels=labels)


def with_grass(frame: Frame, blades_m: float, rng: np.random.Generator) -> Frame:
    """The lawn's readings lifted: tufts and blades up to a height, in patches and from pixel to pixel."""
    if blades_m == 0 or frame.T_map_camera is None or frame.labels is None:
        return frame
    h, w = frame.depth.shape
    tufts = cv2.resize(rng.random((h // 12, w // 12)), (w, h), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    lift = blades_m * (0.6 * tufts + 0.4 * rng.random((h, w)))
    with np.errstate(divide="ignore"):
        nearer = lift / -_rays(frame)[..., 2]
    lawn = (frame.labels == GRASS.id) & np.isfinite(nearer)
    depth = np.where(lawn & (nearer < 0.9 * frame.depth_m), frame.depth_m - nearer, frame.depth_m)
    return replace(frame, depth=np.nan_to_num(depth).astype(np.float32))


def with_bend(frame: Frame, bend_deg: float) -> Frame:
    """An empty lawn that turns uphill by an angle at x = 3 m."""
    if bend_deg == 0 or frame.T_map_camera is None or frame.labels is None:
        return frame
    rays, origin = _rays(frame), frame.T_map_camera.position_m
    rise = np.tan(np.deg2rad(bend_deg))
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = -origin[2] / rays[..., 2]
        slope = ((origin[0] - 3) * rise - origin[2]) / (rays[..., 2] - rise * rays[..., 0])
    flat_there = (flat > 0) & (origin[0] + flat * rays[..., 0] < 3)
    depth = np.where(flat_there, flat, np.where((slope > 0) & (slope < 30), slope, 0)).astype(np.float32)
    labels = np.where(depth > 0, GRASS.id, 255).astype(np.uint8)
    return replace(frame, depth=depth, labels=labels)


def erring(frame: Frame, surface: NDArray[np.int16], rng: np.random.Generator) -> Segmentation:
    """What a network may say: parts of the obstacles are grass to it, and a little of the lawn is not.

    Args:
        frame: with true labels.
        surface: (H, W) which solid or patch a pixel shows.
        rng: source of chance.
    """
    assert frame.labels is not None
    labels = frame.labels.copy()
    h, w = labels.shape
    obstacle = (labels == OTHER.id) | (labels == PERSON.id)
    blobs = cv2.resize(rng.random((h // 16, w // 16)), (w, h), interpolation=cv2.INTER_LINEAR)
    labels[obstacle & (blobs < np.quantile(blobs, SHARE_OF_SURFACE))] = GRASS.id
    for index in np.unique(surface[obstacle]):
        if rng.random() < SHARE_OF_SOLIDS:
            labels[obstacle & (surface == index)] = GRASS.id
    blobs = cv2.resize(rng.random((h // 8, w // 8)), (w, h), interpolation=cv2.INTER_LINEAR)
    labels[(frame.labels == GRASS.id) & (blobs < np.quantile(blobs, SHARE_OF_LAWN))] = OTHER.id
    return Segmentation(labels, GRASS_OBSTACLE_PERSON)


def _rays(frame: Frame) -> NDArray[np.float64]:
    assert frame.T_map_camera is not None
    ray_x, ray_y = frame.intrinsics.ray_tables()
    R = frame.T_map_camera.matrix[:3, :3]
    return np.asarray(ray_x[None, :, None] * R[:, 0] + ray_y[:, None, None] * R[:, 1] + R[:, 2], np.float64)


@dataclass(frozen=True)
class Shown:
    """One view.

    Attributes:
        exact: frame with exact depth and true labels.
        noisy: as the sensor gives it.
        mask: as the network gives it.
        above_lawn: what makes true heights above the lawn of points of the camera; None = z of the map.
    """

    exact: Frame
    noisy: Frame
    mask: Segmentation
    above_lawn: NDArray[np.float32] | None = None


def frames(case: Case, poses: list[Pose], seed: int = 0) -> Iterator[Shown]:
    """A case as it is seen, in a world that slopes."""
    turn = tilt(case.slope_deg, case.roll_deg)
    for i, pose in enumerate(poses):
        rng = np.random.default_rng([seed, i])
        exact = render(case.scene, VGA, pose, i * 200_000_000, f"{i:06d}", exact=True)
        exact = with_bend(with_pit(exact, case), case.bend_deg)
        noisy = with_sensor_noise(with_grass(exact, case.grass_m, rng), rng)
        there = Pose("map", "camera", turn @ pose.matrix)
        surface = cast(case.scene.at(exact.stamp_ns), case.scene.patches, VGA, pose).surface
        mask = erring(exact, surface, rng)
        yield Shown(exact.with_pose(there), noisy.with_pose(there), mask, pose.matrix[2].astype(np.float32))


KERB = Scene((Box((4.0, 0.0), (0.2, 9.0, 0.2)),), name="kerb")


def cases() -> list[Case]:
    """What is measured."""
    small = Scene((Box((2.6, 0.4), (0.2, 0.2, 0.2)), Box((4.5, -0.6), (0.2, 0.2, 0.2)),
                   Box((6.0, 0.8), (0.2, 0.2, 0.2))), name="boxes")  # fmt: skip
    lying = Scene((Ellipsoid((3.2, 0.2, 0.11), (0.3, 0.85, 0.14), PERSON),
                   Ellipsoid((5.6, -0.5, 0.11), (0.85, 0.25, 0.14), PERSON)), name="lying")  # fmt: skip
    kerb = Scene((Box((4.0, 0.0), (0.15, 9.0, 0.15)),), name="kerb")
    step = Scene((Box((6.5, 0.0), (5.0, 12.0, 0.2)),), name="terrace")
    posts = Scene((Cylinder((3.0, -0.5), 0.04, 0.8), Cylinder((5.0, 0.7), 0.04, 0.8)), name="posts")
    hose = Scene((Box((2.5, 0.0), (0.05, 3.0, 0.05)),), name="low")
    path = Scene((), (Patch((3.5, 0.0), (1.0, 8.0)),), name="path")
    empty = Scene(name="empty")
    gardens = [Case(f"garden {seed}", garden_scene(seed)) for seed in range(3)]
    sloping = [replace(gardens[0], name=f"garden 0, slope {s:+d}", slope_deg=s) for s in (-10, 10)]
    return [
        *gardens, *sloping,
        Case("20 cm boxes", small), Case("20 cm boxes, slope +15", small, 15.0), Case("lying persons", lying),
        Case("kerb of 15 cm", kerb),
        Case("kerb of 20 cm", KERB), Case("terrace, step of 20 cm", step), Case("posts", posts),
        Case("pit 0.8 x 0.8 x 0.4 m", empty, pit=(3.0, 0.0, 0.8, 0.8, 0.4)),
        Case("pit, slope +10", empty, 10.0, pit=(3.0, 0.0, 0.8, 0.8, 0.4)),
        Case("ditch 0.5 m wide", empty, pit=(3.5, 0.0, 0.5, 20.0, 0.4)),
        Case("ditch 0.5 m wide, near", empty, pit=(1.9, 0.0, 0.5, 20.0, 0.4)),
        Case("empty lawn", empty), Case("slope +15", empty, 15.0), Case("slope -15", empty, -15.0),
        Case("slope +20", empty, 20.0), Case("across a slope of 15", empty, roll_deg=15.0),
        Case("grass up to 6 cm", empty, grass_m=0.06), Case("grass up to 10 cm", empty, grass_m=0.1),
        Case("grass up to 20 cm", empty, grass_m=0.2), Case("foot of a slope, +10", empty, bend_deg=10.0),
        Case("foot of a slope, +15", empty, bend_deg=15.0), Case("low edge of 5 cm", hose),
        Case("flat path", path),
    ]  # fmt: skip


@dataclass
class Tally:
    """Cells of all frames of a case."""

    positives: int = 0
    missed: int = 0
    negatives: int = 0
    false: int = 0
    distance_m: float = 0.0
    lost: int = 0
    solids: int = 0
    solids_missed: int = 0
    missed_unjudged: int = 0  # of the missed cells, those that the network alone leaves unknown

    def add(self, reference: NDArray[np.uint8], predicted: NDArray[np.uint8], resolution_m: float) -> None:
        """Count one frame; cells unknown in either map are left out."""
        known = (reference > 0) & (predicted > 0)
        hazard, called = reference >= MapClass.OBSTACLE, predicted >= MapClass.OBSTACLE
        self.positives += int((hazard & known).sum())
        self.negatives += int((~hazard & known).sum())
        self.missed += int((hazard & known & ~called).sum())
        self.false += int((~hazard & known & called).sum())
        misses = find_misses(reference, predicted)
        d = misses.d_min_m(resolution_m)
        self.distance_m += float(d[np.isfinite(d)].sum())
        self.lost += int((~np.isfinite(d)).sum())
        self.solids += misses.obstacles
        self.solids_missed += len(misses.missed)

    def columns(self) -> list[str]:
        """FN %, FP %, mean d_min-obst in metres, obstacles without one marked cell / all, over all frames."""
        near = self.missed - self.lost
        return [
            f"{100 * self.missed / self.positives:.1f}" if self.positives else "-",
            f"{100 * self.false / self.negatives:.2f}" if self.negatives else "-",
            f"{self.distance_m / near:.2f}" if near > 0 else "-",
            f"{self.solids_missed}/{self.solids}" if self.solids else "-",
        ]


def measure(views: Iterable[Shown], config: Config = CONFIG) -> dict[str, Tally]:
    """Semantics alone, geometry alone and both, over views of one case."""
    off = replace(config, geometry=GeometryConfig(enabled=False))
    found = {name: Tally() for name in ("semantics", "geometry", "both")}
    for view in views:
        exact, noisy, mask = view.exact, view.noisy, view.mask
        pose = noisy.T_map_camera
        assert pose is not None
        spec = spec_of(noisy, pose, config)
        truth = dense_map(true_pixels(exact, pose, config), true_segmentation(exact), spec).classes
        semantic = frame_map(noisy, mask, pose, off, spec)
        both = frame_map(noisy, mask, pose, config, spec)
        marks = observe(noisy, mask, pose, spec, config).geometry
        assert marks is not None
        # alone it clears nothing; to compare, what was seen and not marked is taken for grass here
        alone = np.maximum(2 * marks.marks.astype(np.uint8), (both.classes > 0).astype(np.uint8))
        for name, classes in (("semantics", semantic.classes), ("geometry", alone), ("both", both.classes)):
            found[name].add(truth, classes, spec.resolution_m)
            missed = (truth >= MapClass.OBSTACLE) & (classes == MapClass.GRASS)
            found[name].missed_unjudged += int((missed & (semantic.classes == 0)).sum())
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--gardens", type=Path, help="folder that `swardmap synth` made")
    arguments = parser.parse_args()
    poses = lane_poses(arguments.frames, step_m=0.15)
    head = ["FN %", "FP %", "d_min", "missed"]
    print(f"{'':<32}" + "".join(f"{name:^44}" for name in ("semantics", "geometry", "both")))
    print(f"{'':<32}" + "".join(f"{h:>11}" for h in head * 3))
    if arguments.gardens is not None:
        for name, views in rendered(arguments.gardens):
            found = measure(views)
            _print(name, found)
            alone, both = found["semantics"], found["both"]
            print(
                f"  obstacle cells marked by the network {alone.positives - alone.missed}, by both "
                f"{both.positives - both.missed}; called free by both {both.missed}, of which the network "
                f"alone leaves {both.missed_unjudged} unknown"
            )
        return
    for case in cases():
        _print(case.name, measure(frames(case, poses)))
    speed(poses, arguments.rounds)


def _print(name: str, found: dict[str, Tally]) -> None:
    print(
        f"{name:<32}" + "".join(f"{c:>11}" for tally in found.values() for c in tally.columns()), flush=True
    )


def rendered(folder: Path) -> Iterator[tuple[str, Iterator[Shown]]]:
    """Every whole sequence of rendered gardens, with the masks of the package's network."""
    network = build_segmenter(SegmenterConfig(), None)

    def views(sequence: Path) -> Iterator[Shown]:
        pairs = zip(open_source(sequence / "exact"), open_source(sequence), strict=True)
        return (Shown(exact, noisy, network(noisy)) for exact, noisy in pairs)

    for place in sorted((folder / "folder").glob("*/*/complete.json")):
        yield f"{place.parent.parent.name} {place.parent.name}", views(place.parent)


def speed(poses: list[Pose], rounds: int) -> None:
    """Median milliseconds a VGA frame, in turn."""
    frames_of = [(view.noisy, view.mask) for view in frames(Case("garden", garden_scene(0)), poses)]
    staged = replace(CONFIG, backend="plain")
    off = replace(CONFIG, geometry=GeometryConfig(enabled=False))

    def geometry(config: Config) -> Callable[[Frame, Segmentation], object]:
        def run(frame: Frame, mask: Segmentation) -> object:
            assert frame.T_map_camera is not None
            spec = spec_of(frame, frame.T_map_camera, config)
            return observe(frame, mask, frame.T_map_camera, spec, config)

        return run

    def semantic(frame: Frame, mask: Segmentation) -> OccupancyGrid:
        assert frame.T_map_camera is not None
        return frame_map(frame, mask, frame.T_map_camera, off)

    runs = {"semantic grid (fused kernel)": semantic, "geometry, compiled": geometry(CONFIG),
            "geometry, NumPy": geometry(staged)}  # fmt: skip
    times: dict[str, list[float]] = {name: [] for name in runs}
    for i in range(rounds + 1):
        for name, run in runs.items():
            started = time.perf_counter()
            run(*frames_of[i % len(frames_of)])
            times[name].append(1e3 * (time.perf_counter() - started))
    print()
    for name, values in times.items():
        print(f"{name:<32}{np.median(values[1:]):>8.2f} ms a frame")


if __name__ == "__main__":
    main()
