"""A whole recording to files: what is written, and what an interruption or a full disk leaves."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from swardmap.config import Config, GeometryConfig, config_from_dict
from swardmap.errors import InputError, OutputError
from swardmap.geometry import Intrinsics
from swardmap.io.clouds.cloud_files import read_cloud
from swardmap.io.maps.map_files import read_costmap, read_map
from swardmap.io.sources.folder import write_folder
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.models.oracle import TruthSegmenter
from swardmap.pipeline import ObstacleMapper, StepResult
from swardmap.runs.recording import map_recording
from swardmap.runs.summary import RunTotals
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.types import Frame

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
TRUTH = config_from_dict({"segmenter": {"name": "truth"}, "output": {"pictures": 2, "clouds": "pcd"}})


def source(n: int = 3) -> AnalyticSource:
    return AnalyticSource(garden_scene(0), tuple(lane_poses(n, step_m=0.4)), SMALL)


def test_everything_is_written_and_reads_back(tmp_path: Path) -> None:
    out = tmp_path / "out"
    run = map_recording(source(), out, TRUTH)
    assert run.grid is not None
    assert run.costmap is not None
    grid = read_map(out / "map.yaml")
    assert grid.spec == run.grid.spec
    np.testing.assert_array_equal(grid.classes, run.grid.classes)
    np.testing.assert_array_equal(read_costmap(out / "costmap.yaml").costs, run.costmap.costs)
    assert sorted(p.name for p in (out / "frames").iterdir()) == ["000000.png", "000002.png"]
    clouds = sorted((out / "clouds").iterdir())
    assert len(clouds) == 3
    assert len(read_cloud(clouds[0])) > 1000
    summary = json.loads((out / "summary.json").read_text())
    assert summary["frames"] == 3
    assert summary["map"]["cells"]["person"] == run.grid.count(MapClass.PERSON) > 0
    assert sum(v for k, v in summary["pixels"].items() if k != "pixels") == summary["pixels"]["pixels"]
    assert set(summary["timings_ms"]) == {"segment", "map"}
    assert config_from_dict(yaml.safe_load((out / "config.yaml").read_text())) == TRUTH
    assert config_from_dict(summary["config"]) == TRUTH


def test_a_folder_on_disk_gives_the_same_map(tmp_path: Path) -> None:
    write_folder(source(), tmp_path / "rec")
    from_disk = map_recording(tmp_path / "rec", config=TRUTH)
    direct = map_recording(source(), config=TRUTH)
    assert from_disk.grid is not None
    assert direct.grid is not None
    np.testing.assert_array_equal(from_disk.grid.classes, direct.grid.classes)


class Spoiled:
    """A source that ends in an error or an interruption after some frames."""

    name, frame_count, label_set = "spoiled", None, GRASS_OBSTACLE_PERSON
    skipped: dict[str, int] = {}  # noqa: RUF012 - never changed

    def __init__(self, error: BaseException, after: int) -> None:
        self._error, self._after = error, after

    def __iter__(self) -> Iterator[Frame]:
        yield from list(source())[: self._after]
        raise self._error


def test_ctrl_c_leaves_what_was_finished(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        map_recording(Spoiled(KeyboardInterrupt(), 2), out, TRUTH)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["interrupted"] is True
    assert summary["frames"] == 2
    assert read_map(out / "map.yaml").count(MapClass.GRASS) > 0


def test_an_error_leaves_the_earlier_result_whole(tmp_path: Path) -> None:
    out = tmp_path / "out"
    map_recording(source(), out, TRUTH)
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}
    with pytest.raises(InputError, match="broken"):
        map_recording(Spoiled(InputError("broken"), 1), out, TRUTH, overwrite=True)
    assert {p: p.read_bytes() for p in out.rglob("*") if p.is_file()} == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_an_existing_result_is_not_touched(tmp_path: Path) -> None:
    map_recording(source(1), tmp_path / "out", TRUTH)
    with pytest.raises(OutputError, match="--overwrite"):
        map_recording(source(1), tmp_path / "out", TRUTH)
    map_recording(source(1), tmp_path / "out", TRUTH, overwrite=True)


def test_a_full_disk_is_one_error_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import errno
    import os

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        map_recording(source(1), tmp_path / "out", TRUTH)
    assert list(tmp_path.iterdir()) == []


def test_an_empty_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no frame that can be mapped"):
        map_recording(AnalyticSource(poses=()), tmp_path / "out", TRUTH)
    assert not (tmp_path / "out").exists()


def test_frames_without_poses_get_a_map_each(tmp_path: Path) -> None:
    class Blind(Spoiled):
        def __iter__(self) -> Iterator[Frame]:
            return (replace(frame, T_map_camera=None) for frame in source(2))

    out = tmp_path / "out"
    config = config_from_dict({"segmenter": {"name": "truth"}, "mount": {"height_m": 0.9, "pitch_deg": 20.0}})
    run = map_recording(Blind(KeyboardInterrupt(), 0), out, config)
    assert run.grid is None
    assert run.summary["map"] is None
    assert run.summary["frames_without_pose"] == 2
    assert run.summary["mount"]["height_m"] == 0.9
    assert not (out / "map.yaml").exists()
    assert read_map(out / "maps" / "000001.yaml").spec.frame_id == "base"


def test_progress_sees_every_frame() -> None:
    steps: list[StepResult] = []
    map_recording(source(2), config=Config(), segmenter=None, on_step=steps.append)
    assert [step.frame.name for step in steps] == ["000000", "000001"]


def test_two_scenes_do_not_go_into_one_map() -> None:
    class TwoScenes(Spoiled):
        def __iter__(self) -> Iterator[Frame]:
            return (replace(frame, tags={"scene": frame.name}) for frame in source(2))

    with pytest.raises(InputError, match="a world of its own"):
        map_recording(TwoScenes(KeyboardInterrupt(), 0), config=TRUTH)


def test_a_frame_in_between_without_a_pose_has_a_map_of_its_own(tmp_path: Path) -> None:
    frames = list(source())
    frames[1] = replace(frames[1], T_map_camera=None)
    write_folder(frames, tmp_path / "rec")
    summary = map_recording(tmp_path / "rec", tmp_path / "out", TRUTH).summary
    assert (summary["frames"], summary["frames_without_pose"]) == (3, 1)
    names = sorted(p.name for p in (tmp_path / "out/maps").glob("*.yaml"))
    assert names == ["000001.yaml"]
    assert read_map(tmp_path / "out/maps/000001.yaml").count(MapClass.GRASS) > 100
    assert summary["mount"]["source"] == "measured from the ground in frame 000001, the first without a pose"
    assert summary["mount"]["height_m"] == pytest.approx(0.9, abs=0.02)


def test_both_kinds_of_evidence_are_counted_and_written(tmp_path: Path) -> None:
    config = config_from_dict(
        {
            "segmenter": {"name": "truth"},
            "geometry": {"enabled": True},
            "output": {"pictures": 1, "frame_maps": True},
        }
    )
    steps: list[StepResult] = []
    run = map_recording(source(2), tmp_path / "out", config, on_step=steps.append)
    cells = json.loads((tmp_path / "out" / "summary.json").read_text())["evidence_cells"]
    assert cells == run.summary["evidence_cells"]
    assert cells["geometric"] == sum(
        int(s.observation.geometry.marks.sum()) for s in steps if s.observation.geometry
    )
    assert cells["fused"] == cells["semantic"] + cells["geometric"] - cells["both"]
    assert cells["both"] > 50
    assert set(run.summary["timings_ms"]) == {"segment", "map"}
    for step in steps:
        assert step.observation.geometry is not None
        maps = tmp_path / "out" / "maps"
        written = [
            read_map(maps / f"{step.frame.name}{kind}.yaml") for kind in ("", "_semantic", "_geometry")
        ]
        semantic = step.observation.semantic_grid.is_obstacle
        known = (step.seen.is_obstacle, semantic, step.observation.geometry.marks)
        for grid, marked in zip(written, known, strict=True):
            np.testing.assert_array_equal(grid.is_obstacle, marked)
        assert (tmp_path / "out" / "frames" / f"{step.frame.name}.png").is_file()
    plain = map_recording(source(1), None, replace(TRUTH, geometry=GeometryConfig(enabled=False)))
    assert plain.summary["evidence_cells"] is None


def test_compiling_does_not_count_as_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = iter([0, 3, 3, 3])  # at the start, and after each frame: the first one waited
    monkeypatch.setattr("swardmap.runs.summary.machine_code_count", lambda: next(counts))
    totals = RunTotals(machine_code=next(counts))
    steps = list(ObstacleMapper(TruthSegmenter(GRASS_OBSTACLE_PERSON)).run(source(3)))
    for step, milliseconds in zip(steps, (9_000.0, 2.0, 4.0), strict=True):
        totals.add(replace(step, timings_ms={"grid": milliseconds}))
    assert totals.timing_summary() == {"grid": {"mean": 3.0, "p50": 3.0, "p99": 3.98}}
    assert totals.compiling_ms["grid"].tolist() == [9_000.0]


def test_a_run_of_one_frame_has_timings_too() -> None:
    totals = RunTotals(machine_code=-1)
    step = next(ObstacleMapper(TruthSegmenter(GRASS_OBSTACLE_PERSON)).run(source(1)))
    totals.add(step)
    assert set(totals.timing_summary()) == set(step.timings_ms)
