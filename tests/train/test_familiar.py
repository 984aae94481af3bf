"""A network file learns to say which images it knows, and gives what it gave before."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.errors import InputError, ModelError
from swardmap.geometry import Intrinsics
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.models.onnx import OnnxSegmenter
from swardmap.models.spec import METADATA_KEY, UNFAMILIAR, NetworkSpec
from swardmap.train.export import open_session, read_spec
from swardmap.train.familiar import carry_familiar, fitted, limit_of, teach_familiar
from swardmap.train.photos import Photo
from swardmap.train.recipe import AugmentConfig
from swardmap.train.unknown import KINDS
from swardmap.types import Frame
from tests.train.conftest import make_photo

onnx = pytest.importorskip("onnx", reason="the tests build their networks with the package onnx")

WIDTH, HEIGHT = 96, 64
SPEC = NetworkSpec("tiny", WIDTH, HEIGHT, GRASS_OBSTACLE_PERSON, (0, 1, 2), (0, 0, 0), (1, 1, 1))


def photos(seeds: range) -> list[Photo]:
    return [Photo(*make_photo(seed), np.zeros((1, 1), np.uint8), str(seed)) for seed in seeds]


def write_network(path: Path, averages: bool = True) -> Path:
    """A convolution with a residual sum, from which the logits come, less what is averaged over the image."""
    rng = np.random.default_rng(0)
    shapes = {"a": (48, 3, 3, 3), "b": (48, 48, 3, 3), "c": (3, 48, 1, 1), "d": (3, 48, 1, 1)}
    constants = [
        onnx.numpy_helper.from_array(rng.normal(0, 0.1, shape).astype(np.float32), name)
        for name, shape in shapes.items()
    ]
    constants.append(onnx.numpy_helper.from_array(np.array([2, 3], np.int64), "over"))
    make = onnx.helper.make_node
    nodes = [
        make("Conv", ["image", "a"], ["first"], pads=[1, 1, 1, 1]),
        make("Relu", ["first"], ["seen"]),
        make("Conv", ["seen", "b"], ["second"], pads=[1, 1, 1, 1]),
        make("Add", ["seen", "second"], ["sum"]),
        make("Conv", ["sum", "c"], ["local"]),
    ]
    if averages:
        nodes += [make("ReduceMean", ["sum", "over"], ["mean"]), make("Conv", ["mean", "d"], ["whole"])]
        nodes.append(make("Sub", ["local", "whole"], ["logits"]))
    else:
        nodes.append(make("Identity", ["local"], ["logits"]))
    value = onnx.helper.make_tensor_value_info
    sizes = ([1, 3, HEIGHT, WIDTH],) * 2
    ends = [value(n, onnx.TensorProto.FLOAT, s) for n, s in zip(("image", "logits"), sizes, strict=True)]
    graph = onnx.helper.make_graph(nodes, "tiny", ends[:1], ends[1:], constants)
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 18)], ir_version=9)
    onnx.helper.set_model_props(model, {METADATA_KEY: SPEC.to_json()})
    path.write_bytes(model.SerializeToString())
    return path


def taught(path: Path) -> dict[str, Any]:
    known = {"made": photos(range(24))}
    return teach_familiar(path, known, {"held": photos(range(100, 112))}, AugmentConfig())


def frame_of(rgb: NDArray[np.uint8]) -> Frame:
    height, width = rgb.shape[:2]
    depth = np.full((height, width), 1500, np.uint16)
    return Frame(0, Intrinsics(width, height, 90.0, 90.0, width / 2, height / 2), rgb, depth)


def test_a_file_learns_which_images_it_knows(tmp_path: Path) -> None:
    path = write_network(tmp_path / "net.onnx")
    before = OnnxSegmenter(path)
    lawn = frame_of(make_photo(200)[0])
    assert before(lawn).unfamiliar is None
    figures = taught(path)
    after = OnnxSegmenter(path)
    assert after.spec == replace(
        before.spec, unfamiliar_limit=figures["limit"], metrics={UNFAMILIAR: figures}
    )
    seen = after(lawn)
    np.testing.assert_array_equal(seen.labels, before(lawn).labels)
    np.testing.assert_array_equal(seen.confidence, before(lawn).confidence)
    assert seen.unfamiliar is not None
    assert seen.unfamiliar < 1
    rng = np.random.default_rng(5)
    spoilt = [after(frame_of(KINDS["covered"](lawn.rgb, rng))).unfamiliar or 0.0 for _ in range(10)]
    assert np.mean(np.array(spoilt) > 1) >= 0.6
    assert set(figures["noticed"]) == set(KINDS)
    assert figures["refused"]["held"] <= 0.05
    assert {p.name for p in tmp_path.iterdir()} == {"net.onnx"}


def test_taught_again_it_has_one_score_and_the_same(tmp_path: Path) -> None:
    path = write_network(tmp_path / "net.onnx")
    first = taught(path)
    once = path.read_bytes()
    assert taught(path) == first
    assert path.read_bytes() == once
    assert [o.name for o in open_session(path).get_outputs()] == ["logits", UNFAMILIAR]


def test_a_score_is_carried_to_a_network_whose_features_changed(tmp_path: Path) -> None:
    old = write_network(tmp_path / "old.onnx")
    assert carry_familiar(old, old, photos(range(8)), AugmentConfig()) is None
    before = taught(old)
    changed = onnx.load(old)
    for constant in changed.graph.initializer:
        if constant.name == "a":
            louder = onnx.numpy_helper.to_array(constant) * np.float32(1.4)
            constant.CopyFrom(onnx.numpy_helper.from_array(louder, "a"))
    new = tmp_path / "new.onnx"
    new.write_bytes(changed.SerializeToString())
    lawns = [frame_of(make_photo(seed)[0]) for seed in range(200, 212)]
    rng = np.random.default_rng(5)
    spoilt = [frame_of(KINDS["covered"](lawn.rgb, rng)) for lawn in lawns]

    def beyond(path: Path, frames: list[Frame]) -> float:
        segmenter = OnnxSegmenter(path)
        return float(np.mean([(segmenter(f).unfamiliar or 0.0) > 1 for f in frames]))

    figures = carry_familiar(new, old, photos(range(24)), AugmentConfig())
    assert figures is not None
    assert figures["limit"] >= before["limit"]
    assert set(figures["noticed"]) == set(KINDS)
    assert [o.name for o in open_session(new).get_outputs()] == ["logits", UNFAMILIAR]
    assert OnnxSegmenter(new).spec.unfamiliar_limit == figures["limit"]
    assert beyond(new, lawns) == 0
    assert beyond(new, spoilt) >= 0.6
    with pytest.raises(InputError, match="photos that the network knows"):
        carry_familiar(new, old, [], AugmentConfig())


def test_what_cannot_be_taught_is_said_and_left_as_it_was(tmp_path: Path) -> None:
    path = write_network(tmp_path / "net.onnx", averages=False)
    before = path.read_bytes()
    with pytest.raises(ModelError, match="an average over the image, got 1 of the one and none of the other"):
        taught(path)
    with pytest.raises(InputError, match="photos that the network knows"):
        teach_familiar(path, {"none": []}, {}, AugmentConfig())
    assert path.read_bytes() == before
    assert read_spec(path).unfamiliar_limit is None


def test_the_regression_finds_what_differs_and_leaves_out_what_does_not() -> None:
    rng = np.random.default_rng(0)
    known, strange = rng.normal(0, 1, (200, 5)), rng.normal(0, 1, (300, 5))
    known[:, 4] = strange[:, 4] = 7.0  # says nothing
    strange[:, 1] += 5.0
    fit = fitted(known, strange)
    assert np.argmax(np.abs(fit.weights)) == 1
    assert abs(fit.weights[4]) < 1e-9
    assert np.mean(fit.logits(known) < 0) > 0.97
    assert np.mean(fit.logits(strange) > 0) > 0.97
    far = np.full((1, 5), 1e9)
    assert np.isfinite(fit.logits(far)).all()


def test_the_limit_counts_each_set_alike() -> None:
    assert limit_of([np.arange(1000.0)]) == 994
    assert limit_of([np.arange(-1000.0, 0.0)]) == 0, "even odds at least"
    assert limit_of([np.arange(1000.0), np.array([2000.0])]) == 2000, "a small set counts as a large one"


@pytest.mark.parametrize("kind", KINDS)
def test_spoilt_images_are_images_that_chance_decides(kind: str) -> None:
    rgb = make_photo(3, 96, 128)[0]
    one, same, other = (KINDS[kind](rgb, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert one.dtype == np.uint8
    assert one.shape == rgb.shape
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()
    assert np.mean(np.abs(one.astype(int) - rgb).max(axis=2) > 8) > 0.15, "much of it is not as it was"
