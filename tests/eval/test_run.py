import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swardmap.config import Config, SourceConfig, config_from_dict
from swardmap.errors import ConfigError, InputError, InvalidValueError, OutputError
from swardmap.eval import dataset as dataset_module
from swardmap.eval.compare import compare_runs
from swardmap.eval.confusion import confusion_of_masks
from swardmap.eval.dataset import DatasetSpec, count_frames, read_frames
from swardmap.eval.frame import Plan, compare_again, evaluate_frame, evaluate_part, pose_of, scored_mask
from swardmap.eval.maps import compare_maps
from swardmap.eval.protocols import at_resolution
from swardmap.eval.results import results
from swardmap.eval.run import evaluate, make_plan, parts_of, read_plan, read_records
from swardmap.geometry import Pose
from swardmap.io.marks import marks_of
from swardmap.io.sources.folder import write_folder
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.perception.ground_plane import estimate_mount
from swardmap.pipeline import ObstacleMapper
from swardmap.synth.analytic import AnalyticSource, lane_poses
from swardmap.synth.analytic_source import AnalyticGardens
from swardmap.types import Frame, Segmentation, nearest_indices

TRUTH = config_from_dict({"segmenter": {"name": "truth"}})
COLOUR = config_from_dict({"segmenter": {"name": "colour"}})
GARDENS = "analytic:scenes=2,frames=6,width=96"


def small_plan(location: str = GARDENS, **options: Any) -> Plan:
    options = {"resolutions_m": (0.1,), "protocols": ("dense",), "with_budget": False} | options
    return make_plan(DatasetSpec(location), COLOUR, **options)


def test_parts_cover_every_frame_once_and_do_not_depend_on_the_machine() -> None:
    for total in (1, 7, 8, 9, 1023, 1024, 50_000):
        indices = [i for start, stop in parts_of(total) for i in range(start, stop)]
        assert indices == list(range(total))


def test_any_split_gives_the_same_bytes() -> None:
    plan = small_plan()
    whole = evaluate_part(plan, 0, 12)
    for cuts in ([0, 12], [0, 1, 5, 12], list(range(13))):
        assert "".join(evaluate_part(plan, a, b) for a, b in pairwise(cuts)) == whole


def test_processes_give_the_results_of_one_process(tmp_path: Path) -> None:
    plan = small_plan(with_budget=True, protocols=("dense", "paper"))
    one = evaluate(plan, tmp_path / "one", workers=1)
    two = evaluate(plan, tmp_path / "two", workers=2)
    assert one == two
    assert json.dumps(results(plan, one)) == json.dumps(results(plan, two))


def test_a_run_goes_on_where_it_was_and_does_only_what_is_missing(tmp_path: Path) -> None:
    plan, seen = small_plan(), []
    first = evaluate(plan, tmp_path, workers=1)
    parts = sorted((tmp_path / "parts").iterdir())
    parts[1].unlink()
    before = parts[0].stat().st_mtime_ns
    again = evaluate(plan, tmp_path, workers=1, on_done=lambda done, total: seen.append((done, total)))
    assert again == first
    assert seen == [(8, 12), (12, 12)]
    assert parts[0].stat().st_mtime_ns == before
    parts[0].write_text(parts[0].read_text()[:100])  # damaged from outside: done again
    assert evaluate(plan, tmp_path, workers=1) == first


def test_another_plan_is_never_mixed_in(tmp_path: Path) -> None:
    evaluate(small_plan(), tmp_path, workers=1)
    other = small_plan(resolutions_m=(0.2,))
    with pytest.raises(OutputError, match="other data or settings"):
        evaluate(other, tmp_path, workers=1)
    records = evaluate(other, tmp_path, workers=1, overwrite=True)
    assert list(records[0]["maps"]) == ["dense@0.2"]
    kept = (tmp_path / "parts" / "0000000-0000008.jsonl").stat().st_mtime_ns
    evaluate(other, tmp_path, workers=1, overwrite=True)  # begins anew, though the plan is the same
    assert (tmp_path / "parts" / "0000000-0000008.jsonl").stat().st_mtime_ns != kept
    stranger = tmp_path / "stranger"
    stranger.mkdir()
    (stranger / "thesis.txt").write_text("mine")
    with pytest.raises(OutputError, match="was not made by swardmap"):
        evaluate(other, stranger, workers=1, overwrite=True)
    assert (stranger / "thesis.txt").read_text() == "mine"


