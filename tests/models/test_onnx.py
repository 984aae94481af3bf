from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from swardmap.config import SegmenterConfig
from swardmap.errors import ConfigError, InvalidValueError, ModelError
from swardmap.labels import GRASS_OBSTACLE, GRASS_OBSTACLE_PERSON, OTHER, VOID_ID
from swardmap.models import build_segmenter
from swardmap.models.network_io import decide, preprocess
from swardmap.models.onnx import OnnxSegmenter
from swardmap.models.spec import METADATA_KEY, UNFAMILIAR, NetworkSpec
from swardmap.types import Frame

onnx = pytest.importorskip("onnx", reason="the tests build their networks with the package onnx")

MakeFrame = Callable[..., Frame]
SPEC = NetworkSpec("tiny", 32, 24, GRASS_OBSTACLE_PERSON, (0, 1, 2), mean=(0, 0, 0), std=(1, 1, 1))
BINARY = NetworkSpec("tiny2", 32, 24, GRASS_OBSTACLE, (0, 1), (0, 0, 0), (1, 1, 1), activation="sigmoid")


def write_network(path: Path, channels: int, metadata: str | None, height: int = 24, kind: int = 1) -> Path:
    """A 1x1 convolution: channel 1 is large where green outweighs red and blue, channel 2 where red does."""
    rows = [[0.0, 0, 0], [-20.0, 40, -20], [40.0, -20, -20], [0, 0, 0]][:channels]
    if channels == 1:
        rows = [[-20.0, 40, -20]]
    helper, weights = onnx.helper, np.array(rows, np.float32)[:, :, None, None]
    graph = helper.make_graph(
        [helper.make_node("Conv", ["image", "w"], ["logits"])],
        "tiny",
        [helper.make_tensor_value_info("image", kind, [1, 3, height, 32])],
        [helper.make_tensor_value_info("logits", kind, [1, channels, height, 32])],
        [helper.make_tensor("w", kind, weights.shape, weights.ravel().tolist())],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    if metadata is not None:
        helper.set_model_props(model, {METADATA_KEY: metadata.replace("\udcff", "BAD")})
    content = model.SerializeToString()
    path.write_bytes(content.replace(b"BAD", b"\xff\xfe\xfd") if metadata == "\udcff" else content)
    return path


@pytest.fixture
def network(tmp_path: Path) -> Path:
    return write_network(tmp_path / "net.onnx", 3, SPEC.to_json())


def patches() -> NDArray[np.uint8]:
    rgb = np.full((48, 64, 3), 128, np.uint8)
    rgb[:, 20:40] = (60, 160, 50)
    rgb[:, 40:] = (200, 60, 50)
    return rgb


def test_a_network_gives_classes_and_probabilities(network: Path, frame_of: MakeFrame) -> None:
    segmenter = build_segmenter(SegmenterConfig(name=str(network)))
    assert (segmenter.name, segmenter.label_set) == ("tiny", GRASS_OBSTACLE_PERSON)
    found = segmenter(frame_of(patches()))
    assert found.labels.shape == (24, 32)
    np.testing.assert_array_equal(found.labels[:, [5, 15, 25]], [[0, 1, 2]] * 24)
    assert found.confidence is not None
    assert found.confidence.min() > 1 / 3 - 1e-6
    assert found.confidence.max() <= 1


def test_a_sigmoid_network_agrees_with_its_softmax_twin(tmp_path: Path) -> None:
    one = OnnxSegmenter(write_network(tmp_path / "one.onnx", 1, BINARY.to_json()))
    twin = NetworkSpec("two", 32, 24, GRASS_OBSTACLE, (0, 1), (0, 0, 0), (1, 1, 1))
    two = OnnxSegmenter(write_network(tmp_path / "two.onnx", 2, twin.to_json()))
    (labels, confidence), (labels_two, confidence_two) = one.segment(patches()), two.segment(patches())
    np.testing.assert_array_equal(labels, labels_two)
    np.testing.assert_allclose(confidence, confidence_two, atol=1e-6)


def test_a_second_frame_is_not_marked_by_the_first(network: Path) -> None:
    segmenter = OnnxSegmenter(network)
    first, _ = segmenter.segment(patches())
    segmenter.segment(np.full((50, 30, 3), 255, np.uint8))
    again, _ = segmenter.segment(patches())
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("order", ["rgb", "bgr"])
def test_preprocessing_is_the_textbook_formula(order: str) -> None:
    spec = NetworkSpec(
        "t", 32, 24, GRASS_OBSTACLE, (0, 1), (0.4, 0.5, 0.6), (0.2, 0.3, 0.4), colour_order=order
    )
    rgb = np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)
    buffer = np.full((1, 3, 24, 32), np.nan, np.float32)
    preprocess(rgb, spec, buffer)
    colours = rgb if order == "rgb" else rgb[..., ::-1]
    expected = ((colours / 255 - np.array(spec.mean)) / np.array(spec.std)).transpose(2, 0, 1)[None]
    np.testing.assert_allclose(buffer, expected, atol=1e-5)


