from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from swardmap.errors import ModelError
from swardmap.models.onnx import OnnxSegmenter
from swardmap.train.build import build_network, network_spec
from swardmap.train.calibrate import fit_temperature
from swardmap.train.data import load_photos
from swardmap.train.evaluate import evaluate_network, reliability_bins
from swardmap.train.export import (
    export_onnx,
    quantise,
    read_spec,
    with_spec,
)
from swardmap.train.photos import Photo
from swardmap.train.recipe import Recipe, recipe_from_dict

pytest.importorskip("onnxscript", reason="export needs the package onnxscript")
pytestmark = pytest.mark.slow  # the exporter alone takes seconds to import

MakeRecipe = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def exported(
    tiny_recipe: MakeRecipe, data_root: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Recipe, list[Photo]]:
    recipe = recipe_from_dict(tiny_recipe())
    network = build_network(recipe)
    photos = load_photos(recipe, data_root, validation=True)[0].photos
    images = torch.from_numpy(np.stack([p.image for p in photos])).permute(0, 3, 1, 2).float() / 255
    with torch.no_grad():
        network.train()
        for _ in range(20):  # batch statistics, without which an untrained network's output vanishes
            network(images)
    path = tmp_path_factory.mktemp("export") / "net.onnx"
    assert export_onnx(network, network_spec(recipe), path) < 1e-3
    return path, recipe, photos


def test_the_file_agrees_with_torch_and_says_what_it_is(exported: tuple[Path, Recipe, list[Photo]]) -> None:
    path, recipe, photos = exported
    segmenter = OnnxSegmenter(path)
    assert segmenter.spec == network_spec(recipe) == read_spec(path)
    labels, confidence = segmenter.segment(photos[0].image)
    assert labels.shape == (64, 96)
    assert np.isfinite(confidence).all()


def test_an_export_that_differs_is_refused(
    tiny_recipe: MakeRecipe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swardmap.train.export.AGREEMENT", 0.0)
    recipe = recipe_from_dict(tiny_recipe())
    with pytest.raises(ModelError, match="differs from torch"):
        export_onnx(build_network(recipe), network_spec(recipe), tmp_path / "net.onnx")


def test_int8_is_smaller_and_mostly_of_one_mind(
    exported: tuple[Path, Recipe, list[Photo]], tmp_path: Path
) -> None:
    path, _, photos = exported
    small = tmp_path / "small.onnx"
    quantise(path, small, (p.image for p in photos))
    assert small.stat().st_size < 0.5 * path.stat().st_size
    assert {p.name for p in tmp_path.iterdir()} == {"small.onnx"}
    a, b = OnnxSegmenter(path), OnnxSegmenter(small)
    same = [np.mean(a.segment(p.image)[0] == b.segment(p.image)[0]) for p in photos]
    assert np.mean(same) > 0.85
    assert b.spec == a.spec


def test_temperature_makes_confidence_honest(
    exported: tuple[Path, Recipe, list[Photo]], tmp_path: Path
) -> None:
    path, _, photos = exported
    copy = tmp_path / "net.onnx"
    copy.write_bytes(path.read_bytes())
    before = evaluate_network(copy, photos)
    temperature = fit_temperature(copy, {"held": photos})
    with_spec(copy, temperature=temperature)
    after = evaluate_network(copy, photos)
    np.testing.assert_array_equal(before.score.counts, after.score.counts)  # no class changes
    assert after.calibration_error <= before.calibration_error + 0.02
    assert OnnxSegmenter(copy).spec.temperature == pytest.approx(temperature)


def test_reliability_bins_count_every_pixel() -> None:
    confidence = np.array([0.05, 0.95, 0.95, 1.0], np.float32)
    bins = reliability_bins(confidence, np.array([False, True, False, True]))
    np.testing.assert_allclose(bins[0], [1, 0.05, 0], atol=1e-6)
    np.testing.assert_allclose(bins[9], [3, 2.9, 2], atol=1e-6)
    assert bins[:, 0].sum() == 4
