"""Kills a verb at each of its calls to the file system, and looks at what is left.

    python -m tests.runs.kills FOLDER EVERY [VERB ...]      a row for each verb, of a kill at every n-th call

A hook of the interpreter (sys.addaudithook) counts the calls that change files below FOLDER, in a process of
its own, and kills that at the n-th with SIGKILL. What must hold after each kill: the place of the result
holds the old result, the new one, or a folder that says which new one it is and goes on to it; never a
mixture. After the same command again: the bytes of an undisturbed run, and nothing beside them.
"""

import json
import os
import re
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Any

CHANGES = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink", "swardmap.exchange")
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
VARYING = ("timings_ms", "seconds", "command", "versions")
PLAN, MARKER = "plan.json", ".swardmap"
TROUBLES = ("lost", "double", "leftovers", "mixed")
LEFT = ("old", "none", "resumes", "new")


class TroubleError(Exception):
    """What a kill must never do.

    Args:
        kind: one of `TROUBLES`: a result is gone; there are two; something lies beside it; it is of both.
        why: for a person.
    """

    def __init__(self, kind: str, why: str) -> None:
        super().__init__(f"{kind}: {why}")
        self.kind = kind


@dataclass(frozen=True)
class Kill:
    """One kill.

    Attributes:
        call: at which call to the file system.
        left: what was then at the place of the result: old, new, none or resumes; empty if it was no whole.
        trouble: what went wrong, empty if nothing; `kind` of it is one of `TROUBLES`.
    """

    call: int
    left: str
    trouble: str = ""
    kind: str = ""


@dataclass(frozen=True)
class Verb:
    """One way to write a result.

    Attributes:
        command: writes it to a path; may raise or return an exit code.
        old: writes an older one there, to be replaced; None = nothing is there before.
        resumes: whether what is left after a kill may be a folder with a plan.
        grows: reads each file of a folder whose files are written over and over; raises if one is not whole.
        name: of the result.
    """

    command: Callable[[Path], Any]
    old: Callable[[Path], Any] | None = None
    resumes: bool = False
    name: str = "out"
    grows: Callable[[Path], Any] | None = None


def changes(event: str, arguments: tuple[Any, ...], below: str) -> bool:
    """Whether an audit event is a change of something below a folder."""
    if event == "open":
        path, _, flags = arguments
        return isinstance(path, str) and path.startswith(below) and bool(flags & WRITING)
    if event not in CHANGES:
        return False
    return any(str(a).startswith(below) for a in arguments[:2] if isinstance(a, (str, os.PathLike)))


def in_child(command: Callable[[Path], Any], out: Path, kill_at: int | None) -> tuple[bool, int]:
    """Run a command in a process of its own; whether it was killed, and its exit code."""
    child = os.fork()
    if child == 0:
        count, below = 0, str(out.parent)

        def hook(event: str, arguments: tuple[Any, ...]) -> None:
            nonlocal count
            if changes(event, arguments, below):
                count += 1
                if count == kill_at:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(hook)
        code = 3
        with Path(os.devnull).open("w") as nothing, redirect_stdout(nothing), redirect_stderr(nothing):
            try:
                code = int(command(out) or 0)
            finally:
                os._exit(code)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status), os.waitstatus_to_exitcode(status)


def content(path: Path) -> dict[str, bytes]:
    """All files below a path, or the file itself, without what differs between any two runs."""
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    return {str(p.relative_to(path)): steady(p) for p in files}


def steady(path: Path) -> bytes:
    """Content of a file, of JSON without timings."""
    if path.suffix == ".html":  # with timings in its text
        return re.sub(rb"[0-9]+", b"0", path.read_bytes())
    if path.suffix == ".pt":  # pickles of equal values may differ
        from swardmap.train.checkpoint import read_checkpoint

        return repr(values_of(read_checkpoint(path))).encode()
    if path.suffix != ".json":
        return path.read_bytes()
    tree = json.loads(path.read_bytes())
    return json.dumps(
        {k: v for k, v in tree.items() if k not in VARYING} if isinstance(tree, dict) else tree
    ).encode()


def values_of(tree: Any) -> Any:
    """A checkpoint's values, tensors by what they hold."""
    if isinstance(tree, dict):
        return sorted((repr(key), values_of(value)) for key, value in tree.items())
    if isinstance(tree, (list, tuple)):
        return [values_of(value) for value in tree]
    if hasattr(tree, "numpy"):
        array = tree.detach().numpy()
        return array.dtype, array.shape, sha256(array.tobytes()).hexdigest()
    return tree


