"""One evaluation of several recordings: that of the run itself, and those that were added to it later.

OUT/parts, OUT/plan.json     the first recording, as `run` writes them
OUT/more/001-NAME/...        a recording that `swardmap evaluate NAME -o OUT --more` added: a run of its own,
                             with the plan of the first but for its frames

What is added appears in the numbers when it is whole; a run that was killed goes on with the same command.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from swardmap import __version__
from swardmap.errors import InputError
from swardmap.eval.dataset import DatasetSpec, dataset_name
from swardmap.eval.frame import FORMAT, Plan
from swardmap.eval.run import is_finished, make_plan, read_plan, read_records
from swardmap.runs.plan_folder import read_plan_file

Record = Mapping[str, Any]

MORE = "more"
NUMBERED = re.compile(r"(\d{3,})-")


@dataclass(frozen=True, slots=True)
class Member:
    """One recording of a run.

    Attributes:
        name: that tells it from the others.
        plan: of its frames.
        first: index of its first frame among all.
        total: frames.
    """

    name: str
    plan: Plan
    first: int
    total: int


@dataclass(frozen=True, slots=True)
class Gathered:
    """All recordings of a run with their records, numbered through.

    Attributes:
        members: in the order in which they were added.
        records: of all frames.
        unfinished: names of recordings whose addition was interrupted; not among the members.
    """

    members: tuple[Member, ...]
    records: tuple[dict[str, Any], ...]
    unfinished: tuple[str, ...] = ()

    @property
    def plan(self) -> Plan:
        """Of the first recording; the others differ from it in their frames only."""
        return self.members[0].plan

    def locate(self, index: int) -> tuple[Plan, int]:
        """The plan that a frame belongs to, and its index there."""
        member = next(m for m in reversed(self.members) if m.first <= index)
        return member.plan, index - member.first


def alone(plan: Plan, records: Sequence[dict[str, Any]]) -> Gathered:
    """A run of one recording whose records are known."""
    name = dataset_name(plan.dataset.location)
    return Gathered((Member(name, plan, 0, len(records)),), tuple(records))


def gather(out: Path) -> Gathered:
    """Everything that a run has evaluated.

    Raises:
        InputError: if the folder holds no finished run.
    """
    plan, total = read_plan(out)
    members = [Member(dataset_name(plan.dataset.location), plan, 0, total)]
    records = read_records(out, total)
    unfinished = []
    for folder in added_folders(out):
        added, count = read_plan(folder)
        name = _other_name(dataset_name(added.dataset.location), [m.name for m in members])
        if not is_finished(folder, count):
            unfinished.append(name)
            continue
        member = Member(name, added, len(records), count)
        members.append(member)
        records += [_numbered(record, member) for record in read_records(folder, count)]
    if len(members) > 1:
        records[:total] = [_of_drive(record, members[0].name) for record in records[:total]]
    return Gathered(tuple(members), tuple(records), tuple(unfinished))


def added_folders(out: Path) -> list[Path]:
    """Folders of the recordings that were added, in the order in which they were."""
    found = [f for f in (out / MORE).glob("*") if NUMBERED.match(f.name) and (f / "plan.json").is_file()]
    return sorted(found, key=lambda f: int(f.name.split("-")[0]))


def place_for_more(out: Path, dataset: DatasetSpec) -> tuple[Plan, Path]:
    """Plan and folder of a recording that is to be added to a finished run, or goes on being added.

    Args:
        out: folder of the run.
        dataset: what to add.

    Raises:
        InputError: if `out` holds no finished run of this version, its network is another by now, or the
            recording is the run's first.
    """
    plan, total = read_plan(out)
    _refuse_others(out)
    if not is_finished(out, total):
        raise InputError(f"{out} is not finished: give its own command again, then add to it")
    margin_m, mount = plan.margin_m, plan.T_base_camera
    made = make_plan(
        dataset, replace(plan.config, source=dataset.source), resolutions_m=plan.resolutions_m,
        protocols=plan.protocols, pose_noise=plan.pose_noise, with_budget=plan.with_budget,
        seed=plan.seed, margin_m=margin_m, T_base_camera=mount,
    )  # fmt: skip
    if made.network != plan.network:
        raise InputError(
            f"{out} was evaluated with another network than the one that is there now: numbers of two "
            "networks are not added up; evaluate everything anew in another folder"
        )
    folders = added_folders(out)
    for folder in folders:
        if _chosen(read_plan(folder)[0]) == _chosen(made):
            return made, folder  # goes on, or is there already
    for there, count in ((plan, total), *map(read_plan, folders)):
        if _share_frames(made, there, count):
            raise InputError(
                f"frames of {dataset.location} are in {out} already, and no frame counts twice; "
                "add another recording, or other frames of it with --set source.start=..."
            )
    number = 1 + max((int(f.name.split("-")[0]) for f in folders), default=0)
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", dataset_name(dataset.location))[:60]
    return made, out / MORE / f"{number:03d}-{plain}"


def recordings_section(run: Gathered) -> list[dict[str, Any]]:
    """Name and number of frames of each recording."""
    return [{"name": m.name, "frames": m.total} for m in run.members]


def _refuse_others(out: Path) -> None:
    """Records of another version may mean something else."""
    said = read_plan_file(out).get("plan")
    there = (said.get("format"), said.get("version")) if isinstance(said, dict) else (None, None)
    if there != (FORMAT, __version__):
        raise InputError(
            f"{out} was evaluated by swardmap {there[1]}, this is {__version__}: numbers of two versions are "
            "not added up; evaluate everything anew in another folder"
        )


def _chosen(plan: Plan) -> tuple[Any, ...]:
    """Which frames of which recording a plan is about; one place has many spellings."""
    location, source = plan.dataset.location, plan.dataset.source
    path = Path(location)
    return str(path.resolve()) if path.exists() else location, source.start, source.stop, source.every


def _share_frames(new: Plan, there: Plan, count: int) -> bool:
    """Whether a new plan would take a frame that is evaluated already."""
    (location, start, stop, every), (known, first, _, step) = _chosen(new), _chosen(there)
    return location == known and any(
        i >= start and (stop is None or i < stop) and (i - start) % every == 0
        for i in range(first, first + count * step, step)
    )


def _other_name(name: str, taken: Sequence[str]) -> str:
    """A name that none of the others has."""

    def tries() -> Iterator[str]:
        yield name
        for number in range(2, len(taken) + 3):
            yield f"{name} ({number})"

    return next(each for each in tries() if each not in taken)


def _numbered(record: Mapping[str, Any], member: Member) -> dict[str, Any]:
    """A record of an added recording among all: number, frame and drive are its own."""
    own = _of_drive(record, member.name) | {"index": record["index"] + member.first}
    if "error" in own:
        return own
    return own | {"name": f"{member.name}/{own['name'] or record['index']}"}


def _of_drive(record: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The record with the drive it is of, so that drives can be taken as what is independent."""
    if "error" in record:
        return dict(record)
    sequence = record["tags"].get("sequence")
    drive = name if sequence in (None, "") else f"{name}/{sequence}"
    return {**record, "tags": {**record["tags"], "sequence": drive}}
