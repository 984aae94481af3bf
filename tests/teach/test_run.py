"""`swardmap teach` from end to end: labels and page, learning, a gate that lets pass and one that refuses."""

import json
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from swardmap.cli.app import run
from swardmap.config import Config, MountConfig
from swardmap.io import open_source
from swardmap.io.maps.area_files import read_metric_area
from swardmap.io.sources.folder import write_folder
from swardmap.mapping.work_area import AreaRole
from swardmap.teach.gate import Row, Verdict, judge
from swardmap.teach.kept import forget_other_runs, is_of, labels_digest
from swardmap.teach.learn import teach_recipe
from swardmap.teach.page import mount_warning, warnings
from swardmap.teach.plan import LearnConfig, TeachPlan, circle
from swardmap.teach.run import _learn_twice, label
from swardmap.teach.safety import SafetyFrame
from swardmap.teach.task import Task
from swardmap.teach.write import Written
from swardmap.train.recipe import NetworkConfig
from tests.teach.scenes import lane

TINY = NetworkConfig(
    encoder="efficientnet-lite0", decoder_channels=16, rates=(1, 2, 3), width=96, height=64, imagenet=True
)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("drives") / "lawn"
    write_folder((replace(f, labels=None, label_set=None) for f in lane(n=22)), out)
    return out


