"""The evaluation of a whole data set, in parts that any process of any machine can do.

OUT/plan.json            what is evaluated; another plan is refused in the same folder
OUT/parts/A-B.jsonl      records of the frames A..B-1, each file complete or not there at all
OUT/results.json, ...    what follows from the records; see `results` and `report`
OUT/more/                recordings that were added later; see `gathered`

A part is written under its name only when it is whole, and the numbers come from the parts on the disk in
the order of the frames. So a run that was killed goes on where it was, loses nothing and counts nothing
twice, and the result does not depend on who did which part.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from swardmap.config import Config
from swardmap.errors import InputError, shortened
from swardmap.eval.dataset import DatasetSpec, count_frames, data_marks, open_dataset
from swardmap.eval.frame import Plan, evaluate_part
from swardmap.io.door import parse_json, reading
from swardmap.io.files import read_bytes, write_text
from swardmap.pipeline import configured_mount
from swardmap.runs.parallel import OnDone, Tick, each_part
from swardmap.runs.plan_folder import open_plan_folder, read_plan_file
from swardmap.runs.record_looks import refused_in_order
from swardmap.runs.versions import network_digest

Part = tuple[int, int]

MAX_FRAMES = 100_000_000
MAX_PART_BYTES = 2**28


def make_plan(dataset: DatasetSpec, config: Config | None = None, **options: Any) -> Plan:
    """A plan for a data set, checked as far as that is cheap: labels there.

    Args:
        dataset: the frames.
        config: of the robot.
        options: fields of Plan.

    Raises:
        InputError: if the data set cannot be opened, or has no true labels.
    """
    config = config or Config()
    source = open_dataset(dataset, config)
    if source.label_set is None and dataset.masks is None:
        raise InputError(
            f"{source.name} has no true labels to compare with; name masks of the same frames with --masks"
        )
    mount = options.pop("T_base_camera", None)
    if mount is None and (pose := configured_mount(config.mount)) is not None:
        mount = tuple(pose.matrix.ravel().tolist())
    options.setdefault("margin_m", config.costmap.obstacle_margin_m)
    network, data = network_digest(config), data_marks(dataset)
    return Plan(dataset, config, T_base_camera=mount, network=network, data=data, **options)


def evaluate(
    plan: Plan,
    out: str | Path,
    *,
    workers: int | None = None,
    ray_address: str | None = None,
    strict: bool = False,
    overwrite: bool = False,
    on_done: OnDone | None = None,
) -> list[dict[str, Any]]:
    """Evaluate every frame of a plan, or go on where an earlier run stopped.

    Args:
        plan: from `make_plan`.
        out: folder; may hold an unfinished run of the same plan.
        workers: processes; None = one a core, 1 = this one.
        ray_address: Ray cluster to use in place of processes.
        strict: stop at the first frame that cannot be evaluated.
        overwrite: throw away what `out` holds of this or another plan, and begin anew.
        on_done: told of the progress.

    Returns:
        The records of all frames, in order.

    Raises:
        InputError: with `strict`, for a frame that cannot be evaluated.
        OutputError: if `out` holds something else, or cannot be written.
    """
    out = Path(out)
    total = _prepare(plan, out, overwrite)
    todo = [part for part in parts_of(total) if not _is_whole(out, part)]
    done = total - sum(stop - start for start, stop in todo)
    if on_done is not None:
        on_done(done, total)
    work = partial(_work, replace(plan, config=_one_thread(plan.config)))
    for (start, stop), text in each_part(work, todo, workers, ray_address):
        if strict:
            _stop_at_fault([json.loads(line) for line in text.splitlines()], plan.config)
        _write_part(out, (start, stop), text)
        done += stop - start
        if on_done is not None:
            on_done(done, total)
    records = read_records(out, total)
    if strict:  # of all: a frame may repeat the last of the part before
        _stop_at_fault(records, plan.config)
    return records


def parts_of(total: int) -> list[Part]:
    """How frames are split; depends on their number only, so that a resumed run has the same parts."""
    size = 8 if total < 1024 else 64 if total < 16_384 else 128
    return [(start, min(start + size, total)) for start in range(0, total, size)]


def read_records(out: Path, total: int) -> list[dict[str, Any]]:
    """All records, in order, each frame exactly once.

    Raises:
        InputError: if one is missing.
    """
    records = []
    for part in parts_of(total):
        try:
            records += _read_part(out, part)
        except InputError as error:
            raise InputError(f"{error}; run the same command again") from error
    if [r["index"] for r in records] != list(range(total)):
        raise InputError(f"{out}: expected {total} frames, each once; run again with --overwrite")
    return records


def read_plan(out: Path) -> tuple[Plan, int]:
    """Plan and number of frames of a run.

    Raises:
        InputError: if the folder holds none.
    """
    what = "a folder that `swardmap evaluate` wrote"
    try:
        plain = read_plan_file(out)
    except InputError as error:
        raise InputError(f"{out}: expected {what} ({error})") from error
    with reading(out, what):
        return Plan.from_json(json.dumps(plain["plan"])), _frames_said(plain, out)


def is_finished(out: Path, total: int) -> bool:
    """Whether every part of a run is there, with every frame."""
    return all(_is_whole(out, part) for part in parts_of(total))


def _prepare(plan: Plan, out: Path, overwrite: bool) -> int:
    """Make the folder ready for this plan; the number of frames."""

    def new() -> dict[str, Any]:
        total = count_frames(plan.dataset)
        if total == 0:
            raise InputError(f"{plan.dataset.location} holds no frame")
        return {"plan": json.loads(plan.to_json()), "fingerprint": plan.fingerprint, "frames": total}

    def difference(known: Mapping[str, Any]) -> str:
        return "" if known.get("fingerprint") == plan.fingerprint else _difference(known.get("plan"), plan)

    known = open_plan_folder(out, "evaluation", new, difference, overwrite, inner=("parts",))
    return _frames_said(known, out)


def _frames_said(plain: Mapping[str, Any], out: Path) -> int:
    """The number of frames that a plan.json says."""
    frames = plain.get("frames")
    if not isinstance(frames, int) or isinstance(frames, bool) or not 0 < frames <= MAX_FRAMES:
        raise InputError(f"{out}: expected a number of frames in plan.json, got {shortened(frames)}")
    return frames


def _difference(there: Any, plan: Plan) -> str:
    """What of two plans differs, by name; of data that was changed, which."""
    now = json.loads(plan.to_json())
    before = there if isinstance(there, dict) else {}
    names = [name for name in now if name != "data" and before.get(name) != now[name]]
    known = {tuple(each) for each in before.get("data", ()) if isinstance(each, list)}
    changed = [
        f"files of the {role} changed since" for role, marks in plan.data if (role, marks) not in known
    ]
    return f"other data or settings: {', '.join([*names, *changed] or ['data'])}"


def _part_path(out: Path, part: Part) -> Path:
    return out / "parts" / f"{part[0]:07d}-{part[1]:07d}.jsonl"


def _read_part(out: Path, part: Part) -> list[dict[str, Any]]:
    path = _part_path(out, part)
    lines = read_bytes(path, MAX_PART_BYTES).splitlines()
    return [parse_json(line, path, {"index": int}) for line in lines]


def _write_part(out: Path, part: Part, text: str) -> None:
    write_text(_part_path(out, part), text)


def _is_whole(out: Path, part: Part) -> bool:
    """Whether a part is there with every frame; one that was damaged from outside is done again."""
    try:
        return [record["index"] for record in _read_part(out, part)] == list(range(*part))
    except InputError:
        return False


def _stop_at_fault(records: list[dict[str, Any]], config: Config) -> None:
    """Raise InputError for the first of these frames, in order, that failed or that the watchdog refuses."""
    for record in records:
        if "error" in record:
            raise InputError(f"frame {record['index']}: {record['error']} (--strict stops here)")
    for refused, faults in refused_in_order(records, config.watchdog):
        raise InputError(f"frame {refused['index']}: {', '.join(faults)} (--strict stops here)")


def _work(plan: Plan, part: Part, _: Tick) -> str:
    return evaluate_part(plan, *part)


def _one_thread(config: Config) -> Config:
    """A core for each part: a network must not take them all, and rounds the same however many there are."""
    return replace(config, segmenter=replace(config.segmenter, threads=1))
