"""`swardmap teach` from end to end: labels and a page; and where that is wished, learning, gate, file."""

import hashlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from swardmap import __version__
from swardmap.errors import ConfigError
from swardmap.io.door import read_json
from swardmap.io.files import output_error, read_bytes, write_text
from swardmap.models import build_segmenter
from swardmap.models.spec import NetworkSpec
from swardmap.teach.again import AGAIN, label_again, second_recipe
from swardmap.teach.drive import read_drive
from swardmap.teach.faults import measure
from swardmap.teach.gate import Verdict, judge
from swardmap.teach.kept import FACTS, RUN, clear, forget_other_runs, is_of, labels_digest
from swardmap.teach.learn import (
    START_SHARES,
    Report,
    check_start,
    device_and_precision,
    driven_weight,
    export_candidate,
    know_images,
    learn_labels,
    read_network,
    refit_sureness,
    teach_recipe,
    tell,
    write_lit_gardens,
)
from swardmap.teach.page import JudgedDrive, mount_warning, teach_page, warnings
from swardmap.teach.task import Task
from swardmap.teach.write import (
    HELD,
    Written,
    doubt_of,
    ground_of,
    write_facts,
    write_labels,
)
from swardmap.train.recipe import Recipe

PAGE, GATE = "page.html", "gate.json"


@dataclass(frozen=True)
class Labelled:
    """What came of the labels: numbers, and lines that a person should read."""

    facts: Mapping[str, Any]
    warnings: Sequence[str] = field(default_factory=tuple)


OnFrames = Callable[[int, int | None], None]


def label(task: Task, on_frames: OnFrames) -> Labelled:
    """Write labels and page; what is there already, of the same drive and settings, is kept.

    Raises:
        ConfigError: if the network that it would write is there, taught by other drives or settings.
        InputError: for a recording that cannot be learnt from.
        OutputError: if the folder cannot be written.
    """
    facts_file, digest = task.folder / FACTS, labels_digest(task)
    if facts_file.is_file():
        facts = read_json(facts_file, {"digest": str})
        if facts.get("digest") == digest:
            return Labelled(facts, list(facts.get("warnings", [])))
    if task.out.exists() and not task.replace:
        raise not_ours(task.out)
    clear(task.folder)
    judged, written = _write_drives(task, on_frames)
    told = [*warnings(judged, written), *mount_warning(task.config.mount)]
    write_text(task.folder / PAGE, teach_page(judged, written, task.command))
    facts = {**written.facts(), "digest": digest, "warnings": told, **_facts_of(judged)}
    write_facts(facts_file, facts)
    return Labelled(facts, told)


def not_ours(out: Path) -> ConfigError:
    """The refusal of a file that is there already."""
    return ConfigError(
        f"{out} is there already, not taught by these drives with these settings; "
        "name another file, or add --replace"
    )


def _write_drives(task: Task, on_frames: OnFrames) -> tuple[list[JudgedDrive], Written]:
    """Read every drive twice: what is believed of it, then its labels."""
    segmenter = build_segmenter(replace(task.config.segmenter, name=str(task.start_file)))
    written, judged = Written(), []
    counts = [s.frame_count for s in task.sources]
    total = None if None in counts else 2 * sum(c for c in counts if c is not None)
    done = 0

    def on_frame() -> None:
        nonlocal done
        done += 1
        on_frames(done, total)

    for number, (name, source) in enumerate(zip(task.names, task.sources, strict=True)):
        drive = read_drive(name, source, segmenter, task.config, task.plan, on_frame)
        doubt = doubt_of(drive)
        ground = ground_of(drive, doubt, task.area, task.unwanted)
        judged.append(JudgedDrive(drive, doubt, ground))
        write_labels(
            source, drive, ground, segmenter, task.config, task.plan, task.folder, f"{number}_", written,
            on_frame,
        )  # fmt: skip
    return judged, written


