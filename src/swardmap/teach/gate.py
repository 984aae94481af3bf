"""The gate: the old and the new network on what must not get worse, and a verdict that may be no.

Counted per network and garden (of the safety set) or group of frames (of the drive's part held out):
pixels, and things, that it calls grass, and pixels that it is so sure of that they would clear a cell of
the map (`grid.clear_below`). A dangerous figure of the new network may not lie above the 95 % interval of
the old one's; nor may it rise by more than chance in the same gardens, for these differ from each other far
more than one network from another.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import GridConfig
from swardmap.eval.intervals import share_interval
from swardmap.eval.things import HEIGHTS_M
from swardmap.io.images import read_color, read_mask
from swardmap.io.sources.truth import FIRST_AREA
from swardmap.labels import GRASS, OTHER, PERSON, MapClass
from swardmap.models.network_io import segmentation_of
from swardmap.models.onnx import OnnxSegmenter
from swardmap.teach.safety import SafetyFrame, safety_frames

FEWEST_PIXELS = 20
"""Of a thing, to count."""
GONE_SHARE = 0.5
"""A thing of which more than this is called grass is overlooked."""
HELD_GROUP = 4
"""Frames of the drive that follow each other count as one case."""
WITHOUT_INTERVAL = 0.01
"""By which a share may rise where there are too few cases for an interval."""
RISE_ON_DRIVE = 0.02
"""By which one of what stands on the drive may: it is of one place, whose interval may reach to 92 %."""
LEAST_RISE = 0.002
"""A share that rises less, however surely, is no reason to refuse."""
LEAST_LOST = 0.01
"""Of the driven ground: a network that knows so much less of it has learnt nothing."""

CLEARS_255 = 255 * GridConfig().clear_below
"""P(obstacle or person) in 255ths up to which a pixel that is called grass helps to clear a cell."""

DANGEROUS = {
    "obstacle_called_grass": "obstacle pixels called grass",
    "obstacle_clears": "obstacle pixels surely grass: they clear",
    "person_called_grass": "person pixels called grass",
    "person_clears": "person pixels surely grass",
    "bare_called_grass": "pixels of paths and beds called grass",
    "bare_clears": "pixels of paths and beds surely grass",
    "things_5-20 cm": "things of 5-20 cm overlooked",
    "things_20-50 cm": "things of 20-50 cm overlooked",
    "things_over 50 cm": "things over 50 cm overlooked",
    "persons": "persons overlooked",
    "held_stands_called_grass": "pixels of what stands on your drive called grass",
    "held_stands_clears": "pixels of what stands on your drive surely grass",
}
ON_DRIVE = frozenset({"held_stands_called_grass", "held_stands_clears"})
USEFUL = {
    "held_driven_called_grass": "pixels of the driven ground called grass, part held out",
    "held_driven_clears": "pixels of the driven ground surely grass, part held out",
    "grass_called_grass": "pixels of lawn called grass, gardens",
    "grass_clears": "pixels of lawn surely grass, gardens",
}
KNOWN_LESS = {
    "held_driven_called_grass": "it knows less of the driven ground than before",
    "held_driven_clears": "it is sure of less of the driven ground than before",
}
PIXEL_FIGURES = {"obstacle": OTHER.id, "person": PERSON.id, "grass": GRASS.id}
Key = tuple[str, str]


Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Said:
    """What a network says of the pixels of a frame.

    Attributes:
        grass: (H, W) bool that it calls grass.
        clears: (H, W) bool of these, where it is sure enough to clear a cell.
    """

    grass: Bools
    clears: Bools

    @property
    def named(self) -> tuple[tuple[str, Bools], ...]:
        """Both, by the ends of the figures' names."""
        return ("called_grass", self.grass), ("clears", self.clears)


