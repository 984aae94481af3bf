"""Evidence that was saved under other settings is never worth more than what a run itself has seen."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swardmap.config import Config, EvidenceConfig, config_from_dict
from swardmap.errors import InputError
from swardmap.io.maps.log_odds_files import read_living_map, write_living
from swardmap.io.maps.saved_evidence import (
    Difference,
    adapted,
    check_cells,
    difference,
    settings_of_evidence,
    without_doubt,
)
from swardmap.labels import MapClass
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.mapping.sensor_model import PER_NAT, Cells, Viewpoint, parameters, update_cells

EVIDENCE = config_from_dict({"grid": {"mode": "log_odds"}})
NATS = st.floats(0.01, 30, allow_nan=False)


@st.composite
def models(draw: st.DrawFn) -> EvidenceConfig:
    mark, free, clear = draw(NATS), draw(NATS), draw(NATS)
    high = [draw(st.floats(mark, 30)) for _ in range(2)]
    gains = {name: draw(NATS) for name in ("obstacle_gain", "person_gain", "grass_gain", "ray_gain")}
    return EvidenceConfig(
        mark_at=mark, free_at=free, clear_at=clear, obstacle_limit=high[0], person_limit=high[1],
        free_limit=draw(st.floats(max(free, clear), 30)), **gains,
    )  # fmt: skip


def see(cells: Cells, model: EvidenceConfig, sights: list[int]) -> Cells:
    """One cell after sightings at its distance of nothing; 1 grass, 2 obstacle, 3 person."""
    for sight in sights:
        points = np.zeros((1, 1, 4), np.uint32)
        points[0, 0, sight] = 5
        view = Viewpoint(0.5, 0.5, 10.0, 0.0)
        update_cells(points, np.zeros((1, 1), np.bool_), view, (0, 0), parameters(model, 1, 1), cells)
    return cells


def frames_to_mark(cells: Cells, model: EvidenceConfig, at_most: int = 4000) -> int:
    for n in range(1, at_most):
        see(cells, model, [2])
        if cells.classes[0, 0] >= MapClass.OBSTACLE:
            return n
    return at_most


@settings(deadline=None, max_examples=150)
@given(models(), models(), st.lists(st.sampled_from([1, 1, 1, 2, 3]), max_size=12), st.booleans())
def test_a_resumed_map_never_needs_more_frames_to_mark_an_obstacle_than_a_fresh_one(
    before: EvidenceConfig, now: EvidenceConfig, sights: list[int], seen_otherwise: bool
) -> None:
    saved = see(Cells.unknown(1, 1), before, sights)
    saved = Cells(saved.evidence, saved.person, without_doubt(saved))
    check_cells(saved, before)
    found = Difference(("evidence.free_limit",), ("cloud.max_range_m",) if seen_otherwise else ())
    resumed = adapted(saved, found, now)
    check_cells(resumed, now)
    free = Cells.unknown(1, 1)
    free.classes[:] = MapClass.GRASS
    free.evidence[:] = -round(PER_NAT * now.free_limit)  # as free as a cell can get, however long it takes
    fresh = Cells.unknown(1, 1) if seen_otherwise else free
    assert frames_to_mark(resumed, now) <= frames_to_mark(fresh, now)
    if seen_otherwise:
        assert adapted(saved, found, now).classes[0, 0] != MapClass.GRASS
    if saved.classes[0, 0] >= MapClass.OBSTACLE:
        assert adapted(saved, found, now).classes[0, 0] >= MapClass.OBSTACLE


def test_under_the_same_settings_nothing_changes() -> None:
    same = difference(json.dumps(settings_of_evidence(EVIDENCE)), EVIDENCE)
    assert (same.model, same.seeing, str(same)) == ((), (), "")
    cells = see(Cells.unknown(1, 1), EVIDENCE.evidence, [1, 1, 2])
    assert adapted(cells, same, EVIDENCE.evidence) is cells


@pytest.mark.parametrize(
    ("setting", "model", "seeing"),
    [({"evidence": {"free_limit": 30}}, ("evidence.free_limit",), ()),
     ({"geometry": {"enabled": not EVIDENCE.geometry.enabled}}, (), ("geometry.enabled",)),
     ({"cloud": {"max_range_m": 5}, "segmenter": {"name": "colour"}}, (),
      ("cloud.max_range_m", "segmenter.name")),
     ({"evidence": {"window_m": 10}, "output": {"pictures": 0}, "segmenter": {"threads": 3}}, (), ())],
)  # fmt: skip
def test_what_differs_is_named(
    setting: dict[str, dict[str, object]], model: tuple[str, ...], seeing: tuple[str, ...]
) -> None:
    found = difference(json.dumps(settings_of_evidence(config_from_dict(setting))), EVIDENCE)
    assert (found.model, found.seeing) == (model, seeing)
    assert difference(None, EVIDENCE).seeing


def lawn(config: Config, frames: int = 60) -> LogOddsMap:
    """A map of one tile that saw nothing but grass."""
    living = LogOddsMap(config.grid, config.evidence)
    cells = see(Cells.unknown(1, 1), config.evidence, [1] * frames)
    tile = Cells.unknown(128, 128)
    for name in ("evidence", "person", "classes"):
        getattr(tile, name)[:] = getattr(cells, name)
    living.restore({(0, 0): tile}, 1)
    return living


def test_a_map_freed_under_a_high_limit_is_brought_within_the_limit_of_the_run(tmp_path: Path) -> None:
    eager = replace(EVIDENCE, evidence=replace(EVIDENCE.evidence, free_limit=30.0))
    write_living(lawn(eager), tmp_path / "monday.npz", eager)
    told: list[str] = []
    friday = read_living_map(tmp_path / "monday.npz", EVIDENCE, told.append)
    assert friday.tiles[0, 0].evidence.min() == -800
    assert friday.grid is not None
    assert friday.grid.count(MapClass.GRASS) == 128 * 128
    assert len(told) == 1
    assert "evidence.free_limit" in told[0]
    told.clear()
    assert read_living_map(tmp_path / "monday.npz", eager, told.append).tiles[0, 0].evidence.min() == -30000
    assert not told


def test_a_map_that_does_not_tell_its_settings_keeps_its_hazards_alone(tmp_path: Path) -> None:
    living = lawn(EVIDENCE)
    living.tiles[0, 0].classes[5, 5], living.tiles[0, 0].evidence[5, 5] = MapClass.OBSTACLE, 3000
    write_living(living, tmp_path / "old.npz")
    told: list[str] = []
    again = read_living_map(tmp_path / "old.npz", EVIDENCE, told.append).tiles[0, 0]
    assert again.classes[5, 5] == MapClass.OBSTACLE
    assert again.evidence[5, 5] == 3000
    assert (again.classes == MapClass.GRASS).sum() == 0
    assert "16383 free cells are unknown until seen again" in told[0]


def test_settings_that_are_none_are_refused(tmp_path: Path) -> None:
    write_living(lawn(EVIDENCE), tmp_path / "a.npz", EVIDENCE)
    with np.load(tmp_path / "a.npz", allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    for bad in ("[]", "{", '{"evidence": 3}', '{"evidence": {"free_limit": -1}}', "[" * 100_000):
        np.savez(tmp_path / "b.npz", **(arrays | {"settings": np.array(bad)}))
        with pytest.raises(InputError, match=r"b\.npz"):
            read_living_map(tmp_path / "b.npz", EVIDENCE)
