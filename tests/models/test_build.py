from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import swardmap.models as models
from swardmap.config import SegmenterConfig
from swardmap.errors import ConfigError, InputError, ModelError
from swardmap.labels import GRASS_OBSTACLE
from swardmap.models import SEGMENTERS, SegmenterModule, build_segmenter
from swardmap.segmenter import Segmenter
from swardmap.types import Frame

MakeFrame = Callable[..., Frame]


@pytest.mark.parametrize("name", ["auto", "large", "small", "colour", "truth"])
def test_each_named_segmenter_keeps_the_contract(lawn_frame: MakeFrame, name: str) -> None:
    segmenter = build_segmenter(SegmenterConfig(name=name), GRASS_OBSTACLE)
    assert isinstance(segmenter, Segmenter)
    segmentation = segmenter(lawn_frame())
    assert segmentation.label_set == segmenter.label_set
    declared = {c.id for c in segmenter.label_set.classes}
    assert set(np.unique(segmentation.labels)) <= declared


def test_every_module_offers_open_segmenter() -> None:
    import importlib

    for module in SEGMENTERS.values():
        opener: SegmenterModule = importlib.import_module(module)  # type: ignore[assignment]
        assert callable(opener.open_segmenter)


def test_auto_is_colour_in_a_package_without_a_network(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(models, "BUNDLED_FOLDER", tmp_path)
    assert build_segmenter().name == "colour"


@pytest.mark.parametrize("name", ["color", "", "onnx", "net.pt"])
def test_an_unknown_name_is_refused_with_what_is_known(name: str) -> None:
    with pytest.raises(ConfigError, match="expected auto, large, small, colour, truth or the path"):
        build_segmenter(SegmenterConfig(name=name))


def test_a_network_that_is_not_there_is_said() -> None:
    with pytest.raises(ModelError, match="no such network file"):
        build_segmenter(SegmenterConfig(name="nowhere/net.onnx"))


def test_truth_returns_the_frames_labels(lawn_frame: MakeFrame) -> None:
    frame = lawn_frame()
    segmentation = build_segmenter(SegmenterConfig(name="truth"), frame.label_set)(frame)
    assert segmentation.labels is frame.labels


def test_truth_without_labels_is_refused(frame_of: MakeFrame) -> None:
    with pytest.raises(ConfigError, match="recording with true labels"):
        build_segmenter(SegmenterConfig(name="truth"))
    segmenter = build_segmenter(SegmenterConfig(name="truth"), GRASS_OBSTACLE)
    with pytest.raises(InputError, match="frame made: expected true labels"):
        segmenter(frame_of(np.zeros((4, 4, 3), np.uint8)))