@pytest.fixture(scope="module")
def start(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network that knows nothing."""
    pytest.importorskip("onnxscript", reason="export needs the package onnxscript")
    from swardmap.train.build import build_network, network_spec
    from swardmap.train.export import export_onnx
    from swardmap.train.recipe import DataConfig, Recipe

    recipe = Recipe("tiny", TINY, data=(DataConfig(name="a", folder="a"),))
    path = tmp_path_factory.mktemp("networks") / "tiny.onnx"
    export_onnx(build_network(recipe, pretrained=False), network_spec(recipe), path)
    return path


def gardens() -> Iterator[SafetyFrame]:
    """A safety set of four frames: lawn below, something else above."""
    for k in range(4):
        labels = np.zeros((48, 64), np.uint8)
        labels[24:] = 1
        rgb = np.array([(150, 150, 160), (70, 120, 50)], np.uint8)[labels]
        yield SafetyFrame(str(k), rgb, labels, np.zeros((48, 64), np.uint16), {})


def make_small(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A tiny network, and three frames with true labels in place of what the package replays."""
    known = tmp_path / "known"
    write_folder(lane(n=3), known)
    for part, name in (("images", "rgb"), ("labels", "labels")):
        (known / part).mkdir(exist_ok=True)
        for file in sorted((known / name).iterdir()):
            (known / part / file.name).write_bytes(file.read_bytes())
    monkeypatch.setattr("swardmap.teach.learn.NetworkConfig", lambda: TINY)
    monkeypatch.setattr("swardmap.teach.learn.REPLAY", known)
    monkeypatch.setattr("swardmap.teach.learn.DEMO", known)
    monkeypatch.setattr("swardmap.teach.learn.FRESH", known)
    monkeypatch.setattr("swardmap.teach.learn.HOLD_OUT", 3)


def test_labels_and_page_are_made_kept_and_made_anew(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "my-lawn.onnx"
    assert run(["teach", str(drive), "-o", str(out)]) == 0
    told = capsys.readouterr().out
    assert "m2 driven" in told
    assert f"page: {out.with_suffix('.teach') / 'page.html'}" in told
    assert "--yes" in told
    assert not out.exists()
    page = (out.with_suffix(".teach") / "page.html").read_text(encoding="utf-8")
    assert page.count("data:image") >= 10
    assert "Nothing is learnt yet" in page
    assert "shows no ground that was driven" not in page
    labels = sorted((out.with_suffix(".teach") / "learn" / "labels").iterdir())
    before = labels[0].stat().st_mtime_ns
    assert run(["teach", str(drive), "-o", str(out), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["frames_learn"] == len(labels)
    assert labels[0].stat().st_mtime_ns == before
    assert run(["teach", str(drive), "-o", str(out), "--leave-out", "2-4"]) == 0
    facts = json.loads((out.with_suffix(".teach") / "labels.json").read_text())
    assert facts["left_out"] == {"lawn": {"left out as told": [[2.0, 4.0]]}}


def test_labels_of_another_meaning_are_made_anew(drive: Path, tmp_path: Path) -> None:
    """The same ring once as the lawn, once as what is left out: the labels of the first were kept."""
    area = tmp_path / "area.yaml"
    area.write_text("polygon_m: [[-1, -1], [3, -1], [3, 1], [-1, 1]]\n")
    out = tmp_path / "my-lawn.onnx"
    task = Task([open_source(drive)], [drive], out, Config(), TeachPlan(circle(0.3)))
    lawn = read_metric_area(area)
    inside, outside = replace(task, area=lawn), replace(task, unwanted=(lawn,))
    kept_out = replace(
        task, area=replace(lawn, polygons=(replace(lawn.polygons[0], role=AreaRole.EXCLUSION),))
    )
    found = [labels_digest(t) for t in (task, inside, outside, kept_out)]
    assert len(set(found)) == 4


def test_what_is_made_beside_the_recording_is_no_part_of_it(drive: Path, tmp_path: Path) -> None:
    """The network in the folder of the drive: every call began anew, and then refused its own file."""
    copy = tmp_path / "drive"
    shutil.copytree(drive, copy)
    task = Task([open_source(copy)], [copy], copy / "my-lawn.onnx", Config(), TeachPlan(circle(0.3)))
    before = labels_digest(task)
    (copy / "my-lawn.teach" / "learn").mkdir(parents=True)
    (copy / "my-lawn.teach" / "learn" / "x.png").write_bytes(b"x")
    (copy / "my-lawn.onnx").write_bytes(b"x")
    assert labels_digest(task) == before
    (copy / "poses.txt").write_text((copy / "poses.txt").read_text() + "# more\n")
    assert labels_digest(task) != before


def test_who_does_not_say_where_the_camera_sits_is_told() -> None:
    assert "give mount.x_m" in mount_warning(MountConfig())[0]
    assert mount_warning(MountConfig(x_m=0.4)) == []


def test_checkpoints_of_another_recipe_begin_anew(tmp_path: Path) -> None:
    run_folder = tmp_path / "run" / "again"
    forget_other_runs(run_folder, "one")
    (run_folder / "last.pt").write_bytes(b"x")
    forget_other_runs(run_folder, "one")
    assert (run_folder / "last.pt").is_file()
    forget_other_runs(run_folder, "two")
    assert not (run_folder / "last.pt").exists()
    assert is_of(run_folder, "two")
    assert not is_of(run_folder, "one")


def test_a_part_held_out_that_can_measure_nothing_is_told() -> None:
    told = "shows no ground that was driven"
    assert any(told in line for line in warnings([], Written(learn=9, held=4)))
    assert not any(told in line for line in warnings([], Written(learn=9, held=4, held_driven=500)))


@pytest.mark.parametrize("trusted", [True, False])
def test_paths_that_nothing_speaks_against_are_warned_of(trusted: bool) -> None:
    """A taught network took paths of a campus for lawn, and the gate of rendered gardens let it pass."""
    one: Any = SimpleNamespace(
        drive=SimpleNamespace(name="lawn", left_out={}, spec=SimpleNamespace(resolution_m=0.05)),
        doubt=SimpleNamespace(cells=np.zeros((2, 2), np.bool_), grass_share=0.8),
        ground=SimpleNamespace(least_other=0.3 if trusted else float("inf")),
    )
    assert any("a path in view may become lawn" in line for line in warnings([one], Written())) != trusted


def test_a_refusal_is_told_and_nothing_is_written(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    row = Row("persons", 0.0, 0.5, 0.1, 40)
    monkeypatch.setattr("swardmap.teach.run.learn", lambda *_: Verdict((row,), (row.reason,)))
    out = tmp_path / "my-lawn.onnx"
    assert run(["teach", str(drive), "-o", str(out), "--yes"]) == 1
    told = capsys.readouterr()
    assert "persons overlooked" in told.out
    assert "refused" in told.err
    assert "persons overlooked rise from 0.00% to 50.00%, beyond 10.00%" in told.err
    assert not out.exists()


def test_a_network_is_not_replaced_by_its_pupil(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start = tmp_path / "lawn.onnx"
    start.write_bytes(b"a network")
    assert run(["teach", str(drive), "-o", str(start), "--start", str(start)]) == 1
    assert "must not replace" in capsys.readouterr().err
    link = tmp_path / "other-name.onnx"
    link.symlink_to(start)
    assert run(["teach", str(drive), "-o", str(link), "--start", str(start)]) == 1
    assert "must not replace" in capsys.readouterr().err
    assert start.read_bytes() == b"a network"


def test_a_second_drive_does_not_take_the_place_of_the_first(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, again = tmp_path / "my-lawn.onnx", tmp_path / "again" / drive.name
    shutil.copytree(drive, again)  # of the same name, size and number of frames
    assert run(["teach", str(drive), "-o", str(out)]) == 0
    facts = json.loads((out.with_suffix(".teach") / "labels.json").read_text())
    out.write_bytes(b"what the first drive taught")
    assert run(["teach", str(drive), "-o", str(out)]) == 0  # the same drive may go on
    capsys.readouterr()
    assert run(["teach", str(again), "-o", str(out)]) == 1
    assert "name another file, or add --replace" in capsys.readouterr().err
    assert json.loads((out.with_suffix(".teach") / "labels.json").read_text()) == facts
    assert run(["teach", str(again), "-o", str(out), "--replace"]) == 0
    assert json.loads((out.with_suffix(".teach") / "labels.json").read_text()) != facts
    assert out.read_bytes() == b"what the first drive taught"


def test_two_drives_of_one_name_are_told_apart(drive: Path, tmp_path: Path) -> None:
    again, out = tmp_path / "again" / drive.name, tmp_path / "my-lawn.onnx"
    shutil.copytree(drive, again)
    assert run(["teach", str(drive), str(again), "-o", str(out), "--leave-out", "2-4"]) == 0
    facts = json.loads((out.with_suffix(".teach") / "labels.json").read_text())
    names = [f"{drive.name} (1)", f"{drive.name} (2)"]
    assert facts["drives"] == names
    assert sorted(facts["left_out"]) == names


class KilledError(Exception):
    pass


def test_a_killed_second_round_goes_on_to_the_same_weights(
    drive: Path, start: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import torch

    from swardmap.train.checkpoint import read_checkpoint

    make_small(monkeypatch, tmp_path)
    torch.set_num_threads(1)
    learning = LearnConfig(steps=2, again=1.5, kept_batches=2, check_every=1, batch=2)
    plan, config = TeachPlan(circle(0.3), learn=learning), Config()
    averages = []
    for kill in (False, True):
        out = tmp_path / ("cut" if kill else "whole") / "my-lawn.onnx"
        task = Task([open_source(drive, config)], [drive], out, config, plan, start)
        label(task, lambda *_: None)
        recipe = teach_recipe("my-lawn", start.absolute(), "MIT", learning, (), "fp32", 5.0)

        def killed(figures: Mapping[str, Any]) -> None:
            if figures["step"] == 4 and "accuracy" not in figures:
                raise KilledError

        if kill:
            with pytest.raises(KilledError):
                _learn_twice(task, recipe, killed, "cpu", 1)
        last = _learn_twice(task, recipe, lambda _: None, "cpu", 1)
        state = read_checkpoint(last)
        assert state["step"] == 3
        averages.append(state["average"])
    assert all(torch.equal(averages[0][key], value) for key, value in averages[1].items())


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_drive_is_learnt_and_the_figures_travel(
    drive: Path,
    start: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    make_small(monkeypatch, tmp_path)
    monkeypatch.setattr("swardmap.teach.faults.safety_frames", gardens)
    monkeypatch.setattr("swardmap.teach.run.judge", lambda old, new: replace(judge(old, new), reasons=()))
    out = tmp_path / "my-lawn.onnx"
    options = ["--start", str(start), "--steps", "2", "--device", "cpu", "--threads", "1"]
    assert run(["teach", str(drive), "-o", str(out), "--yes", *options]) == 0
    assert "written:" in capsys.readouterr().out
    assert run(["doctor", "--seconds", "0", "--segmenter", str(out), "--json"]) in (0, 1)
    taught = json.loads(capsys.readouterr().out)["network"]["taught"]
    assert taught["from"] == "tiny"
    assert taught["figures"]["grass_called_grass"]["after"] is not None
    assert taught["figures"]["held_stands_called_grass"]["cases"] > 0
