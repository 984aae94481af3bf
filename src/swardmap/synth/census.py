"""What is to be seen in the frames of gardens, counted: classes, kinds of obstacle, poses, distances."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.errors import InputError
from swardmap.io.door import parse_json, through_door
from swardmap.io.files import read_bytes
from swardmap.labels import GRASS_OBSTACLE_PERSON, PERSON
from swardmap.synth.model import Thing, View

FACTS_FILE = "frames.jsonl"
EDGES_M = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 15.0, 30.0)
"""Borders of the ranges of distance; the last range has no end."""
SEEN_PIXELS = 20
"""A kind or a pose is seen in a frame that has so many pixels of it."""

Facts = Mapping[str, Any]


MAX_FACTS_BYTES = 2**28
FACTS_SHAPE = {"pixels": {"person": int}, "kinds": dict, "poses": dict, "distances": dict}


def frame_facts(view: View, things: Sequence[Thing]) -> dict[str, Any]:
    """Counts of one frame.

    Args:
        view: with exact depth and labels.
        things: `garden.at(stamp_ns)`, which `view.thing` refers to.

    Returns:
        pixels by class; pixels by kind of thing; pixels by pose of persons; pixels of each class by
        range of distance (EDGES_M), sky left out; distance of the nearest pixel of a person, or None.
    """
    classes = [c for c in GRASS_OBSTACLE_PERSON.classes if c.id in (0, 1, 2)]
    per_thing = np.bincount(view.thing.ravel(), minlength=len(things) + 1)[1:]
    kinds, poses = Counter[str](), Counter[str]()
    for thing, pixels in zip(things, per_thing.tolist(), strict=False):
        if pixels:
            kinds[thing.kind] += pixels
            if thing.label == PERSON:
                poses[thing.pose or "unknown"] += pixels
    there = view.depth_m > 0
    ranges = np.digitize(view.depth_m, EDGES_M[1:])
    distances = {
        c.name: np.bincount(ranges[there & (view.labels == c.id)], minlength=len(EDGES_M)).tolist()
        for c in classes
    }
    persons = view.depth_m[there & (view.labels == PERSON.id)]
    return {
        "pixels": {c.name: int(np.count_nonzero(view.labels == c.id)) for c in classes},
        "kinds": dict(sorted(kinds.items())),
        "poses": dict(sorted(poses.items())),
        "distances": distances,
        "nearest_person_m": round(float(persons.min()), 3) if persons.size else None,
    }


def read_facts(out: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Illumination and facts of every frame that `swardmap synth` wrote under a folder.

    Raises:
        InputError: if there is none, or a file is damaged.
    """
    files = sorted(out.glob(f"**/{FACTS_FILE}"))
    if not files:
        raise InputError(f"{out}: expected a folder that `swardmap synth` wrote, found no {FACTS_FILE} in it")
    for file in files:
        for line in read_bytes(file, MAX_FACTS_BYTES).splitlines():
            yield file.parent.name, parse_json(line, file, FACTS_SHAPE)


@through_door("facts of gardens")
def census_of(out: Path) -> dict[str, Any]:
    """The census of a folder that `swardmap synth` wrote.

    Raises:
        InputError: if there is none, or a file is damaged.
    """
    return census(read_facts(out))


def census(facts: Iterable[tuple[str, Facts]]) -> dict[str, Any]:
    """Sums over frames: all of them, and by illumination.

    Returns:
        `all` and `illuminations`: name -> frames, share of pixels by class, share of frames with at least
        SEEN_PIXELS of a person, frames by kind and by pose, share of the pixels of each class by range.
    """
    groups: dict[str, list[Facts]] = defaultdict(list)
    for illumination, frame in facts:
        groups[illumination].append(frame)
    everything = [frame for frames in groups.values() for frame in frames]
    return {
        "edges_m": list(EDGES_M),
        "all": _sums(everything),
        "illuminations": {name: _sums(frames) for name, frames in sorted(groups.items())},
    }


def census_text(found: Mapping[str, Any]) -> str:
    """The census as a person reads it."""
    total = found["all"]
    lines = [f"{total['frames']} frames, {100 * total['frames_with_person']:.0f} % of them with a person"]
    lines.append(f"{'':10}{'frames':>8}{'with person':>13}" + "".join(f"{n:>9}" for n in total["pixels"]))
    for name, group in {"all": total, **found["illuminations"]}.items():
        shares = "".join(f"{100 * share:8.1f}%" for share in group["pixels"].values())
        lines.append(f"{name:10}{group['frames']:8}{100 * group['frames_with_person']:12.0f}%{shares}")
    edges = found["edges_m"]
    heads = [f"{a:g}-{b:g}" for a, b in pairwise(edges)] + [f"{edges[-1]:g}-"]
    lines.append("share of pixels by distance in metres")
    lines.append(f"{'':10}" + "".join(f"{head:>8}" for head in heads))
    for name, shares in total["distances"].items():
        lines.append(f"{name:10}" + "".join(f"{100 * share:7.1f}%" for share in shares))
    for what in ("kinds", "poses"):
        told = ", ".join(f"{name} {count}" for name, count in _by_count(total[what]))
        lines.append(f"{what} (frames with {SEEN_PIXELS} pixels or more): {told or 'none'}")
    return "\n".join(lines)


def _sums(frames: Sequence[Facts]) -> dict[str, Any]:
    pixels, kinds, poses = Counter[str](), Counter[str](), Counter[str]()
    distances: dict[str, Any] = {}
    with_person = 0
    for frame in frames:
        pixels.update(frame["pixels"])
        kinds.update(name for name, count in frame["kinds"].items() if count >= SEEN_PIXELS)
        poses.update(name for name, count in frame["poses"].items() if count >= SEEN_PIXELS)
        with_person += frame["pixels"]["person"] >= SEEN_PIXELS
        for name, counts in frame["distances"].items():
            distances[name] = distances.get(name, 0) + np.asarray(counts, np.int64)
    return {
        "frames": len(frames),
        "frames_with_person": with_person / max(1, len(frames)),
        "pixels": {name: count / max(1, pixels.total()) for name, count in pixels.items()},
        "kinds": dict(sorted(kinds.items())),
        "poses": dict(sorted(poses.items())),
        "distances": {
            name: (counts / max(1, int(counts.sum()))).round(5).tolist() for name, counts in distances.items()
        },
    }


def _by_count(counts: Mapping[str, int]) -> list[tuple[str, int]]:
    return sorted(counts.items(), key=lambda item: (-item[1], item[0]))
