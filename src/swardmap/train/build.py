"""A recipe's network, and what it takes and gives."""

from collections.abc import Mapping

import torch
from torch import Tensor

from swardmap.errors import ModelError
from swardmap.labels import Role
from swardmap.models.spec import NetworkSpec
from swardmap.train.encoders import RESNET_DEPTHS, freeze_filters, load_imagenet
from swardmap.train.networks import DeepLabV3Plus
from swardmap.train.recipe import Recipe

HEAD = ("segmentation_head.0.weight", "segmentation_head.0.bias")
"""The last layer, with one row for each output."""

BIASES = {Role.FREE: "grass_bias", Role.PERSON: "person_bias"}
"""Whose logits `swardmap export` may move, and under which name a file's `training` tells by how much."""

LITE_NORMALISATION = ((0.498, 0.498, 0.498), (0.502, 0.502, 0.502))
RESNET_NORMALISATION = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))


def network_spec(recipe: Recipe) -> NetworkSpec:
    """What the recipe's network takes and gives."""
    config = recipe.network
    mean, std = RESNET_NORMALISATION if config.encoder in RESNET_DEPTHS else LITE_NORMALISATION
    return NetworkSpec(
        name=recipe.name,
        width=config.width,
        height=config.height,
        label_set=config.label_set,
        channel_ids=config.trained_ids,
        mean=mean,
        std=std,
        activation=config.activation,
        licence=recipe.licence,
    )


def build_network(recipe: Recipe, pretrained: bool = True) -> DeepLabV3Plus:
    """The recipe's network, its encoder from ImageNet where the recipe says so."""
    config = recipe.network
    torch.manual_seed(recipe.schedule.seed)
    outputs = network_spec(recipe).channels
    network = DeepLabV3Plus(config.encoder, outputs, config.decoder_channels, config.rates, config.dropout)
    if pretrained and config.imagenet:
        load_imagenet(network.encoder, config.encoder)
    if config.frozen_blocks >= 0 and config.imagenet:
        freeze_filters(network.encoder, config.frozen_blocks)
    return network


def fitted_head(
    found: Mapping[str, Tensor], own: Mapping[str, Tensor], spec: NetworkSpec, source: NetworkSpec
) -> dict[str, Tensor]:
    """The head of another network for the classes of this one: by name, else the first of the same role.

    Args:
        found: the other network's tensors, with those of `HEAD`.
        own: this network's; a sigmoid and a softmax have nothing in common, and it keeps its head.
        spec: of this network.
        source: of the other.

    Returns:
        The tensors of `HEAD`.
    """
    meant = spec.label_set.remap_table(source.label_set)[list(spec.channel_ids)]
    strange = not set(meant.tolist()) <= set(source.channel_ids)
    if strange or spec.activation != source.activation:
        return {key: own[key] for key in HEAD}
    rows = [source.channel_ids.index(int(i)) for i in meant] if spec.channels > 1 else [0]
    return {key: found[key][rows] for key in HEAD}


@torch.no_grad()
def add_biases(network: DeepLabV3Plus, spec: NetworkSpec, biases: Mapping[Role, float]) -> None:
    """Add to the logits of the classes of each role."""
    for role, bias in biases.items():
        network.segmentation_head[0].bias += role_shift(spec, role, bias)


def role_shift(spec: NetworkSpec, role: Role, bias: float) -> Tensor:
    """(channels,) float32: the bias for each output of a class of this role, 0 for the others."""
    roles = {c.id: c.role for c in spec.label_set.classes}
    meant = [roles[i] is role for i in spec.channel_ids][-spec.channels :]
    return bias * torch.tensor(meant, dtype=torch.float32)


def export_shift(spec: NetworkSpec) -> Tensor:
    """(channels,) float32: what `swardmap export` added to the logits, by what the file says of its training.

    Raises:
        ModelError: if the file tells of biases for another number of classes.
    """
    biases = spec.training.get("class_biases", [0.0] * spec.channels)
    if not isinstance(biases, list) or len(biases) < spec.channels:
        raise ModelError(f"expected {spec.channels} class_biases in the file, got {biases!r}"[:200])
    shift = torch.tensor(biases[-spec.channels :], dtype=torch.float32)
    for role, key in BIASES.items():
        shift += role_shift(spec, role, float(spec.training.get(key, 0.0)))
    return shift
