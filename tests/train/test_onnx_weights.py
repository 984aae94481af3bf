"""A file of `export` becomes a network again that computes the same and can learn."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

import swardmap
from swardmap.cli.demo import RECORDING
from swardmap.errors import ModelError
from swardmap.labels import Role
from swardmap.models import bundled_network
from swardmap.models.onnx import OnnxSegmenter
from swardmap.train.build import HEAD, add_biases, build_network, export_shift, network_spec
from swardmap.train.checkpoint import load_network
from swardmap.train.data import load_photos
from swardmap.train.export import export_onnx, quantise, with_spec
from swardmap.train.loop import predict, train
from swardmap.train.networks import DeepLabV3Plus
from swardmap.train.onnx_weights import load_onnx_weights
from swardmap.train.recipe import recipe_from_dict
from swardmap.types import Segmentation

pytest.importorskip("onnxscript", reason="export needs the package onnxscript")
pytestmark = pytest.mark.slow  # the exporter alone takes seconds to import

MakeRecipe = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def images(tiny_recipe: MakeRecipe, data_root: Path) -> torch.Tensor:
    photos = load_photos(recipe_from_dict(tiny_recipe()), data_root, validation=False)[0].photos
    stack = np.stack([p.image[:64] for p in photos[:8]])
    return torch.from_numpy(stack).permute(0, 3, 1, 2).float() / 255 - 0.5


def settled(network: DeepLabV3Plus, images: torch.Tensor) -> DeepLabV3Plus:
    """With scales, shifts and statistics of batch norm that are not those it starts with."""
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(module.weight, 0.5, 1.5)
            torch.nn.init.uniform_(module.bias, -0.5, 0.5)
    network.train()
    with torch.no_grad():
        for _ in range(30):
            network(images)
    return network.eval()


@pytest.mark.parametrize("encoder", ["efficientnet-lite0", "resnet18"])
def test_a_network_comes_back_from_its_file(
    encoder: str, tiny_recipe: MakeRecipe, images: torch.Tensor, tmp_path: Path
) -> None:
    recipe = recipe_from_dict(tiny_recipe(encoder=encoder))
    first = settled(build_network(recipe), images)
    with torch.no_grad():
        expected = first(images)
    spec = network_spec(recipe)
    with torch.no_grad():
        first.get_parameter(HEAD[1]).add_(torch.tensor([0.0, 0.7, -0.7]))
    export_onnx(first, spec, tmp_path / "net.onnx")
    told = {"grass_bias": 0.5, "person_bias": -0.3, "class_biases": [0.0, 0.2, -0.4]}
    with_spec(tmp_path / "net.onnx", training=told)
    assert str(Path(swardmap.__file__).parent).encode() not in (tmp_path / "net.onnx").read_bytes()

    again = build_network(recipe)
    load_onnx_weights(tmp_path / "net.onnx", again, spec, [images])
    with torch.no_grad():
        torch.testing.assert_close(again(images), expected, atol=2e-3, rtol=1e-3)
        again.decoder.aspp[0].project[-1].p = 0.0  # dropout
        again.train()
        learning = again(images)  # by the statistics of these very images
    torch.testing.assert_close(learning, expected, atol=2e-2, rtol=2e-2)


def test_int8_comes_back_but_for_its_rounding(
    tiny_recipe: MakeRecipe, images: torch.Tensor, tmp_path: Path
) -> None:
    recipe = recipe_from_dict(tiny_recipe())
    first = settled(build_network(recipe), images)
    export_onnx(first, network_spec(recipe), tmp_path / "net.onnx")
    pictures = ((images + 0.5) * 255).byte().permute(0, 2, 3, 1).numpy()
    quantise(tmp_path / "net.onnx", tmp_path / "small.onnx", list(pictures))
    again = build_network(recipe)
    load_onnx_weights(tmp_path / "small.onnx", again, network_spec(recipe), [images])
    for (name, weight), expected in zip(again.named_parameters(), first.parameters(), strict=True):
        if name == "segmentation_head.0.weight":  # the one layer without a batch norm
            torch.testing.assert_close(weight, expected, atol=0.01, rtol=0)
    with torch.no_grad():
        error, spread = (again(images) - first(images)).abs().mean(), first(images).std()
    assert error < 0.15 * spread


def test_new_classes_begin_as_what_they_are_called_or_what_role_they_play(
    tiny_recipe: MakeRecipe, images: torch.Tensor, tmp_path: Path
) -> None:
    recipe = recipe_from_dict(tiny_recipe())
    first, spec = settled(build_network(recipe), images), network_spec(recipe)
    add_biases(first, spec, {Role.FREE: 0.7})
    export_onnx(first, spec, tmp_path / "net.onnx")
    with_spec(tmp_path / "net.onnx", training={"grass_bias": 0.7})
    add_biases(first, spec, {Role.FREE: -0.7})
    own = recipe_from_dict(tiny_recipe(classes="person=person,clover=free,pond=obstacle,grass=free"))
    again = build_network(own)
    load_onnx_weights(tmp_path / "net.onnx", again, network_spec(own), [images])
    with torch.no_grad():
        torch.testing.assert_close(again(images), first(images)[:, [2, 1, 0, 1]], atol=2e-3, rtol=1e-3)
    export_onnx(again, network_spec(own), tmp_path / "own.onnx")
    segmenter = OnnxSegmenter(tmp_path / "own.onnx")
    assert segmenter.label_set == own.network.label_set  # which is what the map goes by
    picture = ((images[0] + 0.5) * 255).byte().permute(1, 2, 0).numpy()
    roles = segmenter.label_set.map_class_table[segmenter.segment(picture)[0]]
    with torch.no_grad():
        expected = spec.label_set.map_class_table[first(images[:1])[0].argmax(0).numpy()]
    assert (roles == expected).mean() > 0.99


def test_another_network_or_no_network_is_said(
    tiny_recipe: MakeRecipe, images: torch.Tensor, tmp_path: Path
) -> None:
    recipe = recipe_from_dict(tiny_recipe())
    export_onnx(build_network(recipe), network_spec(recipe), tmp_path / "net.onnx")
    wider = build_network(recipe_from_dict(tiny_recipe(decoder_channels=24)))
    with pytest.raises(ModelError, match="expected the recipe's network"):
        load_onnx_weights(tmp_path / "net.onnx", wider, network_spec(recipe), [images])
    (tmp_path / "cut.onnx").write_bytes((tmp_path / "net.onnx").read_bytes()[:999])
    for name in ("cut.onnx", "none.onnx"):
        with pytest.raises(ModelError, match=name):
            load_onnx_weights(tmp_path / name, wider, network_spec(recipe), [images])


def test_training_may_begin_from_the_network_in_the_package(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path
) -> None:
    path = bundled_network()
    assert path is not None
    shipped = OnnxSegmenter(path)
    lite2 = {"encoder": "efficientnet-lite2", "decoder_channels": 128, "rates": [6, 12, 18]}
    size = {"width": shipped.spec.width, "height": shipped.spec.height}
    tree = tiny_recipe(steps=1, **lite2, **size) | {"start": "auto"}
    tree["schedule"] |= {"encoder_rate": 0.0, "decoder_rate": 0.0, "batch": 2}
    tree["data"].pop()  # nothing to validate
    train(recipe_from_dict(tree), data_root, tmp_path, lambda _: None)
    network, recipe, _ = load_network(tmp_path / "start.pt")
    with torch.no_grad():
        network.get_parameter(HEAD[1]).add_(export_shift(shipped.spec))  # as at its export
    garden = load_photos(recipe, data_root, validation=False)[0].photos[0]
    for picture in sorted((RECORDING / "rgb").iterdir())[:6]:  # of toys it is not sure, and INT8 decides
        image = np.asarray(Image.open(picture).convert("RGB"))
        photo = replace(garden, image=image, codes=np.zeros(image.shape[:2], np.uint8))
        found = predict(network, recipe, photo, torch.device("cpu"))
        labels, confidence = shipped.segment(photo.image)
        expected = Segmentation(labels, shipped.label_set, confidence).resized_to(*photo.codes.shape)
        assert (found.labels == expected.labels).mean() > 0.97  # INT8 rounds
