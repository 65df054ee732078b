"""Learning the bits of the hash grid (SPEC §10.4; paper §3.4, §3.5, §3.8).

Parameters are real numbers of which only the sign is sent; gradients pass the sign where a parameter is in
-1..1 (clipped straight-through). The forward pass gives exactly the integers a decoder computes, so a
network trained on them never meets a feature that a decoder would not see.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from scarfmt.neural.grid import FEATURE_MAX, GridBox, GridLevel, HashGrid, vertex_addresses, vertex_weights

# Small enough that a few steps can turn any bit.
_START = 0.1
_FRACTION_BITS = 8


@dataclass(frozen=True)
class Lookup:
    """What a grid reads for n anchors; made once, then sampled every step.

    Attributes:
        addresses: (n, 2^dims) int32 table entries a level.
        weights: (n, 2^dims) float32 a level, integers that sum to 256^dims.
    """

    addresses: tuple[torch.Tensor, ...]
    weights: tuple[torch.Tensor, ...]

    def __len__(self) -> int:
        return len(self.addresses[0])

    def take(self, chosen: torch.Tensor) -> Lookup:
        """The anchors numbered `chosen`, (m,) int64."""
        return Lookup(tuple(a[chosen] for a in self.addresses), tuple(w[chosen] for w in self.weights))


class BinaryGrid(nn.Module):
    """A grid whose bits are learned.

    Args:
        box: what its cells divide.
        levels: at least one.
        unit: value of the integer 1 in the units of the network that reads the features.
        seed: of the first parameters.
    """

    def __init__(self, box: GridBox, levels: tuple[GridLevel, ...], unit: float = 1.0, seed: int = 0) -> None:
        super().__init__()
        self.box, self.levels, self.unit = box, levels, unit
        generator = torch.Generator().manual_seed(seed)
        self.tables = nn.ParameterList(
            _START * (2 * torch.rand(level.entries, level.features, generator=generator) - 1) for level in levels
        )

    def lookup(self, positions: NDArray[np.integer[Any]]) -> Lookup:
        """What the grid reads for anchors at (n, 3) lattice `positions`."""
        inside = self.box.inside(positions)
        addresses, weights = [], []
        for level in self.levels:
            cells, fractions = self.box.locate(level, inside)
            addresses.append(torch.from_numpy(np.ascontiguousarray(vertex_addresses(level, cells).T, np.int32)))
            weights.append(torch.from_numpy(np.ascontiguousarray(vertex_weights(fractions).T, np.float32)))
        return Lookup(tuple(addresses), tuple(weights))

    def forward(self, lookup: Lookup) -> torch.Tensor:
        """(n, width) float32 features: `unit` times the integers of ``export().features``.

        Every partial sum of signs times weights is an integer of at most 2^24: exact in binary32, in any order.
        """
        parts = []
        for level, table, addresses, weights in zip(
            self.levels, self.tables, lookup.addresses, lookup.weights, strict=True
        ):
            sums = nn.functional.embedding_bag(addresses, _signs(table), mode="sum", per_sample_weights=weights)
            exact = sums / 2.0 ** (_FRACTION_BITS * len(level.axes) - 7)
            rounded = torch.floor(exact + 0.5).clamp(-FEATURE_MAX, FEATURE_MAX)
            parts.append(_value_of(rounded, exact))
        return torch.cat(parts, dim=1) * self.unit

    def coded_bits(self) -> torch.Tensor:
        """Bits the tables take when coded, the paper's L_hash (§3.5): scalar, differentiable.

        Each level codes its bits with one probability in 256ths; that is held constant, as it is at its optimum.
        """
        total = torch.zeros(())
        for table in self.tables:
            ones = (_signs(table) + 1).sum() / 2
            share = float(ones.detach()) / table.numel()
            chance = min(max(round(256 * share), 1), 255) / 256
            total = total - ones * math.log2(chance) - (table.numel() - ones) * math.log2(1 - chance)
        return total

    def export(self) -> HashGrid:
        """The grid a file stores."""
        bits = tuple((table.detach() >= 0).numpy().astype(np.uint8) for table in self.tables)
        return HashGrid(self.box.origin, self.box.extent_bits, self.levels, bits)


def _signs(table: torch.Tensor) -> torch.Tensor:
    """-1 or +1, with the gradient of clamp(table, -1, 1)."""
    return _value_of(torch.where(table >= 0, 1.0, -1.0), table.clamp(-1, 1))


def _value_of(value: torch.Tensor, gradient: torch.Tensor) -> torch.Tensor:
    """Exactly `value`, with the gradient of `gradient`: their difference would not cancel exactly in binary32."""
    return value.detach() + (gradient - gradient.detach())
