"""Faults of camera, pose and clock on one drive, offline and in the node, and what they do to free cells.

python -m tests.runs.semantic_faults     prints the table of docs/safety.md
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from swardmap.config import config_from_dict
from swardmap.errors import SwardmapError
from swardmap.geometry import R_BODY_OPTICAL, Intrinsics, Pose
from swardmap.grid import OccupancyGrid
from swardmap.io.bags.poses import optical_by_axes
from swardmap.labels import MapClass
from swardmap.models import build_segmenter
from swardmap.ros.live_pipeline import JUDGED_FRAMES
from swardmap.ros.watched_mapper import WatchedMapper
from swardmap.runs.recording import map_recording
from swardmap.runs.warnings import pixel_warnings
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.types import Frame

LENS = Intrinsics(320, 240, 230.0, 230.0, 159.5, 119.5)
PERIOD_NS, LATENCY_NS, START_NS = 100_000_000, 50_000_000, 1_700_000_000_000_000_000
CONFIG = config_from_dict(
    {"segmenter": {"name": "truth"}, "output": {"pictures": 0}, "grid": {"resolution_m": 0.1}}
)
FRAMES = 14

PARTS = ("rgb", "depth", "labels")

Frames = list[Frame]
Cells = set[tuple[int, int]]


@dataclass(frozen=True)
class Event:
    """What reaches the node: a frame, or nothing, at a time."""

    arrival_ns: int
    frame: Frame | None


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        name: for the table.
        frames: the drive with it.
        events: how the frames arrive; None = each `LATENCY_NS` after its stamp.
    """

    name: str
    frames: Callable[[Frames], Frames]
    events: Callable[[Frames], list[Event]] | None = None


@dataclass(frozen=True)
class Outcome:
    """Free cells that the undisturbed drive never saw, and over its obstacles; and the faults named."""

    unseen: int
    over: int
    named: tuple[str, ...]

    @property
    def is_safe(self) -> bool:
        """Whether no cell is wrongly free, or a fault says that one may be."""
        return bool(self.named) or self.unseen == self.over == 0


@cache
def drive() -> tuple[Frame, ...]:
    """A drive along a lane, undisturbed."""
    source = AnalyticSource(garden_scene(0), tuple(lane_poses(FRAMES, step_m=0.2)), LENS)
    return tuple(replace(f, stamp_ns=START_NS + i * PERIOD_NS) for i, f in enumerate(source))


def cells(grid: OccupancyGrid | None, *classes: MapClass) -> Cells:
    """Cells of some classes, counted from the lattice."""
    if grid is None:
        return set()
    iy, ix = np.nonzero(np.isin(grid.classes, classes))
    ox, oy = (round(v / grid.spec.resolution_m) for v in grid.spec.origin_m)
    return {(int(x) + ox, int(y) + oy) for x, y in zip(ix, iy, strict=True)}


@cache
def truth() -> tuple[Cells, Cells]:
    """Cells that the undisturbed drive saw, and its obstacles but for those it took for lawn from afar."""
    hazards = (MapClass.OBSTACLE, MapClass.PERSON)
    frames = list(drive())
    grids = [_mapped(frames[: n + 1])[0] for n in range(len(frames))]
    once_free: Cells = set().union(*(cells(grid, MapClass.GRASS) for grid in grids))
    return cells(grids[-1], MapClass.GRASS, *hazards), cells(grids[-1], *hazards) - once_free


class _Given(AnalyticSource):
    def __init__(self, frames: Frames) -> None:
        self.__dict__.update(AnalyticSource(garden_scene(0), tuple(lane_poses(1)), LENS).__dict__)
        self._given = frames

    def __iter__(self):  # type: ignore[no-untyped-def]
        yield from self._given


def _mapped(frames: Frames) -> tuple[OccupancyGrid | None, tuple[str, ...]]:
    try:
        found = map_recording(_Given(frames), config=CONFIG)
    except SwardmapError as error:
        return None, (f"refused: {error}",)
    posed = found.summary["frames"] > found.summary["frames_without_pose"]
    named = [*found.summary["watchdog"]["faults"], *found.summary["warnings"]]
    if found.summary["frames_without_pose"]:
        named.append("frames without pose")
    return (found.grid if posed else None), tuple(named)


