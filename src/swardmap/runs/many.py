"""Many recordings, a map each, by many processes or a Ray cluster.

OUT/plan.json        the recordings and all settings; another plan is refused in the same folder
OUT/NAME/            the map of one recording, whole or not there; see `files`
OUT/summary.json     what became of each
OUT/report.html      a page over all, which leads to those of the maps

A run that was killed goes on with the recordings that are not there yet; one that failed is tried again.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from swardmap.config import Config, config_to_dict, config_to_yaml
from swardmap.errors import InvalidValueError, SwardmapError, one_line
from swardmap.io.door import read_json, reading
from swardmap.io.files import refuse_to_replace, write_text
from swardmap.io.maps.map_files import read_map
from swardmap.runs.files import typed_command
from swardmap.runs.parallel import OnDone, Tick, each_part
from swardmap.runs.plan_folder import open_plan_folder
from swardmap.runs.recording import map_recording
from swardmap.runs.versions import network_digest

Recording = tuple[str, str]
"""Name of the folder of its map, and where it is."""

MAX_SUMMARY_BYTES = 2**26


def map_recordings(
    recordings: Sequence[str | Path],
    out: str | Path,
    config: Config | None = None,
    *,
    workers: int | None = None,
    ray_address: str | None = None,
    overwrite: bool = False,
    strict: bool = False,
    on_done: OnDone | None = None,
) -> dict[str, Any]:
    """Map each recording into a folder of its own, or go on where an earlier run stopped.

    Args:
        recordings: folders or files; two of one name get a number.
        out: folder; may hold an unfinished run of the same recordings and settings.
        config: all settings.
        workers: processes; None = one a core, 1 = this one.
        ray_address: Ray cluster to use in place of processes.
        overwrite: throw away what `out` holds, and begin anew.
        strict: a recording with a frame that the node's watchdog would refuse is not mapped.
        on_done: told how many recordings are done.

    Returns:
        `recordings`: name -> frames and cells of its map, or its `error`; what summary.json holds.

    Raises:
        InvalidValueError: without a recording.
        OutputError: if `out` holds something else or cannot be written.
    """
    out, config = Path(out), config or Config()
    named = _named(recordings)
    for _, location in named:
        refuse_to_replace(location, out)
    plan = {
        "recordings": dict(named),
        "config": config_to_dict(config),
        "network": network_digest(config),
        "strict": strict,
    }

    def difference(before: Mapping[str, Any]) -> str:
        return ", ".join(key for key in plan if before.get(key) != plan[key])

    open_plan_folder(out, "maps", lambda: plan, difference, overwrite)
    todo = [item for item in named if _summary(out / item[0]) is None]
    done, errors = len(named) - len(todo), dict[str, str]()
    if on_done is not None:
        on_done(done, len(named))
    one = replace(config, segmenter=replace(config.segmenter, threads=1))  # a core for each recording
    for (name, _), error in each_part(partial(_map_one, one, out, strict), todo, workers, ray_address):
        if error:
            errors[name] = error
        done += 1
        if on_done is not None:
            on_done(done, len(named))
    return _tell(out, [name for name, _ in named], errors, config)


def _named(recordings: Sequence[str | Path]) -> list[Recording]:
    if not recordings:
        raise InvalidValueError("expected at least one recording, got none")
    named: dict[str, str] = {}
    for recording in recordings:
        path = Path(recording).absolute()
        stem = path.name if path.is_dir() else path.stem
        stem, name, number = stem.lstrip(".") or "recording", "", 1
        while not name or name in named:
            name = stem if number == 1 else f"{stem}-{number}"
            number += 1
        named[name] = str(path)
    return list(named.items())


def _map_one(config: Config, out: Path, strict: bool, recording: Recording, tick: Tick) -> str:
    """Map one; empty, or why it cannot be mapped."""
    name, location = recording
    try:
        map_recording(location, out / name, config, overwrite=True, on_step=lambda _: tick(), strict=strict)
    except SwardmapError as error:
        return one_line(error)
    return ""


def _summary(folder: Path) -> dict[str, Any] | None:
    """What is told of a map that is there and whole; None if it is not."""
    file, shape = folder / "summary.json", {"interrupted": bool, "frames": int, "map": Any}
    try:
        with reading(file, "the summary of a map"):
            summary: dict[str, Any] = read_json(file, shape, MAX_SUMMARY_BYTES)
            _facts(summary)
    except SwardmapError:
        return None
    return None if summary["interrupted"] else summary


def _facts(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Frames and cells of a map."""
    return {"frames": summary["frames"], "cells": None if summary["map"] is None else summary["map"]["cells"]}


def _tell(out: Path, names: Sequence[str], errors: Mapping[str, str], config: Config) -> dict[str, Any]:
    """Write the page and the summary; what the summary holds."""
    summaries = {name: _summary(out / name) for name in names}
    reasons = {name: errors.get(name, "not mapped") for name in names}
    write_text(out / "report.html", _page(out, summaries, reasons, config), durable=False)
    found = {name: {"error": reasons[name]} if s is None else _facts(s) for name, s in summaries.items()}
    write_text(out / "summary.json", json.dumps({"recordings": found}, indent=2) + "\n")
    return {"recordings": found}


def _page(
    out: Path, summaries: Mapping[str, dict[str, Any] | None], reasons: Mapping[str, str], config: Config
) -> str:
    from swardmap.viz.maps_page import MappedRecording, maps_page

    told = [
        MappedRecording(name, {}, error=reasons[name])
        if summary is None
        else MappedRecording(name, summary, _picture(out / name))
        for name, summary in summaries.items()
    ]
    settings = config_to_yaml(config, comments=False)
    return maps_page(told, config.grid.resolution_m, settings, typed_command() or "made from Python")


def _picture(folder: Path) -> str:
    from swardmap.viz.maps_page import thumbnail

    try:
        return thumbnail(read_map(folder / "map.yaml"))
    except SwardmapError:  # no poses: it has no map, or somebody took it away
        return ""
