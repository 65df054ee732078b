"""The layers of a trained file, and how fine each is (paper §3.7); `slot_importance` decides which slots each shows.

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
        steps: ternary steps of latents and scalings after each layer (SPEC §6.5), first 1, not falling; anchors that
            only the last of several layers shows have one less: they are worth least.
        shares: bytes of each prefix that are aimed at, as parts of the file's.
        draws: how often each layer is drawn, relative.
    """

    steps: tuple[int, ...]
    shares: tuple[float, ...]
    draws: tuple[float, ...]

    @classmethod
    def of(cls, count: int, last: float) -> LayerPlan:
        """`count` layers: the later half one step finer, each prefix larger by about the same factor.

        Args:
            last: how many times as often as each other the last one is drawn; at 1 it pays for the others.
        """
        late = count - count // 2
        steps = tuple(1 if layer < late else 2 for layer in range(count))
        first = 0.15 if count > 1 else 1.0
        shares = tuple(first ** (1 - layer / max(count - 1, 1)) for layer in range(count))
        return cls(steps, shares, (1.0,) * (count - 1) + (last,))

    @property
    def count(self) -> int:
        """How many layers."""
        return len(self.steps)

    def steps_of(self, layer: int, first: int) -> int:
        """Steps after layer `layer` of anchors that layer `first` shows first, both 0-based."""
        most = self.steps[-1] if first < self.count - 1 else max(1, self.steps[-1] - 1)
        return min(self.steps[layer], most)

    def missing(self, layer: int, first: Tensor) -> Tensor:
        """(n,) int64 steps after layer `layer` before the finest; `first` as of :meth:`steps_of`, (n,) int64."""
        by_class = [self.steps[-1] - self.steps_of(layer, each) for each in range(self.count)]
        return torch.tensor(by_class, device=first.device)[first]


def coarse(values: Tensor, steps: Tensor) -> Tensor:
    """(n, c) integers (n,) `steps` ternary steps before those of (n, c) `values`: cells nest (SPEC §7.5)."""
    for step in range(int(steps.max()) if len(steps) else 0):
        values = torch.where((steps > step)[:, None], torch.round(values / 3), values)
    return values
