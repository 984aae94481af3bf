"""DeepLabv3+ in plain torch (Sec. 3.3); logits at the size of the input.

With a ResNet encoder its parameters have the names of segmentation_models_pytorch's DeepLabV3Plus, so
that checkpoints interchange.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812 - torch's own name for it

from swardmap.train.encoders import RESNET_DEPTHS, EfficientNetLite, ResNet


def _separable(inputs: int, outputs: int, dilation: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, inputs, 3, 1, dilation, dilation, groups=inputs, bias=False),
        nn.Conv2d(inputs, outputs, 1, bias=False),
    )


def _with_norm(conv: nn.Module, channels: int) -> list[nn.Module]:
    return [conv, nn.BatchNorm2d(channels), nn.ReLU()]


class PooledBranch(nn.Sequential):
    """The image-wide feature of ASPP, repeated over the map."""

    def forward(self, x: Tensor) -> Tensor:
        """Pool to one pixel, project, repeat."""
        return super().forward(x).expand(-1, -1, *x.shape[-2:])


class AtrousPyramid(nn.Module):
    """ASPP: the same map at several dilations, and its mean."""

    def __init__(self, inputs: int, channels: int, rates: Sequence[int], dropout: float) -> None:
        super().__init__()
        branches: list[nn.Module] = [
            nn.Sequential(*_with_norm(nn.Conv2d(inputs, channels, 1, bias=False), channels))
        ]
        branches += [nn.Sequential(*_with_norm(_separable(inputs, channels, r), channels)) for r in rates]
        branches.append(
            PooledBranch(
                nn.AdaptiveAvgPool2d(1), *_with_norm(nn.Conv2d(inputs, channels, 1, bias=False), channels)
            )
        )
        self.convs = nn.ModuleList(branches)
        joined = nn.Conv2d(len(branches) * channels, channels, 1, bias=False)
        self.project = nn.Sequential(*_with_norm(joined, channels), nn.Dropout(dropout))

    def forward(self, x: Tensor) -> Tensor:
        """All branches, joined."""
        return self.project(torch.cat([branch(x) for branch in self.convs], 1))


class Decoder(nn.Module):
    """DeepLabv3+'s decoder: ASPP, up by 4, joined with the low features."""

    def __init__(self, low: int, high: int, channels: int, rates: Sequence[int], dropout: float) -> None:
        super().__init__()
        self.aspp = nn.Sequential(
            AtrousPyramid(high, channels, rates, dropout),
            *_with_norm(_separable(channels, channels), channels),
        )
        self.block1 = nn.Sequential(*_with_norm(nn.Conv2d(low, 48, 1, bias=False), 48))
        self.block2 = nn.Sequential(*_with_norm(_separable(48 + channels, channels), channels))

    def forward(self, low: Tensor, high: Tensor) -> Tensor:
        """Features at stride 4."""
        up = F.interpolate(self.aspp(high), size=low.shape[-2:], mode="bilinear", align_corners=False)
        return self.block2(torch.cat([up, self.block1(low)], 1))


class DeepLabV3Plus(nn.Module):
    """Logits of each class for each pixel.

    Args:
        encoder: name of the encoder, see `encoders`.
        channels_out: 1 with a sigmoid, else the number of classes.
        channels: width of the decoder (256 in the paper's network).
        rates: dilations of ASPP.
        dropout: of ASPP's projection.
    """

    def __init__(
        self,
        encoder: str,
        channels_out: int,
        channels: int = 256,
        rates: Sequence[int] = (12, 24, 36),
        dropout: float = 0.5,
    ) -> None:
        super().__init__()
        self.encoder = ResNet(encoder) if encoder in RESNET_DEPTHS else EfficientNetLite(encoder)
        self.decoder = Decoder(
            self.encoder.low_channels, self.encoder.high_channels, channels, rates, dropout
        )
        self.segmentation_head = nn.Sequential(nn.Conv2d(channels, channels_out, 1))

    def features(self, x: Tensor) -> Tensor:
        """(N, 3, H, W) normalised image -> (N, channels, H / 4, W / 4)."""
        return self.decoder(*self.encoder(x))

    def forward(self, x: Tensor) -> Tensor:
        """(N, 3, H, W) normalised image -> (N, channels_out, H, W) logits."""
        y = self.segmentation_head(self.features(x))
        return F.interpolate(y, size=x.shape[-2:], mode="bilinear", align_corners=False)
