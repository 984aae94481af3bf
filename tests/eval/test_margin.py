import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swardmap.config import Config, config_to_dict, load_config
from swardmap.errors import InputError, InvalidValueError
from swardmap.eval.margin import Claim, measure_margin, unit_misses, units_needed
from swardmap.eval.margin_statement import margin_of, statement_of
from swardmap.eval.tally import MapTally, MissKind
from swardmap.io.files import write_text
from swardmap.io.maps.margin_file import Margin, margin_text, measured_with, read_margin

Units = dict[str, dict[int, int]]

frames_of_misses = st.dictionaries(st.integers(0, 400), st.integers(1, 9), min_size=1, max_size=6)


def named(rows: list[dict[int, int]]) -> Units:
    return {f"{i:06d}": row for i, row in enumerate(rows)}


def mean_coverage(rows: list[dict[int, int]], margin_m: float, resolution_m: float = 0.05) -> float:
    shares = [
        sum(n for s, n in row.items() if s >= 0 and math.sqrt(s) * resolution_m <= margin_m + 1e-9)
        / sum(row.values())
        for row in rows
    ]
    return float(np.mean(shares))


def population(kind: str, rng: np.random.Generator, size: int = 4000) -> list[dict[int, int]]:
    """Frames whose cells depend on each other: a frame is good or bad as a whole."""
    rows = []
    for _ in range(size):
        if kind == "clustered":
            reach = rng.geometric(0.3) * (6 if rng.random() < 0.03 else 1)
            squares = (rng.integers(1, reach + 1, rng.integers(1, 60)) ** 2).tolist()
        elif kind == "one large frame in a hundred":
            far = rng.random() < 0.0101
            squares = [900] * 300 if far else [1] * int(rng.integers(1, 5))
        else:  # heavy tail
            squares = [min(int(1 + rng.pareto(1.5)) ** 2, 10**6) for _ in range(int(rng.integers(1, 30)))]
        row: dict[int, int] = {}
        for s in squares:
            row[s] = row.get(s, 0) + 1
        rows.append(row)
    return rows


@pytest.mark.parametrize("kind", ["clustered", "one large frame in a hundred", "heavy tail"])
@pytest.mark.parametrize(("share", "confidence", "n"), [(0.9, 0.9, 60), (0.95, 0.95, 150)])
def test_the_promised_coverage_holds_on_fresh_frames(
    kind: str, share: float, confidence: float, n: int
) -> None:
    """300 calibrations on a known population: at most 1 - confidence of them may promise too much."""
    rng = np.random.default_rng(7)
    frames = population(kind, rng)
    truth = {}  # coverage of the whole population, which is what fresh frames have on average
    broken = 0
    for draw in range(300):
        chosen = rng.integers(0, len(frames), n)
        claim = measure_without_bootstrap(named([frames[i] for i in chosen]), share, confidence)
        assert claim.margin_m is not None, claim.reason
        if claim.margin_m not in truth:
            truth[claim.margin_m] = mean_coverage(frames, claim.margin_m)
        broken += truth[claim.margin_m] < share
        del draw
    allowed = 300 * (1 - confidence) + 3 * math.sqrt(300 * confidence * (1 - confidence))
    assert broken <= allowed


def test_the_plain_quantile_of_pooled_cells_would_break_the_promise() -> None:
    """Why units and a bound are needed: this is what one would do without them."""
    rng = np.random.default_rng(8)
    near = [{int(rng.integers(1, 4)): 100} for _ in range(900)]
    frames = near + [{int(rng.integers(50, 90)): 2} for _ in range(100)]  # few cells, all of them far
    broken = 0
    for _ in range(200):
        chosen = [frames[i] for i in rng.integers(0, len(frames), 150)]
        claim = measure_without_bootstrap(named(chosen), 0.95, 0.95)
        assert claim.pooled_m is not None
        broken += mean_coverage(frames, claim.pooled_m) < 0.95
        assert claim.margin_m is not None
        assert mean_coverage(frames, claim.margin_m) >= 0.95
    assert broken == 200


def measure_without_bootstrap(units: Units, share: float, confidence: float) -> Claim:
    import swardmap.eval.margin as module

    draws, module.DRAWS = module.DRAWS, 1
    try:
        return measure_margin(units, 0.05, share, confidence)
    finally:
        module.DRAWS = draws


