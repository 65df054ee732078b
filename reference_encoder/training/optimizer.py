"""Adam over anchors that come and go, and means of parameters (Polyak and Juditsky 1992).

Rows of parameters keep their moments, new ones start at 0. Each iteration sees one photo and one layer, so that values
wander about where they belong for as long as learning rates are worth having; their mean does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor

_EPSILON = 1e-15


Rates = tuple[float, float]
"""A learning rate at the first iteration and at the last; it falls log-linearly."""


def rate_at(rates: Rates, progress: float) -> float:
    """A learning rate at `progress`, 0..1, of the run."""
    t = min(max(progress, 0.0), 1.0)
    return math.exp((1 - t) * math.log(rates[0]) + t * math.log(rates[1]))


Moments = list[dict[str, Tensor]]
"""What an optimiser remembers of each of its parameters, in their order; nothing before its first step."""


def moments(optimiser: torch.optim.Optimizer) -> Moments:
    """Moments for a checkpoint."""
    known, count = optimiser.state_dict()["state"], sum(len(group["params"]) for group in optimiser.param_groups)
    return [{key: value.clone() for key, value in known.get(number, {}).items()} for number in range(count)]


def restore_moments(optimiser: torch.optim.Optimizer, saved: Moments) -> None:
    """Take up the moments of an optimiser of the same parameters, which are on the processor."""
    state = {number: part for number, part in enumerate(saved) if part}
    optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})


class AnchorOptimizer:
    """Adam with a learning rate of its own for every named parameter.

    Attributes:
        parameters: by name; leaves that require gradients.
    """

    def __init__(self, parameters: dict[str, Tensor], rates: dict[str, Rates]) -> None:
        self.rates = rates
        self.parameters: dict[str, Tensor] = {}
        self._optimiser = torch.optim.Adam([torch.zeros(1, requires_grad=True)], lr=0.0, eps=_EPSILON, fused=True)
        self._optimiser.param_groups.clear()
        for name, values in parameters.items():
            leaf = values if values.is_leaf and values.requires_grad else values.detach().clone().requires_grad_()
            self.parameters[name] = leaf
            self._optimiser.add_param_group({"params": [leaf], "lr": 0.0, "name": name})

    def step(self, progress: float, scale: Callable[[str], float] = lambda name: 1.0) -> None:
        """One step down; gradients are gone afterwards."""
        for group in self._optimiser.param_groups:
            group["lr"] = rate_at(self.rates[group["name"]], progress) * scale(group["name"])
        self._optimiser.step()
        self._optimiser.zero_grad(set_to_none=True)

    def rearrange(self, name: str, rows: Tensor, fresh: Tensor) -> Tensor:
        """A parameter of its `rows`, and then of `fresh` ones; the new leaf."""
        group = next(group for group in self._optimiser.param_groups if group["name"] == name)
        old = group["params"][0]
        leaf = torch.cat([old.detach()[rows], fresh]).requires_grad_()
        state = self._optimiser.state.pop(old, {})
        for key in ("exp_avg", "exp_avg_sq"):
            if key in state:
                state[key] = torch.cat([state[key][rows], torch.zeros_like(fresh)])
        if state:
            self._optimiser.state[leaf] = state
        group["params"] = [leaf]
        self.parameters[name] = leaf
        return leaf

    def state(self) -> Moments:
        """For checkpoints."""
        return moments(self._optimiser)

    def load(self, saved: Moments) -> None:
        """Take up moments from a checkpoint."""
        restore_moments(self._optimiser, saved)


class WeightAverage:
    """Running means of parameters by name.

    Attributes:
        count: how often they were looked at since means last took their place.
    """

    def __init__(self) -> None:
        self.count = 0
        self._means: dict[str, Tensor] = {}

    @torch.no_grad()
    def update(self, parameters: Mapping[str, Tensor]) -> None:
        """Take in parameters as they are now: the same names and shapes each time."""
        self.count += 1
        if self.count == 1:
            self._means = {name: values.detach().clone() for name, values in parameters.items()}
        else:
            for name, values in parameters.items():
                self._means[name].lerp_(values, 1 / self.count)

    @torch.no_grad()
    def apply(self, parameters: Mapping[str, Tensor]) -> None:
        """Put the means in the place of parameters, and start anew; nothing if none were taken."""
        for name, mean in self._means.items():
            parameters[name].copy_(mean)
        self.count, self._means = 0, {}

    def state(self) -> dict[str, Any]:
        """For checkpoints."""
        return {"count": self.count, "means": {name: mean.clone() for name, mean in self._means.items()}}

    def restore(self, saved: Mapping[str, Any], device: torch.device) -> None:
        """Take up a checkpoint, which is on the processor."""
        self.count = saved["count"]
        self._means = {name: mean.to(device) for name, mean in saved["means"].items()}
