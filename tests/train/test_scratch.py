"""From nothing to a working file, by the commands a user types."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from swardmap.cli.export import export
from swardmap.cli.train import train
from swardmap.models.colour import grass_threshold, green_chromaticity
from swardmap.models.onnx import OnnxSegmenter
from swardmap.train.checkpoint import read_checkpoint
from swardmap.train.data import load_photos
from swardmap.train.photos import Photo
from swardmap.train.recipe import recipe_from_dict
from swardmap.types import Segmentation

pytest.importorskip("onnxscript", reason="export needs the package onnxscript")

MakeRecipe = Callable[..., dict[str, Any]]


def grass_iou(masks: list[np.ndarray[Any, Any]], photos: list[Photo]) -> float:
    pairs = [(m == 1, p.codes == 1) for m, p in zip(masks, photos, strict=True)]
    return float(sum((a & b).sum() for a, b in pairs) / sum((a | b).sum() for a, b in pairs))


@pytest.mark.slow
def test_from_scratch_to_a_file_that_beats_colour(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tree = tiny_recipe(steps=160)
    tree["schedule"].update(check_every=40, batch=8)
    (tmp_path / "recipe.yaml").write_text(yaml.safe_dump(tree))
    train(tmp_path / "recipe.yaml", data_root, tmp_path / "run", "cpu", 1)
    history = read_checkpoint(tmp_path / "run/last.pt")["history"]
    assert history[-1]["loss"] < history[0]["loss"]
    assert history[-1]["loss"] < math.log(3) / 2  # half of what knowing nothing costs

    capsys.readouterr()
    file = tmp_path / "net.onnx"
    export(
        tmp_path / "run/best.pt", data_root, file, int8=True, images=16, size=None, max_loss=2.0, as_json=True
    )
    told = json.loads(capsys.readouterr().out)
    assert told["bytes"] == file.stat().st_size
    assert told["int8_loss_points"] == pytest.approx(
        100 * (told["float32"]["grass_iou"] - told["int8"]["grass_iou"])
    )

    photos = load_photos(recipe_from_dict(tree), data_root, validation=True)[0].photos
    segmenter = OnnxSegmenter(file)
    assert segmenter.spec.metrics["int8"] == told["int8"]
    found = []
    for photo in photos:
        labels, confidence = segmenter.segment(photo.image)
        found.append(
            Segmentation(labels, segmenter.label_set, confidence).resized_to(*photo.codes.shape).labels
        )
    greens = [green_chromaticity(photo.image)[0] for photo in photos]
    by_colour = [np.asarray(g > grass_threshold(g)) for g in greens]
    assert grass_iou(found, photos) > grass_iou(by_colour, photos) + 0.02
