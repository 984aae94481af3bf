"""What a safety engineer reads first: things missed, corridors, what lies beyond the margin, lawn kept.

*Missed*: no mark within 0.10 m of a thing's cells. *Dangerous*: a cell of it that is farther than the margin
from every mark is called free. *Corridor*: 3 m x 0.6 m ahead of the robot; a miss if the first mark, grown
by the margin, comes more than 0.15 m behind the first cell of a thing, of which a cell before it is called
free; a false stop if there is a mark though all that is truly seen of it is lawn. Distances are between
centres of cells.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.eval.cost import squared_distance
from swardmap.eval.things import NEAR_M, TrueThings
from swardmap.eval.truth import TruePixels
from swardmap.geometry import Pose
from swardmap.grid import OccupancyGrid
from swardmap.labels import LabelSet, MapClass

TOUCH_M = 0.10
"""A mark so near to a thing's cells is a mark of it."""
CORRIDOR_M = (3.0, 0.6)
"""Length and width."""
LATE_M = 0.15
HEADINGS_DEG = tuple(range(-25, 26, 5))
"""Of the corridors, from the camera's own."""
SEEN_SHARE = 0.5
"""Of a corridor that must be seen lawn before a mark in it is a false stop."""
GROUPS = ("standing", "flat", "water")
"""What is in an obstacle cell: something over 5 cm high; bare ground and what is lower; water."""


class ThingKind(NamedTuple):
    """What is kept of a thing; things of one kind are only counted. See `things.TrueThing`."""

    kind: str
    height: str
    band: int
    missed: bool
    dangerous: bool


