"""Many sequences by many processes, so that an interrupted run goes on where it was.

OUT/plan.json holds what is made; another plan in the same folder is refused. A sequence, one garden in one
light, is made by one process and is whole when its marker is there; one without is made again. Everything
is drawn from (seed, scene, light, frame), so it does not matter who makes what, and when.
"""

import os
import queue
from collections import Counter
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import asdict
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.errors import OutputError, SwardmapError
from swardmap.grid import OccupancyGrid
from swardmap.io.sources.eden_layout import LIGHTS
from swardmap.synth.config import SynthConfig, digest, synth_config_to_dict
from swardmap.synth.model import Garden
from swardmap.synth.plan import SynthPlan, garden_seed, prepare_folder
from swardmap.synth.sequence import GardenSource
from swardmap.synth.sequence_files import discard, is_complete, write_sequence
from swardmap.synth.stage import Stage
from swardmap.synth.truth import scene_map

LIGHT_STREAM = 4
"""Of chance, beside those of camera, sensor and frames (see `sequence`)."""

StageOf = Callable[[SynthConfig], Stage]
OnDone = Callable[[int, int], None]
"""Called with the number of frames done and of all frames."""


def produce(
    plan: SynthPlan,
    out: str | Path,
    stage_of: StageOf,
    *,
    jobs: int | None = None,
    overwrite: bool = False,
    on_done: OnDone | None = None,
) -> dict[str, Any]:
    """Make all sequences that are not there yet. More scenes or lights can be added to a folder later.

    Args:
        plan: what to make.
        out: folder; may hold a part of it.
        stage_of: makes what films the gardens; a function of a module, since other processes import it.
        jobs: processes; None = one a core, 1 = this one.
        overwrite: throw away what `out` holds of this or another plan, and begin anew.
        on_done: told of the progress.

    Returns:
        sequences, frames, made (sequences of this run), out.

    Raises:
        OutputError: if `out` holds something else or cannot be written; what is whole stays.
        SwardmapError: what the stage raises, such as a missing driver.
    """
    out = Path(out)
    prepare_folder(plan, out, overwrite)
    todo = [
        (scene, light) for scene, light in plan.sequences
        if not is_complete(out, f"{scene:04d}", light, plan.frames)
    ]  # fmt: skip
    total = len(plan.sequences) * plan.frames
    done = total - len(todo) * plan.frames
    if on_done is not None:
        on_done(done, total)

    def on_frame() -> None:
        nonlocal done
        done += 1
        if on_done is not None:
            on_done(done, total)

    jobs = min(jobs or len(os.sched_getaffinity(0)), len(todo))
    try:
        if jobs > 1:
            _make_in_processes(plan, out, todo, stage_of, jobs, on_frame)
        else:
            for scene, light in todo:
                _make(plan, out, scene, light, stage_of, on_frame)
    except KeyboardInterrupt:
        whole = sum(is_complete(out, f"{s:04d}", light, plan.frames) for s, light in plan.sequences)
        raise KeyboardInterrupt(
            f"{whole} of {len(plan.sequences)} sequences are whole; give the same command again to go on"
        ) from None
    return {"out": str(out), "sequences": len(plan.sequences), "frames": total, "made": len(todo)}


def make_source(
    plan: SynthPlan, stage: Stage, scene: int, illumination: str, garden: Garden | None = None
) -> GardenSource:
    """One sequence of a plan as a source of frames, without any file.

    The drive and the lens are those of the garden, the same in all lights, as in EDEN.
    """
    config = plan.config
    garden = garden or stage.garden(garden_seed(plan.seed, scene))
    light_key = (plan.seed, scene, LIGHTS.index(illumination))
    intrinsics, run = stage.drive(garden, plan.frames, config.rig)
    return GardenSource(
        garden,
        stage.light(illumination, np.random.default_rng([*light_key, LIGHT_STREAM])),
        tuple(run),
        intrinsics,
        stage.view,
        config.camera,
        config.stereo,
        light_key,
        {"scene": f"{scene:04d}", "illumination": illumination, "sequence": f"{scene:04d}-{illumination}"},
        stage.radiance,
    )