def check_left(out: Path, verb: Verb, old: dict[str, bytes], new: dict[str, bytes]) -> str:
    """What a kill left at the place of the result: none, old, new or resumes.

    Raises:
        TroubleError: if it is none of these.
    """
    if not out.exists():
        if verb.old is not None:
            raise TroubleError("lost", "the old result is gone and the new one is not there")
        return "none"
    left = content(out)
    if left == new:
        return "new"
    if verb.old is not None and left == old:
        return "old"
    if verb.grows is not None:
        _grown(out, left, new, verb.grows)
    elif not verb.resumes:
        raise TroubleError("mixed", f"neither old nor new: {sorted(left)[:8]}")
    else:
        _resumable(left, old, new)
    return "resumes"


def _grown(out: Path, left: dict[str, bytes], new: dict[str, bytes], read: Callable[[Path], Any]) -> None:
    for file in out.iterdir():
        if not file.name.startswith("."):
            _whole(file, read)
    if strange := {n for n in left if not n.startswith(".")} - new.keys():
        raise TroubleError("mixed", f"files of another name: {sorted(strange)[:5]}")


def _resumable(left: dict[str, bytes], old: dict[str, bytes], new: dict[str, bytes]) -> None:
    if left.get(MARKER) != new[MARKER] or left.get(PLAN) != new[PLAN]:
        raise TroubleError("mixed", "it does not say what kind it is, or what it is going to be")
    seen = {n: c for n, c in left.items() if not Path(n).name.startswith(".")}
    strange = {
        n for n, c in seen.items() if (n in old and n not in new) or (n in old and c == old[n] != new[n])
    }
    if strange:
        raise TroubleError("mixed", f"of the old result: {sorted(strange)[:5]}")


def _whole(file: Path, read: Callable[[Path], Any]) -> None:
    try:
        read(file)
    except Exception as error:  # whatever it is, the file is torn
        raise TroubleError("mixed", f"{file.name} is not whole: {error}") from error


def check_again(out: Path, verb: Verb, new: dict[str, bytes]) -> None:
    """After the same command again: the bytes of an undisturbed run, and nothing beside them.

    Raises:
        TroubleError: if they are not.
    """
    again = content(out) if out.exists() else {}
    other = {name for name in again.keys() & new.keys() if again[name] != new[name]}
    for kind, names in (("lost", new.keys() - again), ("double", again.keys() - new), ("mixed", other)):
        if names:
            raise TroubleError(kind, f"after the same command again: {sorted(names)[:8]}")
    beside = [p for p in out.parent.iterdir() if p.name != verb.name]
    if double := [p.name for p in beside if p.is_dir() and any(p.iterdir()) and not p.name.startswith(".")]:
        raise TroubleError("double", f"beside the result: {double}")
    hidden = [p for p in out.rglob(".*") if p.name != MARKER] if out.is_dir() else []
    if beside or hidden:
        raise TroubleError("leftovers", str([p.name for p in (*beside, *hidden)]))


def kills(verb: Verb, folder: Path, every: int = 1, first: int = 1) -> Iterator[Kill]:
    """Kill at the n-th call, for each n, and look at what is left then and after the same command again."""
    undisturbed, older = (folder / name / verb.name for name in ("undisturbed", "older"))
    undisturbed.parent.mkdir(parents=True)
    assert in_child(verb.command, undisturbed, None) == (False, 0), "the command fails by itself"
    new, old = content(undisturbed), dict[str, bytes]()
    if verb.old is not None:
        older.parent.mkdir()
        assert in_child(verb.old, older, None) == (False, 0)
        old = content(older)
    n, killed = first, True
    while killed:
        here = folder / f"kill{n}"
        here.mkdir()
        out = here / verb.name
        if older.is_dir():
            shutil.copytree(older, out, symlinks=True)
        elif older.exists():
            shutil.copy(older, out)
        killed, _ = in_child(verb.command, out, n)
        left = ""
        try:
            left = check_left(out, verb, old, new) if killed else "new"
            if killed:
                in_child(verb.command, out, None)  # refuses a result that is whole
            check_again(out, verb, new)
        except TroubleError as trouble:
            yield Kill(n, left, str(trouble), trouble.kind)
        else:
            if killed:
                yield Kill(n, left)
        shutil.rmtree(here)
        n += every