def test_the_plan_round_trips_and_is_read_back(tmp_path: Path) -> None:
    plan = small_plan(T_base_camera=tuple(map(float, range(16))))
    assert Plan.from_json(plan.to_json()) == plan
    assert replace(plan, seed=1).fingerprint != plan.fingerprint
    evaluate(plan, tmp_path, workers=1)
    assert read_plan(tmp_path) == (plan, 12)
    with pytest.raises(InputError, match="swardmap evaluate"):
        read_plan(tmp_path / "parts")
    (tmp_path / "parts" / "0000000-0000008.jsonl").unlink()
    with pytest.raises(InputError, match="same command again"):
        read_records(tmp_path, 12)


def test_the_mount_is_not_measured_by_true_labels(monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot has none: the mount that an evaluation finds must be the one that `map` finds."""
    seen: list[bool] = []

    def measured(frame: Frame) -> Pose:
        seen.append(frame.labels is not None)
        return estimate_mount(frame)

    monkeypatch.setattr("swardmap.perception.ground_plane.estimate_mount", measured)
    (frame,) = AnalyticGardens("analytic:scenes=1,frames=1,width=96,noise=0", SourceConfig())
    pose_of(small_plan(), replace(frame, T_map_camera=None))
    assert seen == [False]


class Doubtful:
    """True labels with a confidence of 0.5 or 0.9 in patches, and 0.4 P(obstacle) where it is low."""

    name, label_set = "doubtful", GRASS_OBSTACLE_PERSON

    def __call__(self, frame: Frame) -> Segmentation:
        assert frame.labels is not None
        assert frame.label_set is not None
        patches = np.random.default_rng(3).random((6, 8)) < 0.5
        rows, columns = (nearest_indices(n, m) for n, m in zip(frame.labels.shape, (6, 8), strict=True))
        low = patches[rows[:, None], columns]
        confidence = np.where(low, np.float32(0.5), np.float32(0.9))
        hazard = np.where(low, np.uint8(102), np.uint8(0))
        return Segmentation(frame.labels, frame.label_set, confidence, hazard)


@pytest.mark.parametrize("min_confidence", [0.0, 0.7])
def test_the_map_that_is_judged_is_the_one_that_the_robot_makes(min_confidence: float) -> None:
    """Grass that is not sure keeps its cells from clearing: left out, it would let them be cleared."""
    config = config_from_dict({"segmenter": {"name": "truth", "min_confidence": min_confidence}})
    plan = make_plan(
        DatasetSpec(GARDENS), config, resolutions_m=(0.1,), protocols=("dense",), with_budget=False
    )
    (numbered,) = read_frames(plan.dataset, 2, 3)
    frame, doubtful = numbered.frame, Doubtful()
    assert frame is not None
    assert frame.labels is not None
    robot = ObstacleMapper(doubtful, at_resolution(config, 0.1)).step(frame)
    mask, found = compare_again(plan, frame, numbered.clean, doubtful, numbered.truth)
    assert found.predicted.spec == robot.seen.spec
    assert np.array_equal(found.predicted.classes, robot.seen.classes)
    assert (robot.seen.classes == MapClass.GRASS).any()
    record = evaluate_frame(plan, numbered, doubtful)
    assert (
        record["maps"]["dense@0.1"]
        == compare_maps(found.reference, robot.seen, pose_of(plan, frame).position_m[:2]).tally.to_dict()
    )
    scored = scored_mask(plan, mask)
    assert np.array_equal(scored.labels, robot.segmentation.labels)
    expected = confusion_of_masks(frame.labels, scored.labels, scored.label_set).to_dict()
    assert record["mask"] == expected, "void where it is not sure"


def touched(file: Path) -> None:
    """Changed in place, without a byte of difference in size."""
    content = bytearray(file.read_bytes())
    content[-5] ^= 1
    file.write_bytes(bytes(content))
    os.utime(file, ns=(0, file.stat().st_mtime_ns + 1))  # within the clock's step a change shows no time


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: touched(sorted((f / "drive" / "labels").iterdir())[0]), "files of the recording changed"),
        (lambda f: sorted((f / "drive" / "depth").iterdir())[0].unlink(), "files of the recording changed"),
        (lambda f: (f / "drive" / "instances.json").write_bytes(b"{}"), "files of the recording changed"),
        (lambda f: touched(sorted((f / "clean" / "depth").iterdir())[0]), "files of the clean depth changed"),
    ],
)
def test_data_that_was_changed_under_its_name_is_other_data(
    change: Callable[[Path], None], said: str, tmp_path: Path
) -> None:
    """Labels that were corrected must not give the figures of before."""
    for name in ("drive", "clean"):
        write_folder(AnalyticGardens("analytic:scenes=1,frames=2,width=96", SourceConfig()), tmp_path / name)
    spec = DatasetSpec(str(tmp_path / "drive"), clean=str(tmp_path / "clean"))
    options: dict[str, Any] = {"resolutions_m": (0.1,), "protocols": ("dense",), "with_budget": False}
    out = tmp_path / "drive" / "out"  # results that lie in the recording are no part of it
    first = evaluate(make_plan(spec, COLOUR, **options), out, workers=1)
    kept = (out / "parts" / "0000000-0000002.jsonl").stat().st_mtime_ns
    assert evaluate(make_plan(spec, COLOUR, **options), out, workers=1) == first
    assert (out / "parts" / "0000000-0000002.jsonl").stat().st_mtime_ns == kept, (
        "it goes on, with nothing to do"
    )
    change(tmp_path)
    with pytest.raises(OutputError, match=said):
        evaluate(make_plan(spec, COLOUR, **options), out, workers=1)


def test_marks_follow_links_and_no_link_leads_round(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "a.png").write_bytes(b"123")
    (tmp_path / "data" / "round").symlink_to(tmp_path / "data")
    (tmp_path / "data" / "gone").symlink_to(tmp_path / "nothing")
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "b.png").write_bytes(b"45")
    (tmp_path / "data" / "far").symlink_to(tmp_path / "far")
    first = marks_of(tmp_path / "data")
    assert first.startswith("3 files, 5 bytes, ")
    assert marks_of(tmp_path / "data") == first
    (tmp_path / "far" / "b.png").write_bytes(b"456")
    assert marks_of(tmp_path / "data") != first
    assert marks_of(tmp_path / "data" / "a.png").startswith("1 files, 3 bytes, ")
    assert small_plan().data == (), "frames that are made have no files"


def test_two_networks_of_one_name_are_two_plans(tmp_path: Path) -> None:
    network, fingerprints = tmp_path / "lawn.onnx", []
    config = config_from_dict({"segmenter": {"name": str(network)}})
    for content in (b"one", b"two", b"one"):
        network.write_bytes(content)
        fingerprints.append(make_plan(DatasetSpec(GARDENS), config).fingerprint)
    assert fingerprints[0] != fingerprints[1]
    assert fingerprints[0] == fingerprints[2]
    network.unlink()
    with pytest.raises(InputError, match=r"lawn\.onnx"):
        make_plan(DatasetSpec(GARDENS), config)


def test_a_process_that_dies_is_one_clear_error_and_what_is_finished_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = small_plan("analytic:scenes=4,frames=8,width=96")
    expected = evaluate(plan, tmp_path / "alone", workers=1)
    monkeypatch.setattr("swardmap.runs.parallel._start_worker", _die_at_once)
    with pytest.raises(OutputError, match="died, perhaps for want of memory"):
        evaluate(plan, tmp_path / "run", workers=2)
    monkeypatch.undo()
    assert evaluate(plan, tmp_path / "run", workers=2) == expected


def _die_at_once(*_: object) -> None:
    os._exit(1)


class Broken:
    """A source whose fourth frame cannot be read, and whose seventh is left out."""

    def __init__(self, config: SourceConfig) -> None:
        self._good = AnalyticGardens(GARDENS, config)
        self.name, self.label_set, self.frame_count = "broken", self._good.label_set, self._good.frame_count
        self.skipped: dict[str, int] = {}

    def __iter__(self) -> Any:
        for frame in self._good:
            if frame.name == "0000_0003":
                raise InputError("rgb/0003.png is truncated")
            if frame.name == "0001_0000":
                self.skipped["no depth image"] = 1
                continue
            yield frame


def test_a_frame_that_cannot_be_read_is_named_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dataset_module, "open_source", lambda _, config: Broken(config.source))
    plan = replace(small_plan(), dataset=DatasetSpec("broken"))
    records = evaluate(plan, tmp_path / "run", workers=1)
    bad = {r["index"]: r["error"] for r in records if "error" in r}
    assert bad.keys() == {3, 6}
    assert "truncated" in bad[3]
    assert "no depth image" in bad[6]
    found = results(plan, records)
    assert found["frames"]["evaluated"] == 10
    assert [b["index"] for b in found["frames"]["unreadable"]] == [3, 6]
    with pytest.raises(InputError, match=r"frame 3: .*truncated"):
        evaluate(plan, tmp_path / "strict", workers=1, strict=True)
    # the good ones are what they are without the bad ones
    monkeypatch.undo()
    clean = {r["name"]: r["mask"] for r in evaluate(small_plan(), tmp_path / "clean", workers=1)}
    assert all(r["mask"] == clean[r["name"]] for r in records if "error" not in r)


def test_sources_of_unknown_length_are_read_from_the_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    class Bag(AnalyticGardens):
        frame_count = None  # type: ignore[assignment]

    monkeypatch.setattr(dataset_module, "open_source", lambda _, config: Bag(GARDENS, config.source))
    spec = DatasetSpec("some.mcap", SourceConfig(start=2, every=2))
    assert count_frames(spec) == 5
    names = [n.frame.name for n in read_frames(spec, 1, 4) if n.frame]
    assert names == ["0000_0004", "0001_0000", "0001_0002"]


def test_clean_depth_of_a_second_recording_must_be_of_the_same_frames(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def opened(location: str, config: Config) -> Any:
        gardens = {"noisy": GARDENS, "clean": GARDENS + ",noise=0", "other": GARDENS + ",seed=5"}
        return AnalyticGardens(gardens[str(location)], config.source)

    monkeypatch.setattr(dataset_module, "open_source", opened)
    good = list(read_frames(DatasetSpec("noisy", clean="clean"), 2, 5))
    assert all(n.clean is not None and n.frame is not None for n in good)
    assert not np.array_equal(good[0].frame.depth, good[0].clean.depth)  # type: ignore[union-attr]
    (wrong,) = read_frames(DatasetSpec("noisy", clean="other"), 0, 1)
    assert wrong.frame is None
    assert "expected clean depth of frame '0000_0000'" in wrong.error


def test_what_cannot_be_evaluated_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="expected whole numbers for scenes"):
        make_plan(DatasetSpec("analytic:scenes=many"))
    with pytest.raises(InputError, match="no such recording"):
        make_plan(DatasetSpec(str(tmp_path / "nothing")))
    with pytest.raises(InvalidValueError, match="protocols"):
        small_plan(protocols=("mine",))
    with pytest.raises(ConfigError, match="resolution_m"):
        small_plan(resolutions_m=(-0.1,))
    with pytest.raises(InputError, match="holds no frame"):
        evaluate(small_plan("analytic:scenes=0"), tmp_path / "empty", workers=1)

    class Unlabelled(AnalyticGardens):
        label_set = None  # type: ignore[assignment]

    monkeypatch.setattr(dataset_module, "open_source", lambda _, config: Unlabelled(GARDENS, config.source))
    with pytest.raises(InputError, match="no true labels"):
        make_plan(DatasetSpec("recording"))


def test_runs_side_by_side(tmp_path: Path) -> None:
    truth = make_plan(
        DatasetSpec(GARDENS), TRUTH, resolutions_m=(0.1,), protocols=("dense",), with_budget=False
    )
    for name, plan in (("colour", small_plan()), ("truth", truth), ("again", small_plan())):
        evaluate(plan, tmp_path / name, workers=1)
    folders = [tmp_path / name for name in ("colour", "truth", "again")]
    better, same = compare_runs(folders)
    assert (better.frames, better.units) == (12, 12)
    (pixels,) = (d for d in better.differences if d.key == "pixels_right")
    assert pixels.other == 1
    assert pixels.is_sure
    assert pixels.low is not None
    assert pixels.difference is not None
    assert 0 < pixels.low <= pixels.difference
    assert all(d.difference in (0, None) and not d.is_sure for d in same.differences)
    by_sequence = compare_runs(folders[:2], unit="sequence")[0]
    assert by_sequence.units == 2
    with pytest.raises(InputError, match="at least two"):
        compare_runs(folders[:1])
    evaluate(small_plan(resolutions_m=(0.2,)), tmp_path / "coarse", workers=1)
    with pytest.raises(InputError, match="in common"):
        compare_runs([folders[0], tmp_path / "coarse"])


SCRIPT = """
import sys
from swardmap.eval.run import evaluate, read_plan
from swardmap.synth.analytic import AnalyticSource, lane_poses
from swardmap.eval.frame import Plan
if __name__ == "__main__":
    evaluate(Plan.from_json(open(sys.argv[1]).read()), sys.argv[2], workers=2)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="kill -9 of a process group needs POSIX")
