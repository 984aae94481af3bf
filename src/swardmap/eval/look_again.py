"""Frames that are looked at once more, for pictures: what stands in them, and how far its marks are off.

Records hold sums. What was where is made again for the few frames that a report shows.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from swardmap.errors import SwardmapError
from swardmap.eval.cost import squared_distance
from swardmap.eval.dataset import read_frames
from swardmap.eval.frame import Plan, compare_again, pose_of, scored_mask, segmenter_of
from swardmap.eval.frame_maps import FrameMaps
from swardmap.eval.maps import MapComparison, compare_frame
from swardmap.eval.protocols import at_resolution
from swardmap.eval.safety import TOUCH_M
from swardmap.eval.things import PERSON, UNKNOWN_KIND, TrueThing, find_things
from swardmap.geometry import Pose
from swardmap.labels import MapClass
from swardmap.types import Frame, Segmentation


@dataclass(frozen=True, slots=True)
class SeenThing:
    """A thing of one frame, and what the map makes of it.

    Attributes:
        kind: shrub, test body, ...; `unknown` where nobody says.
        height: class of its height, or `person`.
        away_m: from the camera to its nearest cell.
        xy_m: centre of the cell that is worst off, in the map's frame; of its nearest if none is called free.
        cells: that it covers.
        missed: no mark near it.
        free_cells: of its cells called free.
        needs_m: smallest margin at which none of them is left outside; None where nothing is marked at all.
    """

    kind: str
    height: str
    away_m: float
    xy_m: tuple[float, float]
    cells: int
    missed: bool
    free_cells: int
    needs_m: float | None

    def is_dangerous(self, margin_m: float) -> bool:
        """Whether a cell of it is called free beyond a margin, as `safety` counts it."""
        return self.free_cells > 0 and (self.needs_m is None or self.needs_m > margin_m + 1e-9)

    @property
    def title(self) -> str:
        """What a person calls it."""
        if self.height == PERSON:
            return "person"
        return f"thing of {self.height}" if self.kind == UNKNOWN_KIND else f"{self.kind}, {self.height}"


@dataclass(frozen=True, slots=True, eq=False)
class FrameAgain:
    """One frame, looked at again.

    Attributes:
        name: of the frame among all of a run.
        frame: with true labels.
        T_map_camera: the pose that was used.
        segmentation: predicted mask.
        comparison: of the main kind of map.
        things: in it, the worst first.
    """

    name: str
    frame: Frame
    T_map_camera: Pose
    segmentation: Segmentation
    comparison: MapComparison
    things: tuple[SeenThing, ...]


def look_again(plan: Plan, index: int) -> FrameAgain | None:
    """One frame of a plan; None if it cannot be read or mapped any more."""
    try:
        numbered = next(read_frames(plan.dataset, index, index + 1, plan.config))
        frame = numbered.frame
        if frame is None:
            return None
        segmenter = segmenter_of(plan, frame.label_set)
        segmentation, comparison = compare_again(plan, frame, numbered.best, segmenter, numbered.truth)
        pose, config = pose_of(plan, frame), at_resolution(plan.config, plan.resolutions_m[0])
        made, found = FrameMaps(numbered.truth), comparison
        if plan.protocols[0] != "dense":  # safety is always judged by the robot's own map
            found = compare_frame(frame, segmentation, pose, config, "dense", numbered.best, made)
        truth, spec = numbered.best or frame, found.reference.spec
        pixels = made.pixels(truth, pose, config)
        cells = made.cells(pixels, spec)
        there = find_things(truth, pixels, cells, spec, config, numbered.truth, numbered.filtered)
    except SwardmapError:
        return None
    name = frame.name or str(index)
    mask = scored_mask(plan, segmentation)
    return FrameAgain(name, frame, pose, mask, comparison, tuple(seen_things(found, there.things, pose)))


def seen_things(
    comparison: MapComparison, things: Sequence[TrueThing], T_map_camera: Pose
) -> list[SeenThing]:
    """What a map makes of the things that are there, the worst first.

    Args:
        comparison: of the robot's map with the truth.
        things: of the frame, on the same grid.
        T_map_camera: pose of the camera.
    """
    predicted, spec = comparison.predicted.classes, comparison.predicted.spec
    to_mark_m = np.sqrt(squared_distance(predicted >= MapClass.OBSTACLE)).ravel() * spec.resolution_m
    has_marks = bool((predicted >= MapClass.OBSTACLE).any())
    free = (predicted == MapClass.GRASS).ravel()
    eye_m = T_map_camera.position_m[:2]

    def seen(thing: TrueThing) -> SeenThing:
        cells = thing.cells
        centers_m = spec.center_of(np.stack((cells % spec.width, cells // spec.width), axis=1))
        away_m = np.hypot(*(centers_m - eye_m).T)
        missed = bool((to_mark_m[cells] > TOUCH_M + 1e-9).all())
        own = free[cells]
        worst = int(np.argmax(np.where(own, to_mark_m[cells], -1))) if own.any() else int(np.argmin(away_m))
        needs_m = (float(to_mark_m[cells][own].max()) if has_marks else None) if own.any() else 0.0
        x, y = (round(float(v), 3) for v in centers_m[worst])
        return SeenThing(thing.kind, thing.height, round(float(away_m.min()), 2), (x, y), len(cells), missed,
                         int(own.sum()), needs_m)  # fmt: skip

    return sorted((seen(t) for t in things if len(t.cells)), key=stake)


def stake(thing: SeenThing) -> tuple[float, ...]:
    """Sorts things, the worst first: missed and called free, called free in part, near before far."""
    needs_m = np.inf if thing.needs_m is None else thing.needs_m
    return -(thing.missed and thing.free_cells > 0), -(needs_m > 0), -thing.missed, -needs_m, thing.away_m


def worst_things(again: Sequence[tuple[int, FrameAgain]], margin_m: float) -> list[dict[str, Any]]:
    """Things that are missed, or reach beyond their marks, of some frames; the worst first, as plain data.

    Args:
        again: index and frame.
        margin_m: that marks are grown by.
    """
    bad = [
        (thing, index, seen.name)
        for index, seen in again
        for thing in seen.things
        if thing.missed or thing.free_cells
    ]
    return [
        {"index": index, "frame": name, "title": thing.title, **asdict(thing),
         "dangerous": thing.is_dangerous(margin_m)}
        for thing, index, name in sorted(bad, key=lambda each: (*stake(each[0]), each[1]))
    ]  # fmt: skip
