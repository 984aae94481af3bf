"""Judging a map against the truth of a moment, and masks that err: for the benchmarks of the living map."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swardmap.config import Config
from swardmap.eval.dmin import d_min_obst
from swardmap.eval.maps import spec_of, true_segmentation
from swardmap.eval.truth import dense_map, true_pixels
from swardmap.geometry import Intrinsics, Pose, project
from swardmap.grid import GridSpec, OccupancyGrid, overlap
from swardmap.io import open_source
from swardmap.io.maps.map_files import read_map
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.synth.analytic import AnalyticSource, Scene, StereoNoise, garden_scene, lane_poses, true_map
from swardmap.types import Frame, Segmentation

NEAR_TRUTH_M = 0.15
"""A hazard cell farther from every true one is a ghost, not a border that is a cell or two off."""

LOOK_EVERY = 5
"""Of so many frames one is a moment at which maps are judged."""


class Noisy:
    """True masks with wrong blobs: each frame has `blobs` of them on average, each of one wrong class."""

    name = "noisy"
    label_set = GRASS_OBSTACLE_PERSON

    def __init__(self, blobs: float = 0.0, seed: int = 0) -> None:
        self._blobs, self._seed = blobs, seed

    def __call__(self, frame: Frame) -> Segmentation:
        assert frame.labels is not None
        labels = frame.labels.copy()
        height, width = labels.shape
        rng = np.random.default_rng([self._seed, frame.stamp_ns // 1_000_000])
        v, u = np.ogrid[:height, :width]
        for _ in range(rng.poisson(self._blobs)):
            cu, cv = rng.uniform(0, width), rng.uniform(0.25 * height, height)
            a, b = rng.uniform(0.015, 0.08, 2) * width
            inside = ((u - cu) / a) ** 2 + ((v - cv) / b) ** 2 <= 1
            here = int(labels[min(int(cv), height - 1), min(int(cu), width - 1)])
            labels[inside] = rng.choice([c for c in (0, 1, 2) if c != here])
        return Segmentation(labels, GRASS_OBSTACLE_PERSON)


@dataclass(frozen=True)
class Drive:
    """Frames of a garden, and the truth at the moments that are judged.

    Attributes:
        name: of the garden.
        frames: as the sensor gave them, with true labels.
        spec: the whole garden.
        truths: by index of the frame: (h, w) uint8 MapClass; UNKNOWN where nobody can know it: a person who
            has walked out of view, and what no frame could see.
    """

    name: str
    frames: list[Frame]
    spec: GridSpec
    truths: Mapping[int, NDArray[np.uint8]]


def analytic_drive(seed: int, count: int, intrinsics: Intrinsics) -> Drive:
    """A lane through an analytic garden at 0.4 m/s and 5 frames a second, with stereo noise; exact truth."""
    scene = garden_scene(seed)
    poses = tuple(lane_poses(count, step_m=0.08))
    frames = list(AnalyticSource(scene, poses, intrinsics, noise=StereoNoise(), seed=seed))
    spec = GridSpec(0.05, 320, 320, (-2.0, -8.0))
    moments = range(LOOK_EVERY - 1, count, LOOK_EVERY)
    return Drive(
        f"garden {seed}", frames, spec, {i: _analytic_truth(scene, spec, frames[i]) for i in moments}
    )


def rendered_drives(folder: Path, leave_out: tuple[str, ...] = ()) -> Iterator[Drive]:
    """The whole sequences of a folder that `swardmap synth` made; the truth is what exact frames have shown.

    That is the reference map of the paper's Sec. 4.3 over time: every pixel of the exact depth with its true
    label. A cell is an obstacle from the first frame on that shows one there; a person's cells are those of
    the moment.
    """
    for place in sorted((folder / "folder").glob("*/*/complete.json")):
        sequence = place.parent
        if sequence.parent.name in leave_out:
            continue
        spec = read_map(sequence / "maps/scene.yaml").spec
        exact = open_source(sequence / "exact")
        frames = list(open_source(sequence))
        yield Drive(f"{sequence.parent.name} {sequence.name}", frames, spec, _seen_truths(exact, spec))


def _analytic_truth(scene: Scene, spec: GridSpec, frame: Frame) -> NDArray[np.uint8]:
    truth = true_map(scene, spec, frame.stamp_ns).classes.copy()
    still = true_map(replace(scene, persons=()), spec).classes
    truth[(truth != still) & ~_in_view(spec, frame)] = MapClass.UNKNOWN
    return truth


def _in_view(spec: GridSpec, frame: Frame, height_m: float = 0.5) -> NDArray[np.bool_]:
    """Cells whose middle, at a height, is in the image."""
    assert frame.T_map_camera is not None
    iy, ix = np.indices(spec.shape)
    places = spec.center_of(np.stack((ix, iy), axis=-1)).reshape(-1, 2)
    points = np.column_stack((places, np.full(len(places), height_m)))
    uv, z = project(frame.T_map_camera.inverse().apply(points), frame.intrinsics)
    with np.errstate(invalid="ignore"):
        seen = (z > 0.3) & (uv[:, 0] >= 0) & (uv[:, 0] < frame.intrinsics.width)
    return np.asarray(seen.reshape(spec.shape))


def _seen_truths(exact: object, spec: GridSpec) -> dict[int, NDArray[np.uint8]]:
    config = Config()
    obstacle, grass, person = (np.zeros(spec.shape, np.bool_) for _ in range(3))
    truths = {}
    for i, frame in enumerate(exact):  # type: ignore[var-annotated, arg-type]
        assert frame.T_map_camera is not None
        pixels = true_pixels(frame, frame.T_map_camera, config)
        shown = dense_map(pixels, true_segmentation(frame), spec_of(frame, frame.T_map_camera, config))
        now = np.zeros(spec.shape, np.uint8)
        here, there = overlap(shown.spec, spec)
        now[there] = shown.classes[here]
        obstacle |= now == MapClass.OBSTACLE
        grass |= now == MapClass.GRASS
        person |= now == MapClass.PERSON
        if i % LOOK_EVERY == LOOK_EVERY - 1:
            truth = np.where(grass, np.uint8(MapClass.GRASS), np.uint8(MapClass.UNKNOWN))
            truth[person & (now == MapClass.UNKNOWN)] = MapClass.UNKNOWN
            truth[obstacle] = MapClass.OBSTACLE
            truth[now == MapClass.PERSON] = MapClass.PERSON
            truths[i] = truth
    return truths


@dataclass
class Score:
    """Sums over the moments looked at."""

    hazards: int = 0
    missed: int = 0
    unknown_hazards: int = 0
    grass: int = 0
    false: int = 0
    unknown_grass: int = 0
    ghosts: int = 0
    moments: int = 0
    distances_m: list[NDArray[np.float64]] = field(default_factory=list)

    def add(self, truth: NDArray[np.uint8], grid: OccupancyGrid, observed: NDArray[np.bool_]) -> None:
        """Judge a map at one moment, where `observed` and the truth is known."""
        judged = observed & (truth != MapClass.UNKNOWN)
        called = np.where(judged, grid.classes, MapClass.UNKNOWN).astype(np.uint8)
        real = np.where(judged, truth, MapClass.UNKNOWN).astype(np.uint8)
        hazard, lawn, marked = real >= MapClass.OBSTACLE, real == MapClass.GRASS, called >= MapClass.OBSTACLE
        self.moments += 1
        self.hazards += int(hazard.sum())
        self.missed += int((hazard & (called == MapClass.GRASS)).sum())
        self.unknown_hazards += int((hazard & (called == MapClass.UNKNOWN)).sum())
        self.grass += int(lawn.sum())
        self.false += int((lawn & marked).sum())
        self.unknown_grass += int((lawn & (called == MapClass.UNKNOWN)).sum())
        away = ndimage.distance_transform_edt(truth < MapClass.OBSTACLE) * grid.spec.resolution_m
        self.ghosts += int((marked & (away > NEAR_TRUTH_M)).sum())
        self.distances_m.append(d_min_obst(real, called, grid.spec.resolution_m))

    def __iadd__(self, other: "Score") -> "Score":
        for f in fields(self):
            setattr(self, f.name, getattr(self, f.name) + getattr(other, f.name))
        return self

    def row(self) -> dict[str, float]:
        """What the tables show."""
        distances = np.concatenate([np.zeros(0), *self.distances_m])
        finite = distances[np.isfinite(distances)]
        hazards, grass = max(self.hazards, 1), max(self.grass, 1)
        return {
            "FN %": 100 * self.missed / hazards,
            "hazard unknown %": 100 * self.unknown_hazards / hazards,
            "FP %": 100 * self.false / grass,
            "grass unknown %": 100 * self.unknown_grass / grass,
            "d_min mean m": float(finite.mean()) if len(finite) else float("nan"),
            "d_min p99 m": float(np.percentile(finite, 99)) if len(finite) else float("nan"),
            "sum d_min m": float(finite.sum()) / max(self.moments, 1),
            "FN without TP": float(len(distances) - len(finite)) / max(self.moments, 1),
            "ghost cells": self.ghosts / max(self.moments, 1),
        }


def pose_of(frame: Frame) -> Pose:
    """The pose of a frame that has one."""
    assert frame.T_map_camera is not None
    return frame.T_map_camera


def show(title: str, rows: Mapping[str, Mapping[str, float]]) -> None:
    """Print one table in Markdown, modes as columns."""
    names = list(rows)
    print(f"\n{title}\n\n| | " + " | ".join(names) + " |\n|---|" + "---:|" * len(names))
    for key in rows[names[0]]:
        print(f"| {key} | " + " | ".join(f"{rows[name][key]:.3f}" for name in names) + " |", flush=True)
