"""The drive that comes with the package: whole, small, with everybody on it."""

import re
from pathlib import Path
from typing import Any

from swardmap.cli.demo import RECORDING
from swardmap.cli.demo_text import IN_WORDS, told
from swardmap.eval.shares import PLAIN_SHARES, plain_share
from swardmap.io import open_source
from swardmap.labels import GRASS, OTHER, PERSON
from tests.io.contract import check_source

MOST_BYTES = 6_000_000


def test_the_bundled_drive_is_a_whole_recording_with_true_labels() -> None:
    frames = check_source(lambda: open_source(RECORDING))
    assert len(frames) >= 20
    assert not open_source(RECORDING).skipped
    seen = set().union(*(set(frame.labels.ravel().tolist()) for frame in frames if frame.labels is not None))
    assert seen == {OTHER.id, GRASS.id, PERSON.id}
    for frame in frames:
        assert frame.T_map_camera is not None
        assert frame.labels is not None
        assert (frame.depth > 0).mean() > 0.3
        assert 40 < frame.rgb.mean() < 190  # neither dark nor washed out


def test_the_bundled_drive_is_small() -> None:
    assert sum(f.stat().st_size for f in RECORDING.rglob("*") if f.is_file()) < MOST_BYTES


PERSON_IN_DANGER = {"title": "person", "height": "person", "kind": "person", "frame": "00015", "away_m": 4.21,
                    "missed": False, "free_cells": 3, "needs_m": 0.18}  # fmt: skip


def found_of(**changes: Any) -> dict[str, Any]:
    options = {"share": 0.8, "confidence": 0.95}
    points = [{"margin_m": 0.0, "reachable_m2": 40.0}, {"margin_m": 0.142, "reachable_m2": 36.0}]
    return {
        "margin": {"margin_m": 0.142, "options": options},
        "cost": {"margin_m": 0.142, "mower_width_m": 0.5, "points": points},
        "metrics": {"overall": {"things_missed": {"of": 35}}},
        "margin_in_use_m": 0.1,
        "frames": {"evaluated": 20},
        "worst_things": [PERSON_IN_DANGER, PERSON_IN_DANGER | {"needs_m": 0.1, "title": "stump, 20-50 cm",
                                                               "height": "20-50 cm"}],
    } | changes  # fmt: skip


def test_its_last_lines_say_margin_price_danger_and_what_is_next() -> None:
    text = told(found_of(), Path("demo"))
    assert "stay 15 cm away" in text  # never less than was measured
    assert "4 of 5 of the places" in text
    assert "at most 1 in 20" in text
    assert "reaches 36 m² of the lawn that was seen,\n  40 m² without a margin: 10 % is lost" in text
    assert "Without a margin, 2 could be hit (such as a person at 4.2 m in frame 00015)" in text
    assert "With 10 cm, what is taken while nothing is measured, 1 could be hit (a person" in text
    assert "With 15 cm, 1 could be hit (a person" in text
    assert "none was overlooked whole" in text
    lines = text.splitlines()
    assert lines[-1].strip().startswith("swardmap map MY_DRIVE")
    assert not re.search(r"d_min|quantile|confidence|share|0\.\d\d\d", text)


def test_it_is_honest_where_nothing_can_be_promised() -> None:
    refused = {"margin_m": None, "options": {"share": 0.99, "confidence": 0.95}}
    missed = PERSON_IN_DANGER | {"missed": True, "needs_m": None}
    text = told(found_of(margin=refused, cost=None, worst_things=[missed]), Path("demo"))
    assert "20 frames are too few to measure one; 10 cm is taken" in text
    assert "1 were overlooked whole (a person" in text
    assert "what is taken while nothing is measured, 1 could be hit" in text
    safe = told(found_of(worst_things=[]), Path("demo"))
    assert safe.count("nobody and nothing could be hit") == 3


def test_the_shares_that_it_chooses_can_be_said() -> None:
    assert tuple(IN_WORDS) == PLAIN_SHARES
    assert [plain_share(c) for c in (0.995, 0.99, 0.846, 0.5, 0.49)] == [0.99, 0.99, 0.8, 0.5, None]
