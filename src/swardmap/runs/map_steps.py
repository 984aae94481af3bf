"""The frames of a recording, mapped one by one: of one world, fit, mounted, within bounds."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from time import perf_counter

from swardmap.errors import InputError
from swardmap.io import FrameSource
from swardmap.io.door import frames_of
from swardmap.pipeline import ObstacleMapper, StepResult
from swardmap.runs.ahead import in_order
from swardmap.runs.bounds import Bounds
from swardmap.runs.frame_check import FrameCheck
from swardmap.types import Frame, Segmentation


def map_steps(
    source: FrameSource,
    mapper: ObstacleMapper,
    mount: dict[str, str] | None = None,
    check: FrameCheck | None = None,
    workers: int | None = None,
) -> Iterator[StepResult]:
    """Map the frames of a source one by one, as `map_recording` does.

    Args:
        source: open, in order of time.
        mapper: gets the mount measured from the first frame without a pose, where none is configured.
        mount: takes under `source` where the mount came from.
        check: counts the frames that are not mapped, since the node's watchdog would refuse them, and those
            that clear nothing, since the network does not know them.
        workers: frames that are segmented at once, ahead of the map; 0 = they are read ahead only, None =
            one thread does everything.

    Raises:
        InputError: if there is no frame, or frames with poses are of more than one scene.
    """
    where = {} if mount is None else mount
    looks = check or FrameCheck(mapper.config.watchdog)

    def read() -> Iterator[Frame]:
        fit = (f for f in _of_one_world(source) if looks.is_fit(f, mapper.T_base_camera))
        return _mounted(fit, mapper, where)

    steps = mapper.run(read()) if workers is None else _run_ahead(read, mapper, workers)
    return _looked_at(_within_bounds(steps, mapper), looks)


def _run_ahead(
    read: Callable[[], Iterator[Frame]], mapper: ObstacleMapper, workers: int
) -> Iterator[StepResult]:
    """The same as `mapper.run`, with frames read and segmented while those before them are mapped."""

    def segment(frame: Frame) -> tuple[Segmentation, float]:
        started = perf_counter()
        return mapper.segmenter(frame), perf_counter() - started

    for frame, (segmentation, segment_s) in in_order(read, segment, workers):
        started = perf_counter()
        step = mapper.integrate(frame, segmentation)
        stages = {"segment": segment_s, "map": perf_counter() - started}
        yield replace(step, timings_ms={name: 1e3 * seconds for name, seconds in stages.items()})


def _looked_at(steps: Iterator[StepResult], check: FrameCheck) -> Iterator[StepResult]:
    """The steps, their masks counted by the check."""
    for step in steps:
        check.take_mask(step.frame, step.segmentation)
        check.take_ground(step.frame, step.observation.ground_slope)
        yield step


def _within_bounds(steps: Iterator[StepResult], mapper: ObstacleMapper) -> Iterator[StepResult]:
    """The steps, as long as the map they make is one that fits into memory and files."""
    config = mapper.config
    rolling = config.grid.mode == "log_odds" and config.evidence.window_m is not None
    bounds = None if rolling or config.grid.size_m is not None else Bounds(config.grid.resolution_m)
    for step in steps:
        frame, seen = step.frame, step.observation
        if bounds is not None and frame.T_map_camera is not None:
            bounds.take_in(frame.name or str(frame.stamp_ns), step.T_map_camera, seen.spec)
        yield step


def _of_one_world(source: FrameSource) -> Iterator[Frame]:
    """All frames, as long as they are of one world: poses of two scenes do not go into one map."""
    scene, count = None, 0
    for count, frame in enumerate(frames_of(source, source.name), start=1):
        if count == 1:
            scene = frame.tags.get("scene")
        if frame.T_map_camera is not None and frame.tags.get("scene") != scene:
            raise InputError(
                f"frame {frame.name} is of scene '{frame.tags.get('scene')}', the map of scene '{scene}': "
                "each scene has a world of its own; map them one by one"
            )
        yield frame
    if not count:
        raise InputError(f"{source.name} holds no frame that can be mapped{_reasons(source)}")


def _mounted(frames: Iterator[Frame], mapper: ObstacleMapper, mount: dict[str, str]) -> Iterator[Frame]:
    """The frames; at the first without a pose, the ground it sees gives the mount that is not configured."""
    for frame in frames:
        if frame.T_map_camera is None and mapper.T_base_camera is None:
            from swardmap.perception.ground_plane import estimate_mount

            # not by its true labels: an evaluation must not profit from them
            mapper.mounted(estimate_mount(replace(frame, labels=None)))
            mount["source"] = f"measured from the ground in frame {frame.name}, the first without a pose"
        yield frame


def _reasons(source: FrameSource) -> str:
    told = dict(getattr(source, "facts", {})).get("left_out", {})
    firsts = {reason: about.get("first", "") for reason, about in told.items() if isinstance(about, dict)}
    left_out = "; ".join(
        f"{n} x {reason}" + (f", first: {firsts[reason]}" if firsts.get(reason) else "")
        for reason, n in source.skipped.items()
        if n
    )
    return f" (left out: {left_out})" if left_out else ""
