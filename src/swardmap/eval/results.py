"""From the records of the frames to everything a report says, as plain data in a fixed order."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from swardmap import __version__
from swardmap.eval.budget import budget_rows, missing_stages
from swardmap.eval.confusion import ConfusionMatrix, Share
from swardmap.eval.distances import DistanceSummary
from swardmap.eval.frame import Plan, split_key
from swardmap.eval.margin_section import MarginOptions, margin_section
from swardmap.eval.metrics import Tallies, metrics_section
from swardmap.eval.safety import SafetyTally, things_rows, total_safety
from swardmap.eval.tally import RANGE_BANDS_M, MapTally, total_of
from swardmap.eval.things import HEIGHT_CLASSES, PERSON

Record = Mapping[str, Any]

MOST_GROUPS = 60
"""A tag with more values than this is a name, not a group."""

JOINED = {"unknown": ["unknown"], "obstacle": ["obstacle", "person"], "grass": ["grass"]}
"""Classes of Tables 6, 8 and 9: a person is an obstacle."""


def results(
    plan: Plan, records: Sequence[Record], margin: MarginOptions | None = None, command: str = ""
) -> dict[str, Any]:
    """Everything that is known after an evaluation.

    Args:
        plan: that the records are of.
        records: of all frames, in order.
        margin: what the margin shall promise.
        command: that made the run, for the record.
    """
    margin = margin or MarginOptions()
    good = [r for r in records if "error" not in r]
    groups = groups_of(good)
    return {
        "swardmap": __version__,
        "fingerprint": plan.fingerprint,
        "command": command,
        "dataset": plan.dataset.location,
        "segmenter": plan.segmenter_name,
        "main": plan.main,
        "frames": {
            "total": len(records),
            "evaluated": len(good),
            "unreadable": [{"index": r["index"], "error": r["error"]} for r in records if "error" in r],
        },
        "masks": _grouped(good, groups, lambda rs: mask_section(mask_total(rs)) if rs else None),
        "margin_in_use_m": plan.margin_m,
        "unit": unit_of(good),
        "metrics": _grouped(good, groups, lambda rs: metrics_of(rs, plan.main) if rs else None),
        "safety": safety_section(plan, good),
        "maps": {
            key: _grouped(good, groups, lambda rs, key=key: map_section(map_total(rs, key)))  # type: ignore[misc]
            for key in (good[0]["maps"] if good else ())
        },
        "budget": _budget_section(plan, good),
        "margin": margin_section(plan, good, margin),
        "worst": [r["index"] for r in worst_first(good, plan.main)[:24]],
    }


def margin_for(plan: Plan, records: Sequence[Record], options: MarginOptions) -> dict[str, Any]:
    """The section `margin` alone, for another promise.

    Args:
        plan: that the records are of.
        records: of all frames.
        options: what the margin shall promise.
    """
    return margin_section(plan, [r for r in records if "error" not in r], options)


def groups_of(records: Sequence[Record]) -> dict[str, dict[str, list[Record]]]:
    """Records by tag and value, for tags with few values; in the order of tags and values."""
    tags = sorted({tag for r in records for tag in r["tags"]})
    groups: dict[str, dict[str, list[Record]]] = {}
    for tag in tags:
        values: dict[str, list[Record]] = {}
        for record in records:
            if tag in record["tags"]:
                values.setdefault(record["tags"][tag], []).append(record)
        if len(values) <= MOST_GROUPS:
            groups[tag] = dict(sorted(values.items()))
    return groups


def mask_total(records: Sequence[Record]) -> ConfusionMatrix:
    """The sum of the masks' matrices."""
    matrices = [ConfusionMatrix.from_dict(r["mask"]) for r in records]
    return sum(matrices[1:], matrices[0])


def map_total(records: Iterable[Record], key: str) -> MapTally:
    """The sum of the tallies of one kind of map."""
    _, resolution_m = split_key(key)
    return total_of([MapTally.from_dict(r["maps"][key], resolution_m) for r in records], resolution_m)


