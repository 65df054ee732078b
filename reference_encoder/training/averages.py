"""Means of what is learnt over the last iterations of a phase, in its place (Polyak and Juditsky 1992).

Each iteration sees one photo and one layer, so that values wander about where they belong for as long as learning
rates are worth having. Their mean does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor


class Averages:
    """Running means of parameters by name.

    Attributes:
        count: how often they were looked at since means last took their place.
    """

    def __init__(self) -> None:
        self.count = 0
        self._means: dict[str, Tensor] = {}

    @torch.no_grad()
    def take(self, parameters: Mapping[str, Tensor]) -> None:
        """Take in parameters as they are now: the same names and shapes each time."""
        self.count += 1
        if self.count == 1:
            self._means = {name: values.detach().clone() for name, values in parameters.items()}
        else:
            for name, values in parameters.items():
                self._means[name].lerp_(values, 1 / self.count)

    @torch.no_grad()
    def settle(self, parameters: Mapping[str, Tensor]) -> None:
        """Put the means in the place of parameters, and start anew; nothing if none were taken."""
        for name, mean in self._means.items():
            parameters[name].copy_(mean)
        self.count, self._means = 0, {}

    def state(self) -> dict[str, Any]:
        """For checkpoints."""
        return {"count": self.count, "means": {name: mean.clone() for name, mean in self._means.items()}}

    def restore(self, kept: Mapping[str, Any], device: torch.device) -> None:
        """Take up a checkpoint, which is on the processor."""
        self.count = kept["count"]
        self._means = {name: mean.to(device) for name, mean in kept["means"].items()}
