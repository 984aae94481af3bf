"""The first reading of a drive: its poses, frames to learn from, what they saw, what is believed."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.errors import InputError
from swardmap.grid import GridSpec, overlap
from swardmap.segmenter import Segmenter
from swardmap.teach.belief import (
    Picked,
    believed_way,
    blocked_views,
    contradicting,
    jumps_between,
    spread,
)
from swardmap.teach.doubt import looks_of
from swardmap.teach.evidence import grid_around
from swardmap.teach.plan import TeachPlan
from swardmap.teach.track import Track, base_of, driven_cells, in_spans, steady
from swardmap.teach.views import Bools, Heights, heights_of, seen_of
from swardmap.types import Frame, Segmentation

MOST_LEFT_OUT = 0.3
"""Share of a drive that may contradict the rest; beyond it nobody knows which part is right."""
FEWEST_FRAMES = 8
LEAST_DRIVEN_M2 = 1.0

OnFrame = Callable[[], None]


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """What is known of a drive after its first reading.

    Attributes:
        name: of the recording.
        track: poses of all frames that have one.
        picked: frames to learn from, in order of time.
        kept: (len(track),) bool, poses that are believed and not left out.
        left_out: reason -> time spans in seconds after the first pose.
        spec: grid around all.
        driven: (height, width) int32 poses that drove over each cell.
        frames: that were read.
    """

    name: str
    track: Track
    picked: tuple[Picked, ...]
    kept: Bools
    left_out: dict[str, list[tuple[float, float]]]
    spec: GridSpec
    driven: NDArray[np.int32]
    frames: int

    @property
    def used(self) -> list[Picked]:
        """The picked frames whose poses are believed."""
        return [p for p in self.picked if self.kept[p.index]]

    @property
    def driven_m2(self) -> float:
        """Area that the robot covered."""
        return float((self.driven > 0).sum()) * self.spec.resolution_m**2


@dataclass(eq=False)
class _Reading:
    """What grows while frames come in."""

    stamps: list[int] = field(default_factory=list)
    places: list[tuple[float, float, float]] = field(default_factory=list)
    picked: list[Picked] = field(default_factory=list)
    spacing_m: float = 0.0
    last: tuple[float, float, float] | None = None
    frames: int = 0


def read_drive(
    name: str,
    frames: Iterable[Frame],
    segmenter: Segmenter,
    config: Config,
    plan: TeachPlan,
    on_frame: OnFrame,
) -> Drive:
    """Read a drive once.

    Args:
        name: of the recording, for messages.
        frames: in order of time; those without a pose are passed over.
        segmenter: the network so far.
        config: mount, ranges, ground, resolution.
        plan: footprint, spans to leave out, limits.
        on_frame: told of each frame.

    Raises:
        InputError: if the drive has no poses, is too short, or contradicts itself too much to be learnt from.
    """
    reading = _Reading(spacing_m=plan.labels.apart_m)
    frame_ids: set[str] = set()
    for frame in frames:
        on_frame()
        reading.frames += 1
        if frame.T_map_camera is None:
            continue
        frame_ids.add(frame.T_map_camera.parent)
        _take(reading, frame, segmenter, config, plan)
    if len(frame_ids) > 1 or not reading.stamps:
        raise InputError(
            f"{name}: expected a recording with poses in one frame, got "
            f"{', '.join(sorted(frame_ids)) or f'none in {reading.frames} frames'}: "
            "labels come from where the robot drove"
        )
    return _judged(name, reading, plan)


def _take(reading: _Reading, frame: Frame, segmenter: Segmenter, config: Config, plan: TeachPlan) -> None:
    """Note the pose of a frame, and what it sees if it is far enough from the last one noted."""
    assert frame.T_map_camera is not None  # noqa: S101 - narrows the type
    place = base_of(frame.T_map_camera, config.mount)
    reading.stamps.append(frame.stamp_ns)
    reading.places.append(place)
    if reading.last is not None and _way(reading.last, place) < reading.spacing_m:
        return
    heights = heights_of(frame, frame.T_map_camera, config)
    if heights is None:
        return
    found = segmenter(frame).resized_to(*frame.depth.shape)
    seen = seen_of(heights, found, plan.labels)
    looks = looks_of(frame, heights, found, plan.labels)
    reading.picked.append(Picked(len(reading.stamps) - 1, seen, looks))
    reading.last = place
    if (
        len(reading.picked) >= 2 * plan.labels.most_frames
    ):  # a long drive: every second one, twice as far apart
        reading.picked = reading.picked[::2]
        reading.spacing_m *= 2


def _way(one: tuple[float, float, float], two: tuple[float, float, float]) -> float:
    """Metres from one place to the next; a turn by one radian counts as one."""
    turn = abs(float(np.angle(np.exp(1j * (two[2] - one[2])))))
    return float(np.hypot(two[0] - one[0], two[1] - one[1])) + turn


def _judged(name: str, reading: _Reading, plan: TeachPlan) -> Drive:
    places = np.array(reading.places)
    track = Track(np.array(reading.stamps, np.int64), places[:, :2], places[:, 2])
    picked = tuple(reading.picked)
    if len(picked) < FEWEST_FRAMES:
        raise InputError(
            f"{name}: expected at least {FEWEST_FRAMES} places {plan.labels.apart_m:g} m apart with ground "
            f"in view, got {len(picked)}: drive on, over the whole lawn"
        )
    unwanted = in_spans(track.seconds, plan.leave_out_s)
    cuts = jumps_between(track, picked, steady(track) & ~unwanted)
    jumped = ~steady(track, cuts) & ~unwanted
    kept = ~(unwanted | jumped)
    spec = grid_around([p.seen for p in picked if kept[p.index]] or [picked[0].seen])
    against = spread(picked, contradicting(picked, kept, spec), kept)
    kept = kept & ~against
    driven, wrong_way = believed_way(track, picked, kept, plan, spec)
    kept = kept & ~wrong_way
    struck = spread(picked, blocked_views(picked, kept, driven > 0, spec), kept)
    if struck.any():
        kept = kept & ~struck
        driven = driven_cells(track, kept, plan.footprint_m, spec)
    left_out = {
        "left out as told": spans_of(track, unwanted),
        "the pose jumped": spans_of(track, jumped),
        "what stands was elsewhere in other frames": spans_of(track, against),
        "the way led through what stands": spans_of(track, wrong_way | struck),
    }
    drive = Drive(
        name, track, picked, kept, {k: v for k, v in left_out.items() if v}, spec, driven, reading.frames
    )
    _check(drive, jumped | against | wrong_way | struck, unwanted)
    return drive


def spans_of(track: Track, chosen: Bools) -> list[tuple[float, float]]:
    """Time spans, in seconds after the first pose, of the poses that are chosen."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    seconds = track.seconds
    return [
        (round(float(seconds[a]), 2), round(float(seconds[b - 1]), 2))
        for a, b in edges.reshape(-1, 2).tolist()
    ]


