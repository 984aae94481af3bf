"""A recipe's network, and what it takes and gives."""

import torch

from swardmap.labels import Role
from swardmap.models.spec import NetworkSpec
from swardmap.train.encoders import RESNET_DEPTHS, freeze_filters, load_imagenet
from swardmap.train.networks import DeepLabV3Plus
from swardmap.train.recipe import Recipe

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


@torch.no_grad()
def add_grass_bias(network: DeepLabV3Plus, spec: NetworkSpec, bias: float) -> None:
    """Add to the logits of the classes that may be driven on."""
    roles = {c.id: c.role for c in spec.label_set.classes}
    free = torch.tensor([roles[i] is Role.FREE for i in spec.channel_ids][-spec.channels :])
    shift = network.segmentation_head[0].bias
    shift += bias * free.to(shift)