def tallies_of(record: Record, key: str) -> Tallies:
    """All that was counted of one frame with one kind of map."""
    return total_tallies([record], key)


def total_tallies(records: Sequence[Record], key: str) -> Tallies:
    """The sums of all that was counted with one kind of map."""
    safety = [SafetyTally.from_dict(r["safety"]) for r in records]
    return Tallies(mask_total(records), map_total(records, key), total_safety(safety, safety[0].margin_m))


UNITS = ("scene", "sequence")
"""Tags that say what is independent: a garden seen in five lights is one garden."""


def unit_of(records: Sequence[Record]) -> str | None:
    """The tag whose values are taken as independent; None if frames have none with several values."""
    for tag in UNITS:
        if len({r["tags"].get(tag) for r in records} - {None}) > 1:
            return tag
    return None


def metrics_of(records: Sequence[Record], key: str) -> dict[str, Any]:
    """Every metric of some frames, headlines with their interval by sequence."""
    unit, units = unit_of(records), dict[str, list[Record]]()
    for record in records if unit is not None else ():
        units.setdefault(record["tags"].get(unit, ""), []).append(record)
    return metrics_section(total_tallies(records, key), [total_tallies(rs, key) for rs in units.values()])


def safety_section(plan: Plan, records: Sequence[Record]) -> dict[str, Any]:
    """Things by height, kind and distance, cells by what is in them, and what nobody judged."""
    total = total_safety([SafetyTally.from_dict(r["safety"]) for r in records], plan.margin_m)
    kinds = sorted({k.kind for k in total.things})
    body = SafetyTally(plan.margin_m, {k: n for k, n in total.things.items() if k.kind == TEST_BODY})
    bands = range(len(RANGE_BANDS_M))
    return {
        "margin_m": plan.margin_m,
        "by_height": things_rows(total, "height", HEIGHT_CLASSES),
        "by_kind": things_rows(total, "kind", kinds),
        "by_range": things_rows(total, "band", bands),
        "test_body_by_range": things_rows(body, "band", bands) if body.things else [],
        "range_edges_m": list(RANGE_BANDS_M),
        "counts": dict(sorted(total.counts.items())),
    }


TEST_BODY = "test body"
"""Kind of the test body of ISO 18497 in gardens."""


def mask_section(matrix: ConfusionMatrix) -> dict[str, Any]:
    """Scores of a matrix, with the safety rates and the counts themselves."""
    return {
        "accuracy": matrix.accuracy,
        "counted": matrix.total,
        "classes": [asdict(scores) for scores in matrix.all_scores()],
        "obstacle_called_free": share(matrix.obstacle_called_free),
        "person_called_free": share(matrix.person_called_free),
        "free_called_obstacle": share(matrix.free_called_obstacle),
        "obstacle_not_seen": share(matrix.obstacle_not_seen),
        "matrix": matrix.to_dict(),
    }


def map_section(tally: MapTally) -> dict[str, Any]:
    """Scores of maps, d_min-obst in all its splits, and what was missed as a whole."""
    histogram = tally.distances()
    bands = [*RANGE_BANDS_M[1:], None]
    return {
        "frames": tally.frames,
        "frames_with_misses": tally.frames_with_misses,
        "frames_without_hit": tally.frames_without_hit,
        "cells": mask_section(tally.matrix),
        "joined": mask_section(tally.matrix.merged(JOINED)),
        "d_min": {
            "all": summary(histogram.summary()),
            "obstacle": summary(tally.distances(person=False).summary()),
            "person": summary(tally.distances(person=True).summary()),
            "obstacles_found_in_part": summary(tally.distances(found=True).summary()),
            "by_range_m": [
                {"from": low, "to": high, **summary(tally.distances(band=i).summary())}
                for i, (low, high) in enumerate(zip(RANGE_BANDS_M, bands, strict=True))
            ],
            "without_hit": tally.misses_without_hit,
            "histogram": histogram.to_dict(),
        },
        "missed": {
            "obstacles": tally.obstacles,
            "missed": tally.missed_obstacles,
            "called_free": tally.missed_called_free,
            "persons": sum(n for kind, n in tally.missed.items() if kind.person),
            "cells": sum(kind.cells * n for kind, n in tally.missed.items()),
            "largest_cells": max((kind.cells for kind in tally.missed), default=None),
            "by_size": _by_size(tally),
        },
    }