def test_the_order_statistic_holds_for_every_cell_of_a_frame() -> None:
    rng = np.random.default_rng(9)
    frames = population("clustered", rng)
    needs = np.array([math.sqrt(max(row)) * 0.05 for row in frames])
    broken, given = 0, 0
    for _ in range(300):
        chosen = [frames[i] for i in rng.integers(0, len(frames), 60)]
        claim = measure_without_bootstrap(named(chosen), 0.9, 0.9)
        assert claim.every_cell_m is not None
        given += 1
        broken += float(np.mean(needs <= claim.every_cell_m + 1e-9)) < 0.9
    assert broken <= 0.1 * given + 3 * math.sqrt(given * 0.09)


def test_units_needed_are_those_of_wilks() -> None:
    assert units_needed(0.99, 0.95) == 299
    one_cell = {1: 1}
    enough = measure_margin(named([one_cell] * 299), 0.05)
    assert (enough.margin_m, enough.reason, enough.every_cell_m) == (0.05, "", 0.05)
    assert enough.units_more == 0
    few = measure_margin(named([one_cell] * 298), 0.05)
    assert few.margin_m is None
    assert few.every_cell_m is None
    assert "at least 299 independent frames" in few.reason
    assert "got 298" in few.reason
    assert few.claimable_share == 0.989
    assert few.units_more == 1
    assert enough.claimable_share == 0.99
    assert "1 more without an uncovered cell would do; these carry 98 % at most" in few.reason


def test_frames_without_misses_do_not_count() -> None:
    claim = measure_margin(named([{1: 1}] * 200 + [{}] * 500), 0.05)
    assert (claim.units, claim.margin_m) == (200, None)
    nothing = measure_margin({}, 0.05)
    assert nothing.units == 0
    assert "no frame has missed cells" in nothing.reason
    assert (nothing.pooled_m, nothing.bootstrap_m) == (None, None)


def test_cells_that_no_margin_reaches_are_never_covered() -> None:
    claim = measure_margin(named([{1: 9, -1: 1}] * 1000), 0.05)
    assert claim.margin_m is None
    assert "no margin covers" in claim.reason
    assert "leaves 10 % of a frame's missed cells" in claim.reason
    assert claim.units_more is None  # more of the same do not help
    assert claim.bootstrap_m is None
    few = measure_margin(named([{1: 10}] * 398 + [{-1: 10}]), 0.05)
    assert few.margin_m is None
    assert "at this rate 739 frames with missed cells would do, got 399" in few.reason
    assert few.units_more == 739 - 399
    assert measure_margin(named([{1: 10}] * 398 * 2 + [{-1: 10}] * 2), 0.05).margin_m == 0.05
    rare = measure_margin(named([{1: 10}] * 1999 + [{-1: 10}]), 0.05)
    assert rare.margin_m == 0.05


@given(st.lists(frames_of_misses, min_size=2, max_size=30), st.randoms(use_true_random=False))
@settings(deadline=None, max_examples=40)
def test_order_and_split_of_the_units_do_not_matter(rows: list[dict[int, int]], random: object) -> None:
    units = list(named(rows).items())
    first = measure_margin(dict(units), 0.05, 0.5, 0.5)
    random.shuffle(units)  # type: ignore[attr-defined]
    assert measure_margin(dict(units), 0.05, 0.5, 0.5) == first


@given(st.lists(frames_of_misses, min_size=40, max_size=60))
@settings(deadline=None, max_examples=40)
def test_a_bolder_claim_needs_no_smaller_margin(rows: list[dict[int, int]]) -> None:
    margins = [
        measure_without_bootstrap(named(rows), share, confidence).margin_m
        for share, confidence in ((0.5, 0.8), (0.8, 0.8), (0.8, 0.95), (0.9, 0.95))
    ]
    assert None not in margins
    assert margins == sorted(margins, key=lambda m: m or 0)
    assert measure_without_bootstrap(named(rows), 0.9, 0.95).claimable_share > 0.9


def test_the_bootstrap_is_about_units_not_cells() -> None:
    """The same cells in 40 units of 100 and in 4000 units of 1: the first are far less certain."""
    rng = np.random.default_rng(4)
    frames = [{int(rng.integers(1, 20)) ** 2: 100} for _ in range(40)]
    single = [{s: 1} for row in frames for s, n in row.items() for _ in range(n)]
    clustered, independent = (measure_margin(named(r), 0.05, 0.8, 0.95) for r in (frames, single))
    assert clustered.pooled_m == independent.pooled_m
    assert clustered.bootstrap_m is not None
    assert independent.bootstrap_m is not None
    assert clustered.bootstrap_m > independent.bootstrap_m


