"""What the margin section of a report says: the chosen claim, those beside it, and what is not covered."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from swardmap.config import config_to_dict
from swardmap.errors import InvalidValueError
from swardmap.eval.distances import DistanceHistogram
from swardmap.eval.frame import Plan, split_key
from swardmap.eval.margin import POPULATIONS, Claim, measure_margin, unit_misses, units_needed
from swardmap.eval.margin_statement import margin_of, statement_of
from swardmap.eval.protocols import at_resolution
from swardmap.eval.shares import told_share
from swardmap.eval.tally import MapTally, total_of
from swardmap.io.maps.margin_file import measured_with

Record = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class MarginOptions:
    """What the margin shall promise.

    Attributes:
        share: of the missed cells of a unit, on average.
        confidence: of the promise.
        unit: `frame`, or a tag whose values are independent, such as `sequence`.
        population: see `margin.POPULATIONS`.
    """

    share: float = 0.99
    confidence: float = 0.95
    unit: str = "frame"
    population: str = "found"

    def __post_init__(self) -> None:
        units_needed(self.share, self.confidence)  # raises for what is no share or no confidence
        if self.population not in POPULATIONS:
            raise InvalidValueError(
                f"margin: expected a population of {', '.join(POPULATIONS)}, got '{self.population}'"
            )


def margin_section(plan: Plan, records: Sequence[Record], options: MarginOptions) -> dict[str, Any]:
    """The chosen claim, those beside it, and the margin that follows; or why there is none."""
    _, resolution_m = split_key(plan.main)
    tallies = [(r, MapTally.from_dict(r["maps"][plan.main], resolution_m)) for r in records]

    def claim(unit: str, population: str, cells: str) -> Claim:
        named = [(_unit_name(r, unit), tally) for r, tally in tallies]
        units = unit_misses(named, population, cells)
        return measure_margin(
            units, resolution_m, options.share, options.confidence,
            cells=cells, population=population, unit=unit, seed=plan.seed,
        )  # fmt: skip

    tags = {tag for r in records for tag in r["tags"]}
    if records and options.unit not in {"frame", *tags}:
        raise InvalidValueError(
            f"margin: no frame has the tag '{options.unit}'; "
            f"expected frame or one of: {', '.join(sorted(tags))}"
        )
    others = [tag for tag in ("sequence", "scene") if tag in tags][:1]
    wanted = list(dict.fromkeys([options.unit, "frame", *others]))
    claims = {
        (unit, population, cells): claim(unit, population, cells)
        for unit in wanted
        for population in POPULATIONS
        for cells in ("all", "person")
    }
    chosen = claims[options.unit, options.population, "all"]
    person = claims[options.unit, options.population, "person"]
    margin = margin_of(chosen, person)
    total = total_of([tally for _, tally in tallies], resolution_m)
    config = at_resolution(plan.config, resolution_m)
    where = f"{Path(plan.dataset.location).name}, segmenter {plan.segmenter_name}, maps {plan.main}"
    not_covered = not_covered_text(total)
    return {
        "options": asdict(options),
        "margin_m": None if margin is None else margin.margin_m,
        "person_margin_m": None if margin is None else margin.person_margin_m,
        "reason": chosen.reason,
        "statement": statement_of(chosen, person, not_covered, where),
        "not_covered": not_covered,
        "claims": [asdict(c) for c in claims.values()],
        "measured_with": asdict(measured_with(config_to_dict(config), plan.segmenter_name)),
        "carried_share": told_share(chosen.claimable_share),
        "units": chosen.units,
        "units_more": chosen.units_more,
        "curve": margin_curve(total.distances(found=True if options.population == "found" else None)),
    }


def not_covered_text(total: MapTally) -> str:
    """What no margin covers, in words."""
    return (
        f"Not covered by any margin: obstacles of which nothing was found, here {total.missed_obstacles} of "
        f"{total.obstacles} ({total.missed_called_free} of them called free, the rest not seen), and the "
        f"{total.misses_without_hit} missed cells of {total.frames_without_hit} frames with nothing found."
    )


def margin_curve(histogram: DistanceHistogram) -> list[list[float]]:
    """(margin in metres, share of the missed cells within it) at every distance that occurs."""
    points, covered = [], 0
    for squared, n in histogram.counts.items():
        covered += n
        points.append([histogram.distance_m(squared), covered / histogram.count])
    return points


def _unit_name(record: Record, unit: str) -> str:
    if unit == "frame":
        return f"{record['index']:09d}"
    return str(record["tags"].get(unit, ""))