def _by_size(tally: MapTally) -> list[dict[str, Any]]:
    """Missed obstacles by size in cells: single cells are often noise of the reference, large ones never."""
    edges = [1, 2, 4, 10, 30]
    rows = []
    for low, high in zip(edges, [*edges[1:], None], strict=True):
        kinds = {k: n for k, n in tally.missed.items() if k.cells >= low and (high is None or k.cells < high)}
        free = sum(n for kind, n in kinds.items() if kind.called_free)
        rows.append({"from": low, "below": high, "missed": sum(kinds.values()), "called_free": free})
    return rows


def worst_first(records: Sequence[Record], key: str) -> list[Record]:
    """Frames with most at stake first: persons and things in danger, nothing found, cells missed."""

    def stake(record: Record) -> tuple[float, ...]:
        tally = MapTally.from_dict(record["maps"][key], split_key(key)[1])
        free = [m for m in record["missed"] if m["called_free"]]
        longest = tally.distances().summary().max_m or 0.0
        safety = SafetyTally.from_dict(record["safety"])
        return (
            -safety.of_things(height=PERSON)[2],
            -safety.of_things()[2],
            -tally.frames_without_hit,
            -sum(m["called_free"] for m in free if m["person"]),
            -sum(m["called_free"] for m in free),
            -longest,
            record["index"],
        )

    return sorted(records, key=stake)


def share(value: Share) -> dict[str, Any]:
    """A share with its count."""
    return {"share": value.value, "count": value.count, "of": value.of}


def summary(value: DistanceSummary) -> dict[str, Any]:
    """A summary with its quantiles by name."""
    plain = asdict(value)
    plain["quantiles_m"] = {f"{q:g}": v for q, v in value.quantiles_m.items()}
    return plain


def _budget_section(plan: Plan, records: Sequence[Record]) -> dict[str, Any]:
    if not plan.with_budget:
        return {"rows": [], "not_run": {"all": "the budget was switched off"}}
    # recordings of a run may have clean depth or not; rows of both would not add up
    stages = max((list(r["budget"]) for r in records), key=len, default=[])
    whole = [r for r in records if list(r["budget"]) == stages]
    left_out = len(records) - len(whole)
    _, resolution_m = split_key(plan.main)
    totals = {
        stage: total_of([MapTally.from_dict(r["budget"][stage], resolution_m) for r in whole], resolution_m)
        for stage in stages
    }
    rows = []
    for row in budget_rows(totals):
        plain = asdict(row)
        for name in ("called_free", "not_seen", "false_alarm"):
            plain[name] = share(getattr(row, name))
        rows.append(plain | {"d_min": summary(row.d_min)})
    has_pose = np.any([plan.pose_noise.xy_m, plan.pose_noise.yaw_deg, plan.pose_noise.tilt_deg])
    not_run = missing_stages("depth alone" in stages, bool(has_pose))
    if left_out:
        not_run[f"{left_out} frames"] = "they have no clean depth; the budget is of the others"
    return {"rows": rows, "not_run": not_run}


def _grouped(
    records: Sequence[Record],
    groups: Mapping[str, Mapping[str, Sequence[Record]]],
    section: Callable[[Sequence[Record]], Any],
) -> dict[str, Any]:
    return {
        "overall": section(records),
        "by": {tag: {value: section(rs) for value, rs in values.items()} for tag, values in groups.items()},
    }
