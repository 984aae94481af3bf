"""The network in the package: that it loads and runs, and, with the real photos, how good it is."""

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import swardmap
from swardmap.config import GridConfig, SegmenterConfig
from swardmap.io import open_source
from swardmap.labels import GRASS, GRASS_OBSTACLE_PERSON, OTHER, MapClass
from swardmap.models import build_segmenter, bundled_network
from swardmap.models.network_io import segmentation_of
from swardmap.models.onnx import OnnxSegmenter
from swardmap.train.data import load_photos
from swardmap.train.evaluate import evaluate_network
from swardmap.train.recipe import recipe_from_dict
from swardmap.types import Frame

DATA = Path(os.environ.get("SWARDMAP_DATA", "/nowhere"))
DEMO = Path(swardmap.__file__).parent / "data" / "demo"
MakeFrame = Callable[..., Frame]


@pytest.fixture(scope="module")
def shipped() -> OnnxSegmenter:
    path = bundled_network()
    assert path is not None, "the package holds no network"
    return OnnxSegmenter(path, threads=1)


def test_it_is_what_auto_means_and_says_where_it_comes_from(shipped: OnnxSegmenter) -> None:
    assert build_segmenter(SegmenterConfig(name="auto")).name == shipped.name
    assert shipped.label_set == GRASS_OBSTACLE_PERSON
    assert "MSRC" in shipped.spec.licence
    assert shipped.spec.training["data"]
    exported = shipped.spec.metrics.get(
        "at_export", shipped.spec.metrics
    )  # if tools/shift_grass.py went over it
    assert exported["int8"]["grass_iou"] > exported["float32"]["grass_iou"] - 0.005
    path = bundled_network()
    assert path is not None
    assert path.stat().st_size < 25e6


def test_a_made_frame_is_segmented_in_time(shipped: OnnxSegmenter, lawn_frame: MakeFrame) -> None:
    frame = lawn_frame(480, 640)
    found = shipped(frame)
    start = time.perf_counter()
    again = shipped(frame)
    assert time.perf_counter() - start < 1.0  # some 30 ms on a free core; this catches only a mistake
    np.testing.assert_array_equal(found.labels, again.labels)
    assert found.confidence is not None
    assert 1 / 3 - 1e-3 < found.confidence.min() <= found.confidence.max() <= 1
    sky = found.resized_to(480, 640).labels[:100]
    assert (sky == OTHER.id).mean() > 0.95


def test_a_frame_without_grass_has_none(shipped: OnnxSegmenter, frame_of: MakeFrame) -> None:
    rng = np.random.default_rng(0)
    for color in ((0, 0, 0), (255, 255, 255), (130, 128, 125), (150, 180, 220)):
        rgb = np.clip(np.array(color) + rng.integers(-6, 7, (240, 320, 3)), 0, 255).astype(np.uint8)
        assert (shipped(frame_of(rgb)).labels == GRASS.id).mean() < 0.02
    for level, deviation in ((0, 4), (10, 5), (10, 12), (20, 12), (30, 20)):  # a lens covered, in the dark
        covered = np.clip(rng.normal(level, deviation, (480, 640, 3)), 0, 255).astype(np.uint8)
        assert (shipped(frame_of(covered)).labels == GRASS.id).mean() < 0.02


@pytest.mark.skipif(not (DATA / "msrc_v2").is_dir(), reason="needs msrc_v2 under SWARDMAP_DATA")
def test_real_photos_it_never_saw(shipped: OnnxSegmenter) -> None:
    entry = {"name": "val", "folder": "msrc_v2", "list": "val.txt"}
    photos = load_photos(recipe_from_dict({"name": "val", "data": [entry]}), DATA, validation=False)[0].photos
    path = bundled_network()
    assert path is not None
    figures = evaluate_network(path, photos, threads=1).score.figures()
    least = {"accuracy": 0.95, "grass_iou": 0.90, "person_iou": 0.60}
    for name, limit in least.items():
        value = figures[name]
        assert value is not None
        assert value >= limit, name
    assert (figures["obstacle_called_grass"] or 0.0) < 0.03


@pytest.mark.skipif(not (DATA / "orfd").is_dir(), reason="needs orfd under SWARDMAP_DATA")
def test_an_off_road_robot_sees_grass_beside_the_road_and_none_in_the_trees(shipped: OnnxSegmenter) -> None:
    for path in sorted((DATA / "orfd/images").glob("*.png")):
        rgb = np.asarray(cv2.cvtColor(np.asarray(cv2.imread(str(path))), cv2.COLOR_BGR2RGB), np.uint8)
        found = segmentation_of(shipped.logits(rgb), shipped.spec)
        grass = found.map_classes == MapClass.GRASS
        clears = grass & (found.hazard_255 <= 255 * GridConfig().clear_below)
        height, width = grass.shape
        assert grass[: height // 3].mean() < 0.002  # sky and crowns of trees
        assert grass[4 * height // 5 :, : width // 4].mean() < 0.001  # the road
        assert grass[height // 2 :, : width // 4].mean() < 0.02  # with weeds and stones of its far verge
        assert clears[height // 2 :, : width // 4].mean() < 0.001  # of which none is surely grass
        assert grass[height // 3 :, width // 2 :].mean() > 0.03  # the verge


def test_the_small_one_is_the_same_network_with_a_smaller_input(
    shipped: OnnxSegmenter, lawn_frame: MakeFrame
) -> None:
    path = bundled_network("small")
    assert path is not None
    small = OnnxSegmenter(path, threads=1)
    assert small.spec.width * small.spec.height < 0.6 * shipped.spec.width * shipped.spec.height
    assert small.label_set == shipped.label_set
    assert small.spec.training["blend_shares"] == shipped.spec.training["blend_shares"]
    frame = lawn_frame(480, 640)
    here, there = (s(frame).resized_to(480, 640).labels for s in (small, shipped))
    assert (here == there).mean() > 0.9


@pytest.mark.parametrize("name", ["auto", "small"])
def test_a_covered_lens_is_unfamiliar_and_the_demo_is_not(name: str, lawn_frame: MakeFrame) -> None:
    segmenter = build_segmenter(SegmenterConfig(name=name))
    for frame in list(open_source(DEMO))[::3]:
        assert (segmenter(frame).unfamiliar or 0.0) < 1
    frame = lawn_frame(480, 640)
    for level in (0, 40, 120):
        covered = replace(frame, rgb=np.full((480, 640, 3), level, np.uint8))
        assert (segmenter(covered).unfamiliar or 0.0) > 1