@settings(max_examples=60, deadline=None)
@given(
    arrays(np.float32, (1, 3, 4, 5), elements=st.floats(-50, 50, width=32)),
    st.sampled_from([0.5, 1.0, 2.5]),
)
def test_decisions_are_argmax_and_softmax(logits: NDArray[np.float32], temperature: float) -> None:
    spec = NetworkSpec("t", 8, 8, GRASS_OBSTACLE_PERSON, (0, 1, 2), temperature=temperature)
    labels, confidence = decide(logits, spec)
    np.testing.assert_array_equal(labels, logits[0].argmax(0))
    exponents = np.exp((logits[0].astype(np.float64) - logits[0].max(0)) / temperature)
    np.testing.assert_allclose(confidence, (exponents / exponents.sum(0)).max(0), rtol=1e-5)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_logit_that_is_no_number_is_void(channels: int) -> None:
    spec = SPEC if channels == 3 else BINARY
    logits = np.zeros((1, channels, 2, 2), np.float32)
    logits[0, 0, 0, 0] = np.nan
    labels, confidence = decide(logits, spec)
    assert labels[0, 0] == VOID_ID
    assert confidence[0, 0] == 0
    assert (labels.ravel()[1:] == OTHER.id).all()


def test_the_metadata_come_back_whole() -> None:
    spec = NetworkSpec(
        "n", 64, 48, GRASS_OBSTACLE_PERSON, (1, 0, 2), temperature=1.25, licence="x", metrics={"iou": 0.9}
    )
    assert NetworkSpec.from_json(spec.to_json(), "here") == spec


def write_scored(path: Path, spec: NetworkSpec, output: str = UNFAMILIAR, spread: bool = False) -> Path:
    """The tiny network, which says how bright the image is, too."""
    write_network(path, 3, spec.to_json())
    model = onnx.load(path)
    graph, helper = model.graph, onnx.helper
    shape = [1] if not spread else [3]
    axes = [0, 1, 2, 3] if not spread else [0, 2, 3]
    graph.initializer.append(helper.make_tensor("axes", 7, [len(axes)], axes))
    graph.node.append(helper.make_node("ReduceMean", ["image", "axes"], ["bright"], keepdims=0))
    graph.initializer.append(helper.make_tensor("shape", 7, [1], shape))
    graph.node.append(helper.make_node("Reshape", ["bright", "shape"], [output]))
    graph.output.append(helper.make_tensor_value_info(output, 1, shape))
    path.write_bytes(model.SerializeToString())
    return path


def test_a_network_may_say_how_unfamiliar_an_image_is(tmp_path: Path, frame_of: MakeFrame) -> None:
    limited = replace(SPEC, unfamiliar_limit=0.5)
    assert NetworkSpec.from_json(limited.to_json(), "here") == limited
    assert "unfamiliar_limit" not in SPEC.to_json(), "older releases read such files"
    scored = OnnxSegmenter(write_scored(tmp_path / "net.onnx", limited))
    for level, expected in ((0, 0.0), (51, 0.4), (255, 2.0)):
        found = scored(frame_of(np.full((48, 64, 3), level, np.uint8)))
        assert found.unfamiliar == pytest.approx(expected, abs=1e-5)
    plain = OnnxSegmenter(write_scored(tmp_path / "plain.onnx", SPEC))
    assert plain(frame_of(patches())).unfamiliar is None, "without a limit nobody knows what it means"
    np.testing.assert_array_equal(plain(frame_of(patches())).labels, scored(frame_of(patches())).labels)


def test_a_score_that_is_no_number_is_as_unfamiliar_as_can_be(
    tmp_path: Path, frame_of: MakeFrame, monkeypatch: pytest.MonkeyPatch
) -> None:
    scored = OnnxSegmenter(write_scored(tmp_path / "net.onnx", replace(SPEC, unfamiliar_limit=0.5)))
    logits, _ = scored._run()
    monkeypatch.setattr(scored, "_run", lambda: [logits, np.array([np.nan], np.float32)])
    assert scored(frame_of(patches())).unfamiliar == np.inf