@dataclass(eq=False)
class Counts:
    """Hits and cases of each figure by garden or group; what a network is judged by."""

    hits: dict[Key, int] = field(default_factory=dict)
    of: dict[Key, int] = field(default_factory=dict)

    def add(self, figure: str, unit: str, hits: int, of: int) -> None:
        """Count cases of a garden or group."""
        if of:
            key = (figure, unit)
            self.hits[key] = self.hits.get(key, 0) + int(hits)
            self.of[key] = self.of.get(key, 0) + int(of)

    def cases(self, figure: str) -> tuple[list[int], list[int]]:
        """Hits and cases of a figure, one a unit."""
        keys = sorted(k for k in self.of if k[0] == figure)
        return [self.hits[k] for k in keys], [self.of[k] for k in keys]

    def share(self, figure: str) -> float | None:
        """Of all cases; None without any."""
        hits, of = self.cases(figure)
        return sum(hits) / sum(of) if of else None


@dataclass(frozen=True, slots=True)
class Row:
    """A figure of both networks.

    Attributes:
        figure: key in DANGEROUS or USEFUL.
        old, new: shares; None where there are no cases.
        limit: what a dangerous one may not exceed; None for a useful one.
        cases: pixels or things.
        sure_rise: lower end of the 95 % interval of the rise, garden by garden; None if too few of them.
    """

    figure: str
    old: float | None
    new: float | None
    limit: float | None
    cases: int
    sure_rise: float | None = None

    @property
    def reason(self) -> str:
        """Why the new network is refused for this figure; empty if it is not."""
        if self.limit is None or self.new is None or self.old is None:
            return ""
        rise = f"{DANGEROUS[self.figure]} rise from {self.old:.2%} to {self.new:.2%}"
        if self.new > self.limit:
            return f"{rise}, beyond {self.limit:.2%}"
        if self.sure_rise is not None and self.sure_rise > 0 and self.new - self.old > LEAST_RISE:
            return f"{rise}, in the same gardens by {self.sure_rise:.2%} at least"
        return ""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Figures, and why the new network is refused; empty = it passes."""

    rows: tuple[Row, ...]
    reasons: tuple[str, ...]

    @property
    def passes(self) -> bool:
        """Whether the new network may be written."""
        return not self.reasons

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for a file."""
        rows = {
            r.figure: {"before": r.old, "after": r.new, "limit": r.limit, "cases": r.cases} for r in self.rows
        }
        return {"figures": rows, "refused_for": list(self.reasons)}


def measure(
    network: Path, held: Path, frames: Iterable[SafetyFrame] | None = None, threads: int = 0
) -> Counts:
    """Count a network's faults on the safety set, and on the part of the drive that was held out.

    Args:
        network: .onnx file.
        held: folder with images and labels of that part.
        frames: of the safety set; None = the one in the package.
        threads: of the network.
    """
    segmenter, counts = OnnxSegmenter(network, threads), Counts()
    for frame in safety_frames() if frames is None else frames:
        count_frame(counts, frame, _said(segmenter, frame.rgb))
    for number, image in enumerate(sorted((held / "images").glob("*.jpg"))):
        labels = read_mask(held / "labels" / f"{image.stem}.png")
        count_held(counts, f"{number // HELD_GROUP}", labels, _said(segmenter, read_color(image)))
    return counts


def count_frame(counts: Counts, frame: SafetyFrame, said: Said) -> None:
    """Count one frame of the safety set.

    Args:
        counts: is added to.
        frame: with its truth.
        said: by the network.
    """
    unit = frame.garden
    masks = {name: frame.labels == class_id for name, class_id in PIXEL_FIGURES.items()}
    masks["bare"] = (frame.instances >= FIRST_AREA) & masks["obstacle"]
    _count_pixels(counts, unit, masks, said)
    pixels = np.bincount(frame.instances.ravel(), minlength=FIRST_AREA)
    called = np.bincount(frame.instances.ravel(), weights=said.grass.ravel(), minlength=FIRST_AREA)
    persons = np.bincount(
        frame.instances.ravel(), weights=(frame.labels == PERSON.id).ravel(), minlength=FIRST_AREA
    )
    lawn = np.bincount(
        frame.instances.ravel(), weights=(frame.labels == GRASS.id).ravel(), minlength=FIRST_AREA
    )
    for key, (_, height_m) in frame.things.items():
        if key >= FIRST_AREA or pixels[key] < FEWEST_PIXELS or lawn[key] > 0.5 * pixels[key]:
            continue
        name = "persons" if persons[key] > 0 else f"things_{_height_class(height_m)}"
        counts.add(name, unit, int(called[key] > GONE_SHARE * pixels[key]), 1)


