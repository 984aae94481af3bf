"""Views that are drawn once and learnt from again and again, with what a fixed encoder says of them.

Half of a step's time goes into the encoder. Where only the decoder learns, it says the same of a view each
time, so that is kept. Batches are made when they are first asked for and depend on the recipe alone: a run
that was killed goes on exactly as it would have.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor, nn

from swardmap.errors import ConfigError
from swardmap.train.recipe import Recipe

Encoded = tuple[Tensor, ...]
"""Low and high features, codes and finer codes of some views; the first axis is the view."""


@dataclass(frozen=True, slots=True, eq=False)
class KeptViews:
    """Some batches of views. The first time they come as they were drawn, then their views are shuffled.

    Attributes:
        batches: how many.
        each: views in a batch.
        seed: of the order.
        made: number of a batch -> what it holds.
    """

    batches: int
    each: int
    seed: int
    made: dict[int, Encoded] = field(default_factory=dict)

    def at(self, step: int, make: Callable[[int], Encoded]) -> Encoded:
        """What is learnt from in a step.

        Args:
            step: from 0 on.
            make: the batch of a number.
        """
        if step < self.batches:
            return self._batch(step, make)
        turn, place = divmod(step, self.batches)
        order = np.random.default_rng((self.seed, turn)).permutation(self.batches * self.each)
        chosen = order[place * self.each : (place + 1) * self.each].tolist()
        views = [[part[v % self.each] for part in self._batch(v // self.each, make)] for v in chosen]
        return tuple(torch.stack(parts) for parts in zip(*views, strict=True))

    def _batch(self, number: int, make: Callable[[int], Encoded]) -> Encoded:
        if number not in self.made:
            self.made[number] = make(number)
        return self.made[number]


def check_encoder(recipe: Recipe, encoder: nn.Module) -> None:
    """Hold that an encoder says the same of a view each time.

    Raises:
        ConfigError: if it learns, or its batch norms go by each batch.
    """
    if any(p.requires_grad for p in encoder.parameters()) or not recipe.schedule.frozen_norms:
        raise ConfigError(
            f"recipe {recipe.name}: schedule.kept_batches needs schedule.frozen_norms and an encoder that "
            "does not learn (network.frozen_blocks)"
        )