def test_cells_are_chosen_by_what_grows_over_them_and_by_population() -> None:
    tally = MapTally(
        0.05,
        misses={
            MissKind(False, False, True, 0, 4): 3,
            MissKind(True, True, True, 0, 9): 2,
            MissKind(True, False, False, 0, 100): 1,
            MissKind(True, False, False, 0, -1): 5,
        },
    )
    assert unit_misses([("a", tally), ("a", tally)]) == {"a": {4: 6, 9: 4}}
    assert unit_misses([("a", tally)], cells="person") == {"a": {9: 2}}
    assert unit_misses([("a", tally)], population="all") == {"a": {4: 3, 9: 2, 100: 1, -1: 5}}
    with pytest.raises(InvalidValueError, match="population"):
        unit_misses([], population="some")


def test_the_file_is_a_piece_of_configuration(tmp_path: Path) -> None:
    file = tmp_path / "margin.yaml"
    everything = measure_margin(named([{9: 1}] * 300), 0.05)
    person = measure_margin(named([{16: 1}] * 300), 0.05, cells="person")
    margin = margin_of(everything, person)
    assert margin == Margin(0.15, 0.2)
    statement = statement_of(everything, person, "Not covered: nothing.", "frames of a test")
    write_text(file, margin_text(margin, statement))
    assert read_margin(file) == margin
    costmap = load_config(file).costmap
    assert (costmap.margin_m, costmap.person_margin_m) == (0.15, 0.2)
    assert "at least 99 % of them lie within 0.150 m" in file.read_text()
    assert margin_of(person, everything) == Margin(0.2, 0.2)  # persons are never grown by less
    few = measure_margin(named([{9: 1}] * 30), 0.05)
    assert margin_of(few) is None
    assert margin_of(everything, few) == Margin(0.15, None)
    write_text(file, margin_text(Margin(0.15), "x"))
    assert read_margin(file) == Margin(0.15, None)


@pytest.mark.parametrize(
    "text",
    ["", "costmap: 3", "costmap: {margin_m: -1}", "costmap: {margin_m: 380}", "costmap: {margin_m: yes}",
     "costmap: {margin_m: 0.3, person_margin_m: 0.2}", "costmap: {margin_m: 0.3, radius: 1}",
     "costmap: {margin_m: 0.3}\ngrid: {}", "costmap: {margin_m: .nan}", "[1", "!!python/object:os.system {}"],
)  # fmt: skip
def test_a_file_that_is_not_one_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "margin.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=r"margin\.yaml"):
        read_margin(file)


def test_the_file_says_what_it_was_measured_with(tmp_path: Path) -> None:
    here = measured_with(config_to_dict(Config()), "auto (network 1234abcd)")
    file = tmp_path / "margin.yaml"
    write_text(file, margin_text(Margin(0.15, 0.2, here), "Measured."))
    found = read_margin(file).measured
    assert found == here
    assert load_config(file).costmap.margin_m == 0.15  # it stays a piece of configuration
    assert found is not None
    assert found.differences(here) == []
    grid = replace(Config().grid, resolution_m=0.1, min_points=5)
    there = measured_with(config_to_dict(replace(Config(), grid=grid)), "colour")
    assert found.differences(there) == [
        "resolution: 0.05 m there, 0.1 m here",
        "segmenter: auto (network 1234abcd) there, colour here",
        "grid.min_points: 1 there, 5 here",
    ]
    write_text(file, "# measured_with: {oops\n\ncostmap: {margin_m: 0.1}\n")
    with pytest.raises(InputError, match="measured_with"):
        read_margin(file)


def test_the_share_that_can_be_carried_is_carried(tmp_path: Path) -> None:
    rows = named([{1: 3, 4: 1}] * 40 + [{1: 1, -1: 1}])
    refused = measure_margin(rows, 0.05)
    assert refused.margin_m is None
    assert measure_margin(rows, 0.05, refused.claimable_share).margin_m is not None
    assert measure_margin(rows, 0.05, refused.claimable_share + 0.001).margin_m is None
    assert measure_margin(named([{-1: 1}] * 40), 0.05).claimable_share == 0


def test_absent_file_and_senseless_shares_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read_margin(tmp_path / "none.yaml")
    with pytest.raises(InvalidValueError, match="between 0 and 1"):
        measure_margin({}, 0.05, share=99)
