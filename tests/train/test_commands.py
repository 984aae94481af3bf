"""`swardmap train` as users start it: in two processes, and with teachers for photos nobody labelled."""

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
import typer
import yaml

from swardmap.cli.export import export
from swardmap.cli.train import train
from swardmap.errors import ConfigError, InputError, ModelError
from swardmap.labels import GRASS_OBSTACLE_PERSON, VOID_ID
from swardmap.models.spec import METADATA_KEY, NetworkSpec
from swardmap.train.checkpoint import read_checkpoint
from tests.train.conftest import make_photo

onnx = pytest.importorskip("onnx", reason="the tests build their teachers with the package onnx")

MakeRecipe = Callable[..., dict[str, Any]]


def write_teacher(path: Path, size: list[int], spec: NetworkSpec | None = None) -> None:
    """A 1x1 convolution that is sure of grass where green outweighs blue, and of persons where red does."""
    weights = np.array([[-4.0, -4, 9], [0, 40, -40], [60, -40, -10]], np.float32)[:, :, None, None]
    helper = onnx.helper
    graph = helper.make_graph(
        [helper.make_node("Conv", ["image", "w", "b"], ["logits"])],
        "teacher",
        [helper.make_tensor_value_info("image", 1, [1, 3, *size])],
        [helper.make_tensor_value_info("logits", 1, [1, 3, *size])],
        [
            helper.make_tensor("w", 1, weights.shape, weights.ravel().tolist()),
            helper.make_tensor("b", 1, [3], [2.0, -3.0, -6.0]),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    if spec is not None:
        helper.set_model_props(model, {METADATA_KEY: spec.to_json()})
    path.write_bytes(model.SerializeToString())


@pytest.fixture
def unlabelled(tmp_path: Path) -> Path:
    """Photos without masks, and two teachers: one described by the recipe, one that describes itself."""
    (tmp_path / "photos/images").mkdir(parents=True)
    for seed in range(12):
        cv2.imwrite(str(tmp_path / f"photos/images/{seed:03d}.png"), make_photo(seed)[0][..., ::-1])
    write_teacher(tmp_path / "bare.onnx", [64, 64])
    plain = {"mean": (0.0, 0.0, 0.0), "std": (1.0, 1.0, 1.0)}
    write_teacher(
        tmp_path / "own.onnx",
        [48, 96],
        NetworkSpec("own", 96, 48, GRASS_OBSTACLE_PERSON, (0, 1, 2), **plain),  # type: ignore[arg-type]
    )
    return tmp_path


def with_teachers(tiny_recipe: MakeRecipe, steps: int) -> dict[str, Any]:
    tree = tiny_recipe(steps=steps)
    tree["data"] = [{"name": "photos", "folder": "photos", "labels": None, "pseudo": "said"}]
    bare = {"file": "bare.onnx", "size": 64, "mean": 0.0, "std": 1.0, "grass": "1", "person": "2"}
    return tree | {"teachers": [bare, {"file": "own.onnx"}]}


def run(tree: dict[str, Any], root: Path, out: Path) -> None:
    (root / "recipe.yaml").write_text(yaml.safe_dump(tree))
    train(root / "recipe.yaml", root, out, "cpu", 1, distil=True)
    assert "was trained</h1>" in (out / "report.html").read_text()


@pytest.mark.slow
def test_photos_without_labels_teach_through_teachers(
    unlabelled: Path, tiny_recipe: MakeRecipe, capsys: pytest.CaptureFixture[str]
) -> None:
    tree = with_teachers(tiny_recipe, 60)
    tree["schedule"] |= {"check_every": 30, "batch": 8}
    run(tree, unlabelled, unlabelled / "run")
    assert "photos: 12 masks written" in capsys.readouterr().out

    wrong = known = 0
    for seed in range(12):
        said = np.asarray(cv2.imread(str(unlabelled / f"said/{seed:03d}.png"), cv2.IMREAD_GRAYSCALE))
        truth = cv2.resize(make_photo(seed)[1], said.shape[::-1], interpolation=cv2.INTER_NEAREST)
        sky_or_person = truth != 1  # the teachers take the green boxes for grass
        judged = (said != VOID_ID) & (sky_or_person | (said == 1))
        known += int(judged.sum())
        wrong += int((said != truth)[judged & (truth != 0)].sum())
    assert known > 0.5 * 12 * said.size
    assert wrong < 0.02 * known
    history = read_checkpoint(unlabelled / "run/last.pt")["history"]
    assert history[-1]["loss"] < math.log(3) / 2  # half of what knowing nothing costs

    run(tree, unlabelled, unlabelled / "run")  # again: neither asks the teachers nor trains
    assert "photos: 0 masks written" in capsys.readouterr().out


def test_teachers_that_cannot_teach_are_said(unlabelled: Path, tiny_recipe: MakeRecipe) -> None:
    tree = with_teachers(tiny_recipe, 1)
    for teacher, error, words in (
        ({"file": "none.onnx"}, InputError, "no such teacher"),
        ({"file": "bare.onnx", "size": 64}, ConfigError, "which of its channels"),
        ({"file": "bare.onnx", "size": 64, "grass": "7"}, ConfigError, "it has 3 channels"),
    ):
        with pytest.raises(error, match=words):
            run(tree | {"teachers": [teacher]}, unlabelled, unlabelled / "run")
    with pytest.raises(ConfigError, match="needs 'teachers'"):
        run(tree | {"teachers": []}, unlabelled, unlabelled / "run")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_two_processes_train_one_network_and_go_on_after_a_kill(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path
) -> None:
    steps = 8
    (tmp_path / "recipe.yaml").write_text(yaml.safe_dump(tiny_recipe(steps=steps)))
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command += ["-m", "swardmap", "train", str(tmp_path / "recipe.yaml"), "--data", str(data_root)]
    command += ["--device", "cpu", "-o"]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}

    def run_whole(out: str) -> str:
        done = subprocess.run(
            [*command, str(tmp_path / out)], capture_output=True, text=True, env=environment, check=False
        )
        assert done.returncode == 0, done.stderr[-2000:]
        return done.stdout

    assert run_whole("whole").count(f"trained {steps} steps") == 1  # the first process alone speaks
    with subprocess.Popen(
        [*command, str(tmp_path / "cut")], env=environment, stdout=subprocess.DEVNULL
    ) as cut:
        while not (tmp_path / "cut/last.pt").exists() and cut.poll() is None:
            time.sleep(0.02)
        cut.terminate()
    run_whole("cut")
    whole, resumed = (read_checkpoint(tmp_path / out / "last.pt") for out in ("whole", "cut"))
    assert [h["step"] for h in whole["history"]] == [2, 4, 6, 8]
    learnt = [k for k, v in whole["network"].items() if k.endswith("weight") and v.ndim == 4]
    for key in learnt:
        torch.testing.assert_close(whole["network"][key], resumed["network"][key], atol=1e-5, rtol=1e-4)

    alone = tmp_path / "alone"
    train(tmp_path / "recipe.yaml", data_root, alone, "cpu", 1)
    one = read_checkpoint(alone / "last.pt")["network"]
    assert any(not torch.equal(whole["network"][k], one[k]) for k in learnt)  # batch norm sees half a batch
    for key in learnt:
        torch.testing.assert_close(whole["network"][key], one[key], atol=0.02, rtol=0.2)


def test_each_blend_needs_its_share(tmp_path: Path) -> None:
    for shares in (None, [0.5, 0.5], [1.5]):
        with pytest.raises(typer.BadParameter, match="one --blend-share of 0 to 1"):
            export(
                tmp_path / "a.pt",
                tmp_path,
                tmp_path / "a.onnx",
                blend=[tmp_path / "b.pt"],
                blend_share=shares,
            )


@pytest.mark.parametrize("lost", [3.0, None])
def test_an_export_that_is_refused_or_interrupted_leaves_the_file_that_was_there(
    lost: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def release(_: Path, __: Path, out: Path, *___: object, **____: object) -> dict[str, Any]:
        out.write_bytes(b"half of it")
        if lost is None:
            raise KeyboardInterrupt
        return {"int8_loss_points": lost}

    monkeypatch.setattr("swardmap.train.release.release", release)
    out = tmp_path / "lawn.onnx"
    out.write_bytes(b"a good one")
    expected, told = (KeyboardInterrupt, None) if lost is None else (ModelError, "not written")
    with pytest.raises(expected, match=told):
        export(tmp_path / "a.pt", tmp_path, out)
    assert out.read_bytes() == b"a good one"
    assert [p.name for p in tmp_path.iterdir()] == ["lawn.onnx"]


def test_a_network_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no such network"):
        export(tmp_path / "a.onnx", tmp_path, tmp_path / "b.onnx", recipe=tmp_path / "r.yaml")