def offline(fault: Fault) -> Outcome:
    """`swardmap map` of the drive with a fault."""
    try:
        grid, named = _mapped(fault.frames(list(drive())))
    except SwardmapError as error:
        grid, named = None, (f"refused: {error}",)
    return _outcome(grid, named)


def in_the_node(fault: Fault) -> Outcome:
    """The engine of the node, told of the frames as they arrive; its map is that after the last of them."""
    try:
        frames = fault.frames(list(drive()))
    except SwardmapError as error:
        return Outcome(0, 0, (f"refused: {error}",))
    events = fault.events(frames) if fault.events else arriving(frames)
    mount = drive()[0].T_map_camera
    assert mount is not None
    segmenter = build_segmenter(CONFIG.segmenter, drive()[0].label_set)
    mapper = WatchedMapper(CONFIG, segmenter, {"camera": mount})
    named: dict[str, None] = {}
    report, pixels = None, []
    for event in events:
        frame, now_ns = event.frame, event.arrival_ns
        if frame is not None:
            try:
                if frame.T_map_camera is None:
                    mapper.watch_frame("camera", frame, now_ns)
                else:
                    optical_by_axes(frame.T_map_camera, "auto", "camera")  # as the pipeline before the mapper
                    mapper.observe_pose(frame.stamp_ns)
                    if (step := mapper.map_frame("camera", frame, now_ns)) is not None:
                        pixels.append(step.counts)
                        mapper.observe_mapped(frame.stamp_ns, now_ns)
            except SwardmapError as error:
                named[f"refused: {error}"] = None
        report = mapper.check(now_ns, ("camera",))
        named |= dict.fromkeys(str(d.fault) for d in report.diagnoses)
    assert report is not None
    if len(pixels) >= JUDGED_FRAMES:
        named |= dict.fromkeys(pixel_warnings(asdict(sum(pixels[1:], pixels[0]))))
    return _outcome(mapper.snapshot(report.forget_before_ns), (*named, *map(str, mapper.left_out)))


def arriving(frames: Sequence[Frame]) -> list[Event]:
    """Each frame soon after the time at which it should have been taken."""
    return [Event(START_NS + i * PERIOD_NS + LATENCY_NS, f) for i, f in enumerate(frames)]


def _outcome(grid: OccupancyGrid | None, named: tuple[str, ...]) -> Outcome:
    seen, hazards = truth()
    free = cells(grid, MapClass.GRASS)
    return Outcome(len(free - seen), len(free & hazards), named)


def with_parts(frame: Frame, parts: dict[str, Any]) -> Frame:
    """A frame with some other parts."""
    return replace(frame, **parts)


def each(change: Callable[[Frame], Frame], since: int = 0, until: int = FRAMES) -> Callable[[Frames], Frames]:
    """A change of some of the frames."""
    return lambda frames: [change(f) if since <= i < until else f for i, f in enumerate(frames)]


def turned(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Frame], Frame]:
    """Colour, depth and labels moved together."""
    return lambda f: with_parts(f, {n: np.ascontiguousarray(change(getattr(f, n))) for n in PARTS})


def lit(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Frame], Frame]:
    """Another colour."""
    return lambda f: replace(f, rgb=np.clip(change(f.rgb.astype(np.float32)), 0, 255).astype(np.uint8))


def ranged(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Frame], Frame]:
    """Another depth, in metres."""

    def changed(f: Frame) -> Frame:
        metres = f.depth.astype(np.float32) * (f.depth_unit_m if f.depth.dtype == np.uint16 else 1)
        return replace(f, depth=change(metres).astype(np.float32), depth_unit_m=1.0)

    return changed


def moved(change: Callable[[int, np.ndarray], np.ndarray]) -> Callable[[Frames], Frames]:
    """Another pose of the n-th frame, from its matrix."""

    def changed(frames: Frames) -> Frames:
        poses = [f.T_map_camera for f in frames]
        return [
            replace(f, T_map_camera=Pose(p.parent, p.child, change(i, p.matrix.copy())))
            for i, (f, p) in enumerate(zip(frames, poses, strict=True))
            if p is not None
        ]

    return changed


