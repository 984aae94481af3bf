"""The folder beside the taught network: what an earlier run left there, and whether it may serve again."""

import hashlib
import shutil
from dataclasses import asdict
from pathlib import Path

from swardmap.config import config_to_dict
from swardmap.errors import OutputError
from swardmap.io.files import read_bytes, write_text
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
    areas = [
        [ring.tolist() for p in a.polygons for ring in p.rings] for a in (task.area, *task.unwanted) if a
    ]
    said = [
        LABELS_VERSION,
        [mark for file in task.files for mark in _marks(file)],
        hashlib.sha256(read_bytes(task.start_file)).hexdigest(),
        plan.footprint_m.tolist(),
        plan.leave_out_s,
        asdict(plan.labels),
        areas,
        {k: config[k] for k in ("source", "mount", "cloud", "grid", "geometry")},
    ]
    return hashlib.sha256(repr(said).encode()).hexdigest()[:16]


def _marks(recording: Path) -> list[tuple[str, int, int]]:
    """Name, size and time of change of each file of a recording."""
    if not recording.exists():
        return [(str(recording), 0, 0)]  # made by its name, as analytic: is
    inside = [p for p in recording.rglob("*") if p.is_file()] if recording.is_dir() else [recording]
    stats = [(p, p.stat()) for p in sorted(inside)]
    return [(str(p.absolute()), s.st_size, s.st_mtime_ns) for p, s in stats]


def clear(folder: Path) -> None:
    """Make the folder, without the labels and checkpoints of other settings."""
    try:
        for part in (LEARN, HELD, SAID, OPEN, SAID_AGAIN, LIT_GARDENS, RUN):
            shutil.rmtree(folder / part, ignore_errors=True)
        (folder / FACTS).unlink(missing_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder {folder}: {error.strerror}") from error


def forget_other_runs(folder: Path, digest: str) -> None:
    """Checkpoints of another recipe over these labels are no use: begin anew."""
    mark = folder / RUN / "recipe.txt"
    if (folder / RUN).exists() and (not mark.is_file() or mark.read_text(encoding="utf-8") != digest):
        shutil.rmtree(folder / RUN)
    mark.parent.mkdir(parents=True, exist_ok=True)
    write_text(mark, digest)