def verbs(folder: Path) -> dict[str, Verb]:
    """The verbs on a small drive, each new and in place of an older result."""
    from swardmap.cli.app import run
    from swardmap.geometry import Intrinsics
    from swardmap.io.sources.folder import write_folder
    from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
    from swardmap.synth.plan import SynthPlan
    from swardmap.synth.produce import produce
    from tests.synth.small_stage import small_config, small_stage

    lens = Intrinsics(96, 72, 80.0, 80.0, 47.5, 35.5)
    drive = folder / "drive"
    write_folder(AnalyticSource(garden_scene(0), tuple(lane_poses(3, step_m=0.4)), lens), drive)
    plan = SynthPlan(scenes=1, frames=2, illuminations=("clear",), config=small_config())

    def mapped(*more: str) -> Callable[[Path], Any]:
        return lambda out: run(["map", str(drive), "-o", str(out), "--segmenter", "truth", *more])

    def evaluated(*more: str) -> Callable[[Path], Any]:
        settings = ["--segmenter", "truth", "--workers", "1", "--resolution", "0.1", "--no-budget"]
        return lambda out: run(["evaluate", str(drive), "-o", str(out), *settings, *more])

    def recorded(*more: str) -> Callable[[Path], Any]:
        return lambda out: run(["record", str(drive), "-o", str(out), *more])

    def filmed(plan: SynthPlan, overwrite: bool = False) -> Callable[[Path], Any]:
        def command(out: Path) -> None:
            produce(plan, out, small_stage, jobs=1, overwrite=overwrite)

        return command

    other, over = "grid.min_points=2", "--overwrite"
    living = ("--set", "grid.mode=evidence")
    return {
        "map": Verb(mapped()),
        "map_over": Verb(mapped(over), mapped("--set", other)),
        "map_living": Verb(mapped(*living, over), mapped(*living, "--set", other)),
        "evaluate": Verb(evaluated(), resumes=True),
        "evaluate_over": Verb(evaluated(over), evaluated("--set", other), resumes=True),
        "record": Verb(recorded(), name="drive.mcap"),
        "record_over": Verb(recorded(over), recorded("--frames", "2"), name="drive.mcap"),
        "synth": Verb(filmed(plan), resumes=True),
        "synth_over": Verb(filmed(plan, True), filmed(replace(plan, seed=1)), resumes=True),
        "node_save": Verb(_saved_by_the_node(drive)),
        **_trained(folder / "photos"),
    }


def _saved_by_the_node(drive: Path) -> Callable[[Path], Any]:
    """The service ~/save, whose living map a restarted node goes on from."""
    from swardmap.config import config_from_dict
    from swardmap.io import open_source
    from swardmap.models import build_segmenter
    from swardmap.ros.watched_mapper import WatchedMapper

    config = config_from_dict({"grid": {"mode": "log_odds"}, "segmenter": {"name": "colour"}})
    mapper = WatchedMapper(config, build_segmenter(config.segmenter, None), {"camera": None})
    for frame in open_source(drive):
        mapper.map_frame("camera", frame, frame.stamp_ns)

    def save(out: Path) -> None:
        if not out.exists():  # a node saves into a new folder at each call
            mapper.save(out)

    return save


def _trained(photos: Path) -> dict[str, Verb]:
    """Training of a tiny network, which is checked and saved twice; none without torch."""
    if find_spec("torch") is None:
        return {}
    import torch

    from swardmap.train.checkpoint import read_checkpoint
    from swardmap.train.loop import train
    from swardmap.train.recipe import recipe_from_dict
    from tests.train.conftest import write_photos

    torch.set_num_threads(1)
    write_photos(photos / "made", range(4))
    network = {"encoder": "efficientnet-lite0", "decoder_channels": 8, "rates": [1, 2, 3], "width": 32,
               "height": 32, "imagenet": False}  # fmt: skip
    schedule = {"steps": 2, "batch": 2, "crop": 32, "warmup": 1, "check_every": 1, "precision": "fp32"}
    data = [{"name": "made", "folder": "made"}, {"name": "held", "folder": "made", "validation": True}]
    recipe = recipe_from_dict({"name": "tiny", "network": network, "schedule": schedule, "data": data})

    def read(file: Path) -> None:
        if file.suffix == ".pt":
            read_checkpoint(file)
        else:
            assert file.stat().st_size > 0

    return {"train": Verb(lambda out: train(recipe, photos, out, lambda _: None) and 0, grows=read)}


def main(folder: Path, every: int, names: Sequence[str]) -> int:
    """Kill the verbs named, or all; prints a row for each; 1 if any kill did harm."""
    import cv2

    cv2.setNumThreads(1)  # a process with threads cannot be forked safely
    folder.mkdir(parents=True, exist_ok=True)
    found, bad = verbs(folder), 0
    print(f"| verb | kills | {' | '.join((*LEFT, *TROUBLES))} |", flush=True)  # noqa: T201
    for name in names or found:
        done = list(killed(found[name], folder / name, every))
        counts = [sum(k.left == left for k in done) for left in LEFT]
        counts += [sum(k.kind == kind for k in done) for kind in TROUBLES]
        print(f"| {name} | {len(done)} | {' | '.join(map(str, counts))} |", flush=True)  # noqa: T201
        for kill in done:
            if kill.trouble:
                print(f"kill at call {kill.call} of {name}: {kill.trouble}", flush=True)  # noqa: T201
                bad += 1
    return int(bad > 0)


def killed(verb: Verb, folder: Path, every: int) -> Iterator[Kill]:
    """The kills of a verb that has run once before, so that children find all loaded and compiled."""
    with Path(os.devnull).open("w") as nothing, redirect_stdout(nothing), redirect_stderr(nothing):
        verb.command(folder / "warm" / verb.name)
    return kills(verb, folder, every)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), int(sys.argv[2]), sys.argv[3:]))
