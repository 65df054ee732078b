"""What of a scene each layer shows: gates of slots that only ever open, and steps that only get finer (paper §3.2).

Training draws one layer an iteration, with that layer's gates and steps, so that every prefix of the file is a picture
of its own and not the rest of another one.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

_CLOSEST = 1e-3
"""Least distance between the gate logits of two layers: softplus has no zero."""


@dataclass(frozen=True)
class LayerPlan:
    """What layers are, before anything is learnt.

    Attributes:
        steps: ternary steps of latents and scalings after each layer (SPEC §6.5), first 1, not falling.
        shares: bytes of each prefix that are aimed at, as parts of the file's.
        draws: how often each layer is drawn, relative.
    """

    steps: tuple[int, ...]
    shares: tuple[float, ...]
    draws: tuple[float, ...]

    @classmethod
    def of(cls, count: int) -> LayerPlan:
        """`count` layers: the later half one step finer, each prefix larger by about the same factor, the last layer
        drawn twice as often (without, it pays for the others)."""
        late = count - count // 2
        steps = tuple(1 if layer < late else 2 for layer in range(count))
        first = 0.15 if count > 1 else 1.0
        shares = tuple(first ** (1 - layer / max(count - 1, 1)) for layer in range(count))
        return cls(steps, shares, (1.0,) * (count - 1) + (2.0,))

    @property
    def count(self) -> int:
        """How many layers."""
        return len(self.steps)

    def coarseness(self, layer: int) -> float:
        """Width of a cell in layer `layer` (0-based), in widths of the last."""
        return 3.0 ** (self.steps[-1] - self.steps[layer])


def gate_logits(last: Tensor, falls: Tensor, layer: int) -> Tensor:
    """(n, K) logits of the gates in a layer: those of the last less what each layer before it takes away.

    Args:
        last: (n, K) of the last layer.
        falls: (n, K, layers - 1); softplus of [.., i] is how much lower layer i is than layer i + 1.
        layer: 0-based.
    """
    if layer == falls.shape[2]:
        return last
    return last - functional.softplus(falls[:, :, layer:]).sum(dim=2)


def hard_gate(logits: Tensor) -> Tensor:
    """1 where a logit is above 0, else 0; backward that of a sigmoid (straight through)."""
    soft = torch.sigmoid(logits)
    return (logits > 0).to(soft.dtype) + soft - soft.detach()


def falls_to(last: Tensor, wanted: list[Tensor]) -> Tensor:
    """(n, K, layers - 1) falls with which the layers before the last have the `wanted` (n, K) logits, or lower ones."""
    above, falls = last, []
    for logits in reversed(wanted):
        fall = torch.clamp(above - logits, min=_CLOSEST)
        falls.append(torch.log(torch.expm1(fall)))
        above = above - fall
    return torch.stack(falls[::-1], dim=2) if falls else last.new_zeros((*last.shape, 0))


def coarse(values: Tensor, steps: int) -> Tensor:
    """Integers `steps` ternary steps before those of `values`: cells nest (SPEC §7.5)."""
    for _ in range(steps):
        values = torch.round(values / 3)
    return values
