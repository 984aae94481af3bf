"""The folder beside the taught network: what an earlier run left there, and whether it may serve again."""

import hashlib
import shutil
from dataclasses import asdict
from pathlib import Path

from swardmap.config import config_to_dict
from swardmap.errors import OutputError
from swardmap.io.files import read_bytes, write_text
from swardmap.io.marks import marks_of
from swardmap.mapping.work_area import WorkArea
from swardmap.teach.again import SAID_AGAIN
from swardmap.teach.learn import LIT_GARDENS
from swardmap.teach.task import Task
from swardmap.teach.write import HELD, LEARN, OPEN, SAID

FACTS, RUN = "labels.json", "run"
LABELS_VERSION = 2
"""Of what the folder holds: labels of an earlier one are made anew."""


def labels_digest(task: Task) -> str:
    """Of everything that shapes the labels: the same again need not be made again.

    Recordings count by where they lie and when they were written: many a drive is called the same.
    """
    plan, config = task.plan, config_to_dict(task.config)
    made = (task.out.absolute(), task.folder.absolute())  # may lie in the recording
    said = [
        LABELS_VERSION,
        [(str(file.absolute()), marks_of(file, made)) for file in task.files],
        hashlib.sha256(read_bytes(task.start_file)).hexdigest(),
        plan.footprint_m.tolist(),
        plan.leave_out_s,
        asdict(plan.labels),
        None if task.area is None else _area(task.area),
        [_area(area) for area in task.unwanted],
        {k: config[k] for k in ("source", "mount", "cloud", "grid", "geometry")},
    ]
    return hashlib.sha256(repr(said).encode()).hexdigest()[:16]


def _area(area: WorkArea) -> tuple[str, list[tuple[str, list[list[list[float]]]]]]:
    """Frame, and role and rings of each polygon: the same ring may be lawn or be kept out of."""
    return area.frame_id, [(str(p.role), [ring.tolist() for ring in p.rings]) for p in area.polygons]


def clear(folder: Path) -> None:
    """Make the folder, without the labels and checkpoints of other settings."""
    try:
        for part in (LEARN, HELD, SAID, OPEN, SAID_AGAIN, LIT_GARDENS, RUN):
            shutil.rmtree(folder / part, ignore_errors=True)
        (folder / FACTS).unlink(missing_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder {folder}: {error.strerror}") from error


def is_of(run: Path, digest: str) -> bool:
    """Whether checkpoints of this recipe lie in a folder."""
    mark = run / "recipe.txt"
    return mark.is_file() and mark.read_text(encoding="utf-8") == digest


def forget_other_runs(run: Path, digest: str) -> None:
    """Checkpoints of another recipe are no use: begin anew in their folder.

    Raises:
        OutputError: if it cannot be written.
    """
    try:
        if run.exists() and not is_of(run, digest):
            shutil.rmtree(run)
        run.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write to {run}: {error.strerror}") from error
    write_text(run / "recipe.txt", digest)