def count_held(counts: Counts, unit: str, labels: NDArray[np.uint8], said: Said) -> None:
    """Count one frame of the part of the drive that was held out."""
    stands = (labels == OTHER.id) | (labels == PERSON.id)
    _count_pixels(counts, unit, {"held_driven": labels == GRASS.id, "held_stands": stands}, said)


def _count_pixels(counts: Counts, unit: str, masks: Mapping[str, Bools], said: Said) -> None:
    for name, there in masks.items():
        for end, hit in said.named:
            counts.add(f"{name}_{end}", unit, int((hit & there).sum()), int(there.sum()))


def judge(old: Counts, new: Counts) -> Verdict:
    """Hold the new network against the old one."""
    rows = [_row(figure, old, new, True) for figure in DANGEROUS]
    rows += [_row(figure, old, new, False) for figure in USEFUL]
    reasons = [row.reason for row in rows if row.reason]
    for figure, what in KNOWN_LESS.items():
        before, after = old.share(figure), new.share(figure)
        if before is not None and after is not None and after < before - LEAST_LOST:
            reasons.append(f"{what}: {before:.1%} before, {after:.1%} now")
    return Verdict(tuple(rows), tuple(reasons))


def _row(figure: str, old: Counts, new: Counts, dangerous: bool) -> Row:
    hits, of = old.cases(figure)
    share = old.share(figure)
    limit = rise = None
    if dangerous and share is not None:
        interval = share_interval(hits, of)
        limit = share + WITHOUT_INTERVAL if interval is None else interval.high
        if figure in ON_DRIVE:
            limit = min(limit, share + RISE_ON_DRIVE)
        rise = sure_rise(hits, new.cases(figure)[0], of)
    return Row(figure, share, new.share(figure), limit, sum(of), rise)


def sure_rise(
    old: Sequence[int], new: Sequence[int], of: Sequence[int], confidence: float = 0.95
) -> float | None:
    """Lower end of the interval of the rise of a share, garden by garden; None with less than two.

    Args:
        old: hits of the old network, one a garden.
        new: of the new one.
        of: cases, the same for both.
        confidence: two-sided.

    >>> round(sure_rise([0, 1, 0, 2], [2, 3, 2, 4], [10, 10, 10, 10]), 3)
    0.2
    >>> sure_rise([0, 1, 0, 2], [0, 1, 0, 6], [10, 10, 10, 10]) < 0
    True
    """
    from scipy.stats import t

    k, total = len(of), float(sum(of))
    if k < 2:
        return None
    change, cases = np.subtract(new, old).astype(np.float64), np.asarray(of, np.float64)
    rise = float(change.sum()) / total
    variance = k / (k - 1) * float(np.square(change - rise * cases).sum()) / total**2
    return rise - float(t.ppf(0.5 + confidence / 2, k - 1)) * float(np.sqrt(variance))


def table(rows: Sequence[Row] | Mapping[str, Any]) -> list[str]:
    """The figures as lines, of a verdict or of what a file tells."""
    names = DANGEROUS | USEFUL
    if isinstance(rows, Mapping):
        known = [(k, rows[k]) for k in names if k in rows]  # JSON has them by the alphabet
        rows = [Row(k, v["before"], v["after"], v["limit"], int(v["cases"])) for k, v in known]
    lines = []
    for row in rows:
        old, new = (("-" if v is None else f"{v:.2%}") for v in (row.old, row.new))
        limit = "" if row.limit is None else f"  (at most {row.limit:.2%})"
        lines.append(f"{names.get(row.figure, row.figure):<55} {old:>7} -> {new:>7}{limit}")
    return lines


def _height_class(height_m: float) -> str:
    return next(name for name, upper in HEIGHTS_M.items() if height_m < upper)


def _said(segmenter: OnnxSegmenter, rgb: NDArray[np.uint8]) -> Said:
    found = segmentation_of(segmenter.logits(rgb), segmenter.spec).resized_to(*rgb.shape[:2])
    grass = found.map_classes == MapClass.GRASS
    return Said(grass, grass & (found.hazard_255 <= CLEARS_255))