def _check(drive: Drive, doubted: Bools, unwanted: Bools) -> None:
    share = float(doubted.sum()) / max(1, int((~unwanted).sum()))
    spans = [span for reason, found in drive.left_out.items() if "told" not in reason for span in found]
    if share > MOST_LEFT_OUT:
        told = ", ".join(f"{a:g}-{b:g} s" for a, b in spans[:4])
        raise InputError(
            f"{drive.name}: {share:.0%} of the drive contradicts the rest ({told}): its poses are wrong; "
            "repair them, or leave spans out with --leave-out"
        )
    if len(drive.used) < FEWEST_FRAMES or drive.driven_m2 < LEAST_DRIVEN_M2:
        raise InputError(
            f"{drive.name}: expected at least {LEAST_DRIVEN_M2:g} m2 of driven ground and {FEWEST_FRAMES} "
            f"frames, got {drive.driven_m2:.2f} m2 and {len(drive.used)}: drive over more of the lawn"
        )


def driven_again(
    frames: Iterable[Frame], drive: Drive, segmenter: Segmenter, config: Config, on_frame: OnFrame
) -> Iterator[tuple[int, Frame, Heights, Segmentation]]:
    """The second reading: the frames to learn from, with their number among the used ones."""
    wanted = {drive.track.stamps_ns[p.index]: number for number, p in enumerate(drive.used)}
    for frame in frames:
        on_frame()
        number = wanted.pop(frame.stamp_ns, None) if frame.T_map_camera is not None else None
        if number is None:
            continue
        assert frame.T_map_camera is not None  # noqa: S101 - narrows the type
        heights = heights_of(frame, frame.T_map_camera, config)
        if heights is not None:
            yield number, frame, heights, segmenter(frame).resized_to(*frame.depth.shape)


def raised_cells(drive: Drive) -> Bools:
    """(height, width) bool: cells in which something stands in most views, persons among them."""
    flat, raised = np.zeros(drive.spec.shape, np.int32), np.zeros(drive.spec.shape, np.int32)
    for p in drive.used:
        own, there = overlap(p.seen.spec, drive.spec)
        flat[there] += p.seen.flat[own]
        raised[there] += p.seen.raised[own]
    return (raised > 0) & (2 * raised > flat)