def test_a_limit_without_its_score_is_refused(tmp_path: Path) -> None:
    limited = replace(SPEC, unfamiliar_limit=0.5)
    with pytest.raises(ModelError, match="an output 'unfamiliar' after the first"):
        OnnxSegmenter(write_network(tmp_path / "none.onnx", 3, limited.to_json()))
    with pytest.raises(ModelError, match="an output 'unfamiliar' after the first"):
        OnnxSegmenter(write_scored(tmp_path / "other.onnx", limited, "brightness"))
    with pytest.raises(ModelError, match="expected one number as 'unfamiliar'"):
        OnnxSegmenter(write_scored(tmp_path / "three.onnx", limited, spread=True))
    text = limited.to_json().replace('"unfamiliar_limit": 0.5', '"unfamiliar_limit": "much"')
    with pytest.raises(ModelError, match="hold together"):
        OnnxSegmenter(write_network(tmp_path / "text.onnx", 3, text))


@pytest.mark.parametrize(
    "changes",
    [
        {"width": 0},
        {"channel_ids": (0, 0)},
        {"channel_ids": (0, 7)},
        {"std": (1.0, 0.0, 1.0)},
        {"mean": (1.0, float("nan"), 1.0)},
        {"activation": "tanh"},
        {"activation": "sigmoid"},
        {"temperature": -1.0},
        {"unfamiliar_limit": 0.0},
        {"unfamiliar_limit": float("inf")},
        {"colour_order": "grb"},
    ],
)
def test_metadata_that_cannot_be_right_are_refused(changes: dict[str, object]) -> None:
    values: dict[str, object] = {"name": "n", "width": 8, "height": 8, "channel_ids": (0, 1, 2)}
    with pytest.raises(InvalidValueError, match="network n: expected"):
        NetworkSpec(label_set=GRASS_OBSTACLE_PERSON, **{**values, **changes})  # type: ignore[arg-type]


def test_a_damaged_file_gives_one_error(tmp_path: Path, network: Path) -> None:
    data = network.read_bytes()
    cases = {"empty": b"", "text": b"not a network", "cut": data[: len(data) // 2], "zeros": bytes(500)}
    for name, content in cases.items():
        path = tmp_path / f"{name}.onnx"
        path.write_bytes(content)
        with pytest.raises(ModelError, match=name):
            OnnxSegmenter(path)


@settings(max_examples=30, deadline=None)
@given(st.binary(max_size=200))
def test_random_bytes_give_one_error(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.mktemp("bytes") / "net.onnx"
    path.write_bytes(content)
    with pytest.raises(ModelError):
        OnnxSegmenter(path)


def test_a_folder_is_no_network(tmp_path: Path) -> None:
    (tmp_path / "net.onnx").mkdir()
    with pytest.raises(ModelError, match="no such network file"):
        OnnxSegmenter(tmp_path / "net.onnx")


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        (None, "expected the metadata"),
        ("{", "net.onnx: .*metadata"),
        ("[]", "net.onnx: .*metadata"),
        ('{"version": 1}', "net.onnx: .*metadata"),
        ('{"version": 99}', "metadata version"),
        (SPEC.to_json().replace('"width": 32', '"width": "wide"'), "net.onnx: .*metadata"),
        (SPEC.to_json().replace('"name"', '"nom"'), "net.onnx: .*metadata"),
        (SPEC.to_json().replace('"width": 32', '"width": 32.0'), "metadata: width: expected a whole number"),
        ("\udcff", "an ONNX network with metadata in UTF-8"),
    ],
    ids=["none", "cut", "list", "bare", "newer", "text for a number", "foreign key", "float", "not UTF-8"],
)
def test_missing_or_wrong_metadata_is_said(tmp_path: Path, metadata: str | None, message: str) -> None:
    path = write_network(tmp_path / "net.onnx", 3, metadata)
    with pytest.raises(ModelError, match=message):
        OnnxSegmenter(path)


@pytest.mark.parametrize("channels", [1, 2, 4])
def test_another_number_of_channels_is_refused(tmp_path: Path, channels: int) -> None:
    path = write_network(tmp_path / "net.onnx", channels, SPEC.to_json())
    with pytest.raises(ModelError, match="3 output channels"):
        OnnxSegmenter(path)


def test_another_size_or_type_of_input_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="the network takes"):
        OnnxSegmenter(write_network(tmp_path / "net.onnx", 3, SPEC.to_json(), height=48))
    with pytest.raises(ModelError, match=r"one float input|does not load"):
        OnnxSegmenter(write_network(tmp_path / "net.onnx", 3, SPEC.to_json(), kind=11))


def test_a_provider_that_is_not_there_is_refused_with_those_that_are(network: Path) -> None:
    with pytest.raises(ConfigError, match="CPUExecutionProvider"):
        OnnxSegmenter(network, provider="NoSuchExecutionProvider")
