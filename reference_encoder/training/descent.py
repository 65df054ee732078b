"""Adam over anchors that come and go: rows of parameters keep their moments, new ones start at 0."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

_EPSILON = 1e-15


@dataclass(frozen=True)
class Rates:
    """A learning rate that falls log-linearly.

    Attributes:
        start, end: at the first iteration and at the last.
    """

    start: float
    end: float

    def at(self, progress: float) -> float:
        """At `progress`, 0..1, of the run."""
        t = min(max(progress, 0.0), 1.0)
        return math.exp((1 - t) * math.log(self.start) + t * math.log(self.end))


class Descent:
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
            self._add(name, values)

    def _add(self, name: str, values: Tensor) -> None:
        leaf = values if values.is_leaf and values.requires_grad else values.detach().clone().requires_grad_()
        self.parameters[name] = leaf
        self._optimiser.add_param_group({"params": [leaf], "lr": 0.0, "name": name})

    def step(self, progress: float, scale: Callable[[str], float] = lambda name: 1.0) -> None:
        """One step down; gradients are gone afterwards."""
        for group in self._optimiser.param_groups:
            group["lr"] = self.rates[group["name"]].at(progress) * scale(group["name"])
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

    def state(self) -> dict[str, dict[str, Tensor]]:
        """Moments by name, for checkpoints."""
        out = {}
        for group in self._optimiser.param_groups:
            state = self._optimiser.state.get(group["params"][0])
            if state:
                out[group["name"]] = {key: torch.as_tensor(value).clone() for key, value in state.items()}
        return out

    def load(self, state: dict[str, dict[str, Tensor]]) -> None:
        """Take up moments from a checkpoint."""
        for group in self._optimiser.param_groups:
            if group["name"] in state:
                leaf = group["params"][0]
                kept = {key: value.clone().to(leaf.device) for key, value in state[group["name"]].items()}
                self._optimiser.state[leaf] = kept
