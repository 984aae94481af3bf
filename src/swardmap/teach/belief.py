"""Which poses of a drive are believed: by what stands in the views, and where the robot can have driven."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from swardmap.grid import GridSpec
from swardmap.teach.doubt import Looks
from swardmap.teach.evidence import (
    MOST_AGAINST,
    MOST_BLOCKED,
    blocked,
    contradicted,
    disagreement,
    votes_of,
)
from swardmap.teach.plan import TeachPlan
from swardmap.teach.shifts import shift_between
from swardmap.teach.track import Track, driven_cells
from swardmap.teach.views import Bools, SeenCells

BLOCKED_SHARE, BLOCKED_VIEWS = 0.5, 3
"""A driven cell on which something stands in so many of the views is no lawn: the way is wrong there."""
BAD_POSE_SHARE = 0.25
"""Of a footprint on such cells, from which on its pose is not believed."""


@dataclass(frozen=True, slots=True, eq=False)
class Picked:
    """A frame to learn from: its place among the poses, what it saw, how the ground looked in each cell."""

    index: int
    seen: SeenCells
    looks: Looks


def jumps_between(track: Track, picked: tuple[Picked, ...], kept: Bools) -> list[int]:
    """Poses before which the map jumps, by what stands in one view and in the next of those that are kept."""
    cuts = []
    for one, two in pairwise(p for p in picked if kept[p.index]):
        shift = shift_between(one.seen, two.seen)
        if shift is not None and shift.jumped:
            steps_m = np.hypot(*np.diff(track.xy_m[one.index : two.index + 1], axis=0).T)
            cuts.append(one.index + 1 + int(steps_m.argmax()))
    return cuts


def contradicting(picked: tuple[Picked, ...], kept: Bools, spec: GridSpec) -> Bools:
    """(picked,) frames that contradict the others about what stands."""
    believed = np.array([kept[p.index] for p in picked])
    votes = votes_of([p.seen for p in picked], believed, spec)
    values = [disagreement(p.seen, votes, bool(b)) for p, b in zip(picked, believed, strict=True)]
    return np.asarray(contradicted(values, MOST_AGAINST) & believed)


def blocked_views(picked: tuple[Picked, ...], kept: Bools, driven: Bools, spec: GridSpec) -> Bools:
    """(picked,) frames that see something standing where the robot drove."""
    values = [blocked(p.seen, driven, spec) if kept[p.index] else None for p in picked]
    return contradicted(values, MOST_BLOCKED)


def believed_way(
    track: Track, picked: tuple[Picked, ...], kept: Bools, plan: TeachPlan, spec: GridSpec
) -> tuple[NDArray[np.int32], Bools]:
    """The driven cells, and poses whose footprint lies on what stands in most views."""
    votes = votes_of([p.seen for p in picked], np.array([kept[p.index] for p in picked]), spec)
    stands = (votes.raised >= BLOCKED_VIEWS) & (votes.raised > BLOCKED_SHARE * (votes.raised + votes.flat))
    driven = driven_cells(track, kept, plan.footprint_m, spec)
    wrong = np.zeros(len(track), np.bool_)
    if not (stands & (driven > 0)).any():
        return driven, wrong
    for i in np.flatnonzero(kept).tolist():
        alone = np.zeros(len(track), np.bool_)
        alone[i] = True
        covered = driven_cells(_one(track, i), alone[i : i + 1], plan.footprint_m, spec) > 0
        wrong[i] = (covered & stands).sum() > BAD_POSE_SHARE * max(1, int(covered.sum()))
    return (driven_cells(track, kept & ~wrong, plan.footprint_m, spec) if wrong.any() else driven), wrong


def _one(track: Track, i: int) -> Track:
    return replace(
        track,
        stamps_ns=track.stamps_ns[i : i + 1],
        xy_m=track.xy_m[i : i + 1],
        yaw_rad=track.yaw_rad[i : i + 1],
    )


def spread(picked: tuple[Picked, ...], chosen: Bools, kept: Bools) -> Bools:
    """(poses,) those nearer in time to a chosen frame than to any that is believed."""
    indices = np.array([p.index for p in picked])
    nearest = np.abs(np.arange(len(kept))[:, None] - indices[None, :]).argmin(1)
    return np.asarray(chosen[nearest] & kept)
