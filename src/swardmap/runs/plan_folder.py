"""A folder that says what a run makes in it, so that the run can go on after anything.

OUT/.swardmap    the kind of folder
OUT/plan.json    what is made; another plan is refused in the same folder

Both appear at once. Replacing a folder (`--overwrite`) exchanges it for an empty one with the new plan, so
that no result of the old plan is ever seen beside the new one.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from swardmap.errors import InputError, OutputError
from swardmap.io.door import reading
from swardmap.io.files import read_bytes, write_text
from swardmap.io.folders import (
    MARKER,
    clear_leftovers,
    is_unfinished,
    kind_of,
    new_output_folder,
    refuse_occupied,
    resolved,
)
from swardmap.io.staging import sweep_inside

PLAN_FILE = "plan.json"
MAX_PLAN_BYTES = 16 * 2**20


def open_plan_folder(
    out: Path,
    kind: str,
    plan: Callable[[], Mapping[str, Any]],
    difference: Callable[[Mapping[str, Any]], str],
    overwrite: bool = False,
    inner: tuple[str, ...] = (),
) -> Mapping[str, Any]:
    """Make a folder ready for a plan, or go on in one that has it; what its plan.json says.

    Args:
        out: the folder.
        kind: of folder.
        plan: makes what plan.json shall say; asked only if the folder is new.
        difference: says what differs between the plan there and this one; empty if nothing does.
        overwrite: throw away what is there, and begin anew.
        inner: folders inside in which runs write files, to be cleared of leftovers.

    Raises:
        OutputError: if `out` holds something else, or cannot be written.
    """
    out = resolved(out)
    clear_leftovers(out)
    for name in inner:
        sweep_inside(out / name)
    before = None if overwrite else _plan_there(out, kind)
    if before is not None:
        if what := difference(before):
            raise OutputError(
                f"{out} was made with other settings ({what}): choose another folder, give the same "
                "settings, or pass --overwrite to replace it"
            )
        return before
    if not _is_bare(out):
        refuse_occupied(out, overwrite, kind)
    new = plan()
    with new_output_folder(out, overwrite or _is_bare(out), kind) as folder:
        write_text(folder / PLAN_FILE, json.dumps(new, indent=2) + "\n")
    return new


def read_plan_file(out: Path) -> Mapping[str, Any]:
    """What plan.json of a folder says.

    Raises:
        InputError: if there is none, or it is damaged.
    """
    file, more = out / PLAN_FILE, "pass --overwrite to begin anew"
    content = read_bytes(file, MAX_PLAN_BYTES)
    with reading(file, "a plan", more=more):
        plan = json.loads(content)
    if not isinstance(plan, dict):
        raise InputError(f"{file}: expected a plan, got {type(plan).__name__}; {more}")
    return plan


def _plan_there(out: Path, kind: str) -> Mapping[str, Any] | None:
    try:
        there = (out / PLAN_FILE).is_file()
        found = None if is_unfinished(out) else kind_of(out)
    except OSError as error:
        raise OutputError(f"cannot read {out}: {error.strerror or error}") from error
    return read_plan_file(out) if there and found in (kind, "unknown") else None


def _is_bare(out: Path) -> bool:
    """Whether a folder holds nothing but our marker: a run was killed before its plan was written."""
    try:
        return out.is_dir() and [entry.name for entry in out.iterdir()] == [MARKER]
    except OSError:
        return False