def _make_in_processes(
    plan: SynthPlan,
    out: Path,
    todo: list[tuple[int, str]],
    stage_of: StageOf,
    jobs: int,
    on_frame: Callable[[], None],
) -> None:
    context = get_context("spawn")
    frames, stop = context.Queue(), context.Event()
    pool = ProcessPoolExecutor(jobs, context, _start_worker, (os.getpid(), frames, stop))
    try:
        running: set[Future[None]] = {
            pool.submit(_make_in_worker, plan, out, scene, light, stage_of) for scene, light in todo
        }
        while running:
            finished, running = wait(running, timeout=0.5, return_when=FIRST_COMPLETED)
            _tell(frames, on_frame)
            for future in finished:
                _check(future)
        _tell(frames, on_frame)
    finally:
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)


def _tell(frames: Any, on_frame: Callable[[], None]) -> None:
    """Pass on all that workers have told since the last time."""
    with suppress(queue.Empty):
        while True:
            frames.get_nowait()
            on_frame()


def _check(future: "Future[None]") -> None:
    try:
        future.result()
    except BrokenProcessPool as error:
        raise OutputError(
            "a process died, perhaps for want of memory; give the same command again, with fewer --jobs: "
            "sequences that are whole are kept"
        ) from error


class _StoppedError(SwardmapError):
    """The parent wants no more frames."""


_worker: dict[str, Any] = {}
"""Of this process: where to tell of frames, and what says to stop."""


def _start_worker(parent: int, frames: Any, stop: Any) -> None:
    """One core each; end with the parent, even if that is killed."""
    import signal
    import threading
    import time

    import cv2

    os.environ["LP_NUM_THREADS"] = "1"  # of Mesa's software driver; read when the context is made
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's
    cv2.setNumThreads(1)
    _worker.update(frames=frames, stop=stop)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _make_in_worker(plan: SynthPlan, out: Path, scene: int, light: str, stage_of: StageOf) -> None:
    def on_frame() -> None:
        _worker["frames"].put(1)
        if _worker["stop"].is_set():
            raise _StoppedError("stopped")

    _make(plan, out, scene, light, stage_of, on_frame)


def _make(
    plan: SynthPlan, out: Path, scene: int, light: str, stage_of: StageOf, on_frame: Callable[[], None]
) -> None:
    """Make one sequence anew."""
    stage = _stage(stage_of, plan.config)
    garden, grid = _garden(stage_of, plan.config, garden_seed(plan.seed, scene))
    source = make_source(plan, stage, scene, light, garden)
    discard(out, f"{scene:04d}", light)

    def meta() -> dict[str, Any]:
        return _meta(plan, source, stage, scene)

    write_sequence(source, out, f"{scene:04d}", grid, plan.config.map, meta, on_frame)


@lru_cache(maxsize=1)
def _stage(stage_of: StageOf, config: SynthConfig) -> Stage:
    return stage_of(config)


@lru_cache(maxsize=1)
def _garden(stage_of: StageOf, config: SynthConfig, seed: int) -> tuple[Garden, OccupancyGrid | None]:
    """The garden that the last sequence had is likely that of the next."""
    garden = _stage(stage_of, config).garden(seed)
    return garden, scene_map(garden, config.map) if config.map.enabled else None


def _meta(plan: SynthPlan, source: GardenSource, stage: Stage, scene: int) -> dict[str, Any]:
    """All that was drawn, and what it depends on."""
    from swardmap.runs.versions import versions

    kinds = Counter(thing.kind for thing in source.garden.things)
    sensor = source.sensor
    return {
        "seed": plan.seed,
        "scene": f"{scene:04d}",
        "garden": {
            "name": source.garden.name,
            "seed": source.garden.seed,
            "things": dict(sorted(kinds.items())),
            "actors": len(source.garden.actors),
            "lot_m": source.garden.lot_m.tolist(),
        },
        "light": asdict(source.light),
        "camera": asdict(source.faults),
        "stereo": None if sensor is None else asdict(sensor),
        "intrinsics": asdict(source.intrinsics),
        "config": synth_config_to_dict(plan.config),
        "digest": digest(plan.to_dict()),
        "stage": stage.facts,
        "versions": versions(),
    }