def by(x: float = 0, y: float = 0, z: float = 0) -> np.ndarray:
    """A shift in the map, to add to the matrix of a pose."""
    shift = np.zeros((4, 4))
    shift[:3, 3] = x, y, z
    return shift


def about(axis: str, degrees: float) -> np.ndarray:
    """A turn about an axis of the camera, 4 x 4."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    turn, (a, b) = np.eye(4), {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    turn[a, a] = turn[b, b] = c
    turn[a, b], turn[b, a] = -s, s
    return turn


def taken_from(part: str, which: Callable[[int], int]) -> Callable[[Frames], Frames]:
    """Parts of frames (rgb depth labels, pose) from other frames."""
    names = ["T_map_camera"] if part == "pose" else part.split()

    def changed(frames: Frames) -> Frames:
        last = len(frames) - 1
        others = [frames[min(last, max(0, which(i)))] for i in range(len(frames))]
        return [replace(f, **{n: getattr(o, n) for n in names}) for f, o in zip(frames, others, strict=True)]

    return changed


def stamped(stamp: Callable[[int], int]) -> Callable[[Frames], Frames]:
    """Other stamps, in periods from the start."""
    return lambda frames: [
        replace(f, stamp_ns=max(0, START_NS + stamp(i) * PERIOD_NS)) for i, f in enumerate(frames)
    ]


def delayed(delay_ns: Callable[[int], int]) -> Callable[[Frames], list[Event]]:
    """Frames that arrive late, or not at all where the delay is negative; the node looks every period."""

    def events(frames: Frames) -> list[Event]:
        found = [Event(e.arrival_ns, None) for e in arriving(frames)]
        late = [(e, delay_ns(i)) for i, e in enumerate(arriving(frames))]
        found += [Event(e.arrival_ns + d, e.frame) for e, d in late if d >= 0]
        return sorted(found, key=lambda e: e.arrival_ns)

    return events


def torn(image: np.ndarray, before: np.ndarray) -> np.ndarray:
    """The upper half of an image, and the lower half of the one before."""
    return np.concatenate([image[: len(image) // 2], before[len(image) // 2 :]])


def tearing(frames: Frames) -> Frames:
    """Each image is half of the one before."""
    pairs = zip(frames, [frames[0], *frames], strict=False)
    return [with_parts(f, {n: torn(getattr(f, n), getattr(o, n)) for n in PARTS}) for f, o in pairs]


def salted(metres: np.ndarray) -> np.ndarray:
    """A tenth of the readings anywhere between 0.3 and 6 m."""
    dice = np.random.default_rng(0)
    wrong = dice.random(metres.shape) < 0.1
    return np.where(wrong, dice.uniform(0.3, 6, metres.shape), metres)


def sparse(metres: np.ndarray) -> np.ndarray:
    """Three readings in a hundred."""
    return np.where(np.random.default_rng(0).random(metres.shape) < 0.03, metres, np.nan)


def half(metres: np.ndarray) -> np.ndarray:
    """No readings in the left half."""
    return np.where(np.arange(metres.shape[1]) < metres.shape[1] // 2, np.nan, metres)


def body_axes(_: int, matrix: np.ndarray) -> np.ndarray:
    """The pose of the body frame in place of the optical one."""
    matrix[:3, :3] = matrix[:3, :3] @ R_BODY_OPTICAL.T
    return matrix


DICE = [int(n) for n in np.random.default_rng(3).permutation(FRAMES)]
IMAGES = "rgb depth labels"
FAULTS = (
    Fault("nothing wrong", lambda frames: frames),
    Fault("camera frozen after the first image", taken_from(IMAGES, lambda _: 0)),
    Fault("camera frozen from the middle on", taken_from(IMAGES, lambda i: min(i, 6))),
    Fault("depth frozen, colour goes on", taken_from("depth", lambda _: 0)),
    Fault("colour frozen, depth goes on", taken_from("rgb labels", lambda _: 0)),
    Fault("every image twice", taken_from(IMAGES, lambda i: i // 2 * 2)),
    Fault("lens covered from the middle on", each(lit(lambda c: c * 0), 6)),
    Fault("one black image", each(lit(lambda c: c * 0), 6, 7)),
    Fault("night: a twentieth of the light", each(lit(lambda c: c * 0.05))),
    Fault("over-exposed: all white", each(lit(lambda c: c * 0 + 255), 6)),
    Fault("no depth from the middle on", each(ranged(lambda z: z * 0), 6)),
    Fault("one image without depth", each(ranged(lambda z: z * 0), 6, 7)),
    Fault("depth is NaN", each(ranged(lambda z: z * np.nan))),
    Fault("3 % of the depth readings", each(ranged(sparse))),
    Fault("no depth in the left half", each(ranged(half))),
    Fault("a tenth of the readings is noise", each(ranged(salted))),
    Fault("depth unit wrong by 1000", each(ranged(lambda z: z * 1000))),
    Fault("depth unit wrong by 1/10", each(ranged(lambda z: z / 10))),
    Fault("depth 10 % too long", each(ranged(lambda z: z * 1.1))),
    Fault("depth stuck at 2 m", each(ranged(lambda z: z * 0 + 2), 6)),
    Fault("camera upside down", each(turned(lambda a: a[::-1, ::-1]))),
    Fault("top to bottom", each(turned(lambda a: a[::-1]))),
    Fault("mirrored left to right", each(turned(lambda a: a[:, ::-1]))),
    Fault("depth a frame late", taken_from("depth", lambda i: i - 1)),
    Fault("depth a frame early", taken_from("depth", lambda i: i + 1)),
    Fault("depth two frames late", taken_from("depth", lambda i: i - 2)),
    Fault("depth 20 pixels to the side", each(ranged(lambda z: np.roll(z, 20, axis=1)))),
    Fault("images in any order", taken_from(IMAGES, lambda i: DICE[i])),
    Fault("images torn: lower half of the one before", tearing),
    Fault("no pose at all", lambda frames: [replace(f, T_map_camera=None) for f in frames]),
    Fault("pose stands still while the robot drives", taken_from("pose", lambda _: 0)),
    Fault("pose a frame late", taken_from("pose", lambda i: i - 1)),
    Fault("pose jumps by 1 m for one image", moved(lambda i, m: m + by(y=1.0 if i == 6 else 0))),
    Fault("pose jumps by 1 m for good", moved(lambda i, m: m + by(y=1.0 if i >= 6 else 0))),
    Fault("pose jumps by 2 km", moved(lambda i, m: m + by(x=2000.0 if i >= 6 else 0))),
    Fault("pose drifts by 2 cm an image", moved(lambda i, m: m + by(y=0.02 * i))),
    Fault("mount off by 3 degrees of yaw", moved(lambda _, m: m @ about("y", 3))),
    Fault("mount off by 3 degrees of pitch", moved(lambda _, m: m @ about("x", 3))),
    Fault("mount off by 3 degrees of roll", moved(lambda _, m: m @ about("z", 3))),
    Fault("pose 0.3 m too high", moved(lambda _, m: m + by(z=0.3))),
    Fault("pose of the body frame", moved(body_axes)),
    Fault("pose is no number", moved(lambda _, m: m * np.nan)),
    Fault("stamps stand still", stamped(lambda i: min(i, 6))),
    Fault("stamps jump back by 2 s", stamped(lambda i: i - 20 * (i >= 6))),
    Fault("stamps jump ahead by an hour", stamped(lambda i: i + 36000 * (i >= 6))),
    Fault("stamps run backwards", stamped(lambda i: -i)),
    Fault("images arrive 1 s late", lambda f: f, delayed(lambda _: 10 * PERIOD_NS)),
    Fault(
        "camera stops for 0.8 s", lambda f: f[:2] + f[10:], delayed(lambda i: 0 if i < 2 else 8 * PERIOD_NS)
    ),
    Fault("camera stops for good", lambda f: f, delayed(lambda i: 0 if i < 4 else -1)),
)  # fmt: skip


def main() -> None:
    """Print the table."""
    for fault in FAULTS:
        a, b = offline(fault), in_the_node(fault)
        print(f"| {fault.name} | {a.unseen} / {a.over} | {', '.join(a.named)[:70] or '-'} "  # noqa: T201
              f"| {b.unseen} / {b.over} | {', '.join(b.named)[:70] or '-'} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
