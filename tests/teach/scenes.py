"""Drives over lawns of simple solids, at a quarter of the pixels; the segmenter says what a test wants."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from swardmap.config import Config
from swardmap.geometry import Pose
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelSet
from swardmap.synth.analytic import VGA, AnalyticSource, Patch, Scene, Walker, lane_poses
from swardmap.synth.analytic_solids import Box, Cylinder
from swardmap.teach.drive import Drive, read_drive
from swardmap.teach.plan import TeachPlan, circle
from swardmap.types import Frame, Segmentation

SMALL = VGA.scaled_to(240, 180)
CONFIG = Config()
PLAN = TeachPlan(circle(0.3))
PERIOD_NS = 400_000_000


@dataclass
class Says:
    """Calls every pixel what it truly is, or where `grass_is` is given every lawn that, with a confidence."""

    grass_is: int = 1
    confidence: float = 0.95
    name: str = "says"

    @property
    def label_set(self) -> LabelSet:
        return GRASS_OBSTACLE_PERSON

    def __call__(self, frame: Frame) -> Segmentation:
        assert frame.labels is not None
        labels = np.where(frame.labels == 1, np.uint8(self.grass_is), frame.labels)
        return Segmentation(labels, self.label_set, np.full(labels.shape, self.confidence, np.float32))


GARDEN = Scene(
    solids=(
        Box((6.0, 2.2), (14.0, 0.5, 1.2)),
        Box((5.0, -2.4), (3.0, 0.8, 0.6)),
        Cylinder((4.0, 1.0), 0.1, 0.7),
        Cylinder((7.0, -1.1), 0.12, 0.5),
        Box((2.8, -1.0), (0.3, 0.3, 0.25)),
        Box((9.5, 0.9), (0.4, 0.4, 0.4)),
    ),
    name="lane",
)


def lane(
    scene: Scene = GARDEN, n: int = 26, step_m: float = 0.25, poses: Sequence[Pose] | None = None
) -> AnalyticSource:
    """A drive along x at y = 0."""
    ways = lane_poses(n, step_m=step_m, height_m=0.7, pitch_deg=22) if poses is None else list(poses)
    return AnalyticSource(scene, tuple(ways), SMALL, PERIOD_NS)


def moved(pose: Pose, x_m: float, y_m: float) -> Pose:
    matrix = pose.matrix.copy()
    matrix[:2, 3] += (x_m, y_m)
    return Pose(pose.parent, pose.child, matrix)


def with_poses(frames: Sequence[Frame], poses: Sequence[Pose]) -> list[Frame]:
    """The same images, said to be seen from elsewhere."""
    return [replace(f, T_map_camera=p) for f, p in zip(frames, poses, strict=True)]


def drive_of(frames: Sequence[Frame], segmenter: Says | None = None, plan: TeachPlan = PLAN) -> Drive:
    return read_drive("drive", frames, segmenter or Says(), CONFIG, plan, lambda: None)


__all__ = ["CONFIG", "GARDEN", "PLAN", "Patch", "Says", "Scene", "Walker", "drive_of", "lane", "moved"]
