"""Learning the bits of the hash grid (SPEC §10.6; paper §3.4, §3.5, §3.7).

:func:`wave_grid` needs no learning. :class:`BinaryGrid` and :func:`hybrid_levels` are the paper's learned grid, which
`--preset paper` trains.

Parameters are real numbers of which only the sign is sent; gradients pass the sign where a parameter is in
-1..1 (clipped straight-through). The forward pass gives exactly the integers a decoder computes, so a
network trained on them never meets a feature that a decoder would not see.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from reference_encoder.tuning import (
    ANCHORS_PER_CELL,
    AXIS_RESOLUTIONS,
    GRID_FEATURES,
    GRID_INNER_SHARE,
    WAVE_RESOLUTIONS,
)
from scarfmt.neural.grid import (
    FEATURE_MAX,
    MAX_RESOLUTION,
    GridBox,
    GridLevel,
    HashGrid,
    vertex_addresses,
    vertex_weights,
)

# Small enough that a few steps can turn any bit.
_START = 0.1
_FRACTION_BITS = 8
_LARGEST_TABLE_LOG2 = 18


Lookup = list[tuple[torch.Tensor, torch.Tensor]]
"""The vertices that a grid reads for n anchors, computed once and sampled in every step. By level: (n, 2^dims) int32
table entries and float32 weights, integers that sum to 256^dims."""


class BinaryGrid(nn.Module):
    """A grid whose bits are learned.

    Args:
        levels: at least one.
        seed: of the first parameters.
    """

    def __init__(self, box: GridBox, levels: tuple[GridLevel, ...], seed: int = 0) -> None:
        super().__init__()
        self.box, self.levels = box, levels
        generator = torch.Generator().manual_seed(seed)
        self.tables = nn.ParameterList(
            _START * (2 * torch.rand(level.entries, level.features, generator=generator) - 1) for level in levels
        )

    def lookup(self, positions: NDArray[np.integer[Any]]) -> Lookup:
        """The vertices that the grid reads for anchors at (n, 3) lattice `positions`."""
        inside = self.box.inside(positions)
        vertices = []
        for level in self.levels:
            cells, fractions = self.box.locate(level, inside)
            addresses = np.ascontiguousarray(vertex_addresses(level, cells).T, np.int32)
            weights = np.ascontiguousarray(vertex_weights(fractions).T, np.float32)
            vertices.append((torch.from_numpy(addresses), torch.from_numpy(weights)))
        return vertices

    def forward(self, lookup: Lookup) -> torch.Tensor:
        """(n, width) float32 features: the integers of ``export().features``.

        Every partial sum of signs times weights is an integer of at most 2^24: exact in binary32, in any order.
        """
        parts = []
        for level, table, (addresses, weights) in zip(self.levels, self.tables, lookup, strict=True):
            sums = nn.functional.embedding_bag(addresses, _signs(table), mode="sum", per_sample_weights=weights)
            exact = sums / 2.0 ** (_FRACTION_BITS * len(level.axes) - 7)
            rounded = torch.floor(exact + 0.5).clamp(-FEATURE_MAX, FEATURE_MAX)
            parts.append(_value_of(rounded, exact))
        return torch.cat(parts, dim=1)

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


def fit_box(positions: NDArray[np.integer[Any]]) -> tuple[GridBox, tuple[float, float, float]]:
    """The smallest box round the inner 98 % of (n, 3) lattice positions, n > 0, along every axis.

    Returns:
        The box, with these anchors in its middle, and the share of each of its sides that they span, at most 1.
    """
    tail = (1 - GRID_INNER_SHARE) / 2
    ends = np.quantile(positions.astype(np.float64), [tail, 1 - tail], axis=0)
    low, high = np.floor(ends[0]).astype(np.int64), np.ceil(ends[1]).astype(np.int64)
    span = high - low + 1
    extent_bits = (int(span.max()) - 1).bit_length()
    origin = np.maximum(low - ((1 << extent_bits) - span) // 2, 0).tolist()
    extent = (span / (1 << extent_bits)).tolist()
    return GridBox((origin[0], origin[1], origin[2]), extent_bits), (extent[0], extent[1], extent[2])


def hybrid_levels(anchor_count: int, extent: tuple[float, float, float]) -> tuple[GridLevel, ...]:
    """The paper's grid: two 3D levels, two a plane, and levels of single axes.

    Args:
        extent: from :func:`fit_box`.
    """
    axes = [_level(plane, resolution, resolution + 1) for resolution in AXIS_RESOLUTIONS for plane in (4, 5, 6)]
    cells = max(anchor_count // ANCHORS_PER_CELL, 1)
    area = 2 * (extent[0] * extent[1] + extent[0] * extent[2] + extent[1] * extent[2])
    # Anchors lie on surfaces: about as many cells hold some as the faces of the box have.
    finest = min(max(round(math.sqrt(cells / area)), 2), MAX_RESOLUTION // 2)
    solid = [_level(0, resolution, 2 * cells) for resolution in (finest // 2, finest)]
    planes = [_level(plane, resolution, 2 * cells) for resolution in (finest, 2 * finest) for plane in (1, 2, 3)]
    return (*axes[: len(axes) // 2], *solid, *planes)


def _level(plane: int, resolution: int, vertices: int) -> GridLevel:
    """A level whose table has room for about so many vertices."""
    table_log2 = min(max(vertices.bit_length(), 1), _LARGEST_TABLE_LOG2)
    return GridLevel(plane, resolution, table_log2, GRID_FEATURES)


def wave_grid(box: GridBox) -> HashGrid:
    """A grid that needs no learning: two waves a quarter period apart along each axis, at each resolution.

    They tell the network where in the box an anchor is, at as many scales; a period is four cells.
    """
    levels = [
        GridLevel(plane, resolution, resolution.bit_length() + 1, 2)
        for resolution in WAVE_RESOLUTIONS
        for plane in (4, 5, 6)
    ]
    vertices = [np.arange(level.entries) for level in levels]
    # 0, 0, 1, 1 over and over, and the same one vertex later.
    bits = tuple(np.stack([at // 2 % 2, (at + 1) // 2 % 2], axis=1).astype(np.uint8) for at in vertices)
    return HashGrid(box.origin, box.extent_bits, tuple(levels), bits)
