"""The evaluation of a whole data set, in parts that any process of any machine can do.

OUT/plan.json            what is evaluated; another plan is refused in the same folder
OUT/parts/A-B.jsonl      records of the frames A..B-1, each file complete or not there at all
OUT/results.json, ...    what follows from the records; see `results` and `report`

A part is written under its name only when it is whole, and the numbers come from the parts on the disk in
the order of the frames. So a run that was killed goes on where it was, loses nothing and counts nothing
twice, and the result does not depend on who did which part.
"""

import json
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from swardmap.config import Config
from swardmap.errors import ConfigError, InputError, OutputError
from swardmap.eval.dataset import DatasetSpec, count_frames, open_dataset
from swardmap.eval.frame import DEFAULT_MARGIN_M, Plan, evaluate_part
from swardmap.pipeline import configured_mount

Part = tuple[int, int]
OnDone = Callable[[int, int], None]
"""Called with the number of frames done and of all frames."""


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
    source = open_dataset(dataset)
    if source.label_set is None and dataset.masks is None:
        raise InputError(
            f"{source.name} has no true labels to compare with; name masks of the same frames with --masks"
        )
    mount = options.pop("T_base_camera", None)
    if mount is None and (pose := configured_mount(config.mount)) is not None:
        mount = tuple(pose.matrix.ravel().tolist())
    options.setdefault("margin_m", config.costmap.margin_m or DEFAULT_MARGIN_M)
    return Plan(dataset, config, T_base_camera=mount, network=_network_digest(config), **options)


def _network_digest(config: Config) -> str:
    """Tells network files apart, so that results of two networks of one name are never mixed."""
    from swardmap.io.files import read_bytes
    from swardmap.models import bundled_network

    name = config.segmenter.name
    path = bundled_network() if name == "auto" else Path(name) if name.lower().endswith(".onnx") else None
    return "" if path is None else sha256(read_bytes(path)).hexdigest()[:16]


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
    for (start, stop), text in _worked(plan, todo, workers, ray_address):
        if strict:
            _stop_at_error(text)
        _write_part(out, (start, stop), text)
        done += stop - start
        if on_done is not None:
            on_done(done, total)
    return read_records(out, total)


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
        path = _part_path(out, part)
        try:
            records += [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        except (OSError, ValueError) as error:
            raise InputError(f"cannot read {path}: {error}; run the same command again") from error
    if [r["index"] for r in records] != list(range(total)):
        raise InputError(f"{out}: expected {total} frames, each once; run again with --overwrite")
    return records


def read_plan(out: Path) -> tuple[Plan, int]:
    """Plan and number of frames of a run.

    Raises:
        InputError: if the folder holds none.
    """
    try:
        plain = json.loads((out / "plan.json").read_text(encoding="utf-8"))
        return Plan.from_json(json.dumps(plain["plan"])), int(plain["frames"])
    except (OSError, ValueError, KeyError, TypeError, ConfigError) as error:
        raise InputError(f"{out}: expected a folder that `swardmap evaluate` wrote ({error})") from error


def _prepare(plan: Plan, out: Path, overwrite: bool) -> int:
    """Make the folder ready for this plan; the number of frames."""
    from swardmap.io.files import MARKER, write_text

    known = None
    if (out / "plan.json").is_file():
        try:
            known = json.loads((out / "plan.json").read_text(encoding="utf-8"))
        except ValueError:
            known = {}
        if known.get("fingerprint") == plan.fingerprint and not overwrite:
            return int(known["frames"])
        if not overwrite:
            raise OutputError(
                f"{out} holds the evaluation of other data or settings: choose another folder, "
                "or pass --overwrite to replace it"
            )
    elif out.is_dir() and any(out.iterdir()):
        raise OutputError(f"{out} exists and holds no evaluation: choose another folder")
    total = count_frames(plan.dataset)
    if total == 0:
        raise InputError(f"{plan.dataset.location} holds no frame")
    for old in (out / "parts").glob("*.jsonl"):
        old.unlink()
    write_text(out / MARKER, "Made by swardmap. --overwrite may replace this folder.\n")
    plain = {"plan": json.loads(plan.to_json()), "fingerprint": plan.fingerprint, "frames": total}
    write_text(out / "plan.json", json.dumps(plain, indent=2) + "\n")
    return total


def _part_path(out: Path, part: Part) -> Path:
    return out / "parts" / f"{part[0]:07d}-{part[1]:07d}.jsonl"


def _write_part(out: Path, part: Part, text: str) -> None:
    from swardmap.io.files import write_text

    write_text(_part_path(out, part), text)


def _is_whole(out: Path, part: Part) -> bool:
    """Whether a part is there with every frame; one that was damaged from outside is done again."""
    try:
        lines = _part_path(out, part).read_text(encoding="utf-8").splitlines()
        return [json.loads(line)["index"] for line in lines] == list(range(*part))
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _stop_at_error(text: str) -> None:
    for line in text.splitlines():
        record = json.loads(line)
        if "error" in record:
            raise InputError(f"frame {record['index']}: {record['error']} (--strict stops here)")


def _worked(
    plan: Plan, todo: list[Part], workers: int | None, ray_address: str | None
) -> Iterator[tuple[Part, str]]:
    plan = replace(plan, config=_one_thread(plan.config))
    if ray_address is not None:
        from swardmap.eval.cluster import on_ray

        return on_ray(plan, todo, ray_address)
    workers = workers or len(os.sched_getaffinity(0))
    if workers == 1 or len(todo) <= 1:
        return ((part, evaluate_part(plan, *part)) for part in todo)
    return _in_processes(plan, todo, min(workers, len(todo)))


def _in_processes(plan: Plan, todo: Iterable[Part], workers: int) -> Iterator[tuple[Part, str]]:
    """Parts in the order in which they are finished; two a worker are under way, so that none waits."""
    waiting = iter(todo)
    with ProcessPoolExecutor(workers, get_context("spawn"), _start_worker, (os.getpid(),)) as pool:
        running: dict[Future[str], Part] = {}
        try:
            while True:
                while len(running) < 2 * workers and (part := next(waiting, None)) is not None:
                    running[pool.submit(evaluate_part, plan, *part)] = part
                if not running:
                    return
                finished, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    yield running.pop(future), _text_of(future)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _text_of(future: "Future[str]") -> str:
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise InputError(
            "a process of the evaluation died, perhaps for want of memory; give the same command again, "
            "with fewer --workers: what is finished is kept"
        ) from error


def _one_thread(config: Config) -> Config:
    """A core for each part: a network must not take them all, and rounds the same however many there are."""
    return replace(config, segmenter=replace(config.segmenter, threads=1))


def _start_worker(parent: int) -> None:
    """End with the parent, even if that is killed: an orphan would wait for work for ever."""
    import signal
    import threading
    import time

    import cv2

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's
    cv2.setNumThreads(1)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
