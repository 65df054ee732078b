"""The layers of a trained file, and how fine each is (paper §3.7). `masks` decides which slots each layer shows.

Training draws one layer an iteration, with that layer's slots and steps, so that every prefix of the file is a picture
of its own and not the rest of another one.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class LayerPlan:
    """The plan of the layers, before anything is learnt.

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


def coarse(values: Tensor, steps: int) -> Tensor:
    """Integers `steps` ternary steps before those of `values`: cells nest (SPEC §7.5)."""
    for _ in range(steps):
        values = torch.round(values / 3)
    return values
