"""The gate refuses what is more dangerous, and lets pass what is not."""

import pytest

from swardmap.teach.faults import Counts
from swardmap.teach.gate import DANGEROUS, FREED, USEFUL, judge, table
from tests.teach.counting import BALL_ID, PATH_ID, PERSON_ID, counts_of


def test_the_same_network_passes() -> None:
    verdict = judge(counts_of(), counts_of())
    assert verdict.passes
    assert {r.figure for r in verdict.rows} <= {*DANGEROUS, *FREED, *USEFUL}
    assert {r.figure: r.new for r in verdict.rows}["held_driven_called_grass"] == 1.0


@pytest.mark.parametrize(
    ("key", "figure"),
    [(PERSON_ID, "persons overlooked"), (BALL_ID, "things of 5-20 cm"), (PATH_ID, "paths and beds")],
)
def test_whoever_overlooks_more_is_refused(key: int, figure: str) -> None:
    verdict = judge(counts_of(), counts_of((key,)))
    assert not verdict.passes
    assert any(figure in reason for reason in verdict.reasons)
    assert judge(counts_of((key,)), counts_of()).passes  # the other way round it is better


def test_who_is_surer_of_what_is_no_grass_is_refused() -> None:
    """A map is cleared by what is sure, so the most probable class alone does not say what is dangerous."""
    for key, what in ((PERSON_ID, "person"), (BALL_ID, "obstacle"), (PATH_ID, "paths and beds")):
        unsure, sure = counts_of((key,), (key,)), counts_of((key,))
        assert judge(sure, unsure).passes
        reasons = judge(unsure, sure).reasons
        assert any(what in reason and "surely grass" in reason for reason in reasons)


def test_a_rise_in_every_garden_is_refused_within_the_interval_too() -> None:
    old, new = Counts(), Counts()
    for k in range(10):
        old.add("obstacle_called_grass", str(k), 100 * k, 10_000)  # gardens differ far more than that
        new.add("obstacle_called_grass", str(k), 100 * k + 50, 10_000)
    (reason,) = judge(old, new).reasons
    assert "in the same gardens by 0.50% at least" in reason
    assert judge(new, old).passes


def test_who_takes_a_bed_for_lawn_in_the_light_of_the_drive_is_refused() -> None:
    """A taught network took a bluish bed for the bluish lawn; in other light it knew beds better."""
    unsure = counts_of(lit_unsure_of=(PATH_ID,), lit_blind_to=(PATH_ID,))
    sure = counts_of(lit_blind_to=(PATH_ID,))
    reasons = judge(unsure, sure).reasons
    rise = "in your light: pixels of paths and beds surely grass rise from 0.00% to 100.00%"
    assert any(reason.startswith(rise) for reason in reasons)
    assert judge(sure, unsure).passes


def test_in_the_light_of_the_drive_it_may_be_as_wrong_as_the_old_one_in_its_own() -> None:
    """A network that knows nothing in that light is wrong in nothing: that is no reason to refuse."""
    old, new, worse = Counts(), Counts(), Counts()
    for k in range(10):
        for counts, in_your_light in ((old, 0), (new, 290), (worse, 350)):
            counts.add("bare_clears", str(k), 300, 10_000)
            counts.add("lit_bare_clears", str(k), in_your_light, 10_000)
    assert judge(old, new).passes
    (reason,) = judge(old, worse).reasons
    assert "in your light: pixels of paths and beds surely grass rise from 0.00% to 3.50%" in reason


def test_who_is_surer_of_what_stands_on_the_drive_is_refused_however_few_its_frames() -> None:
    """A taught network freed 8 % of the obstacle cells; the gate saw 7 become 22 %, of at most 92."""
    old, new, little = Counts(), Counts(), Counts()
    for place, of, before, after, nearly in (("a", 1200, 160, 300, 160), ("b", 1146, 0, 220, 40)):
        old.add("held_stands_clears", place, before, of)
        new.add("held_stands_clears", place, after, of)
        little.add("held_stands_clears", place, nearly, of)
    (reason,) = judge(old, new).reasons
    assert "what stands on your drive surely grass rise from" in reason
    assert judge(old, little).passes
    assert judge(new, old).passes


def test_who_calls_ground_grass_that_surely_was_none_must_be_looked_at() -> None:
    """Paths of a campus became lawn, and the gardens were silent; on another drive it may be lawn."""
    assert judge(counts_of(), counts_of(ground_called=1)).warning == ""
    verdict = judge(counts_of(), counts_of(ground_called=2))
    assert verdict.passes
    assert verdict.warning.startswith("20% of the ground of your drive")
    assert any(
        "surely were no lawn called grass" in line and "20.00%" in line for line in table(verdict.rows)
    )


def test_a_network_that_knows_less_of_the_lawn_is_refused() -> None:
    less = "of the driven ground than before: 100.0% before, 77.8% now"
    verdict = judge(counts_of(), counts_of(driven_missed=2))
    assert verdict.reasons == (f"it knows less {less}", f"it is sure of less {less}")
    verdict = judge(counts_of(), counts_of(driven_unsure=2))
    assert verdict.reasons == (f"it is sure of less {less}",)


def test_figures_become_lines_and_travel_as_plain_numbers() -> None:
    verdict = judge(counts_of(), counts_of((BALL_ID,)))
    lines = table(verdict.rows)
    assert table(verdict.to_dict()["figures"]) == lines
    assert any("5-20 cm" in line and "100.00%" in line for line in lines)
