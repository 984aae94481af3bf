"""The loss of pixels that need not be known exactly."""

import torch
from torch import Tensor

from swardmap.train.data import Codes


def set_loss(logits: Tensor, view_codes: Tensor, codes: Codes) -> Tensor:
    """Minus the log of the probability of the set of classes that each pixel may have.

    For a pixel of one class this is cross-entropy; a void pixel has all classes and costs nothing.

    Args:
        logits: (N, C, H, W), or (N, 1, H, W) of a sigmoid, float32.
        view_codes: (N, H, W) uint8.
        codes: what they mean.
    """
    if logits.shape[1] == 1:
        logits = torch.cat([torch.zeros_like(logits), logits], 1)
    index = view_codes.long()
    sets = torch.from_numpy(codes.sets).to(logits.device)[index].permute(0, 3, 1, 2)
    weights = torch.from_numpy(codes.weights).to(logits.device)[index]
    allowed = torch.logsumexp(logits.masked_fill(~sets, -1e4), 1)
    cost = (torch.logsumexp(logits, 1) - allowed) * weights
    return cost.sum() / weights.sum().clamp(min=1)
