"""Many sequences by many processes, so that an interrupted run goes on where it was.

OUT/plan.json holds what is made; another plan in the same folder is refused. A sequence, one garden in one
light, is made by one process and is whole when its marker is there; one without is made again. Everything
is drawn from (seed, scene, light, frame), so it does not matter who makes what, and when.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.config.loader import to_dict
from swardmap.grid import OccupancyGrid
from swardmap.io.sources.eden_layout import LIGHTS
from swardmap.runs.parallel import OnDone, Tick, each_part
from swardmap.synth.config import SynthConfig, digest
from swardmap.synth.model import Garden
from swardmap.synth.plan import SynthPlan, garden_seed, prepare_folder
from swardmap.synth.sequence import GardenSource
from swardmap.synth.sequence_files import discard, is_complete, write_sequence
from swardmap.synth.stage import Stage
from swardmap.synth.truth import scene_map

LIGHT_STREAM = 4
"""Of chance, beside those of camera, sensor and frames (see `sequence`)."""

StageOf = Callable[[SynthConfig], Stage]


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

    try:
        for _ in each_part(partial(_make, plan, out, stage_of), todo, jobs, on_tick=on_frame):
            pass
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


def _make(plan: SynthPlan, out: Path, stage_of: StageOf, sequence: tuple[int, str], tick: Tick) -> None:
    """Make one sequence anew."""
    scene, light = sequence
    stage = _stage(stage_of, plan.config)
    garden, grid = _garden(stage_of, plan.config, garden_seed(plan.seed, scene))
    source = make_source(plan, stage, scene, light, garden)
    discard(out, f"{scene:04d}", light)

    def meta() -> dict[str, Any]:
        return _meta(plan, source, stage, scene)

    write_sequence(source, out, f"{scene:04d}", grid, plan.config.map, meta, tick)


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
        "config": to_dict(plan.config),
        "digest": digest(plan.to_dict()),
        "stage": stage.facts,
        "versions": versions(),
    }
