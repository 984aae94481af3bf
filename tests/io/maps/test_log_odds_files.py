"""A living map on disk: it goes on where it ended, and a damaged file changes nothing."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swardmap.config import config_from_dict
from swardmap.errors import InputError, OutputError
from swardmap.geometry import Intrinsics
from swardmap.io.maps.log_odds_files import read_living_map, write_living
from swardmap.io.maps.map_files import read_map
from swardmap.labels import MapClass
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.models.oracle import TruthSegmenter
from swardmap.pipeline import ObstacleMapper
from swardmap.runs.recording import map_recording
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
CONFIG = config_from_dict(
    {"segmenter": {"name": "truth"}, "grid": {"mode": "evidence"}, "output": {"pictures": 0}}
)


def source(n: int = 3) -> AnalyticSource:
    return AnalyticSource(garden_scene(0), tuple(lane_poses(n, step_m=0.4)), SMALL)


def driven(n: int = 3) -> LogOddsMap:
    mapper = ObstacleMapper(TruthSegmenter(source().label_set), CONFIG)
    for frame in source(n):
        mapper.step(frame)
    assert mapper.log_odds is not None
    return mapper.log_odds


def same(one: LogOddsMap, two: LogOddsMap) -> bool:
    return one.tiles.keys() == two.tiles.keys() and all(
        np.array_equal(getattr(one.tiles[key], name), getattr(two.tiles[key], name))
        for key in one.tiles
        for name in ("evidence", "person", "classes")
    )


def test_round_trip_loses_nothing_and_unknown_stays_unknown(tmp_path: Path) -> None:
    living = driven()
    write_living(living, tmp_path / "a.npz", CONFIG)
    again = read_living_map(tmp_path / "a.npz", CONFIG)
    assert same(living, again)
    assert living.grid is not None
    assert again.grid is not None
    assert again.grid.spec == living.grid.spec
    assert again.grid.count(MapClass.UNKNOWN) == living.grid.count(MapClass.UNKNOWN) > 0
    assert again.stamp_ns == living.stamp_ns > 0
    write_living(LogOddsMap(CONFIG.grid), tmp_path / "empty.npz", CONFIG)
    assert read_living_map(tmp_path / "empty.npz", CONFIG).grid is None


def test_a_loaded_map_goes_on_as_if_it_had_never_stopped(tmp_path: Path) -> None:
    whole, stopped = driven(6), driven(3)
    write_living(stopped, tmp_path / "a.npz", CONFIG)
    resumed = read_living_map(tmp_path / "a.npz", CONFIG)
    mapper = ObstacleMapper(TruthSegmenter(source().label_set), CONFIG)
    for i, frame in enumerate(source(6)):
        step = mapper.step(frame)
        if i >= 3:
            resumed.integrate(step.observation)
    assert same(whole, resumed)


def test_map_writes_the_map_and_its_evidence(tmp_path: Path) -> None:
    run = map_recording(source(), tmp_path / "out", CONFIG)
    assert run.grid is not None
    np.testing.assert_array_equal(read_map(tmp_path / "out" / "map.yaml").classes, run.grid.classes)
    again = read_living_map(tmp_path / "out" / "living.npz", CONFIG)
    assert again.grid is not None
    np.testing.assert_array_equal(again.grid.classes, run.grid.classes)


def spoiled(path: Path, **changes: Any) -> Path:
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files} | changes
    np.savez_compressed(path, **{name: a for name, a in arrays.items() if a is not None})
    return path


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"classes": None}, "classes"),
        ({"living_map": np.int64(9)}, "version"),
        ({"resolution_m": np.float64(0.2)}, "its cells are 0.2 m"),
        ({"corner_m": np.array([np.nan, 0.0])}, "finite"),
        ({"evidence": np.zeros((1, 2, 2), np.int16)}, "evidence: expected int16"),
        ({"keys": np.zeros((3, 3), np.int64)}, "keys: expected"),
        ({"person": np.zeros((1, 128, 128), np.float64)}, "person: expected int16"),
    ],
)
def test_what_is_wrong_is_one_error(tmp_path: Path, changes: dict[str, Any], match: str) -> None:
    write_living(driven(1), tmp_path / "a.npz", CONFIG)
    with pytest.raises(InputError, match=match):
        read_living_map(spoiled(tmp_path / "a.npz", **changes), CONFIG)


def test_a_file_that_frees_cells_without_evidence_is_refused(tmp_path: Path) -> None:
    write_living(driven(1), tmp_path / "a.npz", CONFIG)
    with np.load(tmp_path / "a.npz", allow_pickle=False) as archive:
        all_free, evidence = np.ones_like(archive["classes"]), archive["evidence"]
    path = tmp_path / "a.npz"
    with pytest.raises(InputError, match="against its evidence"):
        read_living_map(spoiled(path, classes=all_free), CONFIG)
    with pytest.raises(InputError, match="without evidence"):
        read_living_map(spoiled(path, evidence=np.minimum(evidence, 0)), CONFIG)
    with pytest.raises(InputError, match=r"evidence of -800\.\."):
        read_living_map(spoiled(path, evidence=np.full_like(evidence, -801)), CONFIG)
    with pytest.raises(InputError, match=r"classes 0\.\.3"):
        read_living_map(spoiled(path, classes=all_free * 9), CONFIG)


def test_truncated_and_foreign_files_are_one_error(tmp_path: Path) -> None:
    write_living(driven(1), tmp_path / "a.npz")
    content = (tmp_path / "a.npz").read_bytes()
    for n, bad in enumerate((content[:200], content[: len(content) // 2], b"", b"not a map")):
        (tmp_path / f"{n}.npz").write_bytes(bad)
        with pytest.raises(InputError, match="expected a living map"):
            read_living_map(tmp_path / f"{n}.npz", CONFIG)
    with pytest.raises(InputError):
        read_living_map(tmp_path / "missing.npz", CONFIG)


def test_a_folder_that_cannot_be_written_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        write_living(driven(1), tmp_path / "file" / "a.npz")