@dataclass(frozen=True, slots=True)
class SafetyTally:
    """What was counted of safety. Tallies add up in any order, without rounding.

    Attributes:
        margin_m: that marks are grown by.
        things: by kind.
        counts: whole numbers by name; see `judge` and `unjudged`.
    """

    margin_m: float
    things: Mapping[ThingKind, int] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)

    def __add__(self, other: "SafetyTally") -> "SafetyTally":
        return total_safety((self, other), self.margin_m)

    def count(self, name: str) -> int:
        """A count; 0 for what never occurred."""
        return self.counts.get(name, 0)

    def of_things(self, **wanted: Any) -> tuple[int, int, int]:
        """Things, those missed and those dangerous, of a kind, height class or band."""
        kinds = [(k, n) for k, n in self.things.items() if all(getattr(k, a) == v for a, v in wanted.items())]
        return (
            sum(n for _, n in kinds),
            sum(n for k, n in kinds if k.missed),
            sum(n for k, n in kinds if k.dangerous),
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and numbers."""
        return {
            "margin_m": self.margin_m,
            "things": [[*k[:3], *map(int, k[3:]), n] for k, n in sorted(self.things.items())],
            "counts": dict(sorted(self.counts.items())),
        }

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any]) -> "SafetyTally":
        """What `to_dict` gave."""
        things = {ThingKind(k, h, b, bool(m), bool(d)): n for k, h, b, m, d, n in plain["things"]}
        return cls(plain["margin_m"], things, dict(plain["counts"]))


def total_safety(tallies: Iterable[SafetyTally], margin_m: float) -> SafetyTally:
    """The sum of many tallies of one margin."""
    things, counts = Counter[ThingKind](), Counter[str]()
    for tally in tallies:
        if tally.margin_m != margin_m:
            raise InvalidValueError(f"cannot add safety at margins of {margin_m} m and {tally.margin_m} m")
        things.update(tally.things)
        counts.update(tally.counts)
    return SafetyTally(margin_m, dict(things), dict(counts))


def judge(
    reference: OccupancyGrid,
    predicted: OccupancyGrid,
    things: TrueThings,
    T_map_camera: Pose,
    margin_m: float,
) -> SafetyTally:
    """Judge a map against its reference and the things that are there.

    Args:
        reference: the truth.
        predicted: what is to be judged, on the same grid.
        things: of the frame, on that grid.
        T_map_camera: pose of the camera; the robot is taken to be below it.
        margin_m: that marks are grown by.
    """
    if reference.spec != predicted.spec:
        raise InvalidValueError(f"expected maps on one grid, got {reference.spec} and {predicted.spec}")
    seen = _Seen(reference, predicted, T_map_camera, margin_m)
    kinds = Counter(
        ThingKind(thing.kind, thing.height, thing.band, *seen.judge_thing(thing.cells))
        for thing in things.things
    )
    counts = _cell_counts(seen, things) + _corridor_counts(seen, things)
    counts["frames"] = 1
    counts["frames_with_ids"] = int(things.has_ids)
    return SafetyTally(margin_m, dict(kinds), {k: n for k, n in counts.items() if n})


class _Seen:
    """Both maps as arrays that the figures are read from."""

    def __init__(
        self, reference: OccupancyGrid, predicted: OccupancyGrid, T_map_camera: Pose, margin_m: float
    ) -> None:
        spec, called = reference.spec, predicted.classes
        self.spec, self.T_map_camera = spec, T_map_camera
        self.to_mark_m = np.sqrt(squared_distance(called >= MapClass.OBSTACLE)) * spec.resolution_m
        self.marked = self.to_mark_m <= margin_m + 1e-9
        self.raw_free = called == MapClass.GRASS
        self.free = self.raw_free & ~self.marked
        self.hazard = reference.classes >= MapClass.OBSTACLE
        self.lawn = reference.classes == MapClass.GRASS
        x, y = (
            o + (np.arange(n) + 0.5) * spec.resolution_m
            for o, n in zip(spec.origin_m, spec.shape[::-1], strict=True)
        )
        self.x_m, self.y_m = x - T_map_camera.position_m[0], (y - T_map_camera.position_m[1])[:, None]
        self.near = self.x_m**2 + self.y_m**2 <= NEAR_M**2

    def judge_thing(self, cells: NDArray[np.int64]) -> tuple[bool, bool]:
        """Whether a thing is missed, and whether it is dangerous."""
        missed = bool((self.to_mark_m.ravel()[cells] > TOUCH_M + 1e-9).all())
        return missed, bool(self.free.ravel()[cells].any())


def _cell_counts(seen: _Seen, things: TrueThings) -> Counter[str]:
    counts = Counter[str]()
    for where, area in (("", None), ("_near", seen.near)):
        hazard, lawn = (a if area is None else a & area for a in (seen.hazard, seen.lawn))
        counts[f"obstacle{where}"] = int(hazard.sum())
        counts[f"obstacle_free{where}"] = int((hazard & seen.raw_free).sum())
        counts[f"obstacle_free_beyond{where}"] = int((hazard & seen.free).sum())
        counts[f"lawn{where}"] = int(lawn.sum())
        counts[f"lawn_kept{where}"] = int((lawn & seen.free).sum())
        counts[f"lawn_marked{where}"] = int((lawn & seen.marked).sum())
    groups = (
        things.standing,
        seen.hazard & ~things.standing & ~things.water,
        things.water & ~things.standing,
    )
    for name, group in zip(GROUPS, groups, strict=True):
        counts[f"{name}"] = int((seen.hazard & group).sum())
        counts[f"{name}_free"] = int((seen.hazard & group & seen.raw_free).sum())
        counts[f"{name}_free_beyond"] = int((seen.hazard & group & seen.free).sum())
    return counts


def _corridor_counts(seen: _Seen, things: TrueThings) -> Counter[str]:
    """Corridors with a thing, those missed, corridors that are clear, false stops."""
    thing = np.zeros(seen.spec.width * seen.spec.height, np.bool_)
    for one in things.things:
        thing[one.cells] = True
    thing = thing.reshape(seen.spec.shape)
    forward = seen.T_map_camera.matrix[:2, 2]
    heading = float(np.arctan2(forward[1], forward[0]))
    length_m, half_m = CORRIDOR_M[0], CORRIDOR_M[1] / 2
    ahead = seen.x_m * np.cos(heading) + seen.y_m * np.sin(heading) > -2 * half_m
    rows, columns = np.nonzero(ahead & (seen.x_m**2 + seen.y_m**2 < (length_m + half_m) ** 2))
    x_m, y_m = seen.x_m[columns], seen.y_m[rows, 0]  # of the cells that a corridor may hold
    angles = heading + np.deg2rad(HEADINGS_DEG)[:, None]  # a row for each corridor, all at once
    c, s = np.cos(angles), np.sin(angles)
    along, across = x_m * c + y_m * s, y_m * c - x_m * s
    inside = (along >= 0) & (along <= length_m) & (np.abs(across) <= half_m)
    marked, there = inside & seen.marked[rows, columns], inside & thing[rows, columns]
    hazard, lawn = inside & seen.hazard[rows, columns], inside & seen.lawn[rows, columns]
    first_mark = np.where(marked, along, np.inf).min(axis=1, initial=np.inf)
    first_thing = np.where(there, along, np.inf).min(axis=1, initial=np.inf)
    free_before = (there & seen.free[rows, columns] & (along < first_mark[:, None])).any(axis=1)
    with_thing, cells = there.any(axis=1), inside.sum(axis=1)
    clear = ~with_thing & ~hazard.any(axis=1) & (cells > 0) & (lawn.sum(axis=1) >= SEEN_SHARE * cells)
    return Counter(
        corridor_thing=int(with_thing.sum()),
        corridor_missed=int((with_thing & (first_mark > first_thing + LATE_M) & free_before).sum()),
        corridor_clear=int(clear.sum()),
        corridor_stopped=int((clear & marked.any(axis=1)).sum()),
    )


def unjudged(
    pixels: TruePixels, cells: NDArray[np.int64], labels: NDArray[np.uint8], label_set: LabelSet
) -> dict[str, int]:
    """Obstacle pixels that the limits leave out of the truth, and cells that nothing else stands for.

    Args:
        pixels: of the frame.
        cells: `pixels.cells` of the reference's grid.
        labels: (H, W) uint8 true ids of `label_set`.
        label_set: their classes.

    Returns:
        unjudged_out_of_range, unjudged_above, unjudged_below (height limits): pixels of true obstacles;
        unjudged_cells: cells with such pixels of height and without a judged one; judged_pixels;
        frames_ground_SOURCE: 1.
    """
    hazard = pixels.classes(labels, label_set) >= MapClass.OBSTACLE
    far = label_set.map_class_table[labels.ravel()[pixels.out_of_range]] >= MapClass.OBSTACLE
    out = hazard & ~pixels.judged
    lost = np.zeros(cells.max(initial=0) + 1, np.bool_)
    lost[cells[out & (cells >= 0)]] = True
    judged = hazard & pixels.judged
    lost[cells[judged & (cells >= 0)]] = False
    above = pixels.height_m[out] > 0
    return {
        "unjudged_out_of_range": int(far.sum()),
        "unjudged_above": int(above.sum()),
        "unjudged_below": int((~above).sum()),
        "unjudged_cells": int(lost.sum()),
        "judged_pixels": int(judged.sum()),
        f"frames_ground_{pixels.ground}": 1,
    }


def things_rows(tally: SafetyTally, by: str, values: Sequence[Any]) -> list[dict[str, Any]]:
    """Things, missed and dangerous, for each value of a field of ThingKind."""
    rows = []
    for value in values:
        n, missed, dangerous = tally.of_things(**{by: value})
        rows.append({by: value, "things": n, "missed": missed, "dangerous": dangerous})
    return rows