def test_killed_three_times_at_random_the_result_is_that_of_an_undisturbed_run(tmp_path: Path) -> None:
    plan = small_plan("analytic:scenes=4,frames=40,width=160", with_budget=True)
    expected = evaluate(plan, tmp_path / "undisturbed", workers=2)
    (tmp_path / "plan.txt").write_text(plan.to_json())
    script = tmp_path / "go.py"
    script.write_text(SCRIPT)
    command = [sys.executable, str(script), str(tmp_path / "plan.txt"), str(tmp_path / "killed")]
    dice, parts, killed = random.Random(3), tmp_path / "killed" / "parts", 0
    for _ in range(3):
        run = subprocess.Popen(command)
        done = len(list(parts.glob("*.jsonl"))) if parts.exists() else 0
        deadline = time.monotonic() + 60
        while run.poll() is None and time.monotonic() < deadline:
            if parts.exists() and len(list(parts.glob("*.jsonl"))) > done + dice.randint(0, 2):
                break
            time.sleep(0.01)
        time.sleep(dice.uniform(0, 0.3))
        if run.poll() is None:
            run.send_signal(signal.SIGKILL)
            killed += 1
        run.wait()
    assert killed == 3
    assert 0 < len(list(parts.glob("*.jsonl"))) < 20
    assert evaluate(plan, tmp_path / "killed", workers=2) == expected


@pytest.mark.parametrize("height_m", [0.7, 1.2])
def test_without_a_pose_the_mount_is_measured_frame_by_frame(height_m: float) -> None:
    poses = tuple(lane_poses(1, height_m=height_m, pitch_deg=25.0))
    frame = replace(next(iter(AnalyticSource(poses=poses))), T_map_camera=None)
    assert pose_of(small_plan(), frame).position_m[2] == pytest.approx(height_m, abs=5e-3)
    configured = make_plan(
        DatasetSpec(GARDENS), config_from_dict({"mount": {"height_m": 2.0, "pitch_deg": 10.0}})
    )
    assert pose_of(configured, frame).position_m[2] == pytest.approx(2.0)
