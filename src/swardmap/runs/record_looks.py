"""What an evaluation keeps of the looks at its frames, and what is told of them once all are there.

Frames are looked at in parts, by any process and in any order, so a record holds the little that faults are
told by, and never what came many frames before: two views are compared within a group of eight frames.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import astuple
from typing import Any

import numpy as np

from swardmap.config import WatchdogConfig
from swardmap.monitor.align_watch import shifted_counts
from swardmap.monitor.camera_monitor import image_faults
from swardmap.monitor.diagnostics import Fault, FrameStats, frame_stats
from swardmap.monitor.motion_watch import PairFinder, PairOff
from swardmap.monitor.seen_motion import View
from swardmap.monitor.step_watch import StepCounts, StepWatch, step_counts
from swardmap.monitor.tilt_watch import tilted
from swardmap.monitor.view_watch import ViewWatch
from swardmap.runs.frame_check import over_ground
from swardmap.types import Frame, Segmentation

GROUP = 8
"""Frames within which views are compared; parts of an evaluation have so many or a multiple."""

Look = Mapping[str, Any]


def first_looked_at(start: int) -> int:
    """The frame at which looking must begin, for a record of frame `start` that is the same in any part."""
    return max(0, start // GROUP * GROUP - 2)


class Looker:
    """Looks at frames in order, from `first_looked_at` on.

    Args:
        config: thresholds of the watchdog.
    """

    def __init__(self, config: WatchdogConfig) -> None:
        self._config = config
        self._pairs = PairFinder()
        self._last: FrameStats | None = None
        self._view: View | None = None
        self._tags: dict[str, str] = {}

    def see(self, index: int, frame: Frame | None) -> dict[str, Any]:
        """What a record keeps of a frame, as plain data; None = a frame that cannot be read."""
        if frame is None:
            self._last = self._view = None
            return {}
        last, tags = self._last, dict(frame.tags)
        begins = index == 0 or (last is not None and tags != self._tags)  # of another place: it did not jump
        if begins or index % GROUP == 0 or last is None:
            self._pairs = PairFinder(None if begins else self._view)
        stats = frame_stats(frame, frame.stamp_ns, over_ground(frame.T_map_camera))
        found = {fault for fault, bad in image_faults(stats, last, self._config).items() if bad}
        found -= {Fault.JUMPED_POSE} if begins else set()
        look: dict[str, Any] = {
            "faults": sorted(map(str, found - {Fault.FROZEN})),  # that one is told by the prints
            "prints": [stats.color_print, stats.depth_print],
            "step": None if begins or last is None else _step(last, stats),
        }
        if begins:
            look["begins"] = True
        if not found and self._config.doubt_limit is not None:
            look |= self._doubtful(stats)
        self._last, self._tags, self._view = stats, tags, None if found else stats.view
        return look

    def _doubtful(self, stats: FrameStats) -> dict[str, Any]:
        pair = self._pairs.add(stats.view)
        counts = None if stats.edges is None else shifted_counts(stats.edges)
        told: dict[str, Any] = {} if counts is None else {"shifted": counts.tolist()}
        if pair is not None:
            off = (None if v is None else round(v, 4) for v in (pair.ahead, pair.aside))
            told["pair"] = [*off, bool(pair.is_gross)]
        return told


def with_mask(
    look: Look,
    frame: Frame,
    segmentation: Segmentation,
    slope: tuple[float, float] | None,
    config: WatchdogConfig,
) -> dict[str, Any]:
    """A look with what only segmenting and mapping tell.

    Args:
        look: from `Looker`.
        frame: that it is of.
        segmentation: its mask.
        slope: (dz/dx, dz/dy) of the ground that it shows, in the map; None = none.
        config: thresholds of the watchdog.
    """
    told = dict(look)
    if segmentation.is_unfamiliar(config.unfamiliar):
        told["faults"] = [*look["faults"], str(Fault.UNFAMILIAR)]
    if config.doubt_limit is not None and slope is not None and frame.T_map_camera is not None:
        told["ground"] = [np.round(part, 6).tolist() for part in tilted(frame.T_map_camera, slope)]
    return told


def watchdog_of(records: Iterable[Mapping[str, Any]], config: WatchdogConfig) -> dict[str, Any]:
    """What the watchdog says of all frames, by the names of summary.json.

    Args:
        records: of all frames, in order; those without looks say nothing.
        config: thresholds of the watchdog.

    Returns:
        `faults`: how many frames had each; `first`: the first of them; `doubts`: of pose, mount or depth.
    """
    faults: dict[str, int] = {}
    first: dict[str, str] = {}
    doubts: dict[str, str] = {}
    for record, found, told in _judged(records, config):
        for fault in map(str, (*found, *told)):
            faults[fault] = faults.get(fault, 0) + 1
            first.setdefault(fault, str(record.get("name") or record.get("index")))
        doubts |= {str(fault): text for fault, text in told.items()}
    return {"faults": faults, "first": first, "doubts": doubts}


def refused_in_order(
    records: Iterable[Mapping[str, Any]], config: WatchdogConfig
) -> Iterator[tuple[Mapping[str, Any], tuple[str, ...]]]:
    """Each record whose frame the watchdog would not map, or that is unfamiliar, with its faults."""
    return ((record, found) for record, found, _ in _judged(records, config) if found)


def _judged(
    records: Iterable[Mapping[str, Any]], config: WatchdogConfig
) -> Iterator[tuple[Mapping[str, Any], tuple[str, ...], dict[Fault, str]]]:
    """Each record with its faults, and with what is in doubt by it and those before it."""
    last: Look | None = None
    step, views = StepWatch(config.step_ratio), ViewWatch(config.doubt_limit)
    for record in records:
        look: Look | None = record.get("looks") or None
        if look is not None:
            if look.get("begins"):
                views = ViewWatch(config.doubt_limit)
            faults = (*look["faults"], *_frozen(look, last, config), *_out_of_step(look, step))
            in_doubt = [] if set(faults) - {Fault.UNFAMILIAR} else _doubted(look, views)
            told = views.doubts()
            yield record, faults, {fault: told[fault] for fault in in_doubt}
        last = look


def _doubted(look: Look, views: ViewWatch) -> list[Fault]:
    pair, shifted, ground = (look.get(name) for name in ("pair", "shifted", "ground"))
    found = views.take(
        None if pair is None else PairOff(*pair),
        None if shifted is None else np.array(shifted, np.int64),
    )
    if ground is not None:
        up, place, tilt = (np.array(part, np.float64) for part in ground)
        found += [Fault.TILTED] * views.take_ground((up, place, tilt))
    return found


def _step(before: FrameStats, now: FrameStats) -> list[int] | None:
    counts = step_counts(before.edges, now.edges)
    return None if counts is None else list(astuple(counts))


def _out_of_step(look: Look, watch: StepWatch) -> tuple[str, ...]:
    counts = look.get("step")
    return (str(Fault.OUT_OF_STEP),) if watch.add(None if counts is None else StepCounts(*counts)) else ()


def _frozen(look: Look, last: Look | None, config: WatchdogConfig) -> tuple[str, ...]:
    if last is None or config.frozen_s is None:
        return ()
    black, blind = Fault.BLACK in look["faults"], Fault.NO_DEPTH in look["faults"]
    (color, depth), (color_before, depth_before) = look["prints"], last["prints"]
    same = (not black and color == color_before) or (not blind and depth == depth_before)
    return (str(Fault.FROZEN),) if same else ()
