"""What comparing maps counts: a tally that adds up in any order, and everything read off it."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.eval.confusion import MAP_NAMES, MAP_ROLES, ConfusionMatrix
from swardmap.eval.distances import DistanceHistogram
from swardmap.eval.dmin import NO_HIT

RANGE_BANDS_M = (0.0, 2.0, 4.0, 6.0, 8.0)
"""Lower edges of the bands that distances from the camera are split into; the last one is open."""


class MissKind(NamedTuple):
    """What is kept of an FN cell; cells of one kind are only counted.

    `squared` is the distance to the nearest TP cell in cells, -1 if the map has none; `person` says what
    the reference holds, `from_person` whether the nearest TP cell is mapped as a person, `found` whether
    another cell of the same obstacle is a TP; `band` is the index in RANGE_BANDS_M.
    """

    person: bool
    from_person: bool
    found: bool
    band: int
    squared: int


class MissedKind(NamedTuple):
    """What is kept of an obstacle without one TP cell."""

    person: bool
    cells: int
    called_free: int


EMPTY_MATRIX = ConfusionMatrix.empty(MAP_NAMES, MAP_ROLES)


@dataclass(frozen=True, slots=True)
class MapTally:
    """What comparing maps counted. Tallies add up in any order, without rounding.

    Attributes:
        resolution_m: of the maps.
        frames: number of maps compared.
        frames_with_misses: of these, those with an FN cell.
        frames_without_hit: of these, those without a TP cell: their FN cells have no d_min-obst.
        matrix: cells by (reference class, predicted class).
        misses: FN cells by kind.
        obstacles: connected obstacles in the references.
        missed: of these, those without one TP cell, by kind.
    """

    resolution_m: float
    frames: int = 0
    frames_with_misses: int = 0
    frames_without_hit: int = 0
    matrix: ConfusionMatrix = EMPTY_MATRIX
    misses: Mapping[MissKind, int] = field(default_factory=dict)
    obstacles: int = 0
    missed: Mapping[MissedKind, int] = field(default_factory=dict)

    def __add__(self, other: "MapTally") -> "MapTally":
        return total_of((self, other), self.resolution_m)

    def distances(
        self, *, person: bool | None = None, band: int | None = None, found: bool | None = None
    ) -> DistanceHistogram:
        """d_min-obst of the FN cells that have one, all of them or those of one class, band or sort."""
        wanted = Counter[int]()
        for kind, n in self.misses.items():
            if (
                kind.squared != NO_HIT
                and (person is None or kind.person == person)
                and (band is None or kind.band == band)
                and (found is None or kind.found == found)
            ):
                wanted[kind.squared] += n
        return DistanceHistogram(self.resolution_m, wanted)

    @property
    def misses_without_hit(self) -> int:
        """FN cells of maps without a TP cell."""
        return sum(n for kind, n in self.misses.items() if kind.squared == NO_HIT)

    @property
    def missed_obstacles(self) -> int:
        """Connected obstacles without one TP cell."""
        return sum(self.missed.values())

    @property
    def missed_called_free(self) -> int:
        """Those of them with a cell that was called grass."""
        return sum(n for kind, n in self.missed.items() if kind.called_free)

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and numbers, without the names that all tallies share."""
        return {
            "frames": [self.frames, self.frames_with_misses, self.frames_without_hit],
            "cells": [row[:-1] for row in self.matrix.counts],
            "misses": [[*map(int, kind), n] for kind, n in sorted(self.misses.items())],
            "obstacles": self.obstacles,
            "missed": [[*map(int, kind), n] for kind, n in sorted(self.missed.items())],
        }

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any], resolution_m: float) -> "MapTally":
        """What `to_dict` gave."""
        counts = tuple((*row, 0) for row in plain["cells"])
        frames, with_misses, without_hit = plain["frames"]
        return cls(
            resolution_m,
            frames,
            with_misses,
            without_hit,
            ConfusionMatrix(MAP_NAMES, MAP_ROLES, counts),
            {MissKind(bool(p), bool(g), bool(f), b, s): n for p, g, f, b, s, n in plain["misses"]},
            plain["obstacles"],
            {MissedKind(bool(p), c, f): n for p, c, f, n in plain["missed"]},
        )


def total_of(tallies: Sequence[MapTally], resolution_m: float) -> MapTally:
    """The sum of many tallies of one resolution."""
    wrong = {t.resolution_m for t in tallies} - {resolution_m}
    if wrong:
        raise InvalidValueError(f"cannot add maps of {resolution_m} m and {', '.join(map(str, wrong))} m")
    misses, missed = Counter[MissKind](), Counter[MissedKind]()
    for tally in tallies:
        misses.update(tally.misses)
        missed.update(tally.missed)
    cells = np.array([t.matrix.counts for t in tallies], np.int64).reshape(
        -1, len(MAP_NAMES), len(MAP_NAMES) + 1
    )
    return MapTally(
        resolution_m,
        sum(t.frames for t in tallies),
        sum(t.frames_with_misses for t in tallies),
        sum(t.frames_without_hit for t in tallies),
        ConfusionMatrix(MAP_NAMES, MAP_ROLES, tuple(map(tuple, cells.sum(axis=0).tolist()))),
        dict(misses),
        sum(t.obstacles for t in tallies),
        dict(missed),
    )