def _facts_of(judged: Sequence[JudgedDrive]) -> dict[str, Any]:
    """Plain numbers of the drives."""
    doubtful_m2 = sum(float(j.doubt.cells.sum()) * j.drive.spec.resolution_m**2 for j in judged)
    return {
        "driven_m2": round(sum(j.drive.driven_m2 for j in judged), 2),
        "doubtful_m2": round(doubtful_m2, 2),
        "left_out": {j.drive.name: j.drive.left_out for j in judged},
        "no_grass_counts_above": [
            j.ground.least_other if math.isfinite(j.ground.least_other) else None for j in judged
        ],
        "drives": [j.drive.name for j in judged],
    }


def learn(task: Task, device: str, threads: int, report: Report) -> Verdict:
    """Learn from the labels, and write the network if the gate lets one pass.

    Returns:
        The verdict; `task.out` is written only if it passes.

    Raises:
        ConfigError: if that file is there, taught with other settings.
        SwardmapError: as training and export do.
    """
    began = time.monotonic()
    start, folder = task.start_file, task.folder
    spec = read_network(start)
    check_start(spec, start)
    device, precision = device_and_precision(device)
    facts = read_json(folder / FACTS, {"driven_share": float})
    weight = driven_weight(facts["driven_share"], task.plan.learn.driven_share)
    colours = write_lit_gardens(folder)
    recipe = teach_recipe(
        task.out.stem, start.absolute(), spec.licence, task.plan.learn, task.replay, precision, weight,
        in_your_light=len(colours) > 0,
    )  # fmt: skip
    if task.out.exists() and not task.replace and not is_of(folder / RUN, recipe.digest):
        raise not_ours(task.out)
    forget_other_runs(folder / RUN, recipe.digest)
    learnt = _learn_twice(task, recipe, report, device, threads)
    old = measure(start, folder / HELD, colours, threads)
    verdict, candidate = None, folder / "candidate.onnx"
    for share in START_SHARES:
        export_candidate(learnt, folder / RUN / "start.pt", folder, candidate, start, spec, share)
        bias = refit_sureness(candidate, start, colours)
        verdict = judge(old, measure(candidate, folder / HELD, colours, threads))
        write_facts(folder / GATE, {"start_share": share, "grass_bias": bias, **verdict.to_dict()})
        if verdict.passes:
            know_images(candidate, start, recipe, folder)
            tell(candidate, _taught(task, spec, share, verdict, time.monotonic() - began))
            try:
                candidate.replace(task.out)
            except OSError as error:
                raise output_error(task.out, error) from error
            return verdict
        report({"refused_with_start_share": share, "why": "; ".join(verdict.reasons)})
    assert verdict is not None  # noqa: S101 - there are shares to try
    candidate.unlink(missing_ok=True)
    return verdict


def _learn_twice(task: Task, recipe: Recipe, report: Report, device: str, threads: int) -> Path:
    """Learn from the drive, then again with what the network says of the rest; the last checkpoint."""
    folder, plan = task.folder, task.plan
    run, again = folder / RUN, folder / RUN / AGAIN
    learn_labels(recipe, folder, run, report, device, threads)
    if not plan.learn.again_steps:
        return run / "last.pt"
    share = label_again(folder, run / "last.pt", plan.labels)
    weight = driven_weight(share, plan.learn.driven_share)
    second = second_recipe(recipe, plan.learn, run / "last.pt", weight)
    forget_other_runs(again, second.digest)

    def further(figures: Mapping[str, Any]) -> None:
        report({**figures, "step": figures["step"] + recipe.schedule.steps})

    learn_labels(second, folder, again, further, device, threads)
    return again / "last.pt"


def _taught(task: Task, spec: NetworkSpec, share: float, verdict: Verdict, seconds: float) -> dict[str, Any]:
    """What travels in the file."""
    facts = read_json(task.folder / FACTS, {"digest": str})
    return {
        "from": spec.name,
        "from_digest": hashlib.sha256(read_bytes(task.start_file)).hexdigest()[:12],
        "swardmap": __version__,
        "start_share": share,
        "seconds": round(seconds),
        "drives": facts["drives"],
        "driven_m2": facts["driven_m2"],
        "frames": facts["frames_learn"],
        "steps": task.plan.learn.total_steps,
        **verdict.to_dict(),
    }
